"""
Its phases
==========

Taps come first, then strokes. Where they are is found in the acceleration alone; this recording is
simulated, so the truth is known.
"""

import matplotlib.pyplot as plt

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[2]
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
recording = tx.simulate.record_freehand(surface, operator, duration_s=4.0, seed=30)
truth = recording.phases
found = tx.segment(recording.with_(phases=None))  # without the truth, as of a file
found.kind

# %%
# Each tap says where the hand began to move, where the tool hit, how wide the impact is and how surely it
# is one.

for tap in found.taps:
    at, wide = tap.impact / recording.fs, 1e3 * tap.width / recording.fs
    print(f"impact at {at:.3f} s, {wide:.1f} ms wide, quality {tap.quality:.2f}")

# %%
# Found above, true below.

time = [i / recording.fs for i in range(recording.n_samples)]
signal = recording.acceleration[:, 2] - recording.acceleration[0, 2]
figure, axes = plt.subplots(2, sharex=True, sharey=True, figsize=(9, 4.5))
for axis, phases, name in zip(axes, (found, truth), ("found", "true"), strict=True):
    axis.plot(time, signal, color="C0", linewidth=0.5)
    start, stop = phases.movement
    axis.axvspan(start / recording.fs, stop / recording.fs, color="C2", alpha=0.15, label="movement")
    for tap in phases.taps:
        axis.axvspan(tap.start / recording.fs, tap.end / recording.fs, color="C1", alpha=0.3)
        axis.axvline(tap.impact / recording.fs, color="C1", linewidth=1)
    axis.set_title(f"{name}: {len(phases.taps)} taps")
    axis.set_ylabel("m/s²")
axes[1].set_xlabel("time in s")
plt.show()
