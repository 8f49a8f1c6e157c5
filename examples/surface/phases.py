"""
Find taps and movement
======================

A freehand recording has taps, followed by strokes. Both are detected from the acceleration alone. The
recording here is simulated, so the true phases are known.
"""

import matplotlib.pyplot as plt

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[2]
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
recording = tx.simulate.record_freehand(surface, operator, duration_s=4.0, seed=30)
truth = recording.phases
detected = tx.find_phases(recording.with_(phases=None))
detected.kind

# %%
# Each detected tap has an impact (sample index), a width in samples and a quality between 0 and 1.

for tap in detected.taps:
    impact_s, width_ms = tap.impact / recording.fs, 1e3 * tap.width / recording.fs
    print(f"impact at {impact_s:.3f} s, width {width_ms:.1f} ms, quality {tap.quality:.2f}")

# %%
# Plot the detected phases (top) and the true phases (bottom):

time = [i / recording.fs for i in range(recording.n_samples)]
signal = recording.acceleration[:, 2] - recording.acceleration[0, 2]
figure, axes = plt.subplots(2, sharex=True, sharey=True, figsize=(9, 4.5))
for axis, phases, name in zip(axes, (detected, truth), ("detected", "true"), strict=True):
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
