"""
Reproduce the table of a paper
==============================

Evaluate every row of Table I of Strese, Schuwerk and Steinbach (2015) with every classifier. These are six
simulated surfaces; the paper has 69 real ones, so the accuracies cannot be compared directly.
"""

import texclass as tx

result = tx.benchmark("simulated6", "strese2015", n_folds=4)
result

# %%
# The table is a DataFrame with 95 % confidence intervals.

table = result.table.query("classifier == 'naive_bayes'").set_index("row")
(100 * table[["mean", "low", "high", "paper"]]).round(1)

# %%
# Plot rows with intervals, chance level and published accuracy:

axes = result.plot("naive_bayes")

# %%
# `result.save("results")` writes JSON, Markdown and figures, as `texclass benchmark simulated6` does.
