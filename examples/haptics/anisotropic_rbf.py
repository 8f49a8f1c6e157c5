"""
A texture with a direction
==========================

Corduroy feels different along and across. A radial basis function network maps direction, speed and force
to a vibration model [abdulali2016].
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter, welch

import texclass as tx

# %%
# A scan: half a minute of strokes in all directions. Across the ribs it vibrates at a pitch that rises with
# speed; along them it only hisses.

rng = np.random.default_rng(0)
fs, n = 1000, 30_000
angle = 2 * np.pi * 0.05 * np.arange(n) / fs
speed = 100 + 50 * np.sin(2 * np.pi * 0.31 * np.arange(n) / fs)
velocity = speed[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
ribs = 0.02 * np.abs(velocity[:, 0]) * np.sin(2 * np.pi * np.cumsum(velocity[:, 0]) / fs / 0.8)
hiss = 0.003 * speed * lfilter([1, 0.8], 1, rng.standard_normal(n))
scan = tx.haptics.textures.Scan(
    ribs + hiss, np.cumsum(velocity, axis=0) / fs, velocity, np.ones(n), fs, name="corduroy"
)
texture = tx.haptics.textures.abdulali2016.fit_texture(tx.haptics.textures.abdulali2016.condition(scan))
texture.parameters

# %%
# A tool that is tracked in space has places and forces of three axes: `scan_from_sensors` projects them on
# the surface, by its normal, and conditions them.

on_table = np.column_stack([scan.position, np.zeros(n)])
pressing = np.column_stack([np.zeros((n, 2)), scan.force])
again = tx.haptics.textures.abdulali2016.scan_from_sensors(scan.acceleration, on_table, pressing, fs)
print(f"{again.speed.mean():.0f} mm/s and {again.force.mean():.1f} N in the mean")

# %%
# Rendered across and along the ribs, at one speed:

figure, axis = plt.subplots(figsize=(8, 3.5))
for direction, name in (((100.0, 0.0), "across"), ((0.0, 100.0), "along")):
    vibration = texture.renderer(seed=1).process(np.tile(direction, (8000, 1)), np.ones(8000))
    f, power = welch(vibration, fs, nperseg=512)
    axis.plot(f, 10 * np.log10(power), label=f"{name} the ribs, 100 mm/s")
axis.set_xlabel("Hz")
axis.set_ylabel("dB")
axis.legend()
plt.show()
