"""
One surface, other devices
==========================

A phone knows neither the speed nor the force of a hand: a texture is played for it once, and what that leaves
out is told.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.haptics import exchange
from texclass.haptics.textures import oeztuerk2018

recording = tx.open_dataset("simulated6")[48]
movement = recording.acceleration[slice(*tx.segment(recording).movement), 2]
x = movement - movement.mean()
texture = oeztuerk2018.fit_lpc([x, 2 * x], [40.0, 160.0], recording.fs, order=20, name="simulated")
sent = exchange.play_texture(texture, speed=80.0, seconds=1.0)

# %%
# MPEG haptics take the vibration as wavelets, Apple's patterns its level and sharpness every 20 ms.

with tempfile.TemporaryDirectory() as folder:
    mpeg, apple = Path(folder) / "a.hjif", Path(folder) / "a.ahap"
    for name, lost in (
        ("MPEG", exchange.write_hjif(sent, mpeg)),
        ("Apple", exchange.write_ahap(sent, apple)),
    ):
        print(name, *(f"{key}: {words}" for key, words in lost.items()), sep="\n  ")
    played = exchange.play_hjif(exchange.read_hjif(mpeg))[:, 0]
    pattern = exchange.play_ahap(exchange.read_ahap(apple))

# %%
# What comes out of both: the level of a pattern is relative.

figure, axes = plt.subplots(3, 1, figsize=(8, 5), sharex=True)
sounds = (("texture", sent.samples, sent.fs), ("MPEG haptics", played, 8000.0), ("Apple", pattern, 8000.0))
for axis, (name, samples, fs) in zip(axes, sounds, strict=True):
    axis.plot(np.arange(samples.size) / fs, samples, linewidth=0.5)
    axis.set_ylabel(f"{name}\n" + ("relative" if name == "Apple" else "m/s²"))
axes[-1].set_xlabel("s")
plt.show()
