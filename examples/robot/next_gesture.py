"""
What should I do next?
======================

A tap tells hard from soft, a stroke rough from smooth. Each gesture has a model of its own; the one that is
expected to tell most in a second is made next, until the surface is sure.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

# %%
# Recordings of one gesture train its model. Here they are simulated; one's own stand in a folder a gesture.

recipe = tx.simulate.Recipe(n_surfaces=6, n_recordings=8, n_operators=4, duration_s=5, fs=10_000, seed=6)
models = tx.recognition.train_gestures(recipe, ("tap", "slow stroke", "fast stroke"))
exploration = tx.recognition.Exploration.of(models, confidence=0.99)
for name, bits in exploration.expected_bits().items():
    known = exploration.gestures[name]
    print(f"{name}: {bits:.2f} bits in {known.seconds:.1f} s; repetitions correlate {known.correlation:.2f}")

# %%
# A simulated hand, which no model knows, makes what is asked for. A robot would do the same.

stranger = tx.simulate.operator_catalogue(recipe.n_operators + 1, recipe.seed)[-1]
surface = recipe.surfaces[1]
said, made = [exploration.probabilities], ["before"]
while (advice := exploration.advice()) is not None and len(made) < 8:
    print(advice)
    felt = tx.simulate.record_gesture(advice.gesture, surface, stranger, seed=(1, len(made)))
    exploration.add(advice.gesture, models[advice.gesture].answer(felt).probabilities)
    said.append(exploration.probabilities)
    made.append(advice.gesture)

# %%
# What is believed after each gesture, and what each was expected to tell.

figure, axis = plt.subplots(figsize=(7, 3.5))
bottom = np.zeros(len(said))
for name, p in zip(exploration.materials, np.transpose(said), strict=True):
    axis.bar(range(len(said)), p, bottom=bottom, label=name, hatch="//" if name == surface.name else None)
    bottom += p
axis.set_xticks(range(len(said)), made)
axis.set_ylabel("probability")
figure.legend(loc="outside upper center", ncols=6, fontsize=8)
plt.show()
