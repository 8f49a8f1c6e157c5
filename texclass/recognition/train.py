"""Dataset and pipeline in, a trained model out; what is chosen is chosen by cross-validation alone."""

from dataclasses import dataclass

import numpy as np

from texclass.experiment.choice import NO_LIMITS, Limits, check
from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import cached_table, metadata
from texclass.experiment.pipeline import PipelineDefinition
from texclass.experiment.protocols import splits_of
from texclass.experiment.windows import touches
from texclass.experiment.workers import Progress
from texclass.loaders.dataset import Dataset
from texclass.recognition.calibration import fit_calibration
from texclass.recognition.candidates import candidates_of
from texclass.recognition.facts import manifest_of
from texclass.recognition.holding_out import holding_out
from texclass.recognition.model import Model
from texclass.recognition.reasons import Ranges
from texclass.recognition.study import Choice, Study
from texclass.recognition.unknown import Novelty, check_false_alarms, fit_nearness, kind_for
from texclass.recording import Samples

FALSE_ALARMS = 0.05


@dataclass(frozen=True)
class TrainingSettings:
    """How a model is trained.

    Attributes
    ----------
    row, classifier
        Of the pipeline; the best by cross-validation where None.
    limits
        Milliseconds and columns that may be spent.
    touch_s
        Seconds of movement of one answer; whole recordings where None.
    protocol
        How recordings are held out; see `holding_out` where None. `blocks` chooses, calibrates and sets the
        threshold on later repetitions than it trains on, as a sensor that drifts asks for.
    false_alarms
        Share of known surfaces that may be called unknown.
    """

    row: str | None = None
    classifier: str | None = None
    limits: Limits = NO_LIMITS
    touch_s: float | None = None
    protocol: str | None = None
    false_alarms: float = FALSE_ALARMS


def train(
    dataset: Dataset,
    pipeline: PipelineDefinition,
    settings: TrainingSettings = TrainingSettings(),
    *,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Choose a row and a classifier by cross-validation, train them on everything, calibrate.

    Held-out decisions of the choice also give its probabilities, the threshold for unknown surfaces, and the
    accuracy the manifest states, from which the luck of being chosen is taken out.

    Parameters
    ----------
    dataset : Dataset
        Whole labelled recordings of at least two materials.
    pipeline : PipelineDefinition
        What may be trained.
    settings : TrainingSettings
        How.
    n_jobs : int
        Processes.
    skip_bad : bool
        Leave bad recordings out instead of stopping at the first.
    progress : callable, optional
        Called with (done, total, what).

    Raises
    ------
    RecordingError
        At a bad recording, or if none is left.
    ValueError
        If the protocol cannot hold recordings out, a name is unknown, or nothing is affordable.
    """
    check(settings.limits)
    felt = _felt(dataset, settings, n_jobs, progress)
    known = metadata(felt.entries)
    held = holding_out(settings.protocol, pipeline.protocol.name, known, settings.false_alarms)
    # Before the features: what is impossible should not cost an extraction.
    splits = splits_of(held.protocol, known, pipeline.seed)
    check_false_alarms(settings.false_alarms, sum(len(test) for _, test in splits))
    table = cached_table(
        felt,
        *pipeline.needed,
        channels=pipeline.channels,
        n_jobs=n_jobs,
        skip_bad=skip_bad,
        progress=progress,
    )
    meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), pipeline.channels)
    candidates = candidates_of(
        pipeline, table, meter, settings.limits, row=settings.row, classifier=settings.classifier
    )
    study = Study(table, held, splits_of(held.protocol, table.frame, pipeline.seed), pipeline.seed)
    chosen = study.choose(candidates, n_jobs, progress)
    return _made(chosen, study, felt, pipeline, settings, meter)


def _made(
    chosen: Choice,
    study: Study,
    felt: Dataset,
    pipeline: PipelineDefinition,
    settings: TrainingSettings,
    meter: CostMeter,
) -> Model:
    recogniser, held_out = chosen.recogniser, chosen.held_out
    X = study.values(recogniser[0].plan_)
    calibration = fit_calibration(held_out.decisions, held_out.labels)
    novelty, stretch = _novelty(chosen, X, study, settings.false_alarms)
    manifest = manifest_of(
        chosen, study, felt, pipeline, meter, calibration, novelty, settings.touch_s, stretch=stretch
    )
    return Model(recogniser, calibration, novelty, Ranges.of(X), manifest, study.table.left_out)


def _felt(dataset: Dataset, settings: TrainingSettings, n_jobs: int, progress: Progress | None) -> Dataset:
    if settings.limits.max_seconds is not None or settings.limits.materials:
        raise ValueError(
            "limits hold seconds or materials; the rule is touch_s, and a dataset of the materials"
        )
    if settings.touch_s is None:
        return dataset
    return touches(dataset, settings.touch_s, n_jobs=n_jobs, progress=progress)


def _novelty(chosen: Choice, X: Samples, study: Study, false_alarms: float) -> tuple[Novelty, float]:
    """Return when a surface is unknown, and the factor by which drift has stretched distances."""
    recogniser = chosen.recogniser
    kind = kind_for(recogniser[-1])
    if kind == "decision":
        return Novelty(kind, np.sort(chosen.held_out.strange), false_alarms, None), 1.0
    prepared = X
    for _, step in recogniser.steps[1:-1]:
        prepared = step.transform(prepared)
    near = fit_nearness(prepared, np.unique(study.y, return_inverse=True)[1])
    far, stretch = study.distances(chosen)
    return Novelty(kind, np.sort(far), false_alarms, near), stretch
