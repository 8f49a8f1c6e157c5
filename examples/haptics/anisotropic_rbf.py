"""
A texture with a direction
==========================

Corduroy vibrates differently along and across its ridges. A radial basis function network maps direction,
speed and force to an autoregressive model [abdulali2016].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter, welch

import texclass as tx

# %%
# Simulate a scan of 30 s in all directions. Across the ridges, the frequency rises with the speed; along the
# ridges, there is only noise.

rng = np.random.default_rng(0)
fs, n = 1000, 30_000
angle = 2 * np.pi * 0.05 * np.arange(n) / fs
speed = 100 + 50 * np.sin(2 * np.pi * 0.31 * np.arange(n) / fs)
velocity = speed[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
ridges = 0.02 * np.abs(velocity[:, 0]) * np.sin(2 * np.pi * np.cumsum(velocity[:, 0]) / fs / 0.8)
noise = 0.003 * speed * lfilter([1, 0.8], 1, rng.standard_normal(n))
scan = tx.haptics.textures.Scan(
    ridges + noise, np.cumsum(velocity, axis=0) / fs, velocity, np.ones(n), fs, name="corduroy"
)
texture = tx.haptics.textures.abdulali2016.fit_texture(tx.haptics.textures.abdulali2016.condition(scan))
texture.parameters

# %%
# For your own data, `scan_from_sensors` projects the positions and forces of a tracked tool onto the surface
# and conditions the signals.

position = np.column_stack([scan.position, np.zeros(n)])
force = np.column_stack([np.zeros((n, 2)), scan.force])
projected = tx.haptics.textures.abdulali2016.scan_from_sensors(scan.acceleration, position, force, fs)
print(f"mean speed {projected.speed.mean():.0f} mm/s, mean force {projected.force.mean():.1f} N")

# %%
# Render strokes across and along the ridges at the same speed:

figure, axis = plt.subplots(figsize=(8, 3.5))
for direction, name in (((100.0, 0.0), "across"), ((0.0, 100.0), "along")):
    vibration = texture.renderer(seed=1).process(np.tile(direction, (8000, 1)), np.ones(8000))
    f, power = welch(vibration, fs, nperseg=512)
    axis.plot(f, 10 * np.log10(power), label=f"{name} the ridges, 100 mm/s")
axis.set_xlabel("Hz")
axis.set_ylabel("dB")
axis.legend()
plt.show()
