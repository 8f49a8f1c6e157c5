"""
Pairs of channels
=================

Two channels can have the same spectra on all floors and differ only in the delay between them. Depending on
the floor, the simulated rover of this example tilts before, while or after it shakes.
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
    """Simulate 5 s of driving. The turn rate about x contains the acceleration along y, with a delay."""
    acceleration, turn_rate = rng.standard_normal((2, n, 3))
    turn_rate[:, 0] += np.roll(acceleration[:, 1], floors[floor])
    return tx.Recording(
        acceleration, fs, "arbitrary", surface=floor, turn_rate=turn_rate, phases=Phases(movement=(0, n))
    )


drives = [drive(floor) for floor in floors for _ in range(20)]
surfaces = [drive.surface for drive in drives]

# %%
# A feature of the phase "pair" is computed for each pair of channels. Its columns are named after both
# channels.

coarse = load_feature_set("coarse")
extractor = FeatureExtractor(coarse, channels="all").set_output(transform="pandas")
features = extractor.fit_transform(drives)
correlations = features.filter(like="y*turn_x/lag_correlation").groupby(np.array(surfaces))
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
for floor, correlation in correlations.mean().iterrows():
    lags = [int(name.rpartition("lag")[2]) for name in correlation.index]
    axis.plot(lags, correlation, "o-", label=floor)
axis.set_xlabel("delay of the turn rate relative to the acceleration, samples")
axis.set_ylabel("correlation")
axis.legend()
plt.show()

# %%
# Compare the accuracies: the spectra of single channels do not separate the floors, but the correlation at
# several lags does.

for names in (["band_level", "octave_level"], ["lag_correlation"]):
    extractor = FeatureExtractor(coarse.restricted_to(names), channels="all")
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
    accuracy = cross_val_score(make_pipeline(extractor, lda), drives, surfaces, cv=5).mean()
    print(f"{', '.join(names)}: accuracy {100 * accuracy:.0f} %")
