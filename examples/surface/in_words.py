"""
Describe a surface in words
===========================

Rate recordings on six scales: hard, rough, bumpy, sticky, fine, regular. Each value is the rank of one
feature among 100 simulated reference surfaces, from 0 (the lowest) to 10 (the highest); see
`texclass.haptics.scales`.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import pandas as pd

import texclass as tx

surfaces = tx.simulate.surface_catalogue(14, seed=6)
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
recordings = [
    tx.simulate.record_freehand(surfaces[i], operator, duration_s=6.0, seed=30).with_(recording_id=name)
    for i, name in ((1, "metal"), (3, "foam"), (13, "sandpaper"))
]
features = tx.extract(recordings, "scales")
values = tx.haptics.scale_values(features)
values.round(1)

# %%
# ``tx.haptics.describe(recordings)`` and ``texclass describe FILE`` also name the nearest reference surfaces,
# and state how far a feature is outside their range. They omit undefined scales: *hard* requires a tap, and
# *sticky* requires a friction channel.

figure, axes = plt.subplots(figsize=(7, 3.5))
values.T.plot.bar(ax=axes, rot=0, color=["C0", "C1", "C2"])
axes.set(ylim=(0, 10), ylabel="0 ... 10")
axes.legend(title="")
plt.show()

# %%
# Stroke a grating with ridges every 1.6 mm at two speeds. If the speed of the tool is recorded, *fine* and
# *regular* are computed from the spatial period of the ridges, which does not depend on the speed.

ridges = tx.simulate.surfaces.Grating(wavelength_mm=1.6, depth_um=8.0, sharpness=0.4, jitter=0.1)
grating = replace(surfaces[1], gratings=(ridges,), bumps=None)
straight = replace(operator, direction_deg=0.0)
strokes = [
    tx.simulate.record_freehand(
        grating, replace(straight, speed_mm_s=speed), duration_s=6.0, seed=2, recording_id=f"{speed} mm/s"
    )
    for speed in (90, 180)
]
with_speed = tx.extract(strokes, "scales")
without_speed = tx.extract([stroke.with_(speed=None) for stroke in strokes], "scales")
fine = {
    "ridges per mm": with_speed["ridge_density"],
    "fine": tx.haptics.scale_values(with_speed)["fine"],
    "fine, without speed": tx.haptics.scale_values(without_speed)["fine"],
}
pd.DataFrame(fine).round(2)
