"""Accuracy against what a small computer has: bytes and operations, counted in the graph that is exported."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.neural_network import MLPClassifier

from texclass.document import Document
from texclass.experiment.allowed_estimators import path_of
from texclass.experiment.cost import CostModel
from texclass.experiment.feature_table import metadata
from texclass.experiment.folds import Fold, over_folds
from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.pipeline import PipelineDefinition, RowDefinition, Use
from texclass.experiment.protocols import Split
from texclass.experiment.result import COMPUTED_BY, Result
from texclass.experiment.workers import Progress, each
from texclass.features.phase_view import Channels, channels_apart
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, load_feature_set
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import made_by, versions
from texclass.recognition.export.graph import OnnxExportError
from texclass.recognition.export.graph_view import without_graph
from texclass.recognition.export.onnx_file import check_installed
from texclass.recognition.export.sample_graph import Windows
from texclass.recognition.holding_out import AT_RANDOM, FALSE_ALARMS, HoldingOut, holding_out
from texclass.recognition.model import Model
from texclass.recognition.small_computers import (
    WORDS,
    Cut,
    Word,
    Work,
    at_rate,
    cut_of,
    decisions_of,
    in_bits,
)
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recognition.training import LIBRARIES, train
from texclass.tradeoff.curves import full_scale_of
from texclass.tradeoff.front import (
    KNEE_LOSS,
    Facts,
    Labelled,
    accuracy_of,
    cost_aware,
    criterion,
    discriminant,
    knee,
    preparation,
    study_facts,
)
from texclass.validation import check_above_0

RATES_HZ = (10_000.0, 5_000.0, 2_500.0, 1_000.0)
LONGEST_S = 1.0
"""Of movement that is felt for one answer."""
ALIKE_BITS = 16
N_COLUMNS = (4, 8, 16, 32, 48, 64, 96)
LEAST_OF_NETWORK = 16
ALL = 0
"""Stands for all columns, where their number is asked for."""
FEW = 3
"""Windows of each surface that make a classifier of the right size."""
HIDDEN = 64
CHOSEN_INSIDE = "held-out windows, columns chosen inside each training part"
LINEAR, NETWORK = "lda", "network"


def network(seed: int = 0) -> MLPClassifier:
    """Return a classifier of one hidden layer, strongly held to small weights, which survive few bits."""
    return MLPClassifier((HIDDEN,), solver="lbfgs", alpha=3.0, max_iter=200, random_state=seed)


CLASSIFIERS: Mapping[str, Callable[[int], Any]] = {LINEAR: lambda seed: discriminant(), NETWORK: network}
"""Name -> what makes it, given a seed."""


class Embedded(Result):
    """What memory, operations, rate, window and word length cost in accuracy; see `embedded_tradeoff`.

    `data` holds the `points` (rate, window, bits, columns, classifier, accuracy, bytes, operations), those
    that nothing beats as `front`, the `knee`, the `full` set with a classifier that keeps all it was trained
    on, what was `chosen` within the limits, and what is needed to do it again.
    """

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
        return f"{self.data['dataset']['name']}-embedded"

    def document(self) -> Document:
        """Return the trade-off as a document."""
        from texclass.recognition.embedded_document import embedded_document

        return embedded_document(self.data)


@dataclass(frozen=True)
class SmallLimits:
    """What a small computer has.

    Attributes
    ----------
    max_bytes
        For a window of samples, constants and what is computed; None: any.
    max_ops
        Operations a second of signal; None: any.

    Raises
    ------
    ValueError
        If a limit is not above 0.
    """

    max_bytes: float | None = None
    max_ops: float | None = None

    def __post_init__(self) -> None:
        check_above_0(max_bytes=self.max_bytes, max_ops=self.max_ops)

    def kept(self, points: Sequence[Facts]) -> list[Facts]:
        """Return the points within the limits.

        Raises
        ------
        ValueError
            If there is none.
        """
        most = {"bytes": self.max_bytes or np.inf, "ops_per_s": self.max_ops or np.inf}
        if found := [point for point in points if all(point[key] <= most[key] for key in most)]:
            return found
        bytes_, ops = (min(point[key] for point in points) for key in most)
        raise ValueError(
            f"nothing takes at most {most['bytes']:g} bytes and {most['ops_per_s']:g} operations a second; "
            f"the rule is at least {bytes_:g} and {ops:g}"
        )


def embedded_tradeoff(
    dataset: Dataset | str | Path,
    features: FeatureSet | str | Path = "texclass",
    limits: SmallLimits | None = None,
    *,
    channels: Channels = "auto",
    protocol: str | None = None,
    max_seconds: float | None = None,
    seed: int = 2015,
    n_jobs: int = 1,
    progress: Progress | None = None,
    model_file: str | Path | None = None,
) -> Embedded:
    """Measure what accuracy costs a small computer, and save the model that fits.

    At each sampling rate, window and word length, more and more columns are chosen, and two classifiers
    fitted, inside each training part. Features are those of the graph that `export_onnx` writes, computed in
    single precision, of samples and with tables of so many bits; its operations and bytes are counted.

    Parameters
    ----------
    dataset : Dataset, str or path
        Whole labelled recordings, or what `open_dataset` opens.
    features : FeatureSet, str or path
        What may be bought, as far as it has a graph.
    limits : SmallLimits, optional
        What the model may take; the knee by default.
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    protocol : str, optional
        How recordings are held out; as `train` takes it by default.
    max_seconds : float, optional
        Of movement that are felt for one answer; 1 by default. Half and a quarter of it are tried, too, and
        windows start as often as the longest follow each other.
    seed : int
        Of folds and networks.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, what).
    model_file : str or path, optional
        Where the model is saved (.skops).

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    RecordingError
        If no recording can be used.
    ValueError
        If nothing is within the limits, or no feature has a graph.
    """
    check_installed("counting what a graph costs")
    limits = limits or SmallLimits()
    dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    every = features if isinstance(features, FeatureSet) else load_feature_set(features)
    bought, lacking = _with_graph(every)
    longest = LONGEST_S if max_seconds is None else max_seconds
    check_above_0(max_seconds=longest)
    like, known = dataset[0], metadata(dataset.entries)
    at_rates = _at_rates(dataset, like.fs)
    plan = Plan.of(bought, channels_apart(like, channels))
    level = TrainingFiles.of(dataset, like).remove_resting_level
    of_windows = Windows(plan, plan.channels or like.channels, 0, like.fs, like.unit, level)
    held_out_by, why = holding_out(protocol, AT_RANDOM, known, FALSE_ALARMS)
    tests = HoldingOut(known, held_out_by, why, asked=True, seed=seed)
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    do_each = partial(each, **work)
    cuts = _cuts(at_rates, of_windows, longest, full_scale_of(dataset), tests, limits, do_each)
    points = _points(cuts, limits, do_each)
    front = front_of(points)
    chosen = chosen_of(points, limits)
    if model_file is not None:
        felt = at_rates[chosen["fs_hz"]]
        _trained(felt, bought, chosen, channels, seed, protocol=protocol, **work).save(model_file)
        chosen["file"] = str(model_file)
    first = cuts[0].tests
    facts = study_facts(dataset, every, first.table, like, held_out_by, first.splits, seed)
    return Embedded(
        {
            **facts,
            "without_graph": list(lacking),
            "protocol": held_out_by.name,
            "why": why,
            "max_bytes": limits.max_bytes,
            "max_ops": limits.max_ops,
            "points": [_without_columns(point) for point in points],
            "front": [_without_columns(point) for point in front],
            "knee": _without_columns(knee(front)),
            "full": _full(cuts[0]),
            "chosen": chosen,
            "versions": versions(*LIBRARIES, "onnx", "onnxruntime"),
            **made_by(*COMPUTED_BY, "tradeoff", "recognition"),
            "notes": list(dataset.notes),
        }
    )


def _with_graph(every: FeatureSet) -> tuple[FeatureSet, tuple[str, ...]]:
    """Return the features of a set that have a graph, and the names of those that have none."""
    lacking = without_graph(every)
    if len(lacking) == len(every.members):
        raise OnnxExportError(f"no feature of {every.name} has a graph; the rule is at least one")
    return every.restricted_to(m.name for m in every.members if m.name not in lacking), lacking


def _at_rates(dataset: Dataset, fs: float) -> dict[float, Dataset]:
    """Return a dataset at its own rate fs (Hz), or the highest that is tried, and at each lower one."""
    rates = {rate for rate in RATES_HZ if rate <= fs} | {min(fs, max(RATES_HZ))}
    return {rate: dataset if rate == fs else at_rate(dataset, rate) for rate in sorted(rates, reverse=True)}


def _cuts(
    at_rates: Mapping[float, Dataset],
    of_windows: Windows,
    longest_s: float,
    full_scale: float,
    tests: HoldingOut,
    limits: SmallLimits,
    do_each: Callable[..., Iterator[Cut]],
) -> list[Cut]:
    """Return the windows at each rate (Hz), of the longest length, half and a quarter of it, if defined.

    Raises
    ------
    ValueError
        If the shortest alone take more than the limit, or no feature is defined in any.
    """
    grid = [(fs, seconds) for fs in at_rates for seconds in (longest_s, longest_s / 2, longest_s / 4)]
    shortest = min(len(of_windows.channels) * round(fs * seconds) for fs, seconds in grid)
    if limits.max_bytes is not None and limits.max_bytes < shortest:
        raise ValueError(
            f"max_bytes is {limits.max_bytes:g}; the rule is at least {shortest}: the shortest window alone"
        )
    calls = [
        partial(cut_of, at_rates[fs], of_windows._replace(fs=fs), seconds, longest_s, full_scale, tests)
        for fs, seconds in grid
    ]
    found = do_each(calls, what="windows", total=len(calls))
    # In the shortest windows nothing may be defined.
    if not (cuts := [cut for cut in found if np.isfinite(cut.X[WORDS[0]]).any()]):
        raise ValueError(f"no feature is defined in {longest_s:g} s; the rule is a longer window")
    return cuts


def _points(
    cuts: Sequence[Cut], limits: SmallLimits, do_each: Callable[..., Iterator[Any]]
) -> list[dict[str, Any]]:
    """Return what was tried: rate, window, words, columns and classifier, what they take, how right they are.

    Raises
    ------
    ValueError
        If nothing is within the limits.
    """
    models = [partial(_models_of, cut) for cut in cuts]
    made = list(do_each(models, what="models", total=len(models)))
    # Before the folds: what nothing keeps should not cost as many selections again.
    limits.kept([point for models in made for point in models.values()])
    parts = [partial(_hits_of, cut, split) for cut in cuts for split in cut.tests.splits]
    hits = iter(do_each(parts, what="selections", total=len(parts)))
    points = []
    for cut, models_of_cut in zip(cuts, made, strict=True):
        splits, data = cut.tests.splits, cut.data
        folds = [next(hits) for _ in splits]
        points += [
            {"window_s": cut.seconds, **point, "accuracy": accuracy_of(np.concatenate(right), splits, data)}
            for key, point in models_of_cut.items()
            if len(right := [fold[key] for fold in folds if key in fold]) == len(splits)
        ]
    return points


Rule = tuple[int, float]
"""How many columns were asked for (`ALL`), and at what thrift."""


def _hits_of(cut: Cut, split: Split) -> dict[tuple[Rule, str, Word], NDArray[np.bool_]]:
    """Return which windows of the test part are recognised by what each rule chooses of the training part."""
    found, data, seed = {}, cut.data, cut.tests.seed
    for rule, columns in _grown(cut.costs, data, split).items():
        for kind in _kinds(rule):
            fitted: dict[Word, list[Any]] = {}
            for word in WORDS:
                # What learnt from exact samples is as good with those of 16 bits, not with those of 8.
                source = word if word[0] < ALIKE_BITS else WORDS[0]
                if source not in fitted:
                    learn = partial(_fitted, CLASSIFIERS[kind](seed))
                    X = cut.X[source][:, columns]
                    (fitted[source],) = over_folds(learn, X, data.y, [split], preparation())
                before, classifier = fitted[source]
                asked = before.transform(cut.X[word][split[1]][:, columns])
                found[rule, kind, word] = in_bits(classifier, word[1]).predict(asked) == data.y[split[1]]
    return found


def _models_of(cut: Cut) -> dict[tuple[Rule, str, Word], dict[str, Any]]:
    """Return the points without accuracies: what the models of all windows take, by rule and classifier."""
    data, windows, seed = cut.data, cut.windows, cut.tests.seed
    every = np.arange(len(data.y))
    found: dict[tuple[Rule, str, Word], dict[str, Any]] = {}
    # What a classifier costs does not depend on its weights: a few windows make one.
    few = np.flatnonzero(pd.Series(data.y).groupby(data.y).cumcount() < FEW)
    known: set[tuple[int, ...]] = set()
    for rule, columns in _grown(cut.costs, data, (every, every)).items():
        if tuple(columns) in known:  # of another rule, too
            continue
        known.add(tuple(columns))
        names = [windows.plan.columns[i] for i in columns]
        for kind in _kinds(rule):
            learn, X = partial(_fitted, CLASSIFIERS[kind](seed)), data.X[few][:, columns]
            (steps,) = over_folds(learn, X, data.y[few], [(np.arange(len(few)),) * 2], preparation())
            work = decisions_of(windows, names, steps)
            for word in WORDS:
                facts = {"fs_hz": windows.fs, "sample_bits": word[0], "bits": word[1], "classifier": kind}
                facts |= {"asked": rule[0], "thrift": rule[1], "n_columns": len(names), "columns": names}
                found[rule, kind, word] = facts | taken(windows, work, *word)
    return found


def taken(windows: Windows, work: Work, sample_bits: int = 32, bits: int = 32) -> dict[str, float]:
    """Return the bytes of a window of samples and of the graph it goes into, and operations a second."""
    n_bytes = {
        "window_bytes": len(windows.channels) * windows.n_samples * sample_bits // 8,
        "constant_bytes": work.constant_bytes(bits),
        "intermediate_bytes": work.intermediate_bytes(sample_bits),
    }
    ops_per_s = sum(work.operations) / windows.n_samples * windows.fs
    return {**n_bytes, "bytes": sum(n_bytes.values()), "ops_per_s": ops_per_s}


def _kinds(rule: Rule) -> tuple[str, ...]:
    """Return the classifiers that are tried; few columns leave a network little to combine."""
    return (LINEAR, NETWORK) if rule[0] == ALL or rule[0] >= LEAST_OF_NETWORK else (LINEAR,)


def _grown(costs: CostModel, data: Labelled, split: Split) -> dict[Rule, list[int]]:
    """Return the columns that each rule chooses on the training part."""
    defined = np.flatnonzero(np.isfinite(data.X[split[0]]).any(axis=0))
    some = costs.restricted_to([costs.columns[i] for i in defined])

    def chosen(fold: Fold) -> dict[Rule, list[int]]:
        score = criterion(fold, data.groups)
        most: dict[str, Any] = {"max_features": N_COLUMNS[-1], "unit": "column", "direction": "forward"}
        blind = cost_aware(some, thrift=0.0, floating=False, **most).explore(some, score)
        both = cost_aware(some, thrift=1.0, floating=False, **most).explore(some, score)
        found = {(ALL, 0.0): defined.tolist()}
        for thrift, way in ((0.0, blind), (1.0, both[len(blind) :])):
            for n in N_COLUMNS:
                if fitting := [one.columns for one in way if len(one.columns) <= n]:
                    found[n, thrift] = defined[list(fitting[-1])].tolist()
        return found

    return over_folds(chosen, data.X[:, defined], data.y, [split], preparation())[0]


def _fitted(classifier: Any, fold: Fold) -> list[Any]:
    """Return a preparation and a classifier, fitted on the training part."""
    return [fold.preparation, fold.fitted(classifier)]


def _without_columns(point: Facts) -> Facts:
    return {name: value for name, value in point.items() if name != "columns"}


def front_of(points: Sequence[Facts]) -> list[Facts]:
    """Return the points that none beats in accuracy, bytes and operations, by bytes."""
    figures = np.array([[-p["accuracy"]["mean"], p["bytes"], p["ops_per_s"]] for p in points])
    beaten = [bool(((figures <= own).all(axis=1) & (figures < own).any(axis=1)).any()) for own in figures]
    kept = [point for point, is_beaten in zip(points, beaten, strict=True) if not is_beaten]
    return sorted(kept, key=lambda point: (point["bytes"], point["ops_per_s"]))


def _full(cut: Cut) -> dict[str, Any]:
    """Return what all columns give with a classifier that keeps what it was trained on."""
    data, splits = cut.data, cut.tests.splits
    kept = np.flatnonzero(np.isfinite(data.X).any(axis=0))
    names = [cut.windows.plan.columns[i] for i in kept]

    def judged(fold: Fold) -> tuple[NDArray[np.bool_], dict[str, float]]:
        steps = _fitted(KernelDiscriminant(), fold)
        hits = np.asarray(steps[-1].predict(fold.asked) == fold.truth)
        return hits, taken(cut.windows, decisions_of(cut.windows, names, steps))

    hits, costs = zip(*over_folds(judged, data.X[:, kept], data.y, splits, preparation()), strict=True)
    facts = {"window_s": cut.seconds, "fs_hz": cut.windows.fs, "classifier": "kernel", "n_columns": len(kept)}
    accuracy = accuracy_of(np.concatenate(hits), splits, data)
    dearest = max(costs, key=lambda cost: (cost["ops_per_s"], cost["bytes"]))
    return {**facts, "accuracy": accuracy, **dearest}


def chosen_of(points: Sequence[Facts], limits: SmallLimits) -> dict[str, Any]:
    """Return the most accurate point within the limits, or the knee without any.

    Raises
    ------
    ValueError
        If nothing is within the limits.
    """
    if limits == SmallLimits():
        why = f"knee: the fewest bytes within {KNEE_LOSS:.0%} of the best"
        return {**knee(front_of(points)), "why": why, "file": ""}
    best = max(limits.kept(points), key=lambda point: (point["accuracy"]["mean"], -point["bytes"]))
    return {**best, "why": "the most accurate within the limits", "file": ""}


def _trained(
    dataset: Dataset, features: FeatureSet, chosen: Facts, channels: Channels, seed: int, **settings: Any
) -> Model:
    """Return the model of the columns and the classifier that were chosen, trained on a dataset."""
    classifier = CLASSIFIERS[chosen["classifier"]](seed)
    steps = [step for _, step in preparation().steps]
    row = RowDefinition(name="chosen for its size", features=tuple(chosen["columns"]), skip_missing=True)
    pipeline = PipelineDefinition(
        name="embedded",
        features=features,
        seed=seed,
        channels=channels,
        steps=tuple(map(_used, steps)),
        classifiers={chosen["classifier"]: _used(classifier)},
        rows=(row,),
    )
    model = train(dataset, pipeline, touch_s=chosen["window_s"], skip_bad=True, **settings)
    stated = {**model.manifest.accuracy, **chosen["accuracy"], "how": CHOSEN_INSIDE}
    return replace(model, manifest=model.manifest.model_copy(update={"accuracy": stated}))


def _used(estimator: Any) -> Use:
    """Return an estimator as a pipeline names it, with the parameters that are not the default."""
    kind = type(estimator)
    known = kind().get_params()
    own = {name: value for name, value in estimator.get_params().items() if value is not known[name]}
    return Use(use=path_of(kind), **own)
