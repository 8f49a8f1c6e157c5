"""
Dependence on speed and force
=============================

A feature should depend on the surface, and not on the speed and force of the hand. As in the experiments of
Strese, Schuwerk and Steinbach (2015), a plate rotates under the tool while its speed or the force rises. The
recordings are simulated.
"""

from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[0]
operator = tx.simulate.operator_catalogue(1, seed=6)[0]
faster = tx.simulate.record_rising_speed(surface, operator, seed=1, speed_mm_s=(20, 200))
harder = tx.simulate.record_rising_force(surface, operator, seed=1, force_n=(0.4, 2.5))

# %%
# Divide the movement into ten equal segments, and compute the features of each segment.


def features_by_second(recording, condition):
    start, stop = recording.phases.movement
    edges = np.linspace(start, stop, 11).astype(int)
    windows = [recording.acceleration[a:b] for a, b in pairwise(edges)]
    features = tx.extract(windows, "strese2015", fs=recording.fs, unit="m/s^2")
    return [condition[a:b].mean() for a, b in pairwise(edges)], features


# %%
# The amplitude rises with the speed, and so do all features that measure a level. Features of fixed frequency
# bands change as well. The effect of the force is smaller.

names = ["temporal_roughness", "fineness", "mfcc_constant.c2", "mfcc_constant.c5"]
results = {
    "speed in mm/s": features_by_second(faster, faster.speed),
    "normal force in N": features_by_second(harder, harder.normal_force),
}
figure, rows = plt.subplots(2, 4, figsize=(10, 5), sharey="col", layout="constrained")
for row, (title, (condition, features)) in zip(rows, results.items(), strict=True):
    for axis, name in zip(row, names, strict=True):
        axis.plot(condition, features[name], "o-")
        axis.set_title(name)
        axis.set_xlabel(title)
plt.show()
