"""
Fit a texture to a recording
============================

Fit a texture that follows speed and force to a recording, check it on held-out halves, and write it as a C
header for a device. The command is ``texclass texture fit``.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.reporting import print_document
from texclass.signals import combine, remove_hand_motion

# %%
# A simulated operator strokes cloth for 20 s, at varying speed and force. One sample of the force is wrong.

operator = replace(tx.simulate.operator_catalogue(1, seed=0)[0], speed_spread=0.5, force_spread=0.4)
cloth = tx.simulate.surface_catalogue(16, seed=0)[15]
recording = tx.simulate.record_freehand(cloth, operator, duration_s=20, fs=1000, seed=0, with_taps=False)
force = recording.normal_force.copy()
force[5000] = 505_831.0
recording = recording.with_(normal_force=force)

# %%
# The number of nodes and the order are selected on held-out halves. The wrong sample is excluded.

fit = tx.haptics.scene.fit_recordings([recording], name="cloth")
print_document(fit.document())

# %%
# Compare the levels of the texture with those of the recording, in windows of 0.125 s:

n = 125
vibration = remove_hand_motion(combine(recording.acceleration), recording.fs)
windows = vibration[: recording.n_samples // n * n].reshape(-1, n)
levels = 20 * np.log10(windows.std(axis=1))
speed = recording.speed[: levels.size * n].reshape(-1, n).mean(axis=1)
is_moving = speed > 20
curve = np.geomspace(*fit.texture.speeds[[0, -1]], 50)

figure, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
axis.plot(speed[is_moving], levels[is_moving], ".", color="0.6", label="recorded")
for newton in fit.texture.forces:
    power = fit.texture.grid.at(curve, np.full(50, newton))[1]
    axis.plot(curve, 10 * np.log10(power), label=f"texture at {newton:.2g} N")
axis.set_xscale("log")
axis.set_xlabel("mm/s")
axis.set_ylabel("dB re 1 m/s²")
axis.legend()
plt.show()

# %%
# Render on a device (C): write the models as constants, next to a renderer without dependencies. On the
# device, call ``texclass_step(&contact, velocity_x, velocity_y, force)`` once per sample.

texture = fit.texture
scene = tx.haptics.scene.PlannedScene.of_model("cloth", texture.fs, fit.unit, texture.grid)
with tempfile.TemporaryDirectory() as folder:
    header, renderer = tx.haptics.scene.write_c_header(Path(folder) / "cloth.h", scene)
    print(header.stat().st_size, "bytes of models,", renderer.stat().st_size, "bytes of code")
    print(*header.read_text().splitlines()[7:11], sep="\n")
