"""
Few recordings
==============

To find out how many recordings per surface are enough, train on the first few recordings and test on the last
six.
"""

import matplotlib.pyplot as plt
import pandas as pd

import texclass as tx

dataset = tx.open_dataset("simulated6")
figure, axis = plt.subplots(figsize=(7, 3.5))
for pipeline, n_trained, shift in (("strese2015", [3, 4, 6], -0.05), ("surfaces", [1, 3, 4, 6], 0.05)):
    accuracies = []
    for n in n_trained:
        result = tx.benchmark(dataset, pipeline, protocol=f"repetition=1-{n} -> repetition=7-12")
        accuracies.append(result.data["nested_cv"]["accuracy"])
    accuracy = 100 * pd.DataFrame(accuracies)[["mean", "low", "high"]]
    error = [accuracy["mean"] - accuracy["low"], accuracy["high"] - accuracy["mean"]]
    axis.errorbar(
        [n + shift for n in n_trained], accuracy["mean"], error, fmt="o-", capsize=3, label=pipeline
    )
axis.set_xticks([1, 3, 4, 6])
axis.set_xlabel("training recordings per surface")
axis.set_ylabel("accuracy in %")
axis.legend()
plt.show()

# %%
# Feature subset and classifier are selected inside the training set (nested cross-validation). The pipeline
# `surfaces`, the default of `texclass train`, has only one feature subset and one classifier. It therefore
# needs no selection, and can be trained on one recording per surface.

# %%
# The accuracy depends on which recordings are used for training. The protocol ``few-shot`` uses several
# training sets from the first half of the recordings, tests each on recordings of the second half, and
# reports the mean and the worst accuracy.

figure, axis = plt.subplots(figsize=(7, 2.5))
for n in (1, 3):
    accuracy = tx.benchmark(dataset, "surfaces", protocol=f"few-shot {n}").table.iloc[0]
    axis.plot([100 * accuracy["worst"], 100 * accuracy["mean"]], [str(n)] * 2, "o-")
axis.set_xlabel("accuracy in %: worst training set and mean")
axis.set_ylabel("recordings per surface")
axis.margins(y=0.5)
plt.show()
