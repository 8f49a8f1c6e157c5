"""
A first recording
=================

Open a dataset, look at one recording, compute its features.
"""

import texclass as tx

# %%
# A dataset is opened by name, by the path of its card, or as a folder with one subfolder a material.
# Nothing is read before it is asked for; this one is simulated.

dataset = tx.open_dataset("simulated6")
dataset

# %%
# A recording knows what was explored, by whom, how often it was sampled and in which unit.

recording = dataset[0]
recording

# %%
# At a glance: the taps, the strokes, the clearest tap and the spectrogram.

figure = tx.plot_recording(recording)
figure

# %%
# Features are a DataFrame, one row a recording. The set `strese2015` holds those of the paper, as printed.

features = tx.extract(recording, "strese2015")
features[["hardness", "waviness", "fineness", "friction"]]
