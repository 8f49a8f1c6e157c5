"""
Choose the next gesture
=======================

A tap distinguishes hard from soft surfaces, and a stroke distinguishes rough from smooth surfaces. Each
gesture has its own model. The next gesture is the one with the highest expected information gain per second.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

# %%
# Train one model per gesture, here on simulated recordings.

recipe = tx.simulate.Recipe(n_surfaces=6, n_recordings=8, n_operators=4, duration_s=5, fs=10_000, seed=6)
models = tx.recognition.train_gestures(recipe, ("tap", "slow stroke", "fast stroke"))
exploration = tx.recognition.Exploration.from_models(models, confidence=0.99)
for name, bits in exploration.expected_bits().items():
    gesture = exploration.gestures[name]
    print(f"{name}: {bits:.2f} bits in {gesture.seconds:.1f} s; correlation {gesture.correlation:.2f}")

# %%
# A simulated operator, who is not in the training set, makes the recommended gestures, as a robot would.

operator = tx.simulate.operator_catalogue(recipe.n_operators + 1, recipe.seed)[-1]
surface = recipe.surfaces[1]
probabilities, gestures = [exploration.probabilities], ["start"]
while (advice := exploration.advice()) is not None and len(gestures) < 8:
    print(advice)
    recording = tx.simulate.record_gesture(advice.gesture, surface, operator, seed=(1, len(gestures)))
    exploration.add(advice.gesture, models[advice.gesture].answer(recording).probabilities)
    probabilities.append(exploration.probabilities)
    gestures.append(advice.gesture)

# %%
# Probabilities of the surfaces after each gesture:

figure, axis = plt.subplots(figsize=(7, 3.5))
bottom = np.zeros(len(probabilities))
for name, p in zip(exploration.surfaces, np.transpose(probabilities), strict=True):
    axis.bar(
        range(len(probabilities)), p, bottom=bottom, label=name, hatch="//" if name == surface.name else None
    )
    bottom += p
axis.set_xticks(range(len(probabilities)), gestures)
axis.set_ylabel("probability")
figure.legend(loc="outside upper center", ncols=6, fontsize=8)
plt.show()
