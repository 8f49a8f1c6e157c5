"""
Scores and their nulls
======================

A goodness of fit of 0.98 looks like a success, until another surface reaches it, too. Compare a score with
nulls, which contain nothing of the surface, and with a ceiling, the other half of the recording.
"""

from functools import partial

import matplotlib.pyplot as plt

import texclass as tx

fs = 2500.0
operator = tx.simulate.operator_catalogue(1, seed=0)[0]
vibrations = {}
for surface in tx.simulate.surface_catalogue(8, seed=0):
    recording = tx.simulate.record_rising_speed(
        surface, operator, duration_s=5.0, fs=fs, seed=1, speed_mm_s=(80.0, 80.0)
    )
    vibrations[surface.name] = tx.signals.remove_hand_motion(recording.acceleration[2500:, 2], fs)

# %%
# Two scores: the goodness-of-fit criterion [abdulali2016, eq. 6], and the perceptual distance. The latter
# compares one-third-octave bands in dB above the detection threshold of the hand. Here the strongest band is
# assumed to lie 30 dB above the threshold.

distance = partial(tx.vibration.perceptual_distance.perceptual_distance, fs=fs, strongest_db=30)
scores = {"GFC": (tx.vibration.scores.goodness_of_fit, True), "perceptual distance (dB)": (distance, False)}

# %%
# The nulls are white noise, the best of the other surfaces, and noise with the mean spectrum of the others,
# all at the level of the recording. A score proves something if the ceiling is better than the best null.
# Here both scores do. However, some surfaces have a GFC of 0.98 with another surface, nearly as high as with
# their own other half. In perceptual distance, every other half is closer than all nulls.

nulls = tx.vibration.null_scores
figure, panels = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
for axis, (name, (score, is_higher_better)) in zip(panels, scores.items(), strict=True):
    table = nulls.null_scores(score, vibrations, fs, higher_is_better=is_higher_better)
    margin = nulls.distance_to_null(table["other half"], table, higher_is_better=is_higher_better)
    pairs = nulls.same_or_different(score, vibrations, fs, higher_is_better=is_higher_better, n_resamples=200)
    print(f"{name}: AUROC {pairs['auroc']:.2f} [{pairs['low']:.2f}, {pairs['high']:.2f}]")
    print(f"  ceiling to best null {margin['mean']:+.3f} [{margin['low']:+.3f}, {margin['high']:+.3f}]")
    for column, marker in (("other half", "o"), ("next surface", "x"), ("mean of others", "+")):
        axis.plot(table.index, table[column], marker, label=column)
    axis.set_title(name)
    axis.tick_params(axis="x", rotation=30)
panels[0].legend()
plt.show()
