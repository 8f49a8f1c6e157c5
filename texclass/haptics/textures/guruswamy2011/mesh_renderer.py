"""Render a texture on a triangle mesh: constraint, friction and texture force of a tip that strokes it.

The constraint and the friction are the force of one spring between the tip p and a contact point q (proxy,
god-object) on the surface::

    F = k (q - p) = constraint along the normal n + friction in the tangential plane

The contact point stays where it is while the friction is at most mu times the constraint (sticking).
Otherwise, it slides towards the tip until both are equal (Coulomb friction).

The paper specifies the terms of the force, but neither their continuity nor their energy. Here, both follow
from the contact point:

- The force is continuous, because the surface has a continuous normal (`MeshSurface`), and the contact point
  moves continuously on it, also where the closest triangle changes.
- The energy of the spring, E = k/2 |q - p|^2, is the only energy that the contact can return. The contact
  point moves only if this decreases E, so constraint and friction together are passive on every surface and
  path. A penalty force along interpolated normals is not: it is not the gradient of an energy.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.textures.guruswamy2011.mesh_surface import (
    PROFILE_STEP_MM,
    MeshSurface,
    SurfaceProfile,
)
from texclass.haptics.textures.guruswamy2011.texture import SpatialTexture
from texclass.recording import Samples
from texclass.signals import all_finite, positive

SLIDING_TOLERANCE_MM = 1e-6
"""Distance of the contact point from its equilibrium in mm at which sliding ends."""
SLIDING_STEPS = 10
"""Largest number of steps of the contact point per sample, which limits the computing time. On smooth
surfaces, two to four are necessary; a longer way is continued at the next sample."""
HALVINGS = 4
"""Largest number of times that a step of the contact point is halved."""
LARGEST_STEP_MM = 50.0
"""Largest movement of the tip in one sample in mm (50 m/s at 1 kHz). Beyond this, the position is considered
lost, and the contact ends."""
JUMP_RATIO = 4.0
"""Largest ratio of the change of the position along the profile to the movement of the contact point, in
addition to one segment of the profile (our choice). Beyond it, the nearest point of the profile has jumped,
and no feature was passed."""


@dataclass(frozen=True, eq=False)
class MeshForces:
    """Forces on the tip, sample by sample.

    Attributes
    ----------
    constraint, friction : ndarray of shape (n, 3)
        Force along the normal and in the tangential plane in N; 0 outside the surface.
    texture : ndarray of shape (n,)
        Texture force along the normal in N: the sum of the active filters, scaled.
    normal : ndarray of shape (n, 3)
        Outward unit normal at the contact point; outside, that of the last contact (0 before the first).
    contact_point : ndarray of shape (n, 3)
        Contact point on the surface in mm; outside, the position of the tip.
    along_mm, across_mm : ndarray of shape (n,)
        Position of the contact point along the profile and distance from it in mm; outside, those of the last
        contact.
    """

    constraint: Samples
    friction: Samples
    texture: Samples
    normal: Samples
    contact_point: Samples
    along_mm: Samples
    across_mm: Samples

    @property
    def total(self) -> Samples:
        """Sum of constraint, friction and texture force in N, shape (n, 3)."""
        return self.constraint + self.friction + self.texture[:, np.newaxis] * self.normal


class MeshRenderer:
    """Render a `SpatialTexture` on a surface, sample by sample.

    A filter of the texture becomes active when the contact point passes its position along the profile
    (eq. 5). Its amplitude depends on the tangential speed and on the constraint force.

    Parameters
    ----------
    surface : MeshSurface
        Surface of the object.
    profile : SurfaceProfile
        Profile of the scan on this surface.
    texture : SpatialTexture
        Texture that was fitted to the scan.
    fs : float
        Rate of positions and forces in Hz (default 1000).
    stiffness : float
        Stiffness k of the constraint in N/mm (default 0.5).
    friction : float
        Friction coefficient mu (default 0.3).
    mass_kg : float
        Scale of the texture force in N per m/s^2, which is the moved mass of the tool (default 0.05 kg).
    reach_mm : float
        Distance from the profile in mm up to which features are excited (default: the whole surface).

    Raises
    ------
    ValueError
        If a parameter is negative or not finite, or `fs` is too low for the texture.

    Notes
    -----
    - **Stability.** Between two samples the force is held, which adds an energy of up to k/2 |dp|^2 per
      sample that moves the tip by dp. The device dissipates it if its damping is at least `required_damping`,
      k/(2 fs). Virtual damping B raises this bound to k/(2 fs) + B, so none is added.
    - The texture force is a vibration that is added to the contact, as in the paper, and is not passive.
      After the contact ends, the active filters decay.
    - Beyond the ends of an open profile, the texture is repeated periodically, like that of `SpatialTexture`.
    - The force is continuous while the tip is not deeper than the radius of curvature of the surface. A sharp
      edge is rounded to about a quarter of the smoothing radius; a deeper tip slips over it with a jump.
    - At the border of an open mesh, the contact ends.
    - Default stiffness, friction and mass are our choice; the paper specifies none.

    References
    ----------
    `guruswamy2011`, section III-A and eq. (5). Bound on the damping: Colgate and Schenkel, Passivity of a
    class of sampled-data systems, 1997.

    Examples
    --------
    A tip is pressed 1 mm into a plate, and moves along it:

    >>> import trimesh
    >>> from texclass.haptics.textures.guruswamy2011 import Amplitude, LevelLaw
    >>> surface = MeshSurface.from_mesh(trimesh.creation.box([60, 20, 10]))
    >>> profile = SurfaceProfile([[-30.0, 0, 5], [30, 0, 5]], [0.0, 60.0])
    >>> scaling = Amplitude(LevelLaw(k_v=20.0, k_c=0.5, a_0=0.25), speed=20.0, force=0.5)
    >>> modes = {"frequency_hz": [60.0], "decay_per_s": [30.0], "amplitude": [2.0], "phase": [-1.57]}
    >>> ridge = SpatialTexture("ridge", 500.0, 5.0, [1.0], [0], **modes, scaling=scaling, peak=2.0,
    ...                        direction=[1.0, 0.0])
    >>> renderer = MeshRenderer(surface, profile, ridge)
    >>> forces = renderer.process([[0.05 * i - 10, 0.0, max(5.1 - 0.05 * i, 4.0)] for i in range(100)])
    >>> round(float(forces.constraint[-1, 2]), 3), round(float(forces.friction[-1, 0]), 3)
    (0.5, -0.15)
    >>> round(float(np.abs(forces.texture).max()), 2)
    0.09
    """

    def __init__(
        self,
        surface: MeshSurface,
        profile: SurfaceProfile,
        texture: SpatialTexture,
        *,
        fs: float = 1000.0,
        stiffness: float = 0.5,
        friction: float = 0.3,
        mass_kg: float = 0.05,
        reach_mm: float = np.inf,
    ) -> None:
        positive(fs, "fs")
        positive(stiffness, "stiffness")
        for name, value in (("friction", friction), ("mass_kg", mass_kg)):
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} must be finite and at least 0, got {value}")
        if not reach_mm > 0:
            raise ValueError(f"reach_mm must be positive, got {reach_mm}")
        is_whole_loop = profile.is_closed and abs(texture.length_mm - profile.along_mm[-1]) < 1e-6
        length = profile.length_mm if is_whole_loop else texture.length_mm
        self.fs, self._texture = fs, replace(texture, fs=fs, length_mm=length)
        self._surface, self._profile = surface, profile
        self._stiffness, self._friction, self._mass_kg = stiffness, friction, mass_kg
        self._reach_mm = reach_mm
        self._renderer = self._texture.renderer()
        self.reset()

    @property
    def required_damping(self) -> float:
        """Damping of the device in N s/m above which the contact is passive: k/(2 fs)."""
        return 1000 * self._stiffness / (2 * self.fs)

    def reset(self) -> None:
        """End the contact, and remove all active filters."""
        self._renderer.reset()
        self._tip: Samples | None = None
        self._contact: tuple[Samples, Samples] | None = None
        self._is_outside = False
        self._last = np.zeros(3), np.zeros(3)
        self._was_in_contact, self._along, self._across = False, 0.0, 0.0

    def process(self, position: ArrayLike) -> MeshForces:
        """Return the forces for the next positions of the tip.

        The contact starts when the tip crosses the surface from outside. The result does not depend on how a
        path is divided into blocks.

        Parameters
        ----------
        position : array_like of shape (n, 3)
            Positions of the tip in mm at the rate `fs`.

        Raises
        ------
        ValueError
            If the shape is wrong, or a value is NaN or infinite. The state is then unchanged.
        """
        p = all_finite(position, "position")
        if p.ndim != 2 or p.shape[1] != 3:
            raise ValueError(f"position must have shape (n, 3), got {p.shape}")
        n = len(p)
        previous = np.vstack([p[:1] if self._tip is None else self._tip, p[:-1]])
        q, normal, is_contact, slid = p.copy(), np.zeros((n, 3)), np.zeros(n, bool), np.zeros(n)
        for i, tip in enumerate(p):
            last = self._last[0]
            self._move(tip)
            if self._contact is not None:
                self._last = self._contact
                q[i], is_contact[i] = self._contact[0], True
                slid[i] = np.linalg.norm(q[i] - last)
            normal[i] = self._last[1]
        spring = self._stiffness * (q - p)
        pressure = np.einsum("ij,ij->i", spring, normal)
        constraint = pressure[:, np.newaxis] * normal
        step = p - previous
        sideways = step - np.einsum("ij,ij->i", step, normal)[:, np.newaxis] * normal
        speed = np.where(is_contact, np.linalg.norm(sideways, axis=1) * self.fs, 0.0)
        along, across, texture = self._render(q, normal, is_contact, slid, speed, pressure)
        return MeshForces(constraint, spring - constraint, texture, normal, q, along, across)

    # Contact ------------------------------------------------------------------------------------------------

    def _move(self, tip: Samples) -> None:
        """Move the tip, and update the contact point; a free tip moves in steps that miss no part."""
        start, self._tip = tip if self._tip is None else self._tip, tip
        length = float(np.linalg.norm(tip - start))
        if length > LARGEST_STEP_MM:
            self._contact, self._is_outside = None, False
            start, length = tip, 0.0
        if self._contact is None:
            n_steps = int(length / (self._surface.radius_mm / 2)) + 1
            shares = (np.arange(n_steps) + 1) / n_steps
            touches = (self._touch(start + share * (tip - start), length / n_steps) for share in shares)
            self._contact = next((touch for touch in touches if touch is not None), None)
        if self._contact is not None:
            self._contact = self._slide(tip, *self._contact)

    def _touch(self, p: Samples, step: float) -> tuple[Samples, Samples] | None:
        """Return the contact point and its normal if the tip has just crossed the surface in a step (mm)."""
        here = self._surface.evaluate(p)
        was_outside, self._is_outside = self._is_outside, here is not None and here[0] >= 0
        if here is None or here[0] >= 0 or not was_outside:
            return None
        contact = self._surface.project(p)
        contact = contact and self._slide(p, *contact, friction=0.0)
        # a crossed surface is closer than the step; otherwise, the mesh has a gap or wrong normals here
        if contact is None or np.linalg.norm(p - contact[0]) > 1.001 * step:
            return None
        return contact

    def _slide(
        self, p: Samples, q: Samples, n: Samples, friction: float | None = None
    ) -> tuple[Samples, Samples] | None:
        """Move the contact point q towards the tip p until friction holds it; return None if p is outside."""
        mu = self._friction if friction is None else friction
        for _ in range(SLIDING_STEPS):
            offset = p - q
            depth = -float(offset @ n)
            sideways = offset + depth * n
            distance = float(np.linalg.norm(sideways))
            excess = distance - mu * max(depth, 0.0)
            if excess <= SLIDING_TOLERANCE_MM:
                break
            step = min(excess, self._surface.radius_mm / 2) / distance * sideways
            moved = self._descend(p, q, n, step)
            if moved is None:
                self._is_outside = False
                return None
            if moved[0] is q:
                break
            q, n = moved
        self._is_outside = float((q - p) @ n) <= 0
        return None if self._is_outside else (q, n)

    def _descend(self, p: Samples, q: Samples, n: Samples, step: Samples) -> tuple[Samples, Samples] | None:
        """Return the contact point after a step that reduces its distance from p, or None at a border."""
        distance = float(np.linalg.norm(p - q))
        for _ in range(HALVINGS):
            moved = self._surface.project(q + step)
            if moved is None or float(np.linalg.norm(p - moved[0])) < distance:
                return moved
            step = step / 2
        return q, n

    # Texture ------------------------------------------------------------------------------------------------

    def _render(
        self, q: Samples, normal: Samples, is_contact: NDArray[np.bool_], slid: Samples, speed: Samples,
        pressure: Samples,
    ) -> tuple[Samples, Samples, Samples]:  # fmt: skip
        """Return positions along and across the profile, and the texture force, each of shape (n,)."""
        n, texture, length = len(q), self._texture, self._profile.length_mm
        along, across, is_passing = np.zeros(n), np.zeros(n), np.zeros(n, bool)
        located = np.zeros((2, n))
        if is_contact.any():
            located[:, is_contact] = self._profile.locate(q[is_contact], normal[is_contact])
        for i in range(n):
            if is_contact[i]:
                s = located[0, i]
                if self._profile.is_closed:  # continue in the lap of the last position
                    s += length * np.round((self._along - s) / length)
                is_continuous = abs(s - self._along) <= JUMP_RATIO * slid[i] + PROFILE_STEP_MM
                is_passing[i] = self._was_in_contact and is_continuous
                self._along, self._across = float(s), float(located[1, i])
            self._was_in_contact = bool(is_contact[i])
            along[i], across[i] = self._along, self._across
        # where no feature can be passed, the texture moves without contact
        force = np.where(is_passing & (np.abs(across) <= self._reach_mm), pressure, 0.0)
        direction = np.array(texture.direction)
        left = np.array([-direction[1], direction[0]])
        position = np.outer(texture.origin_mm + along, direction) + np.outer(across, left)
        velocity = np.outer(speed, direction)
        vibration = self._renderer.process(velocity, force, position)
        return along, across, self._mass_kg * vibration
