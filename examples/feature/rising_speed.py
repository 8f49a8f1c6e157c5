"""
Dependence on speed and force
=============================

A feature should depend on the surface, not on speed and force of the hand. As in the paper, a plate turns
faster and faster under the tool, or is pressed harder and harder; here it is simulated.
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
# Compute the features of each of ten seconds.


def by_second(scan, condition):
    start, stop = scan.phases.movement
    edges = np.linspace(start, stop, 11).astype(int)
    seconds = [scan.acceleration[a:b] for a, b in pairwise(edges)]
    features = tx.extract(seconds, "strese2015", fs=scan.fs, unit="m/s^2")
    return [condition[a:b].mean() for a, b in pairwise(edges)], features


# %%
# The amplitude grows with speed, and with it every feature of level. Features of constant bands change too.
# Force has less effect.

names = ["temporal_roughness", "fineness", "mfcc_constant.c2", "mfcc_constant.c5"]
runs = {
    "speed in mm/s": by_second(faster, faster.speed),
    "normal force in N": by_second(harder, harder.normal_force),
}
figure, rows = plt.subplots(2, 4, figsize=(10, 5), sharey="col", layout="constrained")
for row, (title, (condition, features)) in zip(rows, runs.items(), strict=True):
    for axis, name in zip(row, names, strict=True):
        axis.plot(condition, features[name], "o-")
        axis.set_title(name)
        axis.set_xlabel(title)
plt.show()
