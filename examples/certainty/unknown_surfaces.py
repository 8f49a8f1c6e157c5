"""
Unknown surfaces
================

A recogniser has to say when it is asked about a surface that it was never trained on.
"""

import matplotlib.pyplot as plt

import texclass as tx

model = tx.train("simulated6", false_alarms=0.1)

# %%
# Ask it new recordings of its six surfaces, and of six others.

surfaces = tx.simulate.surface_catalogue(12, seed=6)
operators = tx.simulate.operator_catalogue(4, seed=6)
answers = []
for i, surface in enumerate(surfaces):
    for k, operator in enumerate(operators):
        felt = tx.simulate.record_freehand(surface, operator, duration_s=5.0, seed=1000 + 10 * i + k)
        answers.append((surface.name, i < 6, model.answer(felt)))

# %%
# `p_known` is the share of held-out recordings of known surfaces that looked as strange; `unknown` is said
# where it is below the share of false alarms that was allowed.

figure, axis = plt.subplots(figsize=(8, 4))
for trained, colour, name in ((True, "C0", "trained"), (False, "C1", "never met")):
    of = [(surface, answer.p_known) for surface, known, answer in answers if known == trained]
    axis.plot([p for _, p in of], [surface for surface, _ in of], "o", color=colour, alpha=0.7, label=name)
axis.axvline(0.1, color="C2", linestyle=":", label="false alarms allowed")
axis.set_xlabel("p_known")
figure.legend(loc="outside upper left", ncols=3)
plt.show()

# %%
for trained in (True, False):
    said = [answer.unknown for _, known, answer in answers if known == trained]
    print("trained" if trained else "never met", f"{sum(said)} of {len(said)} called unknown")

# %%
# Beside the best answer stand sets, which hold the surface in 90 and in 95 of 100 recordings of known ones.
# They hold several where surfaces are hard to tell apart, and none where even the best answer conforms less
# than right ones do.

for level in (0.9, 0.95):
    sets = [(surface, answer.sets[level]) for surface, known, answer in answers if known]
    holds, size = sum(s in members for s, members in sets), sum(len(members) for _, members in sets)
    print(f"{level:.0%}: {holds} of {len(sets)} sets hold the surface, {size / len(sets):.2f} surfaces a set")
