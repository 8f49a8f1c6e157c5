"""
Unknown surfaces
================

A model reports surfaces that are not in its training set as unknown.
"""

import matplotlib.pyplot as plt

import texclass as tx

model = tx.train("simulated6", false_alarms=0.1)

# %%
# Classify new recordings of the six surfaces in the training set, and of six other surfaces.

surfaces = tx.simulate.surface_catalogue(12, seed=6)
operators = tx.simulate.operator_catalogue(4, seed=6)
answers = []
for i, surface in enumerate(surfaces):
    for k, operator in enumerate(operators):
        recording = tx.simulate.record_freehand(surface, operator, duration_s=5.0, seed=1000 + 10 * i + k)
        answers.append((surface.name, i < 6, model.answer(recording)))

# %%
# `p_known` is the p-value of the novelty score: the fraction of held-out recordings with at least the same
# score. A recording is `unknown` if `p_known` is at most the accepted rate of false alarms.

figure, axis = plt.subplots(figsize=(8, 4))
for trained, colour, name in ((True, "C0", "trained"), (False, "C1", "not trained")):
    points = [(surface, answer.p_known) for surface, is_trained, answer in answers if is_trained == trained]
    axis.plot(
        [p for _, p in points], [surface for surface, _ in points], "o", color=colour, alpha=0.7, label=name
    )
axis.axvline(0.1, color="C2", linestyle=":", label="accepted rate of false alarms")
axis.set_xlabel("p_known")
figure.legend(loc="outside upper left", ncols=3)
plt.show()

# %%
for trained in (True, False):
    unknown = [answer.unknown for _, is_trained, answer in answers if is_trained == trained]
    print("trained" if trained else "not trained", f"{sum(unknown)} of {len(unknown)} unknown")

# %%
# For surfaces in the training set, prediction sets contain the true surface in 90 or 95 % of the recordings.
# A set contains several surfaces if they are hard to distinguish.

for level in (0.9, 0.95):
    sets = [(surface, answer.prediction_sets[level]) for surface, is_trained, answer in answers if is_trained]
    n_covered, size = sum(s in members for s, members in sets), sum(len(members) for _, members in sets)
    print(f"{level:.0%}: coverage {n_covered} of {len(sets)}, {size / len(sets):.2f} surfaces per set")
