"""
Speed against accuracy
======================

Each feature costs milliseconds. Which subset buys most, and where does more stop to pay?
"""

import matplotlib.pyplot as plt

import texclass as tx

found = tx.trade_off("simulated6", "strese2015", n_folds=3, n_repeats=1, with_curves=False)
front, knee = found.data["front"], found.data["knee"]

# %%
# Subsets are chosen inside each training part, from the cheapest on; the *knee* is the point after which
# further milliseconds buy little.

figure, axis = plt.subplots(figsize=(7, 3.5))
axis.step([p["ms"] for p in front], [100 * p["accuracy"]["mean"] for p in front], "o-", where="post")
axis.plot(knee["ms"], 100 * knee["accuracy"]["mean"], "s", color="C1", markersize=10, label="knee")
axis.axhline(100 * found.data["full"]["mean"], color="C2", linestyle=":", label="all features")
axis.set_xlabel("milliseconds a recording")
axis.set_ylabel("accuracy in %")
axis.legend()
plt.show()

# %%
# A budget picks a point: ``tx.trade_off(..., limits=tx.tradeoff.Limits(max_ms=2),
# model_file="fast.skops")`` saves the recogniser that keeps it.
