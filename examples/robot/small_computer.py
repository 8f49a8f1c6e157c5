"""
For small computers
===================

What is accuracy worth in kilobytes, and in operations a second? Both are counted in the graph that would be
exported, at several rates, windows and word lengths.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import texclass as tx
from texclass.recognition import SmallLimits, embedded_tradeoff
from texclass.recognition.small_computers import at_rate

# A sensor of 1 kHz and three axes, windows of half a second and shorter; slopes, and levels of bands.
dataset = at_rate(tx.open_dataset("simulated6"), 1000)
features = tx.load_feature_set("texclass").restricted_to(["band_level", "slope_level"])
file = Path(tempfile.mkdtemp()) / "small.skops"
limits = SmallLimits(max_bytes=16_000, max_ops=1e6)
found = embedded_tradeoff(dataset, features, limits, max_seconds=0.5, model_file=file)
chosen = found.data["chosen"]
print(f"{chosen['accuracy']['mean']:.1%} with {chosen['bytes']} bytes")

# %%
# Every dot is a rate, a window, a word length, a number of columns and a classifier.

figure, axis = plt.subplots(figsize=(7, 4))
for bits, colour in ((32, "tab:blue"), (16, "tab:orange"), (8, "tab:green")):
    points = [p for p in found.data["points"] if p["sample_bits"] == bits]
    accuracy = [100 * p["accuracy"]["mean"] for p in points]
    kilobytes = [p["bytes"] / 1000 for p in points]
    axis.plot(kilobytes, accuracy, "o", color=colour, label=f"samples of {bits} bits")
axis.axvline(limits.max_bytes / 1000, color="grey", linestyle=":", label="limit")
axis.set(xlabel="window, constants and what is computed, kB", ylabel="accuracy, %", xscale="log")
axis.legend()
plt.show()

# %%
# The model is like any other: ask it, look at it, export it.

model = tx.load_model(file)
print(model, model.columns[:4], model.manifest.touch_s)
