"""
In words
========

Hard, rough, bumpy, sticky, fine, regular: six scales, each a monotone link to one measured feature
(`texclass.features.scales`). 0 and 10 are the lowest and the highest twentieth of simulated everyday
surfaces.
"""

import matplotlib.pyplot as plt

import texclass as tx

surfaces = tx.simulate.surface_catalogue(14, seed=6)
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
felt = [
    tx.simulate.record_freehand(surfaces[i], operator, duration_s=6.0, seed=30).with_(recording_id=name)
    for i, name in ((1, "metal"), (3, "foam"), (13, "sandpaper"))
]
measured = tx.extract(felt, "scales")
values = tx.features.scale_values(measured)
values.round(1)

# %%
# The same with its places among reference surfaces is ``tx.describe(felt)``, and on a command line
# ``texclass describe FILE``. What a recording cannot tell is left out: without a tap nothing is hard, without
# a friction channel nothing is sticky.

figure, axes = plt.subplots(figsize=(7, 3.5))
values.T.plot.bar(ax=axes, rot=0, color=["C0", "C1", "C2"])
axes.set(ylim=(-2, 12), ylabel="0 ... 10")
axes.axhline(0, color="0.6", linewidth=0.8)
axes.legend(title="")
plt.show()
