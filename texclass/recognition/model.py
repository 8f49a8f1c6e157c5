"""A trained model: a recording in, an answer out."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from sklearn import config_context
from sklearn.pipeline import Pipeline

from texclass.experiment.feature_table import LeftOut
from texclass.experiment.windows import cut
from texclass.features.extractor import Plan
from texclass.phases import segment
from texclass.recognition.answer import Answer
from texclass.recognition.calibration import Calibration, class_scores
from texclass.recognition.files import ModelFileError, read_model_file, write_model_file
from texclass.recognition.manifest import Manifest
from texclass.recognition.probe import difference, probe_values
from texclass.recognition.reasons import Ranges, outside, too_short, undefined, unlike_in_kind
from texclass.recognition.source import Source
from texclass.recognition.threads import single_threaded
from texclass.recognition.unknown import Novelty, strangeness
from texclass.recording import Recording, Samples
from texclass.tradeoff.deploy import Recogniser

SAME_ANSWER = 1e-6
"""Difference of a probability that rounding on another machine explains."""


@dataclass(frozen=True, eq=False)
class Model:
    """A trained recogniser with calibrated probabilities and a sense of what it does not know.

    Attributes
    ----------
    recogniser
        Features, preparation, classifier.
    calibration
        Decisions -> probabilities.
    novelty
        When a surface is unknown.
    ranges
        What values the columns had in training.
    manifest
        What a user should know of it.
    left_out
        Bad recordings that were skipped in training; not saved, but for their names in the manifest.

    Examples
    --------
    >>> model = load_model("surface.skops")  # doctest: +SKIP
    >>> model.answer(recording).surface  # doctest: +SKIP
    'oak'
    """

    recogniser: Recogniser
    calibration: Calibration
    novelty: Novelty
    ranges: Ranges
    manifest: Manifest
    left_out: tuple[LeftOut, ...] = ()

    @cached_property
    def plan(self) -> Plan:
        """What is computed of a recording."""
        plan: Plan = self.recogniser[0].plan_
        return plan

    @cached_property
    def materials(self) -> tuple[str, ...]:
        """The surfaces it knows, in the order of its decisions."""
        return tuple(map(str, self.recogniser[-1].classes_))

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that `answer_values` takes, in order."""
        return self.plan.columns

    def answer(self, recording: Recording) -> Answer:
        """Say which surface a recording (or one touch) is of.

        Parameters
        ----------
        recording : Recording
            Rate, unit and channels as in training. Phases are found unless it declares them.

        Raises
        ------
        ValueError
            If it lacks a channel, or nothing fills what is undefined; the message names the recording.
        """
        unlike = unlike_in_kind(recording, self.manifest)
        phases = segment(recording)
        row = self.plan.compute(recording.with_(phases=phases))
        nothing = ("no feature has a value",) if np.isnan(row.values).all() else ()
        told = (
            *unlike, *nothing, *too_short(recording, phases, self.manifest), *undefined(row.reasons),
            *recording.flags,
        )  # fmt: skip
        return self.answer_values(
            row.values, reasons=told, recording_id=recording.recording_id, judged=not (unlike or nothing)
        )

    def answer_values(
        self, values: Samples, *, reasons: tuple[str, ...] = (), recording_id: str = "", judged: bool = True
    ) -> Answer:
        """Say which surface the values of the features are of.

        Parameters
        ----------
        values : ndarray of shape (n_columns,)
            As `columns` names them; NaN where undefined.
        reasons : tuple of str
            What is known of the recording already.
        recording_id : str
            For the answer.
        judged : bool
            False makes the answer `unknown` whatever the values are.

        Raises
        ------
        ValueError
            If the number of values is another, or nothing fills what is undefined.
        """
        row = np.asarray(values, dtype=np.float64)
        if row.shape != (len(self.columns),):
            raise ValueError(
                f"values have shape {row.shape}; the rule is one of each of {len(self.columns)} columns"
            )
        p, p_known = (one[0] for one in self.judge(row[None]))
        best, second = np.argsort(-p, kind="stable")[:2]
        strange = bool(p_known <= self.novelty.false_alarms)
        said = (f"unlike every known surface (p = {p_known:.2g})",) if strange else ()
        far = outside(row, self.columns, self.ranges) if judged else ()
        return Answer(
            recording_id=recording_id,
            surface=self.materials[best],
            probability=float(p[best]),
            runner_up=self.materials[second],
            unknown=strange or not judged,
            p_known=float(p_known),
            reasons=(*said, *reasons, *far),
            probabilities=dict(zip(self.materials, p.tolist(), strict=True)),
        )

    def judge(self, X: Samples) -> tuple[Samples, Samples]:
        """Return probabilities (n, n_materials), and p-values of "known" (n,), of rows of features."""
        with single_threaded(), config_context(assume_finite=True, skip_parameter_validation=True):
            prepared = self._preparation.transform(X)
            if not np.isfinite(prepared).all():
                raise ValueError("features are undefined; the rule is a pipeline with a step that fills them")
            decisions = class_scores(self.recogniser[-1], prepared)
        novelty = self.novelty
        strange = strangeness(novelty.kind, decisions, prepared, novelty.nearness)
        return self.calibration(decisions), novelty.p_value(strange)

    def answer_touches(self, recording: Recording) -> Answer:
        """Say which surface a recording is of that is longer than the touches the model was trained on.

        Its movement is cut into touches, whose probabilities are averaged: touches of one stroke are no
        independent witnesses. It is unknown if half of the touches are.
        """
        touches = tuple(self.answer(touch) for touch in self.cut(recording))
        return joined(touches, recording.recording_id) if touches else self.answer(recording)

    def cut(self, recording: Recording) -> tuple[Recording, ...]:
        """Return the touches of a recording, one after another; none without movement enough for one."""
        if self.manifest.touch_s is None:
            return (recording,)
        start, stop = segment(recording).movement or (0, 0)
        n = max(1, round(self.manifest.touch_s * recording.fs))
        starts = range(start, stop - n + 1, n)
        return tuple(
            cut(recording, k, k + n, f"{recording.recording_id}#{i}") for i, k in enumerate(starts, 1)
        )

    def save(self, path: str | Path) -> None:
        """Write a model file: skops with a manifest."""
        values = probe_values(self.plan, self.manifest.fs, self.manifest.unit)
        document = {
            "recogniser": self.recogniser.document(),
            "calibration": {"beta": self.calibration.beta, "lapse": self.calibration.lapse},
            "novelty": self.novelty.document(),
            "ranges": dict(vars(self.ranges)),
            "probe": {"values": values, "probabilities": self.judge(self._typical)[0][0]},
        }
        write_model_file(path, document, self.manifest)

    @cached_property
    def _preparation(self) -> Any:
        """The steps between features and classifier."""
        steps = self.recogniser.steps[1:-1]
        return Pipeline(steps or [("nothing", "passthrough")])

    @property
    def _typical(self) -> Samples:
        return np.nan_to_num(self.ranges.median)[None]


def joined(answers: Sequence[Answer], recording_id: str) -> Answer:
    """Return the answer of several touches of one recording: the mean of their probabilities."""
    mean = {m: float(np.mean([a.probabilities[m] for a in answers])) for m in answers[0].probabilities}
    best, second = sorted(mean, key=lambda material: -mean[material])[:2]
    n_unknown = sum(answer.unknown for answer in answers)
    said = (f"{n_unknown} of {len(answers)} touches are of no known surface",) if n_unknown else ()
    others = (r for answer in answers for r in answer.reasons if not r.startswith("unlike every"))
    return Answer(
        recording_id=recording_id,
        surface=best,
        probability=mean[best],
        runner_up=second,
        unknown=2 * n_unknown >= len(answers),
        p_known=float(np.median([answer.p_known for answer in answers])),
        reasons=(*said, *tuple(dict.fromkeys(others))[:5]),
        probabilities=mean,
    )


def load_model(path: str | Path) -> Model:
    """Read a model file; nothing but known classes is ever loaded.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelFileError
        If it is none, was changed, is newer than this program, names a class that is not trusted or a
        feature that is not known here, or gives other answers here than when it was trained.

    Warns
    -----
    UserWarning
        If the features give other values than when it was trained.
    """
    document, manifest = read_model_file(path)
    try:
        with np.errstate(all="ignore"):  # of damaged numbers, whose answers are then others
            model, same_code = _model_of(document, manifest)
            changed = None if same_code else _changed_values(model, document)
    except Exception as error:  # its parts are known classes, but may not fit each other
        raise ModelFileError(f"{path}: not a model of texclass ({error})") from error
    if changed is not None:
        warnings.warn(
            f"{path}: features give other values than when it was trained ({changed}); train it again",
            UserWarning,
            stacklevel=2,
        )
    return model


def _model_of(document: Any, manifest: Manifest) -> tuple[Model, bool]:
    recogniser, same_code = Recogniser.of_document(document["recogniser"])
    ranges = Ranges(**{name: np.asarray(a, dtype=np.float64) for name, a in document["ranges"].items()})
    calibration = Calibration(*(float(document["calibration"][name]) for name in ("beta", "lapse")))
    model = Model(recogniser, calibration, Novelty.of_document(document["novelty"]), ranges, manifest)
    if sorted(model.materials) != sorted(manifest.materials):
        raise ValueError("it knows other materials than its manifest says; the rule is the same")
    Source.of_dict(manifest.input)
    p = model.judge(model._typical)[0][0]
    before = document.get("probe", {}).get("probabilities", p)  # files of format 1.0 have none
    if not np.allclose(p, before, atol=SAME_ANSWER):
        trained_with = manifest.versions.get("scikit-learn", "unknown")
        raise ValueError(
            f"it gives other answers than when it was trained with scikit-learn {trained_with}; "
            "train it again"
        )
    return model, same_code


def _changed_values(model: Model, document: Any) -> str | None:
    """Return which feature of the probe has another value than in training, None if none has."""
    if "probe" not in document:
        return None
    now = probe_values(model.plan, model.manifest.fs, model.manifest.unit)
    return difference(np.asarray(document["probe"]["values"]), now, model.columns)
