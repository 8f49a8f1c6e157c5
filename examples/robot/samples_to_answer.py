"""
From samples to the answer in ONNX
==================================

One ONNX file contains all steps of a model that is trained on windows: conditioning, spectra, features,
classifier and novelty detection. To use it, you need only ONNX Runtime.
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import onnxruntime

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Several time scales", classifier="lda", window_s=0.5, exportable=True)
file = Path(tempfile.mkdtemp()) / "windows.onnx"
exported = tx.robot.export_onnx(model, file, start="samples")
print(exported.sample_parity)

# %%
# The metadata describe the window. They also contain test windows with their answers, with which `check_onnx`
# checks the file.

session = onnxruntime.InferenceSession(file)
facts = session.get_modelmeta().custom_metadata_map
window = json.loads(facts["texclass.window"])
print(window)
print(tx.robot.check_onnx(file))

# %%
# Classify a stroke, window by window.

recording = dataset.load(dataset.entries[30])
start, stop = tx.find_phases(recording).movement
step = window["n_samples"] // 4
starts = np.arange(start, stop - window["n_samples"], step)
samples = np.stack([recording.acceleration[k : k + window["n_samples"]].T for k in starts]).astype(np.float32)
label, probabilities, p_known, unknown = session.run(None, {"samples": samples})

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5), sharex=True)
above.plot(np.arange(start, stop) / recording.fs, recording.acceleration[start:stop], linewidth=0.3)
above.set_ylabel("m/s²")
below.plot((starts + window["n_samples"]) / recording.fs, probabilities, label=model.surfaces)
below.set_xlabel("s")
below.set_ylabel("probability")
below.legend(fontsize="small")
above.set_title(f"{recording.surface}: {np.mean(label == recording.surface):.0%} of the windows correct")
plt.show()
