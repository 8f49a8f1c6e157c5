"""
Another sensor
==============

A model is trained with one sensor and asked with another: slower, and twice as loud. It follows from three
recordings of known surfaces, or from recordings of which nobody says the surface.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import texclass as tx

surfaces, operators = tx.simulate.surface_catalogue(6, seed=6), tx.simulate.operator_catalogue(2, seed=6)


def felt(surface, k, sensor=None, gain=1.0):
    """Return the strokes of one recording."""
    one = tx.simulate.record_freehand(
        surface, operators[k % 2], duration_s=3.0, fs=4000.0, seed=k, with_taps=False, sensor=sensor
    )
    return one.with_(acceleration=gain * one.acceleration)


def of_all(first, last, **tool):
    """Return recordings of all surfaces."""
    return [felt(surface, k, **tool) for surface in surfaces for k in range(first, last)]


recordings = {f"{r.material}-{i}": r for i, r in enumerate(of_all(0, 8))}
entries = tuple(tx.loaders.Entry(name, r.material) for name, r in recordings.items())
dataset = tx.loaders.Dataset("old", entries, lambda entry: recordings[entry.recording_id], "another sensor")
model = tx.train(dataset, "texclass", row="Spectrum at several scales", classifier="kernel")

# %%
# Three references with labels, or eighteen without.

new = {"sensor": tx.simulate.Sensor(bandwidth_hz=300.0), "gain": 2.0}
models = {
    "as trained": model,
    "three labelled": tx.adapt(model, [felt(surface, 20, **new) for surface in surfaces[:3]]),
    "18 unlabelled": tx.adapt(model, of_all(20, 23, **new), labelled=False),
}

# %%
# What it gets right, and what it calls unknown.

asked = of_all(30, 35, **new)
found = {}
for name, one in models.items():
    answers = one.predict(asked)
    right = np.mean([a.surface == r.material for a, r in zip(answers, asked, strict=True)])
    found[name] = {"right": right, "called unknown": np.mean([a.unknown for a in answers])}
pd.DataFrame(found).T.plot.barh(figsize=(7, 2.5), xlim=(0, 1))
plt.show()
pd.DataFrame(found).T.round(2)
