"""
A texture on a triangle mesh
============================

Register a scan with a mesh, and compute the forces on a tip that strokes it: constraint, friction, and the
vibration of the texture [guruswamy2011, section III-A]. Meshes require the extra `haptics` (trimesh).
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from scipy.spatial import Delaunay

import texclass as tx

guruswamy2011 = tx.haptics.textures.guruswamy2011

# %%
# Create a mesh with a bump. For your own object, load a file in mm with `trimesh.load_mesh("part.stl")`. The
# surface is smooth, so that the force does not jump at the edges of the triangles.

x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-50, 50.1, 2), np.arange(-25, 25.1, 2)))


def height(x, y):
    return 5 * np.exp(-(x**2 + y**2) / 2 / 15**2)


faces = Delaunay(np.column_stack([x, y])).simplices
mesh = trimesh.Trimesh(np.column_stack([x, y, height(x, y)]), faces)
surface = guruswamy2011.MeshSurface.from_mesh(mesh, smoothing_mm=3)

# %%
# Register a scan across the bump: a tracked position and an acceleration at 500 Hz. The fitted filters have
# positions along the profile of the scan.

t = np.arange(2000) / 500
along = 20 * t - 40
position = np.column_stack([along, 0 * t, height(along, 0)])
since = t % 0.2  # ridges, 4 mm apart
acceleration = 4 * np.exp(-40 * since) * np.sin(2 * np.pi * 60 * since)
scan, profile = guruswamy2011.register_scan(surface, acceleration, position, np.full(2000, 0.5), fs=500)
texture = guruswamy2011.fit_texture(scan).texture
print(f"{texture.n_features} filters on {profile.length_mm:.0f} mm")

# %%
# Move a tip in a curve over the surface at 1 kHz, 1 mm deep, and lift it:

t = np.arange(3000) / 1000
tip = np.column_stack([35 * np.cos(2.5 * t), 15 * np.sin(5 * t), np.zeros(t.size)])
tip[:, 2] = height(*tip.T[:2]) - np.minimum(1, np.minimum(8 * t - 1, 20 - 8 * t))
renderer = guruswamy2011.MeshRenderer(surface, profile, texture, stiffness=0.5, friction=0.3, mass_kg=0.05)
forces = renderer.process(tip)
print(f"stable with a device damping of at least {renderer.required_damping} N s/m")
figure = plt.figure(figsize=(9, 4), layout="constrained")
axis = figure.add_subplot(1, 2, 1, projection="3d")
axis.plot_trisurf(x, y, mesh.vertices[:, 2], triangles=faces, color="lightgrey", alpha=0.5)
axis.plot(*profile.point.T, label="profile")
axis.plot(*forces.contact_point[forces.constraint.any(axis=1)].T, label="contact point")
axis.set(xlabel="mm", ylabel="mm", zlim=(-10, 20))
axis.legend()
axis = figure.add_subplot(1, 2, 2)
axis.plot(t, np.linalg.norm(forces.constraint, axis=1), label="constraint")
axis.plot(t, np.linalg.norm(forces.friction, axis=1), label="friction")
axis.plot(t, forces.texture, label="texture", linewidth=0.8)
axis.set(xlabel="s", ylabel="N", ylim=(-0.1, 0.65))
axis.legend(ncols=3, loc="upper center")
plt.show()
