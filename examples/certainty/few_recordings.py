"""
Few recordings
==============

How many recordings of each surface are enough? Train on the first few, test on the last six.
"""

import matplotlib.pyplot as plt
import pandas as pd

import texclass as tx

dataset = tx.open_dataset("simulated6")
n_trained = [3, 4, 6]
figure, axis = plt.subplots(figsize=(7, 3.5))
for pipeline, shift in (("strese2015", -0.05), ("multiscale", 0.05)):
    best = []
    for n in n_trained:
        result = tx.benchmark(dataset, pipeline, protocol=f"repetition=1-{n} -> repetition=7-12", choose=True)
        best.append(result.data["choice"]["accuracy"])
    best = 100 * pd.DataFrame(best)[["mean", "low", "high"]]
    error = [best["mean"] - best["low"], best["high"] - best["mean"]]
    axis.errorbar([n + shift for n in n_trained], best["mean"], error, fmt="o-", capsize=3, label=pipeline)
axis.set_xticks(n_trained)
axis.set_xlabel("recordings of each surface that train")
axis.set_ylabel("accuracy in %")
axis.legend()
plt.show()

# %%
# Row and classifier are chosen inside the training part (`choose=True`), unseen by the tests: the best row
# of a table would have been chosen with them in view.
