"""
Pack a texture into 64 bytes
============================

Pack a stroke into a texture of at most 64 bytes, then make it smoother.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[2]
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
recording = tx.simulate.record_freehand(surface, operator, duration_s=6.0, seed=30)
start, stop = recording.phases.movement
stroke = recording.acceleration[start:stop, 2]

packed = tx.haptics.textures.pack(stroke, 64, fs=recording.fs)
print(len(packed.to_bytes()), "bytes, an AR model of order", packed.order)

# %%
# Render the texture. A texture packed from one stroke has one spectrum and one level. Pack a
# :class:`texclass.haptics.textures.Scan` to make them depend on speed and force.

n = round(2 * packed.fs)
rendered = packed.renderer(seed=1).process(np.tile([110.0, 0.0], (n, 1)), np.ones(n))

# %%
# Change one scale of ``texclass describe``. The other scales approximately keep their values.

original = tx.haptics.textures.measure_scales(packed)
smoother = tx.haptics.textures.retouch(packed, rough=original["rough"] - 2)
changed = tx.haptics.textures.measure_scales(smoother)
print({name: f"{original[name]:.1f} -> {changed[name]:.1f}" for name in original})

# %%
# Plot the power spectral densities of the recorded stroke and of both textures:

figure, axis = plt.subplots(figsize=(8, 3.5), layout="constrained")
smoother_signal = smoother.renderer(seed=1).process(np.tile([110.0, 0.0], (n, 1)), np.ones(n))
for x, name in ((stroke - stroke.mean(), "recorded"), (rendered, "64 bytes"), (smoother_signal, "smoother")):
    axis.psd(x, NFFT=2048, Fs=recording.fs, label=name)
axis.set(xscale="log", xlim=(20, 1000), ylim=(-45, 5), xlabel="frequency in Hz", ylabel="dB re (m/s²)²/Hz")
axis.legend()
plt.show()
