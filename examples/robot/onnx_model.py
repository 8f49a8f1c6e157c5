"""
Export a model to ONNX
======================

An ONNX model classifies features without Python. The file is written only if its answers equal those of
scikit-learn.
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import onnxruntime

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Movement", classifier="lda")
file = Path(tempfile.mkdtemp()) / "surfaces.onnx"
exported = tx.robot.export_onnx(model, file)

# %%
# The metadata describe the input of the model.

session = onnxruntime.InferenceSession(file)
facts = session.get_modelmeta().custom_metadata_map
{name: fact[:60] for name, fact in facts.items()}

# %%
# In an application, your program computes the features. Here, texclass computes them.

columns = json.loads(facts["texclass.columns"])
X = tx.extract(dataset, "texclass")[columns].to_numpy(dtype=np.float64)
label, probabilities, p_known, unknown = session.run(None, {"features": X})
print(f"{np.mean(label == dataset.labels):.1%} of the training recordings correct")

# %%
# A kernel classifier stores training samples. With a size limit, it stores fewer samples, with 16 bits per
# value.

for max_kb in (None, 10):
    kernel = tx.train(dataset, row="Movement", classifier="kernel", max_kb=max_kb)
    onnx_file = tx.robot.export_onnx(kernel, file.with_name("kernel.onnx")).path
    accuracy = kernel.manifest.accuracy["mean"]
    size = onnx_file.stat().st_size
    print(f"{max_kb or 'no'} kB: {size} bytes, accuracy {accuracy:.1%} on held-out recordings")

# %%
# Plot the probabilities, with one row per recording and one column per surface.

figure, axis = plt.subplots(figsize=(6, 4))
axis.imshow(probabilities, aspect="auto", interpolation="none", cmap="Blues")
axis.grid(visible=False)
axis.set_xticks(range(6), model.surfaces, rotation=30)
axis.set_yticks(range(0, 72, 12), dataset.labels[::12])
plt.show()
