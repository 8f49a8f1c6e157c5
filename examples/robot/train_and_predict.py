"""
Train a model and classify
==========================

`train` fits a classifier, calibrates its probabilities and measures its accuracy on held-out recordings.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Movement", classifier="lda")
tx.reporting.print_document(tx.recognition.model_document(model))

# %%
# Save and load the model. The file contains no code, and loading fails if it names a class that is not on the
# allow-list.

file = Path(tempfile.mkdtemp()) / "surfaces.skops"
model.save(file)
model = tx.load_model(file)

# %%
# Each answer contains the predicted surface, its probability, the second most probable surface, and whether
# the surface is unknown.

answers = {r.recording_id: model.answer(r) for r in (dataset[0], dataset[40], dataset[70])}
pd.DataFrame(answer.to_dict() for answer in answers.values())

# %%
figure, axis = plt.subplots(figsize=(8, 3.5))
pd.DataFrame({name: answer.probabilities for name, answer in answers.items()}).plot.barh(
    ax=axis, legend=False
)
figure.legend(loc="outside upper left", ncols=3)
axis.set_xlabel("probability")
plt.show()
