"""Trained models: predict the surface of a recording, save and load."""

import logging
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np

from texclass.features.cepstrum import Banks, use_filter_banks
from texclass.features.phase_view import SOUND_CHANNEL, TURN_CHANNELS
from texclass.features.plan import Computed, Plan
from texclass.loaders.phases_files import is_marked, marked_note
from texclass.loaders.readers import LoadingOptions
from texclass.phases import find_phases
from texclass.recognition.answers import Answer, FeatureRow, Prediction, average_answers, rank_surfaces
from texclass.recognition.array_form import ArrayStep, apply_all, decide, estimators_in
from texclass.recognition.contact_check import ContactLimits
from texclass.recognition.model_files import (
    Manifest,
    ModelFileError,
    changed_value,
    probe_values,
    read_model_file,
    write_model_file,
)
from texclass.recognition.novelty import (
    FAR_OUTSIDE,
    ClassMoments,
    FeatureRanges,
    NoveltyDetector,
    novelty_scores,
)
from texclass.recognition.prediction_sets import DEFAULT_LEVELS, ConformalCalibration
from texclass.recognition.probabilities import Calibration, log_probabilities
from texclass.recognition.sources.training_input import AuxiliarySignal, InputColumns
from texclass.recording import Phases, Recording, RecordingError, Samples, axes_differ, describe_axes

if TYPE_CHECKING:
    from texclass.evaluation.feature_table import LeftOutRecording

CLOCK_TOLERANCE = 0.01
"""Largest relative difference of sampling rates that is attributed to the tolerance of sensor clocks."""
MIN_NATIVE_RATE = 0.5
"""Smallest native sampling rate of a recording, relative to that of the training recordings."""


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """Trained model with calibrated probabilities, prediction sets and novelty detection.

    Models are created by `train` and read by `load_model`.

    Attributes
    ----------
    plan : Plan
        Features to compute.
    surfaces : tuple of str
        Surfaces of the training set, in the order of the decisions.
    steps : sequence of mapping
        Preparation of the features in array form; see `texclass.recognition.array_form`.
    classifier : mapping
        Classifier in array form.
    calibration : Calibration
        Map from decisions to probabilities.
    novelty : NoveltyDetector
        Detection of unknown surfaces.
    ranges : FeatureRanges
        Range of each column in the training set.
    manifest : Manifest
        Description of the model, as in the model card.
    left_out : tuple of LeftOutRecording
        Invalid recordings that were skipped in training; a model file contains only their names.
    set_calibrations : mapping of str to ConformalCalibration
        Kind of answer -> calibration of its prediction sets. The kind "answer" is a single answer. Models of
        windows also have the kinds "recording" (all windows of a recording) and "contact 1", "contact 2",
        "contact 4" ... (this number of windows of a stream).
    levels : tuple of float
        Coverage of the prediction sets in answers.
    class_moments : ClassMoments or None
        Class means and within-class deviations for `adapt`; None in an adapted model.
    banks : mapping
        Mel filters of the features; see `texclass.features.cepstrum.use_filter_banks`.

    Examples
    --------
    >>> model = load_model("surface.skops")  # doctest: +SKIP
    >>> model.predict("stroke.txt").surface  # doctest: +SKIP
    'oak'
    """

    plan: Plan
    surfaces: tuple[str, ...]
    steps: Sequence[ArrayStep]
    classifier: ArrayStep
    calibration: Calibration
    novelty: NoveltyDetector
    ranges: FeatureRanges
    manifest: Manifest
    left_out: "tuple[LeftOutRecording, ...]" = ()
    set_calibrations: Mapping[str, ConformalCalibration] = field(default_factory=dict)
    levels: tuple[float, ...] = DEFAULT_LEVELS
    class_moments: ClassMoments | None = None
    banks: Banks = field(default_factory=dict)

    def __repr__(self) -> str:
        pipeline = self.manifest.pipeline
        return f"<Model of {len(self.surfaces)} surfaces: {pipeline['row']} with {pipeline['classifier']}>"

    @property
    def estimators(self) -> tuple[str, ...]:
        """Class names of the scikit-learn estimators without an array form."""
        return tuple(type(estimator).__name__ for estimator in estimators_in((self.steps, self.classifier)))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the feature columns, in the order of `answer_values`."""
        return self.plan.columns

    @property
    def input_columns(self) -> InputColumns:
        """Columns that a stream must have: axes of the training recordings, turn rate, friction.

        Raises
        ------
        RecordingError
            If the model needs a sound, or a signal with another rate than the acceleration.
        """
        channels = self.plan.channels
        sound = {SOUND_CHANNEL: self.manifest.fs} if SOUND_CHANNEL in channels else {}
        if rates := sound | dict(self.manifest.auxiliary_fs):
            needed = ", ".join(f"{name} at {rate:g} Hz" for name, rate in rates.items())
            raise RecordingError(
                f"the model needs {needed} besides the acceleration at {self.manifest.fs:g} Hz, but the "
                "signals of a stream have one rate, and no sound. Classify recordings with 'texclass "
                "predict', or train a model without the sound and with --resample HZ"
            )
        axes = tuple(name for name in channels if name not in TURN_CHANNELS)
        signals: list[AuxiliarySignal] = ["turn_rate"] if len(axes) < len(channels) else []
        members = [member for _, part in self.plan.parts for member in part.members]
        friction_features = tuple(member.name for member in members if member.feature.phase == "friction")
        if friction_features:
            signals.append("friction")
        axes = axes or self.manifest.input.axes
        return InputColumns(axes, tuple(signals), friction_features)

    def _repr_html_(self) -> str:
        """Return the model card for notebooks."""
        from texclass.recognition.model_document import model_html

        return model_html(self)

    @overload  # mypy: a text is an iterable of texts, too, but the first signature comes first
    def predict(  # type: ignore[overload-overlap]
        self, recordings: Recording | str | Path, **options: Unpack[LoadingOptions]
    ) -> Answer: ...
    @overload
    def predict(
        self, recordings: Iterable[Recording | str | Path], **options: Unpack[LoadingOptions]
    ) -> list[Answer]: ...
    def predict(
        self,
        recordings: Any,
        *,
        fs: float | None = None,
        unit: str | None = None,
        resample: float | None = None,
        column: str | Sequence[str] | None = None,
        topic: str | None = None,
        delimiter: str | None = None,
        time_column: str | None = None,
        time_unit: str | None = None,
        skip_rows: int | None = None,
        comment: str | None = None,
        drop_incomplete: bool = False,
    ) -> Any:
        """Predict the surface of one or several recordings.

        A model of windows cuts a recording into windows and averages their probabilities.

        Parameters
        ----------
        recordings : Recording, str, Path, or iterable of these
            Recording, file or "DATASET:RECORDING"; or several of them, such as a dataset.
        fs : float, optional
            Sampling rate in Hz of files that do not state it (default: that of the training files).
        unit : str, optional
            Unit of files that do not state it (default: that of the training files).
        resample : float, optional
            Target sampling rate in Hz of files that differ from the training files.
        column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
            How files are read that differ from the training files, see `load_recording`.

        Returns
        -------
        Answer, or list of Answer

        Raises
        ------
        RecordingError, ValueError
            If a file is invalid, or `answer` raises an error. The function `predict` continues after an
            invalid file; this method does not.
        """
        reading: LoadingOptions = {
            "fs": fs,
            "unit": unit,
            "resample": resample,
            "column": column,
            "topic": topic,
            "delimiter": delimiter,
            "time_column": time_column,
            "time_unit": time_unit,
            "skip_rows": skip_rows,
            "comment": comment,
            "drop_incomplete": drop_incomplete,
        }
        if not isinstance(recordings, Recording | str | Path):
            return [self.predict(one, **reading) for one in recordings]
        recording = recordings
        if not isinstance(recording, Recording):
            recording = self.manifest.input.find(recording, **reading)
        return self.answer_windows(recording)

    def predict_set(
        self,
        recording: Recording | str | Path,
        level: float = DEFAULT_LEVELS[-1],
        *,
        fs: float | None = None,
        unit: str | None = None,
        resample: float | None = None,
        column: str | Sequence[str] | None = None,
        topic: str | None = None,
        delimiter: str | None = None,
        time_column: str | None = None,
        time_unit: str | None = None,
        skip_rows: int | None = None,
        comment: str | None = None,
        drop_incomplete: bool = False,
    ) -> tuple[str, ...]:
        """Return the prediction set of a recording: it contains the true surface with probability `level`.

        The set contains at least the most probable surface, and all surfaces if too few recordings were held
        out. It is empty only if the recording cannot be classified.

        Parameters
        ----------
        recording : Recording, str or Path
            Recording, as for `predict`.
        level : float
            Coverage for recordings of trained surfaces (default 0.95). Answers contain the sets of `levels`.
        fs, unit, resample : optional
            See `predict`.
        column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
            See `predict`.

        Returns
        -------
        tuple of str
            Surfaces, most probable first.

        Raises
        ------
        ValueError
            If the level is not between 0 and 1, or `predict` raises an error.
        """
        if not 0 < level < 1:
            raise ValueError(f"level must be between 0 and 1, got {level!r}. Use 0.95 for 95 %")
        reading: LoadingOptions = {
            "fs": fs,
            "unit": unit,
            "resample": resample,
            "column": column,
            "topic": topic,
            "delimiter": delimiter,
            "time_column": time_column,
            "time_unit": time_unit,
            "skip_rows": skip_rows,
            "comment": comment,
            "drop_incomplete": drop_incomplete,
        }
        answer = replace(self, levels=(level,)).predict(recording, **reading)
        return answer.prediction_sets.get(level, ())

    def answer(self, recording: Recording) -> Answer:
        """Predict the surface of a recording, or of one window, as a whole.

        Parameters
        ----------
        recording : Recording
            Recording with the sampling rate, unit and channels of the training recordings. Its phases are
            detected unless it declares them.

        Raises
        ------
        ValueError
            If a channel is missing, or a feature is undefined and no step fills it; the message names the
            recording.
        """
        return self.answer_row(self.feature_row(recording))

    def feature_row(self, recording: Recording) -> FeatureRow:
        """Compute the features of a recording, or of one window, and the warnings about it.

        Parameters
        ----------
        recording : Recording
            Recording, as for `answer`.

        Raises
        ------
        ValueError
            If a channel is missing.
        """
        problems = [
            *self.rate_and_unit_problems(recording.fs, recording.unit),
            *self.auxiliary_rate_problems(recording),
            *self.axis_problems(recording.channels),
            *self.bandwidth_problems(recording.native_fs or recording.fs),
        ]
        phases = find_phases(recording, self.manifest.phase_settings)
        row = self.compute(recording.with_(phases=phases))
        if np.isnan(row.values).all():
            problems.append("no feature has a value")
        if problem := self.contact_problem(recording, phases):
            problems.append(problem)
        reasons = list(problems)
        start, stop = phases.movement or (0, 0)
        movement_s, shortest_s = (stop - start) / recording.fs, self.manifest.shortest_s
        if "movement" in self.manifest.phases and shortest_s is not None and movement_s < shortest_s / 2:
            reasons.append(
                f"too short: {movement_s:.3g} s of movement, trained on {shortest_s:.3g} s and more"
            )
        features_by_reason: dict[str, list[str]] = {}
        for feature, reason in row.reasons:
            features_by_reason.setdefault(reason, []).append(feature)
        reasons += [
            f"undefined: {_list_names(names)} ({reason})" for reason, names in features_by_reason.items()
        ]
        return FeatureRow(row.values, (*reasons, *recording.flags), recording.recording_id, not problems)

    def answer_values(
        self, values: Samples, *, reasons: tuple[str, ...] = (), recording_id: str = "", is_valid: bool = True
    ) -> Answer:
        """Predict the surface from the values of the features.

        Parameters
        ----------
        values : ndarray of shape (n_columns,)
            One value per column of `columns`; NaN where undefined.
        reasons : tuple of str
            Warnings about the recording.
        recording_id : str
            Name of the recording.
        is_valid : bool
            Whether the recording can be classified; if not, the answer is `unknown`.

        Raises
        ------
        ValueError
            If the number of values is wrong, or a feature is undefined and no step fills it.
        """
        return self.answer_row(FeatureRow(values, reasons, recording_id, is_valid))

    def answer_row(self, feature_row: FeatureRow) -> Answer:
        """Predict the surface from features and warnings, which `feature_row` computes.

        Raises
        ------
        ValueError
            If the number of values is wrong, or a feature is undefined and no step fills it.
        """
        row, is_valid = np.asarray(feature_row.values, dtype=np.float64), feature_row.is_valid
        if row.shape != (len(self.columns),):
            raise ValueError(
                f"values must have shape ({len(self.columns)},), one value per column, got {row.shape}"
            )
        decisions, p_known = (array[0] for array in self._decide_with_p_value(row[None]))
        is_novel = bool(p_known <= self.novelty.false_alarms)
        messages = [f"unlike every trained surface (p = {p_known:.2g})"] if is_novel else []
        if not len(self.novelty.held_out):
            messages.append("unknown surfaces are not detected: too few recordings were held out")
        messages += feature_row.reasons
        if is_valid:
            messages += self._range_warnings(row)
            if "answer" in self.set_calibrations:
                warning = self.set_calibrations["answer"].warning(self.levels)
                messages += [warning] if warning else []
        scores = self.calibration.beta * decisions
        return Answer(
            recording_id=feature_row.recording_id,
            unknown=is_novel or not is_valid,
            p_known=float(p_known),
            reasons=tuple(messages),
            prediction_sets=self.prediction_sets("answer", scores) if is_valid else {},
            rows=(feature_row,),
            **rank_surfaces(self.calibration(decisions[None])[0], self.surfaces),
        )

    def _range_warnings(self, row: Samples) -> list[str]:
        """Return a warning about values (n_columns,) that are far outside the training range, if any."""
        distance = self.ranges.distance_outside(row)
        order = np.argsort(-distance, kind="stable")[: np.count_nonzero(distance > FAR_OUTSIDE)].tolist()
        if not order:
            return []
        worst, names = order[0], _list_names([self.columns[i] for i in order])
        limits = f"{self.ranges.low[worst]:.3g} to {self.ranges.high[worst]:.3g}"
        example = f"{self.columns[worst]} is {row[worst]:.3g}, trained on {limits}"
        return [f"outside the training range: {names} ({example})"]

    def prediction_sets(self, kind: str, scores: Samples) -> dict[float, tuple[str, ...]]:
        """Return the prediction sets of `levels` for scores (n_surfaces,); empty if `kind` is not calibrated.

        Parameters
        ----------
        kind : str
            Key of `set_calibrations`, such as "answer".
        scores : ndarray of shape (n_surfaces,)
            Decisions times the inverse temperature, or log posteriors.
        """
        calibration = self.set_calibrations.get(kind)
        return {} if calibration is None else calibration.predict_sets(scores, self.surfaces, self.levels)

    @property
    def contact_calibrations(self) -> dict[int, ConformalCalibration]:
        """Number of windows of a contact -> calibration of the prediction sets after this number."""
        numbers = {kind: kind.partition("contact ")[2] for kind in self.set_calibrations}
        return {int(n): self.set_calibrations[kind] for kind, n in numbers.items() if n}

    def classify(self, X: Samples) -> tuple[Samples, Samples]:
        """Return probabilities and p-values of "the surface is in the training set" for rows of features.

        Parameters
        ----------
        X : ndarray of shape (n, n_columns)
            Features, in the order of `columns`; NaN where undefined.

        Returns
        -------
        p : ndarray of shape (n, n_surfaces)
            Calibrated probabilities.
        p_known : ndarray of shape (n,)
            Conformal p-values.

        Raises
        ------
        ValueError
            If a feature is undefined and no step fills it.
        """
        decisions, p_known = self._decide_with_p_value(X)
        return self.calibration(decisions), p_known

    def _decide_with_p_value(self, X: Samples) -> tuple[Samples, Samples]:
        prepared, decisions = self.decide(X)
        scores = novelty_scores(self.novelty.kind, decisions, prepared, self.novelty.class_distance)
        return decisions, self.novelty.p_value(scores)

    def compute(self, recording: Recording) -> Computed:
        """Compute the features of a recording. Its phases are detected unless it declares them."""
        with use_filter_banks(dict(self.banks)):  # banks for other rates are computed
            phases = find_phases(recording, self.manifest.phase_settings)
            return self.plan.compute(recording.with_(phases=phases))

    def prepare(self, X: Samples) -> Samples:
        """Return the prepared features, the input of the classifier, shape (n, n_prepared)."""
        return apply_all(self.steps, X)

    def decide(self, X: Samples) -> tuple[Samples, Samples]:
        """Return prepared rows (n, n_prepared) and decisions (n, n_surfaces) for features (n, n_columns).

        Raises
        ------
        ValueError
            If a prepared value is not finite.
        """
        return decide(self.steps, self.classifier, X)

    def answer_windows(self, recording: Recording) -> Answer:
        """Predict the surface of a recording from the mean probabilities of its windows.

        Windows of one stroke are correlated, so their probabilities are averaged rather than multiplied. The
        recording is unknown if at least half of its windows are unknown. If the model was trained on whole
        recordings, or the recording is shorter than one window, the recording is classified as a whole.
        """
        windows = self.cut(recording) if self.manifest.window_s is not None else ()
        if not windows:
            return self.answer(recording)
        return self.average_rows([self.feature_row(window) for window in windows], recording.recording_id)

    def answer_again(self, answer: Answer) -> Answer:
        """Return the answer of this model to the features of an answer of another model.

        Parameters
        ----------
        answer : Answer
            Answer of a model with the same columns, such as this model before an adaptation.
        """
        if len(answer.rows) == 1 and answer.rows[0].recording_id == answer.recording_id:
            return self.answer_row(answer.rows[0])
        return self.average_rows(answer.rows, answer.recording_id)

    def average_rows(self, rows: Sequence[FeatureRow], recording_id: str) -> Answer:
        """Predict the surface of a recording from the mean probabilities of the rows of its windows."""
        answers = [self.answer_row(row) for row in rows]
        average = average_answers(answers, recording_id)
        if not all(answer.prediction_sets for answer in answers):
            return average
        p = np.array([list(answer.probabilities.values()) for answer in answers])
        sets = self.prediction_sets("recording", log_probabilities(p).mean(axis=0))
        return replace(average, prediction_sets=sets)

    def cut(self, recording: Recording) -> tuple[Recording, ...]:
        """Cut the movement of a recording into consecutive windows; none if it is shorter than one window.

        If the model was trained on whole recordings, the result is the recording itself.
        """
        if self.manifest.window_s is None:
            return (recording.with_(phase_settings=self.manifest.phase_settings),)
        start, stop = find_phases(recording, self.manifest.phase_settings).movement or (0, 0)
        n = max(1, round(self.manifest.window_s * recording.fs))
        starts = range(start, stop - n + 1, n)
        return tuple(
            recording.cut(k, k + n, f"{recording.recording_id}#{i}") for i, k in enumerate(starts, 1)
        )

    def save(self, path: str | Path) -> None:
        """Write a model file.

        Parameters
        ----------
        path : str or Path
            File with the suffix `.skops`.

        Raises
        ------
        ValueError
            If the suffix is wrong, or an estimator is not on the allow-list.
        """
        with use_filter_banks(self.banks):
            values = probe_values(self.plan, self.manifest.fs, self.manifest.unit)
        sets = {kind: dict(vars(calibration)) for kind, calibration in self.set_calibrations.items()}
        document = {
            "plan": self.plan.to_json(),
            "channels": list(self.plan.channels),
            "surfaces": list(self.surfaces),
            "steps": list(self.steps),
            "classifier": self.classifier,
            "banks": [{"key": list(key), "weights": weights} for key, weights in self.banks.items()],
            "calibration": dict(vars(self.calibration)),
            "novelty": self.novelty.document(),
            "ranges": dict(vars(self.ranges)),
            "set_calibrations": sets,
            "class_moments": {} if self.class_moments is None else self.class_moments._asdict(),
            "probe": {"values": values, "probabilities": self._median_probabilities()},
        }
        write_model_file(path, document, self.manifest, is_arrays=not self.estimators)

    def _median_probabilities(self) -> Samples:
        """Return the probabilities (n_surfaces,) for the median features of the training set."""
        probabilities, _ = self.classify(np.nan_to_num(self.ranges.median)[None])
        return np.asarray(probabilities[0])

    def rate_and_unit_problems(self, fs: float, unit: str) -> list[str]:
        """Return the problems of recordings with another sampling rate or unit, and how to solve them.

        Parameters
        ----------
        fs : float
            Sampling rate in Hz.
        unit : str
            Unit of the acceleration.
        """
        manifest = self.manifest
        problems = []
        if abs(fs / manifest.fs - 1) > CLOCK_TOLERANCE:
            problems.append(
                f"wrong rate: {fs:g} Hz, trained at {manifest.fs:g} Hz; --resample {manifest.fs:g} converts "
                "the rate"
            )
        if unit != manifest.unit:
            problems.append(
                f"wrong unit: {unit}, trained with {manifest.unit}; --unit declares the unit of a file"
            )
        return problems

    def auxiliary_rate_problems(self, recording: Recording) -> list[str]:
        """Return the problems of signals whose sampling rate differs from that in training."""
        manifest = self.manifest
        names = {*manifest.auxiliary_fs, *recording.auxiliary_fs}.intersection(self.plan.signals)
        rates = {name: manifest.auxiliary_fs.get(name, manifest.fs) for name in sorted(names)}
        return [
            f"wrong rate of {name}: {recording.rate_of(name):g} Hz, trained at {rate:g} Hz; record it at "
            "that rate, or train and classify with --resample HZ"
            for name, rate in rates.items()
            if getattr(recording, name) is not None
            and abs(recording.rate_of(name) / rate - 1) > CLOCK_TOLERANCE
        ]

    def axis_problems(self, axes: Sequence[str]) -> list[str]:
        """Return the problem of recordings with other axes, and the option that selects axes."""
        trained_axes = self.manifest.input.axes
        if not (trained_axes and axes_differ(axes, trained_axes)):
            return []
        return [
            f"other axes: {describe_axes(axes)}, trained with {describe_axes(trained_axes)}; --column "
            "selects axes"
        ]

    def contact_problem(self, recording: Recording, phases: Phases) -> str:
        """Return the reason why a recording has no contact; empty if it has one.

        Adapted models do not check the level, because that of another sensor may be lower.
        """
        if not self.manifest.contact:
            return ""
        limits = ContactLimits(**self.manifest.contact)
        return (limits._replace(level=0.0) if self.manifest.adapted else limits).problem(recording, phases)

    def bandwidth_problems(self, native_fs: float) -> list[str]:
        """Return the problem of recordings of a slower sensor, which remains after resampling.

        A model that was adapted to the slower sensor accepts them.

        Parameters
        ----------
        native_fs : float
            Sampling rate of the sensor in Hz, before resampling.
        """
        trained_fs = self.manifest.native_fs or self.manifest.fs
        if self.manifest.adapted or native_fs >= MIN_NATIVE_RATE * trained_fs:
            return []
        return [
            f"narrow band: sampled at {native_fs:g} Hz, nothing above {native_fs / 2:g} Hz; trained up to "
            f"{trained_fs / 2:g} Hz. Train with --resample {native_fs:g}, or adapt the model"
        ]


def predict(
    model: Model,
    names: Iterable[str],
    *,
    fs: float | None = None,
    unit: str | None = None,
    labels: str | Path | None = None,
    resample: float | None = None,
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
) -> Iterator[Prediction]:
    """Yield the prediction for each recording, in the order of the names; continue after invalid files.

    Parameters
    ----------
    model : Model
        Trained model.
    names : iterable of str
        Files, folders, dataset cards, or DATASET:RECORDING.
    fs, unit, resample : optional
        See `Model.predict`.
    labels : str or Path, optional
        Table with the surfaces of the recordings of a folder, as for `open_dataset`.
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        See `Model.predict`.

    Examples
    --------
    >>> for name, answer, problem, _ in predict(model, ["strokes/"]):  # doctest: +SKIP
    ...     print(name, answer.surface if answer else problem)
    """
    reading: LoadingOptions = {
        "fs": fs,
        "unit": unit,
        "resample": resample,
        "column": column,
        "topic": topic,
        "delimiter": delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete,
    }
    n_marked = 0
    for name in names:
        try:
            members = model.manifest.input.members(name, labels, **reading)
        except (ValueError, OSError) as error:
            yield _failed_prediction(name, error)
            continue
        for member in members:
            try:
                recording = member.load()
                n_marked += is_marked(recording)
                answer = model.predict(recording)
                yield Prediction(member.name, answer, surface=member.surface or recording.surface)
            except (ValueError, OSError) as error:
                yield _failed_prediction(member.name, error, member.surface)
    if n_marked:
        logging.getLogger(__name__).warning("note: %s", marked_note(n_marked))


def _failed_prediction(name: str, error: Exception, surface: str | None = None) -> Prediction:
    problem = str(error)
    return Prediction(name, None, problem if name in problem else f"{name}: {problem}", surface)


def load_model(path: str | Path) -> Model:
    """Read a model file. Classes that are not on the allow-list are refused.

    Parameters
    ----------
    path : str or Path
        File written by `Model.save`.

    Returns
    -------
    Model

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ModelFileError
        If the file is not a model, is damaged or has another format version, contains a class that is not on
        the allow-list or an unknown feature, or predicts other probabilities than after training.

    Warns
    -----
    UserWarning
        If the code of the features has changed since training, and with it a value.

    Examples
    --------
    >>> model = load_model("surface.skops")  # doctest: +SKIP
    """
    document, manifest = read_model_file(path)
    try:
        with np.errstate(all="ignore"):  # damaged numbers are detected by the probabilities below
            model, is_same_code = _from_document(document, manifest)
            if sorted(model.surfaces) != sorted(manifest.surfaces):
                raise ValueError("its surfaces differ from those in its manifest")
            # A difference of 1e-6 is explained by rounding on another machine.
            if not np.allclose(model._median_probabilities(), document["probe"]["probabilities"], atol=1e-6):
                version = f"scikit-learn {manifest.versions.get('scikit-learn', 'unknown')}"
                raise ValueError(
                    f"it predicts other probabilities than after training with {version}; train it again"
                )
            change = None
            if not is_same_code:
                with use_filter_banks(dict(model.banks)):
                    values = probe_values(model.plan, manifest.fs, manifest.unit)
                change = changed_value(np.asarray(document["probe"]["values"]), values, model.columns)
    except Exception as error:  # steps of allowed classes may still be incompatible
        raise ModelFileError(f"{path}: not a model of texclass ({error})") from error
    if change is not None:
        warnings.warn(
            f"{path}: features differ from those at training ({change}); train it again",
            UserWarning,
            stacklevel=2,
        )
    return model


def _from_document(document: Mapping[str, Any], manifest: Manifest) -> tuple[Model, bool]:
    """Return the model that a file describes, and whether the code of its features is unchanged."""

    def arrays(values_by_name: Mapping[str, Any]) -> dict[str, Samples]:
        return {name: np.asarray(values, dtype=np.float64) for name, values in values_by_name.items()}

    plan, is_same_code = Plan.of_json(document["plan"], document["channels"])
    moments = document["class_moments"]
    model = Model(
        plan,
        tuple(document["surfaces"]),
        document["steps"],
        document["classifier"],
        Calibration(*(float(document["calibration"][name]) for name in ("beta", "lapse"))),
        NoveltyDetector.from_document(document["novelty"]),
        FeatureRanges(**arrays(document["ranges"])),
        manifest,
        set_calibrations={
            kind: ConformalCalibration(**arrays(values))
            for kind, values in document["set_calibrations"].items()
        },
        class_moments=ClassMoments(**arrays(moments)) if moments else None,
        banks={tuple(bank["key"]): bank["weights"] for bank in document["banks"]},
    )
    return model, is_same_code


def _list_names(names: Sequence[str], max_names: int = 3) -> str:
    n_more = len(names) - max_names
    return ", ".join(names[:max_names]) + (f" and {n_more} more" if n_more > 0 else "")
