"""
A first recording
=================

Open a dataset, plot a recording and compute its features.
"""

import texclass as tx

# %%
# Open a dataset by its name, by the path of its card, or as a folder with one subfolder per surface. Each
# recording is loaded when it is first used. This dataset contains simulated recordings.

dataset = tx.open_dataset("simulated6")
dataset

# %%
# A recording has a surface, an operator, a sampling rate and a unit.

recording = dataset[0]
recording

# %%
# Plot the taps and the movement, the clearest tap, and the spectrogram.

figure = tx.plot_recording(recording)
figure

# %%
# Compute the features: the result is a DataFrame with one row per recording. The feature set `strese2015`
# contains the features of Strese, Schuwerk and Steinbach (2015).

features = tx.extract(recording, "strese2015")
features[["hardness", "waviness", "fineness", "friction"]]
