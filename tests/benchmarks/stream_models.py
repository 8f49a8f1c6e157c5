"""The models that the studies of the online recogniser listen with; trained in a minute or two each."""

from dataclasses import replace

from texclass.experiment import touches
from texclass.experiment.choice import Limits
from texclass.experiment.definition import PipelineDefinition, RowDefinition, load_pipeline
from texclass.loaders import Dataset, open_dataset
from texclass.recognition import Model, TrainingSettings, train

SEVERAL_SCALES = (
    "band_level", "octave_level", "deep_octave_level", "slope_level", "slope_agreement",
    "curvature_agreement", "curvature_level", "curvature_shape", "vibration_level", "vibration_shape",
)  # fmt: skip
"""Features of a movement that short touches have; a stream has no friction channel."""
PRUNED_TOUCH_S = 0.5
PRUNED_COLUMNS = 16
BIOTAC_TOUCH_S = 0.25
TRAINED_REPETITIONS = 20
BIOTAC_STEP_S = 0.5
"""From one training window to the next: all of a recording, in half of its windows."""


def several_scales(features: tuple[str, ...] = SEVERAL_SCALES) -> PipelineDefinition:
    """Return the pipeline `texclass` with one row, of features that a short touch has."""
    shipped = load_pipeline("texclass")
    return replace(
        shipped,
        feature_set=shipped.feature_set.restricted_to(features),
        rows=(RowDefinition("Several time scales", features),),
        additions=(),
    )


def pruned_model() -> Model:
    """Return the pruned pipeline at 10 kHz: a few columns, selected under a budget, of half a second."""
    return _pruned(several_scales())


def spectrum_model() -> Model:
    """Return the same of columns that share one Fourier transform."""
    return _pruned(several_scales(("octave_level", "deep_octave_level")))


def _pruned(pipeline: PipelineDefinition) -> Model:
    limits = Limits(max_features=PRUNED_COLUMNS)
    return train(
        open_dataset("simulated"),
        pipeline,
        TrainingSettings(row="budget", touch_s=PRUNED_TOUCH_S, limits=limits),
    )


def biotac_model() -> Model:
    """Return a model of a quarter of a second of `biotac20`, of repetitions 1 to 20 only."""
    windows = touches(
        biotac_recordings(range(1, TRAINED_REPETITIONS + 1)), BIOTAC_TOUCH_S, step=BIOTAC_STEP_S
    )
    model = train(windows, several_scales(), TrainingSettings(classifier="kernel"))
    return replace(model, manifest=replace(model.manifest, touch_s=BIOTAC_TOUCH_S))


def biotac_recordings(repetitions: range) -> Dataset:
    """Return the recordings of some repetitions of `biotac20`."""
    dataset = open_dataset("biotac20")
    entries = tuple(e for e in dataset.entries if e.repetition in repetitions)
    return replace(dataset, entries=entries, name=f"biotac20-repetitions{repetitions[0]}to{repetitions[-1]}")
