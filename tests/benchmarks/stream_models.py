"""The models that `stream_study.py` listens with; trained in a minute or two each."""

from dataclasses import replace
from pathlib import Path

from texclass.experiment import PipelineDefinition, load_pipeline, touches
from texclass.experiment.pipeline import RowDefinition
from texclass.experiment.windows import by_recording
from texclass.loaders import Dataset, open_dataset
from texclass.recognition import Model, load_model, train

SPECTRUM = ("octave_level", "deep_octave_level")
"""Features that share one Fourier transform."""
SEVERAL_SCALES = (
    "band_level", "octave_level", "deep_octave_level", "slope_level", "slope_agreement",
    "curvature_agreement", "curvature_level", "curvature_shape", "vibration_level", "vibration_shape",
)  # fmt: skip
"""Features of a movement that short touches have; a stream has no friction channel."""
PRUNED_TOUCH_S, PRUNED_COLUMNS = 0.5, 16
BIOTAC_TOUCH_S, TRAINED_REPETITIONS = 0.25, 20
HOP_S = 0.125
"""From one window of `biotac20` to the next, in training and in the stream."""
BIOTAC_OPENING, BIOTAC_EVERY = 6, 4
"""The first windows of a slide all train, as its beginning is unlike the rest; then every fourth."""


def model_of(name: str, folder: Path | None) -> Model:
    """Return a model, trained unless it stands in the folder.

    "pruned": 10 kHz, half a second, a few columns selected under a budget; "spectrum": the same of columns
    that share one Fourier transform; "biotac": a quarter of a second of repetitions 1 to 20 of `biotac20`.
    """
    path = folder and folder / f"{name}_model.skops"
    if path and path.is_file():
        return load_model(path)
    if name == "biotac":
        model = _biotac()
    else:
        pipeline = _pipeline(SPECTRUM if name == "spectrum" else SEVERAL_SCALES)
        budget = {"touch_s": PRUNED_TOUCH_S, "max_features": PRUNED_COLUMNS}
        model = train(open_dataset("simulated"), pipeline, row="budget", **budget)
    if path is None:
        return model
    model.save(path)
    return load_model(path)


def _pipeline(features: tuple[str, ...]) -> PipelineDefinition:
    """Return the pipeline `texclass` with one row, of these features."""
    shipped = load_pipeline("texclass")
    row = RowDefinition(name="Several time scales", features=features)
    kept = shipped.features.restricted_to(features)
    return shipped.model_copy(update={"features": kept, "rows": (row,), "additions": ()})


def _biotac() -> Model:
    cut = touches(biotac_recordings(range(1, TRAINED_REPETITIONS + 1)), BIOTAC_TOUCH_S, step=HOP_S)
    kept = [
        window
        for windows in by_recording(cut.entries)
        for i, window in enumerate(windows)
        # Other places in each repetition: a stream has its windows at all of them.
        if i < BIOTAC_OPENING or (i + (window.repetition or 0)) % BIOTAC_EVERY == 0
    ]
    model = train(replace(cut, entries=tuple(kept)), _pipeline(SEVERAL_SCALES), classifier="kernel")
    return replace(model, manifest=model.manifest.model_copy(update={"touch_s": BIOTAC_TOUCH_S}))


def biotac_recordings(repetitions: range) -> Dataset:
    """Return the recordings of some repetitions of `biotac20`."""
    dataset = open_dataset("biotac20")
    entries = tuple(e for e in dataset.entries if e.repetition in repetitions)
    return replace(dataset, entries=entries, name=f"biotac20-repetitions{repetitions[0]}to{repetitions[-1]}")
