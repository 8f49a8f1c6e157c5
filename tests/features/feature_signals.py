"""Signals that tests of several features share."""

import numpy as np

from texclass.features.phase_view import PhaseView, TapSignal, TapView

FS = 10_000.0


def noise(n, seed=0):
    """White, of deviation 1."""
    return np.random.default_rng(seed).standard_normal(n)


def tone(f_hz, n=50_000, fs=FS):
    """A sine of amplitude 1."""
    return np.sin(2 * np.pi * f_hz * np.arange(n) / fs)


def view_of(feature, samples, fs=FS):
    """The samples as the phase that the feature reads; a tap has its contact after a quarter."""
    if feature.phase == "tap":
        contact = samples.size // 4
        return TapView((TapSignal(samples[:contact], samples[contact:]),), fs)
    return PhaseView(samples, fs)
