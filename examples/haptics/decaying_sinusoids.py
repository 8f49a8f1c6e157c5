"""
Taps as decaying sinusoids
==========================

A tap at impact velocity v is A v exp(-B t) sin(w t) [okamura2001, eq. 1]: three numbers a material.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

# %%
# Taps of three materials at several velocities, simulated with noise.

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
# As published (peaks and spectra, tap by tap), and by maximum likelihood over all taps at once.

fits = {}
for name, model in truth.items():
    published = tx.vibration.fit_okamura(taps[name], velocity, fs)
    fits[name] = tx.vibration.fit_tap_model(taps[name], velocity, fs)
    found = f"as published {published.decay_per_s:.1f}, by likelihood {fits[name].decay_per_s:.1f} 1/s"
    print(f"{name}: B is {model.decay_per_s:.0f}; {found}")

# %%
# Where the recordings begin some time before the impact, the moments of impact are fitted, too; the models
# of all materials are one library, to be saved or displayed by a device.

late = {name: [np.concatenate([np.zeros(37), tap]) for tap in of_one] for name, of_one in taps.items()}
library, found = tx.haptics.textures.okamura2001.fit_library(late, dict.fromkeys(late, velocity), fs)
for name, model in library.items():
    print(f"{name}: B {model.decay_per_s:.1f} 1/s, struck at sample {found[name].onset.mean():.2f}")

# %%
figure, axes = plt.subplots(1, 3, sharey=True, figsize=(10, 3))
for axis, (name, found) in zip(axes, fits.items(), strict=True):
    ms = 1e3 * np.arange(500) / fs
    axis.plot(ms, taps[name][-1], color="0.7", label="recorded")
    axis.plot(ms, found.synthesize(velocity[-1], 500, fs), color="C0", label="model")
    axis.set_title(f"{name}, {found.frequency_hz:.0f} Hz")
    axis.set_xlabel("ms")
axes[0].set_ylabel("m/s²")
axes[0].legend()
plt.show()
