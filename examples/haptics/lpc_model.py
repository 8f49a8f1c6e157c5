"""
An autoregressive model
=======================

Model a stroke as filtered noise: a few coefficients represent its spectrum, and a signal of any length can be
synthesised [oeztuerk2018, section 3.1].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import texclass as tx

recording = tx.open_dataset("simulated6")[0]
movement = recording.acceleration[slice(*tx.find_phases(recording).movement), 2]
x = np.diff(movement - movement.mean())  # reduces hand motion

# %%
# Burg's method returns reflection coefficients, so the model is stable. Select the order:

selection = tx.vibration.select_order(x, max_order=100)
model = tx.vibration.fit(x, selection.order)
print(f"order {model.order}, largest |k| {np.abs(model.reflection).max():.3f}")

# %%
# Synthesis uses a lattice that starts in the stationary state.

synthetic = tx.vibration.synthesize(model, x.size, np.random.default_rng(0))
figure, axis = plt.subplots(figsize=(8, 3.5))
for signal, name in ((x, "recorded"), (synthetic, f"synthesised, order {model.order}")):
    f, power = welch(signal, recording.fs, nperseg=1024)
    axis.plot(f, 10 * np.log10(power), label=name)
axis.set_xlabel("Hz")
axis.set_ylabel("dB")
axis.legend()
plt.show()

# %%
# The thesis compares magnitude spectra [eq. 3.11]. Two realisations of the same noise already differ by 0.655
# on average.

scores = tx.vibration.scores
print(f"C {scores.rms_spectral_error(x, synthetic):.2f}, {scores.log_spectral_distance(x, synthetic):.1f} dB")

# %%
# A lattice stays stable while its parameters change, here between the model and one with mirrored resonances,
# four times per second.

lattice = tx.vibration.LatticeSynthesis(model)
mix = np.cos(2 * np.pi * 4 * np.arange(x.size) / recording.fs)[:, np.newaxis]
noise = np.random.default_rng(1).standard_normal(x.size)
varying = lattice.process_varying(noise, mix * model.reflection, np.full(x.size, model.level))
print(f"RMS {varying.std():.3g}, model {model.level:.3g}")
