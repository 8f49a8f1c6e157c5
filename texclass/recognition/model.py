"""A trained model: a recording in, an answer out, and with it what a user should know of the answer."""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from texclass.features.cepstrum import Banks, use_filter_banks
from texclass.features.phase_view import TURN
from texclass.features.plan import Computed, Plan
from texclass.phases import find_phases
from texclass.recognition.answers import Answer, Prediction, joined, ranked
from texclass.recognition.array_form import Part, apply_all, decide, estimators_in
from texclass.recognition.conformal import LEVELS, Conformity
from texclass.recognition.model_files import (
    Manifest,
    ModelFileError,
    changed_value,
    probe_values,
    read_model_file,
    write_model_file,
)
from texclass.recognition.probabilities import Calibration, log_of
from texclass.recognition.sources.training_input import Beside, Needs
from texclass.recognition.unknown import ClassMoments, Novelty, Ranges, strangeness
from texclass.recording import Recording, Samples, axes_differ, describe_axes

if TYPE_CHECKING:
    from texclass.evaluation.feature_table import LeftOut


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """A trained recogniser with calibrated probabilities and a sense of what it does not know.

    Attributes
    ----------
    plan
        The features to compute of a recording.
    surfaces
        The surfaces it knows, in the order of its decisions.
    steps
        What prepares rows of features; see `texclass.recognition.array_form`.
    classifier
        What decides on prepared rows, likewise.
    calibration
        Decisions -> probabilities.
    novelty
        When a surface is unknown.
    ranges
        What values the columns had in training.
    manifest
        What a user should know of it.
    conformity
        How held-out answers conformed, of which sets are made: "answer"; of touches also "recording", which
        all of them make together, and "contact 1", "contact 2", ... of a stream, after so many.
    levels
        How often the right surface is to be in the sets that answers tell.
    left_out
        Bad recordings that were skipped in training; not saved, but for their names in the manifest.
    class_moments
        Where they lay; None in an adapted model.
    banks
        Mel filters that the features need; see `texclass.features.cepstrum.use_filter_banks`.

    Examples
    --------
    >>> model = load_model("surface.skops")  # doctest: +SKIP
    >>> model.predict("felt.txt").surface  # doctest: +SKIP
    'oak'
    """

    plan: Plan
    surfaces: tuple[str, ...]
    steps: Sequence[Part]
    classifier: Part
    calibration: Calibration
    novelty: Novelty
    ranges: Ranges
    manifest: Manifest
    left_out: "tuple[LeftOut, ...]" = ()
    conformity: Mapping[str, Conformity] = field(default_factory=dict)
    levels: tuple[float, ...] = LEVELS
    class_moments: ClassMoments | None = None
    banks: Banks = field(default_factory=dict)

    def __repr__(self) -> str:
        of = self.manifest.pipeline
        return f"<Model of {len(self.surfaces)} surfaces: {of['row']} with {of['classifier']}>"

    @property
    def estimators(self) -> tuple[str, ...]:
        """The classes of scikit-learn in it that have no array form."""
        return tuple(type(one).__name__ for one in estimators_in((self.steps, self.classifier)))

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that `answer_values` takes, in order."""
        return self.plan.columns

    @property
    def needs(self) -> Needs:
        """The columns of a stream that it can judge; axes before friction must be as many as in training."""
        apart = self.plan.channels
        axes = tuple(name for name in apart if name not in TURN)
        beside: list[Beside] = ["turn_rate"] if len(axes) < len(apart) else []
        members = [member for _, part in self.plan.parts for member in part.members]
        of_friction = tuple(member.name for member in members if member.feature.phase == "friction")
        if of_friction:
            beside.append("friction")
        axes = axes or self.manifest.input.axes
        return Needs(axes, tuple(beside), of_friction)

    @overload
    def predict(
        self, felt: Recording | str | Path, *, fs: float | None = ..., unit: str | None = ..., **reading: Any
    ) -> Answer: ...
    @overload
    def predict(
        self,
        felt: Iterable[Recording | str | Path],
        *,
        fs: float | None = ...,
        unit: str | None = ...,
        **reading: Any,
    ) -> list[Answer]: ...
    def predict(self, felt: Any, *, fs: float | None = None, unit: str | None = None, **reading: Any) -> Any:
        """Say which surface was felt, in touches where the model was trained on touches.

        Parameters
        ----------
        felt : Recording, str, Path, or iterable of these
            A recording, a file, "DATASET:RECORDING"; or several, a dataset for example.
        fs, unit : optional
            Of files that do not state them; by default those of the training files.
        **reading : optional
            What else `load_recording` takes where a file is not like the training files: column, delimiter,
            time_column, time_unit, resample, skip_rows, comment, drop_incomplete.

        Returns
        -------
        Answer, or list of Answer

        Raises
        ------
        RecordingError, ValueError
            If a file is bad, or as `answer`; see the function `predict` for files of which some may be bad.
        """
        if not isinstance(felt, Recording | str | Path):
            return [self.predict(one, fs=fs, unit=unit, **reading) for one in felt]
        if not isinstance(felt, Recording):
            felt = self.manifest.input.find(felt, fs=fs, unit=unit, **reading)
        return self.answer_touches(felt)

    def predict_set(
        self, felt: Recording | str | Path, level: float = LEVELS[-1], **reading: Any
    ) -> tuple[str, ...]:
        """Return the surfaces, likeliest first, among which the right one is as often as `level` says.

        Of all surfaces where too few contacts were held out; of none where no surface is thought as much of
        as right ones are so often, or nothing can be judged.

        Parameters
        ----------
        felt : Recording, str or Path
            As `predict` takes it.
        level : float
            Share of recordings of known surfaces; answers tell `levels` of them by themselves.
        **reading : optional
            As `predict` takes it.

        Raises
        ------
        ValueError
            If the level is none, or as `predict`.
        """
        if not 0 < level < 1:
            raise ValueError(f"level is {level!r}. Expected a number between 0 and 1")
        return replace(self, levels=(level,)).predict(felt, **reading).prediction_sets.get(level, ())

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
        unlike = self.unlike(recording.fs, recording.unit, f"--resample {self.manifest.fs:g}")
        unlike += self.other_axes(recording.channels)
        unlike += self.narrow_band(recording.native_fs or recording.fs)
        phases = find_phases(recording, self.manifest.phase_settings)
        row = self.compute(recording.with_(phases=phases))
        nothing = ["no feature has a value"] if np.isnan(row.values).all() else []
        told = [*unlike, *nothing]
        start, stop = phases.movement or (0, 0)
        felt_s, least = (stop - start) / recording.fs, self.manifest.shortest_s
        if "movement" in self.manifest.phases and least is not None and felt_s < least / 2:
            told.append(f"too short: {felt_s:.3g} s of movement, trained on {least:.3g} s and more")
        undefined: dict[str, list[str]] = {}
        for feature, reason in row.reasons:
            undefined.setdefault(reason, []).append(feature)
        told += [f"undefined: {_named(names)} ({reason})" for reason, names in undefined.items()]
        return self.answer_values(
            row.values,
            reasons=(*told, *recording.flags),
            recording_id=recording.recording_id,
            judged=not (unlike or nothing),
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
                f"values have shape {row.shape}. Expected one of each of {len(self.columns)} columns"
            )
        decisions, p_known = (one[0] for one in self._decided(row[None]))
        strange = bool(p_known <= self.novelty.false_alarms)
        said = [f"unlike every known surface (p = {p_known:.2g})"] if strange else []
        said += ["whether it is of another surface is not judged"] * (not len(self.novelty.held_out))
        said += reasons
        far = self.ranges.far(row)
        # Half a width of the training range outside of it is far out.
        order = np.argsort(-far, kind="stable")[: np.count_nonzero(far > 0.5)].tolist()
        if judged and order:
            worst, names = order[0], _named([self.columns[i] for i in order])
            seen = f"{self.ranges.low[worst]:.3g} to {self.ranges.high[worst]:.3g}"
            trained = f"{self.columns[worst]} is {row[worst]:.3g}, trained on {seen}"
            said.append(f"outside the range of training: {names} ({trained})")
        if judged and "answer" in self.conformity and (few := self.conformity["answer"].too_few(self.levels)):
            said.append(few)
        return Answer(
            recording_id=recording_id,
            unknown=strange or not judged,
            p_known=float(p_known),
            reasons=tuple(said),
            prediction_sets=self.sets_of("answer", self.calibration.beta * decisions) if judged else {},
            **ranked(self.calibration(decisions[None])[0], self.surfaces),
        )

    def sets_of(self, kind: str, scores: Samples) -> dict[float, tuple[str, ...]]:
        """Return the sets of an answer, a recording or a contact with such scores (n_surfaces,), if any."""
        known = self.conformity.get(kind)
        return {} if known is None else known.sets(scores, self.surfaces, self.levels)

    @property
    def conformity_so_far(self) -> dict[int, Conformity]:
        """Windows of a contact -> how contacts conformed after so many."""
        found = {kind.partition("contact ")[2]: known for kind, known in self.conformity.items()}
        return {int(n): known for n, known in found.items() if n}

    def judge(self, X: Samples) -> tuple[Samples, Samples]:
        """Return probabilities (n, n_surfaces), and p-values of "known" (n,), of rows of features.

        Raises
        ------
        ValueError
            If nothing fills what is undefined.
        """
        decisions, p_known = self._decided(X)
        return self.calibration(decisions), p_known

    def _decided(self, X: Samples) -> tuple[Samples, Samples]:
        prepared, decisions = self.decide(X)
        strange = strangeness(self.novelty.kind, decisions, prepared, self.novelty.nearness)
        return decisions, self.novelty.p_value(strange)

    def compute(self, recording: Recording) -> Computed:
        """Compute the features of a recording; its phases are found unless it declares them."""
        with use_filter_banks(dict(self.banks)):  # those of other rates are not the model's
            phases = find_phases(recording, self.manifest.phase_settings)
            return self.plan.compute(recording.with_(phases=phases))

    def prepare(self, X: Samples) -> Samples:
        """Return rows of features (n, n_columns) as its classifier sees them, shape (n, n_prepared)."""
        return apply_all(self.steps, X)

    def decide(self, X: Samples) -> tuple[Samples, Samples]:
        """Return prepared rows (n, n_prepared) and decisions (n, n_surfaces) for features (n, n_columns).

        Raises
        ------
        ValueError
            If a prepared value is not finite.
        """
        return decide(self.steps, self.classifier, X)

    def answer_touches(self, recording: Recording) -> Answer:
        """Say which surface a recording is of that is longer than the touches the model was trained on.

        Its movement is cut into touches, whose probabilities are averaged: touches of one stroke are no
        independent witnesses. It is unknown if half of the touches are. A model of whole recordings answers
        the whole.
        """
        touches = self.cut(recording) if self.manifest.window_s is not None else ()
        if not touches:
            return self.answer(recording)
        answers = [self.answer(touch) for touch in touches]
        together = joined(answers, recording.recording_id)
        if not all(answer.prediction_sets for answer in answers):
            return together
        p = np.array([list(answer.probabilities.values()) for answer in answers])
        return replace(together, prediction_sets=self.sets_of("recording", log_of(p).mean(axis=0)))

    def cut(self, recording: Recording) -> tuple[Recording, ...]:
        """Return the touches of a recording, one after another; none without movement enough for one."""
        if self.manifest.window_s is None:
            return (recording.with_(phase_settings=self.manifest.phase_settings),)
        start, stop = find_phases(recording, self.manifest.phase_settings).movement or (0, 0)
        n = max(1, round(self.manifest.window_s * recording.fs))
        starts = range(start, stop - n + 1, n)
        return tuple(
            recording.cut(k, k + n, f"{recording.recording_id}#{i}") for i, k in enumerate(starts, 1)
        )

    def save(self, path: str | Path) -> None:
        """Write a model file: arrays, or skops where an estimator has no array form; and a manifest."""
        with use_filter_banks(self.banks):
            values = probe_values(self.plan, self.manifest.fs, self.manifest.unit)
        document = {
            "plan": self.plan.to_json(),
            "channels": list(self.plan.channels),
            "surfaces": list(self.surfaces),
            "steps": list(self.steps),
            "classifier": self.classifier,
            "banks": [{"of": list(key), "weights": weights} for key, weights in self.banks.items()],
            "calibration": dict(vars(self.calibration)),
            "novelty": self.novelty.document(),
            "ranges": dict(vars(self.ranges)),
            "conformity": {kind: dict(vars(known)) for kind, known in self.conformity.items()},
            "class_moments": {} if self.class_moments is None else self.class_moments._asdict(),
            "probe": {"values": values, "probabilities": self._typical()},
        }
        write_model_file(path, document, self.manifest, is_arrays=not self.estimators)

    def _typical(self) -> Samples:
        """Return the probabilities (n_surfaces,) of the medians of training."""
        probabilities, _ = self.judge(np.nan_to_num(self.ranges.median)[None])
        return np.asarray(probabilities[0])

    def unlike(self, fs: float, unit: str, way_out: str = "--resample") -> list[str]:
        """Return why recordings of such a sampling rate (Hz) and unit cannot be judged, and the way out."""
        trained = self.manifest
        found = []
        if abs(fs / trained.fs - 1) > 0.01:  # the tolerance of sensors' clocks
            found.append(f"wrong rate: {fs:g} Hz, trained at {trained.fs:g} Hz; {way_out} converts")
        if unit != trained.unit:
            found.append(f"wrong unit: {unit}, trained with {trained.unit}; nothing converts these")
        return found

    def other_axes(self, axes: Sequence[str]) -> list[str]:
        """Return why recordings of such axes cannot be judged, and the option that selects others."""
        trained = self.manifest.input.axes
        if not (trained and axes_differ(axes, trained)):
            return []
        return [f"other axes: {describe_axes(axes)}, trained with {describe_axes(trained)}; --column selects"]

    def narrow_band(self, native_fs: float) -> list[str]:
        """Return why recordings of a sensor of such a rate (Hz) cannot be judged, although resampled.

        A model that was adapted to a sensor takes it as it is.
        """
        trained = self.manifest.native_fs or self.manifest.fs
        if self.manifest.adapted or native_fs >= 0.5 * trained:
            return []
        return [
            f"narrow band: sampled at {native_fs:g} Hz, nothing above {native_fs / 2:g} Hz; trained up to "
            f"{trained / 2:g} Hz. Train with --resample {native_fs:g}, or adapt the model"
        ]


def predict(
    model: Model,
    names: Iterable[str],
    *,
    fs: float | None = None,
    unit: str | None = None,
    labels: str | Path | None = None,
    **reading: Any,
) -> Iterator[Prediction]:
    """Yield the prediction for each recording, in the order of the names; a bad file stops nothing.

    Parameters
    ----------
    model : Model
        Trained on whole recordings, or on touches, into which longer recordings are cut.
    names : iterable of str
        Files, folders, cards, or DATASET:RECORDING.
    fs, unit, **reading : optional
        As `Model.predict` takes them.
    labels : str or Path, optional
        Table with the surfaces of the recordings of a folder, as `open_dataset` takes it.
    """
    for name in names:
        try:
            members = model.manifest.input.members(name, labels, fs=fs, unit=unit, **reading)
        except (ValueError, OSError) as error:
            yield _refused(name, error)
            continue
        for one in members:
            try:
                felt = one.load()
                yield Prediction(one.name, model.predict(felt), surface=one.surface or felt.surface)
            except (ValueError, OSError) as error:
                yield _refused(one.name, error, one.surface)


def _refused(name: str, error: Exception, surface: str | None = None) -> Prediction:
    problem = str(error)
    return Prediction(name, None, problem if name in problem else f"{name}: {problem}", surface)


def load_model(path: str | Path) -> Model:
    """Read a model file. Classes that are not on the allow-list are refused.

    Parameters
    ----------
    path : str or Path
        File that `Model.save` wrote.

    Returns
    -------
    Model
        Ready to predict.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ModelFileError
        If the file is no model, is damaged or of another format, names a class that is not on the allow-list
        or an unknown feature, or predicts otherwise than when it was trained.

    Warns
    -----
    UserWarning
        If the code of the features has changed since training.
    """
    document, manifest = read_model_file(path)
    try:
        with np.errstate(all="ignore"):  # of damaged numbers, whose answers are then others
            model, is_same_code = _of_document(document, manifest)
            if sorted(model.surfaces) != sorted(manifest.surfaces):
                raise ValueError("its surfaces differ from those in its manifest")
            # A difference of 1e-6 is what rounding on another machine explains.
            if not np.allclose(model._typical(), document["probe"]["probabilities"], atol=1e-6):
                by = f"scikit-learn {manifest.versions.get('scikit-learn', 'unknown')}"
                raise ValueError(f"it gives other answers than when it was trained with {by}; train it again")
            changed = None
            if not is_same_code:
                with use_filter_banks(dict(model.banks)):
                    now = probe_values(model.plan, manifest.fs, manifest.unit)
                changed = changed_value(np.asarray(document["probe"]["values"]), now, model.columns)
    except Exception as error:  # its parts are known classes, but may not fit each other
        raise ModelFileError(f"{path}: not a model of texclass ({error})") from error
    if changed is not None:
        warnings.warn(
            f"{path}: features give other values than when it was trained ({changed}); train it again",
            UserWarning,
            stacklevel=2,
        )
    return model


def _of_document(document: Mapping[str, Any], manifest: Manifest) -> tuple[Model, bool]:
    """Return the model that a file describes, and whether the code of its features is still the same."""

    def arrays(stated: Mapping[str, Any]) -> dict[str, Samples]:
        return {name: np.asarray(values, dtype=np.float64) for name, values in stated.items()}

    plan, is_same_code = Plan.of_json(document["plan"], document["channels"])
    model = Model(
        plan,
        tuple(document["surfaces"]),
        document["steps"],
        document["classifier"],
        Calibration(*(float(document["calibration"][name]) for name in ("beta", "lapse"))),
        Novelty.of_document(document["novelty"]),
        Ranges(**arrays(document["ranges"])),
        manifest,
        conformity={kind: Conformity(**arrays(known)) for kind, known in document["conformity"].items()},
        class_moments=ClassMoments(**arrays(lay)) if (lay := document["class_moments"]) else None,
        banks={tuple(bank["of"]): bank["weights"] for bank in document["banks"]},
    )
    return model, is_same_code


def _named(names: Sequence[str], max_names: int = 3) -> str:
    more = len(names) - max_names
    return ", ".join(names[:max_names]) + (f" and {more} more" if more > 0 else "")
