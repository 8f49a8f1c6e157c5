"""
Another operator
================

k-fold cross-validation over recordings estimates the accuracy for operators in the training set. To estimate
the accuracy for a new operator, leave one operator out.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

dataset = tx.open_dataset("simulated6")
tables = {}
for protocol in ("recording", "operator"):
    result = tx.benchmark(
        dataset, "strese2015", protocol=protocol, n_folds=4 if protocol == "recording" else None
    )
    tables[protocol] = result.table.query("classifier == 'lda'").set_index("row")

# %%
# The confidence interval is over independent units: recordings with the first protocol, four operators with
# the second.

for protocol, table in tables.items():
    print(protocol, table[["clusters", "n_clusters"]].iloc[0].to_dict())

# %%
rows = tables["recording"]["mean"].nlargest(8).index[::-1]
figure, axis = plt.subplots(figsize=(9, 4))
for (protocol, table), shift in zip(tables.items(), (0.12, -0.12), strict=True):
    accuracy = 100 * table.loc[rows]
    error = [accuracy["mean"] - accuracy["low"], accuracy["high"] - accuracy["mean"]]
    y = np.arange(len(rows)) + shift
    axis.errorbar(accuracy["mean"], y, xerr=error, fmt="o", capsize=3, label=f"leave out: {protocol}s")
axis.set_yticks(range(len(rows)), rows)
axis.set_xlabel("accuracy in %")
figure.legend(loc="outside upper left", ncols=2)
plt.show()
