"""
A first recording
=================

Open a dataset, plot a recording and compute its features.
"""

import texclass as tx

# %%
# Open a dataset by its name, by the path of its card, or as a folder with one subfolder per surface. The
# recordings are loaded when they are used. The recordings of this dataset are simulated.

dataset = tx.open_dataset("simulated6")
dataset

# %%
# A recording has a surface, an operator, a sampling rate and a unit.

recording = dataset[0]
recording

# %%
# Plot taps and movement, the clearest tap, and the spectrogram.

figure = tx.plot_recording(recording)
figure

# %%
# Features are a DataFrame with one row per recording. The set `strese2015` has those of the paper.

features = tx.extract(recording, "strese2015")
features[["hardness", "waviness", "fineness", "friction"]]
