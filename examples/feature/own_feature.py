"""
Add a feature
=============

A feature is one decorated function. A single call compares it with the published table.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.features.movement_filters import unit

# %%
# The decorator declares the phase from which the feature is computed, its unit, its reference, and how its
# value scales with the signal level.


@tx.feature("movement", unit="1", reference="this page", gain=tx.features.Gain())
def kurtosis(view):
    """Return the fourth moment divided by the squared second moment: 3 for noise, more for spikes."""
    x = unit(view)  # the signal divided by its peak; raises an error if it is silent or contains NaN
    return np.mean(x**4) / np.mean(x**2) ** 2


# %%
# Call the function with an array:

kurtosis(np.random.default_rng(0).standard_normal(20_000), fs=10_000)

# %%
# Call it with the movement of each recording. In the figure, each dot is a recording:

dataset = tx.open_dataset("simulated6")
values = [kurtosis(r.acceleration[slice(*tx.find_phases(r).movement)], fs=r.fs) for r in dataset]
figure, axis = plt.subplots(figsize=(7, 3))
axis.plot(values, dataset.labels, "o", alpha=0.6)
axis.set_xlabel("kurtosis of the movement")
plt.show()

# %%
# Evaluate the feature as a row of the table with every classifier, and compute the accuracy gained by adding
# it to the best row:

study = tx.evaluation.study_feature(
    dataset, tx.load_pipeline("strese2015"), tx.features.find_feature("kurtosis"), n_folds=4
)
print(tx.reporting.render_markdown(study.document())[:1200])
