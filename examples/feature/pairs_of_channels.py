"""
Pairs of channels
=================

Two channels can have the same spectra on every floor and still differ in their delay. A simulated rover leans
before it shakes, at the same time, or after it.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import cross_val_score
from sklearn.pipeline import make_pipeline

import texclass as tx
from texclass.features import FeatureExtractor, load_feature_set
from texclass.recording import Phases

rng = np.random.default_rng(2)
floors, n, fs = {"tiles": -2, "carpet": 0, "gravel": 2}, 250, 50.0


def drive(floor):
    """Return 5 s in which the turn rate about x follows the acceleration along y with a delay."""
    shaken, turned = rng.standard_normal((2, n, 3))
    turned[:, 0] += np.roll(shaken[:, 1], floors[floor])
    return tx.Recording(
        shaken, fs, "arbitrary", surface=floor, turn_rate=turned, phases=Phases(movement=(0, n))
    )


drives = [drive(floor) for floor in floors for _ in range(20)]
surfaces = [one.surface for one in drives]

# %%
# A feature of phase "pair" is computed for every two channels. Its columns are named after both.

coarse = load_feature_set("coarse")
extractor = FeatureExtractor(coarse, channels="all").set_output(transform="pandas")
features = extractor.fit_transform(drives)
both = features.filter(like="y*turn_x/lag_correlation").groupby(np.array(surfaces))
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
for floor, course in both.mean().iterrows():
    axis.plot([int(name.rpartition("lag")[2]) for name in course.index], course, "o-", label=floor)
axis.set_xlabel("delay of the turn rate after the acceleration, samples")
axis.set_ylabel("correlation")
axis.legend()
plt.show()

# %%
# The spectra of single channels do not separate the floors; the lagged correlation does.

for names in (["band_level", "octave_level"], ["lag_correlation"]):
    some = FeatureExtractor(coarse.restricted_to(names), channels="all")
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
    right = cross_val_score(make_pipeline(some, lda), drives, surfaces, cv=5).mean()
    print(f"{', '.join(names)}: {100 * right:.0f} %")
