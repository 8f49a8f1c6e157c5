"""
A feature of your own
=====================

One decorated function is a feature. What it is worth beside the paper's table is then a matter of one call.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx
from texclass.features.conditioning import unit

# %%
# The decorator says which phase it reads, its unit, where it comes from, and how it scales when the signal
# is multiplied by a gain.


@tx.feature("movement", unit="1", reference="this page", gain=tx.features.Gain())
def kurtosis(view):
    """Fourth moment over the squared second one: 3 for Gaussian noise, more where there are spikes."""
    x = unit(view)  # over its peak; refuses silence and NaN with a reason
    return np.mean(x**4) / np.mean(x**2) ** 2


# %%
# It is a function of an array,

kurtosis(np.random.default_rng(0).standard_normal(20_000), fs=10_000)

# %%
# and of recordings: here by surface, a dot each.

dataset = tx.open_dataset("simulated6")
values = [kurtosis(r.acceleration[slice(*tx.segment(r).movement)], fs=r.fs) for r in dataset]
figure, axis = plt.subplots(figsize=(7, 3))
axis.plot(values, dataset.labels, "o", alpha=0.6)
axis.set_xlabel("kurtosis of the movement")
plt.show()

# %%
# Beside the paper's table: its own row with every classifier, and what it adds to the best one.

study = tx.evaluation.study_feature(
    dataset, tx.load_pipeline("strese2015"), tx.features.find("kurtosis"), n_folds=4
)
print(tx.reporting.render_markdown(study.document())[:1200])
