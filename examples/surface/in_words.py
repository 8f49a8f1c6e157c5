"""
In words
========

Hard, rough, bumpy, sticky, fine, regular: six scales, each a monotone link to one measured feature
(`texclass.haptics.scales`). 0 and 10 are the lowest and the highest twentieth of simulated everyday
surfaces. Where the speed of the tool was recorded, fine and regular follow the ribs found along its way.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import pandas as pd

import texclass as tx

surfaces = tx.simulate.surface_catalogue(14, seed=6)
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
felt = [
    tx.simulate.record_freehand(surfaces[i], operator, duration_s=6.0, seed=30).with_(recording_id=name)
    for i, name in ((1, "metal"), (3, "foam"), (13, "sandpaper"))
]
measured = tx.extract(felt, "scales")
values = tx.haptics.scale_values(measured)
values.round(1)

# %%
# The same with its places among reference surfaces is ``tx.haptics.describe(felt)``, and on a command line
# ``texclass describe FILE``. What a recording cannot tell is left out: without a tap nothing is hard, without
# a friction channel nothing is sticky.

figure, axes = plt.subplots(figsize=(7, 3.5))
values.T.plot.bar(ax=axes, rot=0, color=["C0", "C1", "C2"])
axes.set(ylim=(-2, 12), ylabel="0 ... 10")
axes.axhline(0, color="0.6", linewidth=0.8)
axes.legend(title="")
plt.show()

# %%
# A grating, its ribs 1.6 mm apart, is stroked slowly and twice as fast. Over time nothing tells a slower hand
# from ribs further apart; over the way of the tool, which its recorded speed gives, the ribs are the same.

ribs = tx.simulate.surfaces.Grating(wavelength_mm=1.6, depth_um=8.0, sharpness=0.4, jitter=0.1)
grating = replace(surfaces[1], gratings=(ribs,), bumps=None)
across = replace(operator, direction_deg=0.0)
strokes = [
    tx.simulate.record_freehand(
        grating, replace(across, speed_mm_s=speed), duration_s=6.0, seed=2, recording_id=f"{speed} mm/s"
    )
    for speed in (90, 180)
]
known = tx.extract(strokes, "scales")
unknown = tx.extract([one.with_(speed=None) for one in strokes], "scales")
fine = {
    "ribs per mm": known["rib_density"],
    "fine": tx.haptics.scale_values(known)["fine"],
    "fine, without speed": tx.haptics.scale_values(unknown)["fine"],
}
pd.DataFrame(fine).round(2)
