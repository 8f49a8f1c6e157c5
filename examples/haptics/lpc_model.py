"""
An autoregressive model
=======================

A stroke as filtered noise: few coefficients hold its spectrum, and any length of it can be made again
[oeztuerk2018, section 3.1].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import texclass as tx

recording = tx.open_dataset("simulated6")[0]
movement = recording.acceleration[slice(*tx.segment(recording).movement), 2]
x = np.diff(movement - movement.mean())  # less of the hand's slow path

# %%
# Burg's method; the model is kept as reflection coefficients, so that it is stable by construction. Which
# order is enough?

chosen = tx.vibration.select_order(x, largest=100)
model = tx.vibration.fit(x, chosen.order)
print(f"order {model.order}, largest |k| {np.abs(model.reflection).max():.3f}")

# %%
# Synthesis is a lattice, from its first sample in the model's stationary state.

again = tx.vibration.synthesize(model, x.size, np.random.default_rng(0))
figure, axis = plt.subplots(figsize=(8, 3.5))
for signal, name in ((x, "recorded"), (again, f"made again, order {model.order}")):
    f, power = welch(signal, recording.fs, nperseg=1024)
    axis.plot(f, 10 * np.log10(power), label=name)
axis.set_xlabel("Hz")
axis.set_ylabel("dB")
axis.legend()
plt.show()

# %%
# How close is that? The thesis compares magnitudes of spectra [eq. 3.11]; two stretches of one noise already
# differ by 0.655 in the mean.

scores = tx.vibration.scores
print(f"C {scores.rms_spectral_error(x, again):.2f}, {scores.log_spectral_distance(x, again):.1f} dB")

# %%
# A lattice stays stable while its parameters move, whatever they are: here to and fro between this model and
# one whose resonances are mirrored, four times a second.

lattice = tx.vibration.LatticeSynthesis(model)
mix = np.cos(2 * np.pi * 4 * np.arange(x.size) / recording.fs)[:, np.newaxis]
noise = np.random.default_rng(1).standard_normal(x.size)
moving = lattice.process_varying(noise, mix * model.reflection, np.full(x.size, model.level))
print(f"RMS {moving.std():.3g}, that of the model {model.level:.3g}")
