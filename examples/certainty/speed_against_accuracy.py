"""
Accuracy against latency
========================

Each feature adds latency. The Pareto front shows the best accuracy that is possible at each latency.
"""

import matplotlib.pyplot as plt

import texclass as tx

result = tx.trade_off("simulated6", "strese2015", n_folds=3, n_repeats=1, with_curves=False)
front, knee = result.data["front"], result.data["knee"]

# %%
# Feature subsets are selected inside each training set. Beyond the *knee point*, additional latency gains
# little accuracy.

figure, axis = plt.subplots(figsize=(7, 3.5))
axis.step([p["ms"] for p in front], [100 * p["accuracy"]["mean"] for p in front], "o-", where="post")
axis.plot(knee["ms"], 100 * knee["accuracy"]["mean"], "s", color="C1", markersize=10, label="knee point")
axis.axhline(100 * result.data["full"]["mean"], color="C2", linestyle=":", label="all features")
axis.set_xlabel("latency in ms per recording")
axis.set_ylabel("accuracy in %")
axis.legend()
plt.show()

# %%
# To save the best model within a latency budget, call ``tx.trade_off(...,
# limits=tx.tradeoff.Limits(max_ms=2), model_file="fast.skops")``.
