"""
A first recording
=================

Open a dataset, plot a recording and compute its features.
"""

import texclass as tx

# %%
# Open a dataset by name, by the path of its card, or as a folder with one subfolder per surface. Recordings
# are read when they are used; these are simulated.

dataset = tx.open_dataset("simulated6")
dataset

# %%
# A recording has a surface, an operator, a sampling rate and a unit.

recording = dataset[0]
recording

# %%
# Plot its taps and strokes, the clearest tap and the spectrogram.

figure = tx.plot_recording(recording)
figure

# %%
# Features are a DataFrame with one row per recording. The set `strese2015` contains those of the paper.

features = tx.extract(recording, "strese2015")
features[["hardness", "waviness", "fineness", "friction"]]
