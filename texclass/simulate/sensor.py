"""What the electronics make of the motion: the accelerometer, its converter, the bridge of force sensors."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from texclass.recording import STANDARD_GRAVITY, Samples


@dataclass(frozen=True)
class Sensor:
    """An LIS344ALH-like accelerometer on a data acquisition board, and two FSRs in a Wheatstone bridge.

    Attributes
    ----------
    range_g
        The accelerometer saturates at plus and minus this.
    bandwidth_hz
        Of its second-order low-pass.
    noise_ug_rt_hz
        Density of its noise, micro-g per root hertz.
    offset_mg
        Deviation of the zero-g level of each axis.
    converter_bits, converter_range_g
        Resolution and span (plus and minus) of the converter.
    bridge_v, bridge_noise_v, bridge_drift_v
        Bridge: voltage at full imbalance, deviation of its noise, size of its drift.
    """

    range_g: float = 6.0
    bandwidth_hz: float = 1800.0
    noise_ug_rt_hz: float = 50.0
    offset_mg: float = 20.0
    converter_bits: int = 14
    converter_range_g: float = 10.0
    bridge_v: float = 2.5
    bridge_noise_v: float = 0.002
    bridge_drift_v: float = 0.02

    @property
    def quantum_m_s2(self) -> float:
        """One step of the converter."""
        return float(2 * self.converter_range_g * STANDARD_GRAVITY / 2**self.converter_bits)

    def analogue_filter(self, fs: float, internal_rate: float) -> Samples:
        """Return second-order sections: the sensor's low-pass, then one against aliases of `fs`."""
        sensor = signal.butter(
            2, min(self.bandwidth_hz, 0.49 * internal_rate), fs=internal_rate, output="sos"
        )
        against_aliases = signal.butter(4, 0.4 * fs, fs=internal_rate, output="sos")
        return np.vstack([sensor, against_aliases])

    def read(
        self, acceleration: Samples, fs: float, rng: np.random.Generator, *, extra_noise: float = 0.0
    ) -> Samples:
        """Return what the converter stores of the true acceleration.

        Parameters
        ----------
        acceleration : ndarray of shape (n, 3)
            In the sensor's axes, gravity included (m/s^2).
        fs : float
            Sampling rate in Hz.
        rng : numpy.random.Generator
            Of offset and noise.
        extra_noise : float
            Deviation of further white noise (m/s^2).

        Returns
        -------
        ndarray of shape (n, 3)
            In m/s^2, clipped and quantised.
        """
        bandwidth = min(1.11 * self.bandwidth_hz, 0.41 * fs)  # of the noise, behind both filters
        density = 1e-6 * self.noise_ug_rt_hz * STANDARD_GRAVITY
        noise = np.hypot(density * np.sqrt(bandwidth), extra_noise)
        offset = 1e-3 * self.offset_mg * STANDARD_GRAVITY * rng.standard_normal(3)
        read = rng.standard_normal(acceleration.shape, dtype=np.float32) * noise
        read += acceleration
        read += offset
        limit = self.range_g * STANDARD_GRAVITY
        np.clip(read, -limit, limit, out=read)
        read /= self.quantum_m_s2
        np.rint(read, out=read)
        read *= self.quantum_m_s2
        return np.asarray(read, dtype=np.float64)

    def read_bridge(self, lateral_force_n: Samples, fs: float, rng: np.random.Generator) -> Samples:
        """Return the bridge's voltage for the lateral force of the grip (N); odd, saturating, drifting.

        The two FSRs of one tool are never alike: gain and balance change with every grip.
        """
        gain = 0.6 * np.exp(0.08 * rng.standard_normal())  # 1/N
        smooth = signal.lfilter(*signal.butter(1, min(150.0, 0.4 * fs), fs=fs), lateral_force_n)
        drive = gain * np.sign(smooth) * np.abs(smooth) ** 0.9
        drift = np.linspace(0.0, rng.standard_normal(), drive.size)
        offset = self.bridge_drift_v * (rng.standard_normal() + drift)
        noise = self.bridge_noise_v * rng.standard_normal(drive.size)
        return np.asarray(self.bridge_v * drive / (1.0 + np.abs(drive)) + offset + noise)
