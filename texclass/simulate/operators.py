"""Operators: the habits with which a person holds and moves the tool."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Operator:
    """A person's habits; one recording is made with values drawn around them (`redrawn`).

    Attributes
    ----------
    name
        Of the person.
    speed_mm_s
        Typical mean speed of a stroke.
    force_n
        Typical normal force while stroking.
    stroke_mm
        Typical length of a stroke.
    roundness
        Speed around the end of a stroke over the speed in its middle: 0 stops dead, 1 draws circles.
    speed_spread, force_spread
        Deviation of the logarithm of speed (stroke to stroke) and force (all the time) within a recording.
    grip_stiffness_n_m, grip_damping
        Of the hand that holds the tool: stiffness along the tool's axis, damping ratio.
    tilt_deg, azimuth_deg
        Of the tool against the surface normal, and about it.
    direction_deg
        Of the strokes against the surface's own direction (normal to its gratings).
    tap_speed_mm_s
        Typical speed at which a tap meets the surface.
    tremor_m_s2, tremor_hz
        Root mean square and centre frequency of the hand's physiological tremor.
    """

    name: str
    speed_mm_s: float
    force_n: float
    stroke_mm: float
    roundness: float
    speed_spread: float
    force_spread: float
    grip_stiffness_n_m: float
    grip_damping: float
    tilt_deg: float
    azimuth_deg: float
    direction_deg: float
    tap_speed_mm_s: float
    tremor_m_s2: float
    tremor_hz: float

    def redrawn(self, rng: np.random.Generator) -> "Operator":
        """Return the same person on one occasion: every habit drawn anew around its typical value."""

        def around(value: float, spread: float) -> float:
            return value * float(np.exp(spread * np.clip(rng.standard_normal(), -2.5, 2.5)))

        return replace(
            self,
            speed_mm_s=around(self.speed_mm_s, 0.10),
            force_n=around(self.force_n, 0.12),
            stroke_mm=around(self.stroke_mm, 0.15),
            grip_stiffness_n_m=around(self.grip_stiffness_n_m, 0.12),
            grip_damping=around(self.grip_damping, 0.12),
            tilt_deg=self.tilt_deg + 4.0 * rng.standard_normal(),
            azimuth_deg=self.azimuth_deg + 8.0 * rng.standard_normal(),
            direction_deg=self.direction_deg + 6.0 * rng.standard_normal(),
            tap_speed_mm_s=around(self.tap_speed_mm_s, 0.15),
            tremor_m_s2=around(self.tremor_m_s2, 0.2),
            tremor_hz=float(np.clip(self.tremor_hz + 0.4 * rng.standard_normal(), 7.5, 12.5)),
        )


def operator_catalogue(n: int, seed: int) -> tuple[Operator, ...]:
    """Return n operators; operator i depends on the seed and on i alone.

    Parameters
    ----------
    n : int
        How many.
    seed : int
        Of the catalogue.
    """
    return tuple(_operator(i, np.random.default_rng(np.random.SeedSequence((seed, 1, i)))) for i in range(n))


def _operator(index: int, rng: np.random.Generator) -> Operator:
    def around(value: float, spread: float) -> float:
        return value * float(np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))

    return Operator(
        name=f"operator-{index + 1}",
        speed_mm_s=around(110.0, 0.18),
        force_n=around(1.0, 0.18),
        stroke_mm=around(65.0, 0.25),
        roundness=rng.uniform(0.15, 0.45),
        speed_spread=rng.uniform(0.15, 0.35),
        force_spread=rng.uniform(0.12, 0.30),
        grip_stiffness_n_m=around(700.0, 0.25),
        grip_damping=around(0.9, 0.2),
        tilt_deg=rng.uniform(10.0, 40.0),
        azimuth_deg=rng.uniform(-35.0, 35.0),
        direction_deg=rng.uniform(-12.0, 12.0),
        tap_speed_mm_s=around(20.0, 0.2),
        tremor_m_s2=around(0.05, 0.3),
        tremor_hz=rng.uniform(8.0, 12.0),
    )
