"""Recognition: models that are trained, saved and asked which surface this is."""

from texclass.recognition.answer import Answer
from texclass.recognition.blocks import Block, BlockSource
from texclass.recognition.calibration import Calibration, expected_calibration_error, fit_calibration
from texclass.recognition.files import ModelFileError, read_manifest_of
from texclass.recognition.live_sources import open_source
from texclass.recognition.manifest import Manifest
from texclass.recognition.model import Model, joined, load_model
from texclass.recognition.predict import Prediction, predict
from texclass.recognition.train import TrainingSettings, train
from texclass.recognition.unknown import Novelty

__all__ = [
    "Answer",
    "Block",
    "BlockSource",
    "Calibration",
    "Manifest",
    "Model",
    "ModelFileError",
    "Novelty",
    "Prediction",
    "TrainingSettings",
    "expected_calibration_error",
    "fit_calibration",
    "joined",
    "load_model",
    "open_source",
    "predict",
    "read_manifest_of",
    "train",
]
