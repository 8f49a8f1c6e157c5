"""
Interpolate between speeds
==========================

Render a texture at any speed from models that were fitted at a few speeds. The line spectral frequencies of
the models are interpolated, so each interpolated model is stable [oeztuerk2018, section 3.1].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter, welch

import texclass as tx

# %%
# Simulate recordings of a surface at four speeds, and render the surface at a fifth speed. The resonance
# frequency of the surface is proportional to the speed.


def simulate(speed, seed):
    """Return 2 s of filtered noise at 2 kHz: resonance at 2 Hz per mm/s, level rising with the speed."""
    noise = np.random.default_rng(seed).standard_normal(4000)
    resonance = [1, -1.9 * np.cos(2 * np.pi * 2 * speed / 2000), 0.95**2]
    return speed / 100 * lfilter([1], resonance, noise)


speeds = [60, 100, 140, 180]
texture = tx.haptics.textures.oeztuerk2018.fit_lpc([simulate(v, v) for v in speeds], speeds, fs=2000, order=2)
renderer = texture.renderer(seed=0)
velocity = np.tile([120.0, 0.0], (8000, 1))
rendered = renderer.process(velocity, np.ones(8000))

# %%
# Compare the spectrum of the rendered signal with a held-out recording at the same speed:

figure, axis = plt.subplots(figsize=(8, 3.5))
for signal, name in (
    (simulate(120, 7), "recorded at 120 mm/s, held out"),
    (rendered, "rendered at 120 mm/s"),
):
    f, power = welch(signal, 2000, nperseg=512)
    axis.plot(f, 10 * np.log10(power), label=name)
axis.set_xlabel("Hz")
axis.set_ylabel("dB")
axis.legend()
plt.show()
