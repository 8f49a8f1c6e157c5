"""
Stroke a scene in a browser
===========================

Write a planned scene as one HTML file that works offline. The speed and pressure of the pointer control the
models sample by sample.
"""

from html import escape

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.haptics.textures.grid import GridModel

# %%
# Define twelve simulated surfaces. The resonance frequency of each surface rises with the speed, and some
# surfaces have ridges. Each surface is a grid of models over speeds (mm/s) and forces (N), as fitted to
# recordings by `texclass scene plan`.

SPEEDS, FORCES, FS = np.array([30.0, 90.0, 270.0]), np.array([0.3, 3.0]), 1000.0


def surface(hz, width, level, ridges_mm=None):
    """Return a surface with a resonance, and with ridges if a spatial period is passed."""
    centre = hz * (SPEEDS / 90) ** 0.2
    r = np.exp(-np.pi * width / FS)
    k = np.column_stack([-2 * r * np.cos(2 * np.pi * centre / FS) / (1 + r**2), np.full(3, r**2)])
    rows = np.repeat(k[:, np.newaxis], 2, axis=1)
    power = (level * np.outer((SPEEDS / 90) ** 0.8, FORCES**0.5)) ** 2
    lines = np.array([] if ridges_mm is None else [1 / ridges_mm])
    rows = np.concatenate([rows, np.full((3, 2, lines.size), 1.1)], axis=-1)
    return GridModel((SPEEDS, FORCES), rows, power, 4 * np.sqrt(power.max()), 0 * lines, lines)


models = {
    "foam": surface(40, 90, 0.2), "felt": surface(70, 110, 0.3), "cork": surface(95, 60, 0.8),
    "paper": surface(240, 160, 0.5), "leather": surface(120, 70, 0.7), "wood": surface(150, 40, 1.4),
    "stone": surface(210, 90, 2.5), "plaster": surface(300, 120, 1.2), "sandpaper": surface(330, 150, 3.0),
    "corduroy": surface(80, 60, 1.2, 2.0), "mesh": surface(180, 60, 2.0, 1.0),
    "file": surface(260, 70, 2.5, 0.5),
}  # fmt: skip
indices, band = {name: i for i, name in enumerate(models)}, (20.0, 450.0)
scene = tx.haptics.scene.PlannedScene("a dozen", FS, "m/s^2", band, 30.0, 4, indices, tuple(models.values()))

# %%
# `tx.haptics.scene.write_scene_page("scene.html", scene)` writes this page. Press a surface and stroke it.


class Framed(str):
    def _repr_html_(self):
        return f'<iframe srcdoc="{escape(self)}" title="Surfaces" width="100%" height="960"></iframe>'


Framed(tx.haptics.scene.scene_page(scene))

# %%
# Plot the level against the speed for three of the surfaces:

renderer = tx.haptics.SceneRenderer(scene, n_contacts=1)
figure, axis = plt.subplots(figsize=(9, 3))
speeds = np.geomspace(20, 300, 20)
for name in ("felt", "wood", "corduroy"):
    renderer.touch(0, name)
    levels = [np.std(renderer.process([[(v, 0)] * 1000], [[1] * 1000])[0, 200:]) for v in speeds]
    axis.loglog(speeds, levels, label=name)
axis.set(xlabel="speed in mm/s", ylabel="RMS in m/s²")
axis.legend()
plt.show()
