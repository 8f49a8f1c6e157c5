"""
Does it depend on how one strokes
=================================

A feature of the surface should not tell the hand instead. The paper turned a plate faster and faster under
the tool; here the plate is simulated.
"""

from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[0]
operator = tx.simulate.operator_catalogue(1, seed=6)[0]
scan = tx.simulate.record_rising_speed(surface, operator, seed=1, speed_mm_s=(20, 200))

# %%
# Ten seconds, cut into ten: each second has its features.

start, stop = scan.phases.movement
edges = np.linspace(start, stop, 11).astype(int)
seconds = [scan.acceleration[a:b] for a, b in pairwise(edges)]
features = tx.extract(seconds, "strese2015", fs=scan.fs, unit="m/s^2")
speed = [scan.speed[a:b].mean() for a, b in pairwise(edges)]

# %%
# The amplitude grows with speed, and with it whatever measures a level; a spectrum that is cut by a filter
# bank in constant bands moves, too.

names = ["temporal_roughness", "fineness", "mfcc_constant.c2", "mfcc_constant.c5"]
figure, axes = plt.subplots(1, 4, figsize=(10, 2.8))
for axis, name in zip(axes, names, strict=True):
    axis.plot(speed, features[name], "o-")
    axis.set_title(name)
    axis.set_xlabel("speed in mm/s")
plt.show()
