"""What a haptic device can display, and a tap library brought into it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.signals import positive
from texclass.textures.okamura2001.library import TapLibrary, tap_peak
from texclass.vibration import TapModel


@dataclass(frozen=True)
class Device:
    """A force-feedback device that taps are displayed on.

    Attributes
    ----------
    band_hz : (float, float)
        Frequencies it shall display: felt well, and not yet swallowed by its inertia.
    force_n : (float, float)
        Least peak force that is felt, and the largest for the vibration.
    limit_n : float
        Largest force of its motors, wall and vibration together.
    mass_kg : float
        What the motors have to shake: force = mass * acceleration.
    cutoff_hz : float
        Where its response has fallen by 3 dB.
    rate_hz : float
        Of its loop.

    Notes
    -----
    `okamura2001`, section III: the response of the 3GM is printed as a curve only (figure 6), its force limit
    not at all. The defaults are ours: a band from 30 Hz to a little above the peak of human sensitivity at
    250 Hz, as its Table II, and forces of a desktop device.
    """

    band_hz: tuple[float, float] = (30.0, 300.0)
    force_n: tuple[float, float] = (0.5, 4.0)
    limit_n: float = 8.0
    mass_kg: float = 0.05
    cutoff_hz: float = 100.0
    rate_hz: float = 10_000.0

    def __post_init__(self) -> None:
        for name in ("limit_n", "mass_kg", "cutoff_hz", "rate_hz"):
            positive(getattr(self, name), name)
        for name in ("band_hz", "force_n"):
            low, high = getattr(self, name)
            if not 0 < low < high < np.inf:
                raise ValueError(f"{name} is {(low, high)}; the rule is 0 < low < high")
        if self.band_hz[1] >= self.rate_hz / 2 or self.force_n[1] > self.limit_n:
            raise ValueError(
                f"{self}; the rule is a band below half the rate, and a vibration within the limit"
            )

    def response(self, frequency_hz: ArrayLike) -> Samples:
        """Return the magnitude of its response, 1 at low frequencies: that of a second-order low pass.

        |H| = 1 / sqrt(1 + (f / f_c)^4), Butterworth: the force that accelerates the mass at the end of an
        elastic drive. In the place of figure 6.
        """
        f = np.asarray(frequency_hz, dtype=np.float64)
        return np.asarray(1 / np.sqrt(1 + (f / self.cutoff_hz) ** 4))

    def peak_force(self, model: TapModel, velocity: float) -> float:
        """Return the largest force (N) that a tap at this velocity (m/s) asks for, before the response."""
        return float(self.mass_kg * abs(model.amplitude_slope * velocity) * tap_peak(model))


def scale_into(library: TapLibrary, device: Device, largest_velocity: float) -> TapLibrary:
    """Return the library with frequencies, decay rates and slopes that the device can display.

    - Frequencies: the smallest and the largest are put on the band's bounds if they lie outside; those
      between keep their places on a logarithmic scale, so that materials stay apart and in order.
    - Decay rates go with the frequency, B' = B w'/w: as many oscillations are left, the shape stays.
    - Slopes: the peak forces at the largest velocity are brought between the device's least and largest in
      the same way; signs stay.

    Parameters
    ----------
    library : TapLibrary
        As measured, m/s^2.
    device : Device
        What displays it.
    largest_velocity : float
        m/s, above 0.

    Returns
    -------
    TapLibrary
        Itself where it fits already.

    Notes
    -----
    The paper scales by the judgement of expert users, each material by another factor, "while maintaining a
    difference between materials"; this is a rule with the same aims, a start for such judgements.

    References
    ----------
    `okamura2001`, section III-A and Table II.
    """
    v = positive(largest_velocity, "largest_velocity")
    f = _into([m.frequency_hz for m in library.models], device.band_hz)
    shaped = [
        TapModel(m.amplitude_slope, float(m.decay_per_s * to / m.frequency_hz), float(to))
        for m, to in zip(library.models, f, strict=True)
    ]
    forces = [device.peak_force(m, v) for m in shaped]
    if min(forces) == 0:
        raise ValueError(f"peak forces are {forces} N; the rule is amplitude slopes other than 0")
    gains = _into(forces, device.force_n) / forces
    models = [
        TapModel(float(m.amplitude_slope * g), m.decay_per_s, m.frequency_hz)
        for m, g in zip(shaped, gains, strict=True)
    ]
    return TapLibrary(library.materials, tuple(models), library.unit)


def _into(values: ArrayLike, bounds: tuple[float, float]) -> Samples:
    """Return ln y = a + b ln x with the extremes of x clipped to the bounds; x itself if none is outside."""
    x = np.log(np.asarray(values, dtype=np.float64))
    low, high = np.clip([x.min(), x.max()], *np.log(bounds))
    if low == x.min() and high == x.max():
        return np.asarray(np.exp(x))
    if x.max() == x.min():
        return np.full(x.shape, np.exp(low))
    return np.asarray(np.exp(low + (x - x.min()) * (high - low) / (x.max() - x.min())))
