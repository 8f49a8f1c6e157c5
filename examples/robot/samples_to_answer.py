"""
Samples in, answer out
======================

The whole path of a model of touches in one ONNX file: conditioning, spectra, features, classifier, verdict.
Whoever has ONNX Runtime needs nothing else.
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import onnxruntime

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Several time scales", classifier="lda", touch_s=0.5, exportable=True)
file = Path(tempfile.mkdtemp()) / "windows.onnx"
exported = tx.robot.export_onnx(model, file, start="samples")
print(exported.of_samples)

# %%
# The metadata say what a window is, and hold what the file can be checked by.

session = onnxruntime.InferenceSession(file)
facts = session.get_modelmeta().custom_metadata_map
window = json.loads(facts["texclass.window"])
print(window)
print(tx.robot.check_onnx(file))

# %%
# A stroke, window by window, from its samples alone.

felt = dataset.load(dataset.entries[30])
start, stop = tx.segment(felt).movement
step = window["n_samples"] // 4
starts = np.arange(start, stop - window["n_samples"], step)
samples = np.stack([felt.acceleration[k : k + window["n_samples"]].T for k in starts]).astype(np.float32)
label, probabilities, p_known, unknown = session.run(None, {"samples": samples})

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5), sharex=True)
above.plot(np.arange(start, stop) / felt.fs, felt.acceleration[start:stop], linewidth=0.3)
above.set_ylabel("m/s²")
below.plot((starts + window["n_samples"]) / felt.fs, probabilities, label=model.materials)
below.set_xlabel("s")
below.set_ylabel("probability")
below.legend(fontsize="small")
above.set_title(f"{felt.material}: {np.mean(label == felt.material):.0%} of the windows say so")
plt.show()
