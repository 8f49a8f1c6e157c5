"""
Reproduce the table of a paper
==============================

Evaluate every row of Table I of Strese, Schuwerk and Steinbach (2015) with every classifier. This dataset has
six simulated surfaces and the paper 69 real surfaces, so the accuracies cannot be compared directly.
"""

import texclass as tx

result = tx.benchmark("simulated6", "strese2015", n_folds=4)
result

# %%
# `result.table` is a DataFrame of accuracies with 95 % confidence intervals.

table = result.table.query("classifier == 'naive_bayes'").set_index("row")
(100 * table[["mean", "low", "high", "paper"]]).round(1)

# %%
# Plot the accuracy of each row with its interval, the chance level and the published accuracy:

axes = result.plot("naive_bayes")

# %%
# `result.save("results")` writes the same JSON, Markdown and figures as `texclass benchmark simulated6`.
