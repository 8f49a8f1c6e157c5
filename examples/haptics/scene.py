"""
Plan a scene
============

Select the cheapest model of each surface that is within the tolerance at held-out speeds and forces.
"""

import json

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

scene = tx.haptics.scene.read_scene("example")
two = {name: scene.surfaces[name] for name in ("fabric", "plastic")}
plan = tx.haptics.plan_scene(scene.model_copy(update={"surfaces": two}))
for surface in plan.surfaces:
    print(f"{surface.name}: {surface.model.kind}, order {surface.model.order}; {surface.reason}")

# %%
# Compare the cost with models of order 400 for every surface, as in the thesis [oeztuerk2018]:

print(f"{plan.saving:.0f} times fewer operations per sample; within tolerance and budget: {plan.is_feasible}")

# %%
# Plot the level against the speed, for held-out recordings and for the models:

figure, axis = plt.subplots(figsize=(6, 3))
for surface, colour in zip(json.loads(plan.to_json())["surfaces"], ("C2", "C1"), strict=True):
    held_out, curve = (surface["speed_dependence"][key] for key in ("test", "curve"))
    axis.plot(
        held_out["speed"], held_out["level"], "o", color=colour, label=f"{surface['surface']}, held out"
    )
    axis.plot(held_out["speed"], held_out["model_level"], "kx")
    axis.fill_between(curve["speed"], curve["level"][0], curve["level"][2], color=colour, alpha=0.2)
axis.set_xscale("log")
axis.set_xlabel("mm/s; crosses and bands (lowest to highest force): the models")
axis.set_ylabel("dB re 1 m/s²")
axis.legend()
plt.show()

# %%
# Render a path that strokes each surface from slow to fast.

path = tx.haptics.scene.sweep_path(
    list(plan.scene.model_indices), speeds_mm_s=(40, 160), forces_n=(0.5, 1.5), fs=plan.scene.fs
)
rendered = tx.haptics.scene.render_path(plan.scene, path)
figure, axis = plt.subplots(figsize=(9, 3))
axis.plot(path.time_s[1:], rendered.samples, linewidth=0.5)
for name in two:
    on = np.array(path.surfaces) == name
    axis.axvspan(
        path.time_s[on].min(), path.time_s[on].max(), alpha=0.1, color="C2" if name == "fabric" else "C1"
    )
    axis.text(path.time_s[on].min(), axis.get_ylim()[1], f" {name}", va="top")
axis.set_xlabel("time in s")
axis.set_ylabel("m/s²")
plt.show()
