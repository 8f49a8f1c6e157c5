"""The models that the studies of the online recogniser listen with; trained in a minute or two each."""

from dataclasses import replace

from texclass.experiment import touches
from texclass.experiment.pipeline import PipelineDefinition, RowDefinition, load_pipeline
from texclass.experiment.windows import by_recording
from texclass.loaders import Dataset, open_dataset
from texclass.recognition import Model, train

SEVERAL_SCALES = (
    "band_level", "octave_level", "deep_octave_level", "slope_level", "slope_agreement",
    "curvature_agreement", "curvature_level", "curvature_shape", "vibration_level", "vibration_shape",
)  # fmt: skip
"""Features of a movement that short touches have; a stream has no friction channel."""
PRUNED_TOUCH_S = 0.5
PRUNED_COLUMNS = 16
BIOTAC_TOUCH_S = 0.25
TRAINED_REPETITIONS = 20
BIOTAC_STEP_S = 0.125
"""From one window to the next: that of the stream."""
BIOTAC_OPENING, BIOTAC_EVERY = 6, 4
"""The first windows of a slide all train, as its beginning is unlike the rest; then every fourth."""


def several_scales(features: tuple[str, ...] = SEVERAL_SCALES) -> PipelineDefinition:
    """Return the pipeline `texclass` with one row, of features that a short touch has."""
    shipped = load_pipeline("texclass")
    row = RowDefinition(name="Several time scales", features=features)
    kept = shipped.features.restricted_to(features)
    return shipped.model_copy(update={"features": kept, "rows": (row,), "additions": ()})


def pruned_model() -> Model:
    """Return the pruned pipeline at 10 kHz: a few columns, selected under a budget, of half a second."""
    return _pruned(several_scales())


def spectrum_model() -> Model:
    """Return the same of columns that share one Fourier transform."""
    return _pruned(several_scales(("octave_level", "deep_octave_level")))


def _pruned(pipeline: PipelineDefinition) -> Model:
    return train(
        open_dataset("simulated"),
        pipeline,
        row="budget",
        touch_s=PRUNED_TOUCH_S,
        max_features=PRUNED_COLUMNS,
    )


def biotac_model() -> Model:
    """Return a model of a quarter of a second of `biotac20`, of repetitions 1 to 20 only."""
    cut = touches(biotac_recordings(range(1, TRAINED_REPETITIONS + 1)), BIOTAC_TOUCH_S, step=BIOTAC_STEP_S)
    kept = [
        window
        for windows in by_recording(cut.entries)
        for i, window in enumerate(windows)
        # Other places in each repetition: a stream has its windows at all of them.
        if i < BIOTAC_OPENING or (i + (window.repetition or 0)) % BIOTAC_EVERY == 0
    ]
    windows = replace(cut, entries=tuple(kept))
    model = train(windows, several_scales(), classifier="kernel")
    return replace(model, manifest=model.manifest.model_copy(update={"touch_s": BIOTAC_TOUCH_S}))


def biotac_recordings(repetitions: range) -> Dataset:
    """Return the recordings of some repetitions of `biotac20`."""
    dataset = open_dataset("biotac20")
    entries = tuple(e for e in dataset.entries if e.repetition in repetitions)
    return replace(dataset, entries=entries, name=f"biotac20-repetitions{repetitions[0]}to{repetitions[-1]}")
