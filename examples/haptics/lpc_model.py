"""
An autoregressive model
=======================

Model a stroke as filtered noise. A few coefficients represent its spectrum, from which a signal of any length
can be synthesised [oeztuerk2018, section 3.1].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import texclass as tx

recording = tx.open_dataset("simulated6")[0]
movement = recording.acceleration[slice(*tx.find_phases(recording).movement), 2]
x = np.diff(movement - movement.mean())  # reduces hand motion

# %%
# Select the order of the model, then fit the model. Burg's method returns reflection coefficients between -1
# and 1, so the model is always stable.

selection = tx.vibration.select_order(x, max_order=100)
model = tx.vibration.fit(x, selection.order)
print(f"order {model.order}, largest |k| {np.abs(model.reflection).max():.3f}")

# %%
# Synthesise a signal with a lattice filter that starts in its stationary state.

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
# The thesis compares magnitude spectra [oeztuerk2018, eq. 3.11]. Even two realisations of the same noise
# differ by 0.655 on average.

scores = tx.vibration.scores
print(f"C {scores.rms_spectral_error(x, synthetic):.2f}, {scores.log_spectral_distance(x, synthetic):.1f} dB")

# %%
# A lattice filter stays stable while its parameters change. Here, the reflection coefficients are multiplied
# by a cosine of 4 Hz.

lattice = tx.vibration.LatticeSynthesis(model)
mix = np.cos(2 * np.pi * 4 * np.arange(x.size) / recording.fs)[:, np.newaxis]
noise = np.random.default_rng(1).standard_normal(x.size)
varying = lattice.process_varying(noise, mix * model.reflection, np.full(x.size, model.level))
print(f"RMS {varying.std():.3g}, model {model.level:.3g}")
