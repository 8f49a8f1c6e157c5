"""Signals shared by the tests of several features."""

import numpy as np

FS = 10_000.0


def noise(n, seed=0):
    """Return white noise with standard deviation 1."""
    return np.random.default_rng(seed).standard_normal(n)


def tone(f_hz, n=50_000, fs=FS):
    """Return a sine of amplitude 1."""
    return np.sin(2 * np.pi * f_hz * np.arange(n) / fs)
