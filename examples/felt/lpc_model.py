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
