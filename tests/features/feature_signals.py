"""Signals that tests of several features share."""

import numpy as np

FS = 10_000.0


def noise(n, seed=0):
    """White, of deviation 1."""
    return np.random.default_rng(seed).standard_normal(n)


def tone(f_hz, n=50_000, fs=FS):
    """A sine of amplitude 1."""
    return np.sin(2 * np.pi * f_hz * np.arange(n) / fs)
