"""
The paper's table
=================

Every row of Table I of Strese, Schuwerk and Steinbach (2015), with every classifier, beside the published
figures. Here on six simulated surfaces; the paper had 69 real ones, so that the two are not to be compared.
"""

import texclass as tx

result = tx.benchmark("simulated6", "strese2015", n_folds=4)
result

# %%
# All of it is a DataFrame, accuracies with their intervals of 95 %.

table = result.table.query("classifier == 'naive_bayes'").set_index("row")
(100 * table[["mean", "low", "high", "paper"]]).round(1)

# %%
# Rows and intervals, chance and what was published:

figure = result.plot("naive_bayes")
figure

# %%
# `result.save("results")` writes JSON, Markdown and pictures; `texclass benchmark simulated6` does all of
# this from the command line.
