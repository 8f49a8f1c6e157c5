"""Accuracy against what a small computer has: bytes and operations, counted in the graph that is exported."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.neural_network import MLPClassifier

from texclass.document import Document
from texclass.experiment.cost import CostModel
from texclass.experiment.feature_table import metadata
from texclass.experiment.folds import Fold, over_folds
from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.pipeline import PipelineDefinition, RowDefinition, Use
from texclass.experiment.protocols import Protocol, Split, splits_of
from texclass.experiment.result import COMPUTED_BY, Result
from texclass.experiment.selection import SubsetScore, inner_splits
from texclass.experiment.windows import touches
from texclass.experiment.workers import Progress, each
from texclass.features.phase_view import TURN, Channels, channels_apart
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, load_feature_set
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset, Entry
from texclass.provenance import made_by, versions
from texclass.recognition.deployed import described_classifier, described_steps
from texclass.recognition.export.graph import (
    LARGE,
    Graph,
    OnnxExportError,
    add_part,
    tensor_of,
)
from texclass.recognition.export.graph_cost import GraphCost, Work, rounded, shortened, work_of
from texclass.recognition.export.graph_view import without_graph
from texclass.recognition.export.onnx_file import check_installed
from texclass.recognition.export.sample_graph import SAMPLES, Windows, add_features, features_of
from texclass.recognition.model import Model
from texclass.recognition.sources.training_input import TrainingFiles
from texclass.recognition.training import AT_RANDOM, FALSE_ALARMS, LIBRARIES, holding_out, train
from texclass.recording import Recording, RecordingError, Samples
from texclass.tradeoff.curves import degraded, full_scale_of, quantised
from texclass.tradeoff.front import (
    INNER_FOLDS,
    KNEE_LOSS,
    Facts,
    Labelled,
    cost_aware,
    discriminant,
    estimate,
    preparation,
)
from texclass.validation import check_above_0

Word = tuple[int, int]
RATES_HZ = (10_000.0, 5_000.0, 2_500.0, 1_000.0)
LONGEST_S = 1.0
"""Of movement that is felt for one answer."""
WORDS = ((32, 32), (16, 16), (16, 8), (8, 8))
"""Bits of samples, and of tables and weights; 32 are single precision."""
ALIKE_BITS = 16
N_COLUMNS = (4, 8, 16, 32, 48, 64, 96)
LEAST_OF_NETWORK = 16
ALL = 0
"""Stands for all columns, where their number is asked for."""
FEW = 3
"""Windows of each surface that make a classifier of the right size."""
HIDDEN = 64
BATCH = 64
"""Windows that a graph is given at once."""
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

    def keeps(self, point: Facts) -> bool:
        """Return whether a point is within the limits."""
        return bool(
            point["bytes"] <= (self.max_bytes or np.inf) and point["ops_per_s"] <= (self.max_ops or np.inf)
        )


class Cut(NamedTuple):
    """The windows of a dataset at one rate and length, and what graphs make of them: (bits, bits) -> X."""

    windows: Windows
    frame: pd.DataFrame
    X: Mapping[Word, Samples]
    costs: CostModel


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
    lacking = without_graph(every)
    if len(lacking) == len(every.members):
        raise OnnxExportError(f"no feature of {every.name} has a graph; the rule is at least one")
    bought = every.restricted_to(m.name for m in every.members if m.name not in lacking)
    own, longest = dataset[0].fs, LONGEST_S if max_seconds is None else max_seconds
    check_above_0(max_seconds=longest)
    rates = {rate for rate in RATES_HZ if rate <= own} | ({own} if own < max(RATES_HZ) else set())
    at_rates = {fs: dataset if fs == own else at_rate(dataset, fs) for fs in sorted(rates, reverse=True)}
    like = dataset[0]
    plan = Plan.of(bought, channels_apart(like, channels))
    level = TrainingFiles.of(dataset, like).remove_resting_level
    of_windows = Windows(plan, plan.channels or like.channels, 0, own, like.unit, level)
    scale = full_scale_of(dataset)
    grid = [(fs, seconds) for fs in at_rates for seconds in (longest, longest / 2, longest / 4)]
    calls = [
        partial(cut_of, at_rates[fs], of_windows._replace(fs=fs), seconds, longest, scale)
        for fs, seconds in grid
    ]
    work: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress}
    found = zip(grid, each(calls, what="windows", total=len(calls), **work), strict=True)
    # In the shortest windows nothing may be defined.
    of_grid = {at: cut for at, cut in found if np.isfinite(cut.X[WORDS[0]]).any()}
    if not of_grid:
        raise ValueError(f"no feature is defined in {longest:g} s; the rule is a longer window")
    grid, cuts = list(of_grid), list(of_grid.values())
    held_out_by, why = holding_out(protocol, AT_RANDOM, metadata(dataset.entries), FALSE_ALARMS)
    splits = [splits_of(held_out_by, cut.frame, seed) for cut in cuts]
    learnt = [_labelled(cut, held_out_by) for cut in cuts]
    models: list[Callable[[], Any]] = [
        partial(_models_of, cut, data, seed) for cut, data in zip(cuts, learnt, strict=True)
    ]
    parts: list[Callable[[], Any]] = [
        partial(_hits_of, cut, data, split, seed)
        for cut, data, of in zip(cuts, learnt, splits, strict=True)
        for split in of
    ]
    said: list[Any] = list(each([*models, *parts], what="selections", total=len(models) + len(parts), **work))
    costs, hits = said[: len(cuts)], iter(said[len(cuts) :])
    points: list[dict[str, Any]] = []
    for (_, seconds), cut, data, of, cost in zip(grid, cuts, learnt, splits, costs, strict=True):
        points += _points(cut, seconds, cost, [next(hits) for _ in of], of, data)
    front, (fs, seconds) = front_of(points), grid[0]
    full = {**_full(cuts[0], splits[0], learnt[0]), "fs_hz": fs, "window_s": seconds}
    chosen = chosen_of(points, limits)
    if model_file is not None:
        felt = at_rates[chosen["fs_hz"]]
        model = _trained(felt, bought, chosen, channels, seed, protocol=protocol, **work)
        model.save(model_file)
        chosen["file"] = str(model_file)
    over, independent = held_out_by.independent(cuts[0].frame)
    recordings = cuts[0].frame.drop_duplicates("parent")
    return Embedded(
        {
            "dataset": {
                "name": dataset.name,
                "title": dataset.title,
                "n_recordings": len(recordings),
                "n_windows": len(cuts[0].frame),
                "n_materials": int(recordings["material"].nunique()),
                "chance": float(cuts[0].frame["material"].value_counts(normalize=True).max()),
                "fs_hz": float(own),
                "unit": like.unit,
            },
            "features": every.name,
            "features_hash": every.hash,
            "movement": every.movement,
            "without_graph": list(lacking),
            "protocol": held_out_by.name,
            "why": why,
            "clusters": over,
            "n_clusters": len(np.unique(independent[np.concatenate([test for _, test in splits[0]])])),
            "max_bytes": limits.max_bytes,
            "max_ops": limits.max_ops,
            "points": [_without_columns(point) for point in points],
            "front": [_without_columns(point) for point in front],
            "knee": _without_columns(knee_of(front)),
            "full": full,
            "chosen": chosen,
            "versions": versions(*LIBRARIES, "onnx", "onnxruntime"),
            "seed": seed,
            "input_hash": dataset.input_hash,
            **made_by(*COMPUTED_BY, "tradeoff", "recognition"),
            "notes": list(dataset.notes),
        }
    )


def at_rate(dataset: Dataset, fs: float) -> Dataset:
    """Return a dataset at a lower rate (Hz), the same for all recordings, to a sample of their length."""
    lower = degraded(dataset, fs=fs)
    return replace(lower, load=partial(_at_rate, lower.load, fs))


def _at_rate(load: Callable[[Entry], Recording], fs: float, entry: Entry) -> Recording:
    return load(entry).with_(fs=fs)


def cut_of(dataset: Dataset, windows: Windows, seconds: float, step: float, full_scale: float) -> Cut:
    """Cut a dataset at one rate, and compute its features with graphs of fewer and fewer bits.

    Parameters
    ----------
    dataset : Dataset
        At that rate.
    windows : Windows
        But for their length.
    seconds, step : float
        Of a window, and from one to the next.
    full_scale : float
        Of the converter.
    """
    felt, rows, kept = touches(dataset, seconds, step=step), [], []
    for entry in felt.entries:
        try:
            recording = felt.load(entry)
        except RecordingError:
            continue
        signals = [recording.acceleration]
        if recording.turn_rate is not None and set(TURN) & set(windows.channels):
            signals.append(recording.turn_rate)
        rows.append(np.column_stack(signals).T)
        kept.append(entry)
    if not rows:
        raise RecordingError(f"{dataset.name}: no recording moves for {seconds:g} s")
    samples, windows = np.stack(rows), windows._replace(n_samples=rows[0].shape[1])
    graph = _features_model(windows)
    X = {}
    for of_samples, bits in WORDS:
        felt_with = samples if of_samples == 32 else quantised(samples, of_samples, full_scale)
        X[of_samples, bits] = _computed(shortened(graph, bits), felt_with)
    return Cut(windows, metadata(kept), X, operations_of(windows))


def _features_model(windows: Windows) -> Any:
    """Return the graph of all features, of any number of windows, in double precision."""
    from onnx import TensorProto

    graph = Graph()
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, "n", len(windows.channels), windows.n_samples)
    graph.add("Identity", add_features(windows, graph, graph.cast(SAMPLES, np.float64)), name="features")
    output = tensor_of("features", TensorProto.DOUBLE, "n", len(windows.plan.columns))
    return graph.model([entry], [output], "features", "")


def _computed(model: Any, samples: Samples) -> Samples:
    """Return what a graph computes of windows, shape (n, n_columns); what is infinite is undefined."""
    from onnxruntime import InferenceSession, SessionOptions

    options = SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    batches = (samples[k : k + BATCH].astype(np.float32) for k in range(0, len(samples), BATCH))
    X = np.concatenate([session.run(None, {SAMPLES: batch})[0] for batch in batches]).astype(np.float64)
    return np.where(np.isfinite(X), X, np.nan)


def operations_of(windows: Windows) -> CostModel:
    """Return what columns cost in operations a window: a part is what the same features need of the graph."""
    from onnx import TensorProto

    graph = Graph()
    tensors, places = features_of(windows, graph, graph.cast(SAMPLES, np.float64))
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, 1, len(windows.channels), windows.n_samples)
    work = work_of(
        graph.model([entry], [tensor_of(t, TensorProto.DOUBLE, 1, "k") for t in tensors], "parts", "")
    )
    users = {tensor: {i} for i, tensor in enumerate(tensors)}
    operations: dict[frozenset[int], float] = {}
    for node, n in reversed(list(zip(work.nodes, work.operations, strict=True))):
        by = frozenset[int]().union(*(users.get(name, ()) for name in node.output))
        operations[by] = operations.get(by, 0.0) + n
        for name in node.input:
            users[name] = users.get(name, set()) | by
    feature_of = dict(
        zip(places, np.repeat(range(len(tensors)), [work.sizes[t] for t in tensors]), strict=True)
    )
    own = [int(feature_of[column]) for column in windows.plan.columns]
    return CostModel(
        columns=windows.plan.columns,
        features=tuple(tensors[i] for i in own),
        parts=tuple(str(sorted(by)) for by in operations),
        ms=np.array(list(operations.values())),
        needs=np.array([[i in by for by in operations] for i in own]),
    )


def _labelled(cut: Cut, protocol: Protocol) -> Labelled:
    y = cut.frame["material"].to_numpy(dtype=str)
    return Labelled(cut.X[WORDS[0]], y, protocol.clusters(cut.frame), protocol.independent(cut.frame)[1])


Rule = tuple[int, float]
"""How many columns were asked for (`ALL`), and at what thrift."""


def _hits_of(
    cut: Cut, data: Labelled, split: Split, seed: int
) -> dict[tuple[Rule, str, Word], NDArray[np.bool_]]:
    """Return which windows of the test part are recognised by what each rule chooses of the training part."""
    found = {}
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


def _models_of(
    cut: Cut, data: Labelled, seed: int
) -> dict[tuple[Rule, str, Word], tuple[list[str], GraphCost]]:
    """Return the columns that each rule chooses of all windows, and what they cost with each classifier."""
    every = np.arange(len(data.y))
    found: dict[tuple[Rule, str, Word], tuple[list[str], GraphCost]] = {}
    # What a classifier costs does not depend on its weights: a few windows make one.
    few = np.flatnonzero(pd.Series(data.y).groupby(data.y).cumcount() < FEW)
    known: set[tuple[int, ...]] = set()
    for rule, columns in _grown(cut.costs, data, (every, every)).items():
        if tuple(columns) in known:  # of another rule, too
            continue
        known.add(tuple(columns))
        names = [cut.windows.plan.columns[i] for i in columns]
        for kind in _kinds(rule):
            learn, X = partial(_fitted, CLASSIFIERS[kind](seed)), data.X[few][:, columns]
            (steps,) = over_folds(learn, X, data.y[few], [(np.arange(len(few)),) * 2], preparation())
            work = decisions_of(cut.windows, names, steps)
            found |= {(rule, kind, word): (names, work.cost(*word)) for word in WORDS}
    return found


def _kinds(rule: Rule) -> tuple[str, ...]:
    """Return the classifiers that are tried; few columns leave a network little to combine."""
    return (LINEAR, NETWORK) if rule[0] == ALL or rule[0] >= LEAST_OF_NETWORK else (LINEAR,)


def _grown(costs: CostModel, data: Labelled, split: Split) -> dict[Rule, list[int]]:
    """Return the columns that each rule chooses on the training part."""
    defined = np.flatnonzero(np.isfinite(data.X[split[0]]).any(axis=0))
    some = costs.restricted_to([costs.columns[i] for i in defined])

    def chosen(fold: Fold) -> dict[Rule, list[int]]:
        labels = np.unique(fold.labels, return_inverse=True)[1]
        inner = inner_splits(fold.labels, data.groups[fold.train], INNER_FOLDS)
        score = SubsetScore(discriminant(), fold.learnt, labels, inner, "log_likelihood")
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


def in_bits(classifier: Any, bits: int) -> Any:
    """Return a fitted linear classifier or network with weights of so many bits."""
    found = copy(classifier)
    if (weights := getattr(classifier, "coef_", None)) is not None:
        found.coef_ = _kept(weights, bits)
    if (layers := getattr(classifier, "coefs_", None)) is not None:
        found.coefs_ = [_kept(weights, bits) for weights in layers]
    return found


def _kept(weights: Samples, bits: int) -> Samples:
    return rounded(weights, bits) if weights.size >= LARGE else weights


def decisions_of(windows: Windows, columns: Sequence[str], steps: Sequence[Any]) -> Work:
    """Return the work of the graph from samples to decisions.

    Parameters
    ----------
    windows : Windows
        With a plan of these columns or more.
    columns : sequence of str
        What is computed.
    steps : sequence of estimator
        Fitted on these columns; a classifier last.
    """
    from onnx import TensorProto

    graph, plan = Graph(), windows.plan.restricted_to(columns)
    rows = add_features(windows._replace(plan=plan), graph, graph.cast(SAMPLES, np.float64))
    described = [part for step in steps[:-1] for part in described_steps(step)]
    for part in (*described, described_classifier(steps[-1])):
        rows = add_part(part, graph, rows)
    graph.add("Identity", rows, name="decisions")
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, 1, len(windows.channels), windows.n_samples)
    output = tensor_of("decisions", TensorProto.DOUBLE, 1, len(steps[-1].classes_))
    return work_of(graph.model([entry], [output], "decisions", ""))


def _sums(windows: Windows, cost: GraphCost, word: Word) -> dict[str, Any]:
    """Return bytes and operations a second as a point holds them."""
    window = len(windows.channels) * windows.n_samples * word[0] // 8
    return {
        "window_bytes": window,
        "constant_bytes": cost.constant_bytes,
        "intermediate_bytes": cost.intermediate_bytes,
        "bytes": window + cost.constant_bytes + cost.intermediate_bytes,
        "ops_per_s": cost.operations / windows.n_samples * windows.fs,
    }


def _points(
    cut: Cut,
    seconds: float,
    models: Mapping[Any, tuple[list[str], GraphCost]],
    folds: Sequence[Mapping[Any, Any]],
    splits: Sequence[Split],
    data: Labelled,
) -> list[dict[str, Any]]:
    """Return the points of one rate and window: accuracy of the folds, cost of the model of all windows."""
    return [
        {
            "fs_hz": cut.windows.fs,
            "window_s": seconds,
            "sample_bits": word[0],
            "bits": word[1],
            "asked": rule[0],
            "thrift": rule[1],
            "n_columns": len(columns),
            "columns": columns,
            "classifier": kind,
            "accuracy": estimate(np.concatenate([fold[rule, kind, word] for fold in folds]), splits, data),
            **_sums(cut.windows, cost, word),
        }
        for (rule, kind, word), (columns, cost) in models.items()
        if all((rule, kind, word) in fold for fold in folds)
    ]


def _without_columns(point: Facts) -> Facts:
    return {name: value for name, value in point.items() if name != "columns"}


def front_of(points: Sequence[Facts]) -> list[Facts]:
    """Return the points that none beats in accuracy, bytes and operations, by bytes."""
    figures = np.array([[-p["accuracy"]["mean"], p["bytes"], p["ops_per_s"]] for p in points])
    beaten = [bool(((figures <= own).all(axis=1) & (figures < own).any(axis=1)).any()) for own in figures]
    kept = [point for point, is_beaten in zip(points, beaten, strict=True) if not is_beaten]
    return sorted(kept, key=lambda point: (point["bytes"], point["ops_per_s"]))


def knee_of(front: Sequence[Facts]) -> Facts:
    """Return the point with the fewest bytes that loses at most `KNEE_LOSS` to the best one."""
    best = max(point["accuracy"]["mean"] for point in front)
    return next(point for point in front if point["accuracy"]["mean"] >= best - KNEE_LOSS)


def _full(cut: Cut, splits: Sequence[Split], data: Labelled) -> dict[str, Any]:
    """Return what all columns give with a classifier that keeps what it was trained on."""
    kept = np.flatnonzero(np.isfinite(data.X).any(axis=0))
    names = [cut.windows.plan.columns[i] for i in kept]

    def judged(fold: Fold) -> tuple[NDArray[np.bool_], GraphCost]:
        before, classifier = _fitted(KernelDiscriminant(), fold)
        hits = np.asarray(classifier.predict(fold.asked) == fold.truth)
        return hits, decisions_of(cut.windows, names, [before, classifier]).cost()

    hits, costs = zip(*over_folds(judged, data.X[:, kept], data.y, splits, preparation()), strict=True)
    return {
        "classifier": "kernel",
        "n_columns": len(kept),
        "accuracy": estimate(np.concatenate(hits), splits, data),
        **_sums(cut.windows, max(costs), WORDS[0]),
    }


def chosen_of(points: Sequence[Facts], limits: SmallLimits) -> dict[str, Any]:
    """Return the most accurate point within the limits, or the knee without any.

    Raises
    ------
    ValueError
        If nothing is within the limits.
    """
    if limits == SmallLimits():
        why = f"knee: the fewest bytes within {KNEE_LOSS:.0%} of the best"
        return {**knee_of(front_of(points)), "why": why, "file": ""}
    within = [point for point in points if limits.keeps(point)]
    if not within:
        least, ops = (min(point[key] for point in points) for key in ("bytes", "ops_per_s"))
        raise ValueError(
            f"nothing takes at most {limits.max_bytes or np.inf:g} bytes and {limits.max_ops or np.inf:g} "
            f"operations a second; the rule is at least {least:g} and {ops:g}"
        )
    best = max(within, key=lambda point: (point["accuracy"]["mean"], -point["bytes"]))
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
    return Use(use=f"{kind.__module__}.{kind.__qualname__}", **own)
