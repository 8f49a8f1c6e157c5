"""
Export to other devices
=======================

A phone does not measure speed and force, so a texture is rendered once, for one speed and force. The
functions that write the files return a description of what is lost.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.haptics import exchange
from texclass.haptics.textures import oeztuerk2018

recording = tx.open_dataset("simulated6")[48]
movement = recording.acceleration[slice(*tx.find_phases(recording).movement), 2]
x = movement - movement.mean()
texture = oeztuerk2018.fit_lpc([x, 2 * x], [40.0, 160.0], recording.fs, order=20, name="simulated")
rendition = exchange.play_texture(texture, speed=80.0, seconds=1.0)

# %%
# MPEG haptics represents the vibration as wavelets. Apple Core Haptics represents it as level and sharpness
# every 20 ms.

with tempfile.TemporaryDirectory() as folder:
    mpeg, apple = Path(folder) / "a.hjif", Path(folder) / "a.ahap"
    for name, losses in (
        ("MPEG", exchange.write_hjif(rendition, mpeg)),
        ("Apple", exchange.write_ahap(rendition, apple)),
    ):
        print(name, *(f"{key}: {text}" for key, text in losses.items()), sep="\n  ")
    played = exchange.play_hjif(exchange.read_hjif(mpeg))[:, 0]
    pattern = exchange.play_ahap(exchange.read_ahap(apple))

# %%
# Plot the signals rendered from both files. The level of an Apple pattern is relative.

figure, axes = plt.subplots(3, 1, figsize=(8, 5), sharex=True)
sounds = (
    ("texture", rendition.samples, rendition.fs),
    ("MPEG haptics", played, 8000.0),
    ("Apple", pattern, 8000.0),
)
for axis, (name, samples, fs) in zip(axes, sounds, strict=True):
    axis.plot(np.arange(samples.size) / fs, samples, linewidth=0.5)
    axis.set_ylabel(f"{name}\n" + ("relative" if name == "Apple" else "m/s²"))
axes[-1].set_xlabel("s")
plt.show()
