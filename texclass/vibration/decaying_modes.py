"""A vibration as a sum of decaying sinusoids: parameters, synthesis, second-order sections."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from texclass.recording import Samples
from texclass.vibration._input import one_channel, positive


@dataclass(frozen=True, eq=False)
class DecayingModes:
    """A vibration as a sum of decaying sinusoids, at no particular sampling rate.

    x(t) = sum_i A_i exp(-B_i t) cos(2 pi f_i t + phi_i) for t >= 0. Every B_i is positive, so every
    realisation is stable.

    Attributes
    ----------
    frequency_hz : ndarray of shape (n_modes,)
        f_i, not negative; 0 for a plain exponential.
    decay_per_s : ndarray of shape (n_modes,)
        B_i > 0, in 1/s.
    amplitude : ndarray of shape (n_modes,)
        A_i >= 0, in the unit of the vibration, strongest mode first when fitted.
    phase : ndarray of shape (n_modes,)
        phi_i, in rad.

    Raises
    ------
    ValueError
        If the shapes differ, a value is not finite, or a frequency, decay or amplitude breaks its rule.
    """

    frequency_hz: Samples
    decay_per_s: Samples
    amplitude: Samples
    phase: Samples

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
            values = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
            if values.shape != (self.n_modes,) or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} is {values}; the rule is one finite value for each of the modes")
        if np.any(self.frequency_hz < 0) or np.any(self.decay_per_s <= 0) or np.any(self.amplitude < 0):
            raise ValueError(
                f"modes have frequencies {self.frequency_hz} Hz, decays {self.decay_per_s} 1/s and "
                f"amplitudes {self.amplitude}; the rule is f >= 0, B > 0, A >= 0"
            )

    @property
    def n_modes(self) -> int:
        """How many modes there are; a mode with 0 < f has two poles."""
        return int(np.size(self.frequency_hz))

    def below(self, limit_hz: float) -> "DecayingModes":
        """Return the modes whose frequency does not exceed `limit_hz`."""
        return self._chosen(self.frequency_hz <= limit_hz)

    def strongest(self, n_modes: int, duration_s: float = np.inf) -> "DecayingModes":
        """Return the modes of most energy A^2 (1 - exp(-2 B T)) / B over the duration T, in that order."""
        largest = np.max(self.amplitude, initial=np.finfo(float).tiny)
        B = self.decay_per_s
        energy = (self.amplitude / largest) ** 2 * -np.expm1(-2 * B * duration_s) / B
        return self._chosen(np.argsort(-energy, kind="stable")[:n_modes])

    def synthesize(self, n_samples: int, fs: float) -> Samples:
        """Return the vibration at t = 0, 1/fs, ..., evaluated in closed form.

        Parameters
        ----------
        n_samples : int
            Any length.
        fs : float
            Sampling rate in Hz, not that of the fit necessarily. Modes above fs/2 are left out.

        Returns
        -------
        ndarray of shape (n_samples,)
            In the unit of the amplitudes.
        """
        t = np.arange(n_samples) / positive(fs, "fs")
        x = np.zeros(n_samples)
        for f, B, A, phi in self._table(fs):
            x += A * np.exp(-B * t) * np.cos(2 * np.pi * f * t + phi)
        return x

    def sections(self, fs: float) -> Samples:
        """Return the filter whose impulse response is the vibration: parallel second-order sections.

        Mode i is one section, and the outputs of all sections are added::

            H_i(z) = A (cos phi - r cos(w - phi) z^-1) / (1 - 2 r cos w z^-1 + r^2 z^-2),
            r = exp(-B / fs),  w = 2 pi f / fs

        A real pole (f = 0, or f = fs/2) leaves z^-2 with coefficient 0. In parallel no section can overload
        another, and each is stable by itself.

        Parameters
        ----------
        fs : float
            Sampling rate in Hz. Modes above fs/2 are left out.

        Returns
        -------
        ndarray of shape (n_modes, 6)
            b0, b1, b2, a0, a1, a2 of each section, as scipy orders them.
        """
        positive(fs, "fs")
        f, B, A, phi = self._table(fs).T
        r = np.minimum(np.exp(-B / fs), 1 - 2**-50)
        w = 2 * np.pi * f / fs
        real = (f == 0) | (f == fs / 2)
        a2 = np.where(real, 0.0, r**2)
        limit = (1 + a2) * (1 - 2**-51)  # rounding must not push a pole of a very slow mode outside
        a1 = np.where(real, -r * np.cos(w), np.clip(-2 * r * np.cos(w), -limit, limit))
        b1 = np.where(real, 0.0, -A * r * np.cos(w - phi))
        zero, one = np.zeros_like(r), np.ones_like(r)
        return np.stack([A * np.cos(phi), b1, zero, one, a1, a2], axis=1)

    def filter(self, x: ArrayLike, fs: float) -> Samples:
        """Return `x` (shape (n_samples,), impulses for instance) through the `sections`, started at rest."""
        excitation = one_channel(x, "excitation")
        sections = self.sections(fs)
        total = np.zeros_like(excitation)
        for section in sections:
            total += signal.sosfilt(section[np.newaxis], excitation)
        return total

    def _table(self, fs: float) -> Samples:
        rows = np.stack([self.frequency_hz, self.decay_per_s, self.amplitude, self.phase], axis=1)
        return rows[self.frequency_hz <= fs / 2]

    def _chosen(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "DecayingModes":
        return DecayingModes(
            self.frequency_hz[which], self.decay_per_s[which], self.amplitude[which], self.phase[which]
        )
