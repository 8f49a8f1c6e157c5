"""
Adapt to another sensor
=======================

A model is trained with one sensor, and used with another sensor that has a lower bandwidth and twice the
gain. It is adapted with three labelled recordings, or with 18 unlabelled recordings.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import texclass as tx

surfaces, operators = tx.simulate.surface_catalogue(6, seed=6), tx.simulate.operator_catalogue(2, seed=6)


def record(surface, k, sensor=None, gain=1.0):
    """Return a simulated recording of strokes."""
    recording = tx.simulate.record_freehand(
        surface, operators[k % 2], duration_s=3.0, fs=4000.0, seed=k, with_taps=False, sensor=sensor
    )
    return recording.with_(acceleration=gain * recording.acceleration)


def record_all(first, last, **tool):
    """Return the recordings `first` to `last - 1` of all surfaces."""
    return [record(surface, k, **tool) for surface in surfaces for k in range(first, last)]


recordings = {f"{r.surface}-{i}": r for i, r in enumerate(record_all(0, 8))}
entries = tuple(tx.loaders.Entry(name, r.surface) for name, r in recordings.items())
dataset = tx.loaders.Dataset("old", entries, lambda entry: recordings[entry.recording_id], "another sensor")
model = tx.train(dataset, "texclass", row="Spectrum at several scales", classifier="kernel")

# %%
# Adapt the model with three labelled reference recordings, or with 18 unlabelled ones.

new = {"sensor": tx.simulate.Sensor(bandwidth_hz=300.0), "gain": 2.0}
models = {
    "as trained": model,
    "three labelled": tx.adapt(model, [record(surface, 20, **new) for surface in surfaces[:3]]),
    "18 unlabelled": tx.adapt(model, record_all(20, 23, **new), use_labels=False),
}

# %%
# Compare the accuracy and the fraction of `unknown` answers.

test_set = record_all(30, 35, **new)
shares = {}
for name, adapted in models.items():
    answers = adapted.predict(test_set)
    correct = np.mean([a.surface == r.surface for a, r in zip(answers, test_set, strict=True)])
    shares[name] = {"correct": correct, "unknown": np.mean([a.unknown for a in answers])}
pd.DataFrame(shares).T.plot.barh(figsize=(7, 2.5), xlim=(0, 1))
plt.show()
pd.DataFrame(shares).T.round(2)
