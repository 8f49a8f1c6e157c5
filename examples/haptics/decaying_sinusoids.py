"""
Taps as decaying sinusoids
==========================

Model a tap at the impact velocity v as A v exp(-B t) sin(w t), with three parameters A, B and w per material
[okamura2001, eq. 1].
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

# %%
# Simulate noisy taps on three materials at several velocities.

fs = 25_000
truth = {
    "rubber": tx.vibration.TapModel(-600.0, 60.0, 300.0),
    "wood": tx.vibration.TapModel(-1500.0, 90.0, 650.0),
    "aluminium": tx.vibration.TapModel(-2000.0, 140.0, 1150.0),
}
velocity = np.linspace(0.05, 0.3, 5)
rng = np.random.default_rng(0)
taps = {
    name: [model.synthesize(v, 500, fs) + 15 * rng.standard_normal(500) for v in velocity]
    for name, model in truth.items()
}

# %%
# Fit the model to the peaks and the spectrum of each tap, as published, and to all taps together by maximum
# likelihood.

fits = {}
for name, model in truth.items():
    published = tx.vibration.fit_okamura(taps[name], velocity, fs)
    fits[name] = tx.vibration.fit_tap_model(taps[name], velocity, fs)
    fitted = f"as published {published.decay_per_s:.1f}, maximum likelihood {fits[name].decay_per_s:.1f} 1/s"
    print(f"{name}: B is {model.decay_per_s:.0f}; {fitted}")

# %%
# If recordings begin before the impact, the time of the impact is fitted as well. The models of all materials
# form a library.

late = {name: [np.concatenate([np.zeros(37), tap]) for tap in recorded] for name, recorded in taps.items()}
library, fits_by_name = tx.haptics.textures.okamura2001.fit_library(late, dict.fromkeys(late, velocity), fs)
for name, model in library.items():
    print(f"{name}: B {model.decay_per_s:.1f} 1/s, impact at sample {fits_by_name[name].onset.mean():.2f}")

# %%
figure, axes = plt.subplots(1, 3, sharey=True, figsize=(10, 3))
for axis, (name, model) in zip(axes, fits.items(), strict=True):
    ms = 1e3 * np.arange(500) / fs
    axis.plot(ms, taps[name][-1], color="0.7", label="recorded")
    axis.plot(ms, model.synthesize(velocity[-1], 500, fs), color="C0", label="model")
    axis.set_title(f"{name}, {model.frequency_hz:.0f} Hz")
    axis.set_xlabel("ms")
axes[0].set_ylabel("m/s²")
axes[0].legend()
plt.show()
