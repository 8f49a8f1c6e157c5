"""A trained model of windows as one ONNX graph: samples in; label, probabilities, p-value and verdict out."""

import math
from typing import Any, NamedTuple

import numpy as np

from texclass.features.phase_view import MIN_SEGMENT_SAMPLES, TURN, trimmed_length
from texclass.features.plan import Plan
from texclass.recognition.live.online_recogniser import RecordingBuilder
from texclass.recognition.model import Model
from texclass.recording import STANDARD_GRAVITY, Recording, Samples
from texclass.robot.export.answers_graph import add_answers
from texclass.robot.export.fourier_graphs import irfft, rfft
from texclass.robot.export.graph import Graph, OnnxExportError, Tensor, tensor_of
from texclass.robot.export.graph_view import GraphView, member_graph, without_graph
from texclass.signals import HAND_WINDOW_S, TIE_BREAK_SINGLE

SAMPLES = "samples"
DOC = """\
Which surface is this: a texclass model of windows, from samples to the answer.

Input: samples, float32 (n, n_channels, n_samples), windows of a movement; texclass.window says how long they
are, at which rate, in which unit, and what the channels are.
Outputs: label, string (n,), the likeliest surface; probabilities, float64 (n, n_surfaces), calibrated, in
the order of texclass.surfaces; p_known, float64 (n,), conformal p-value of "this surface is one of them";
unknown, bool (n,), p_known <= texclass.false_alarms, or no feature has a value.
A window with a sample that is not finite, or with an undefined feature that nothing fills, has the label "",
NaN, and is unknown. texclass.self_check holds windows, made by a formula, with the answers they have to get.
"""


class Windows(NamedTuple):
    """What the graph of features has to know of windows.

    Attributes
    ----------
    plan
        What is computed of them.
    channels
        Of a window, in order: axes of the acceleration, then of the turn rate.
    n_samples
        Of a window.
    fs
        Sampling rate in Hz.
    unit
        Of the acceleration.
    without_level
        Whether the resting level is removed from windows: then their mean is no gravity.
    """

    plan: Plan
    channels: tuple[str, ...]
    n_samples: int
    fs: float
    unit: str
    without_level: bool

    @classmethod
    def of(cls, model: Model, n_samples: int) -> "Windows":
        """Return the windows of a model."""
        stated = model.manifest
        level = stated.input.remove_resting_level
        return cls(model.plan, channels_of(model), n_samples, stated.fs, stated.unit, level)


def channels_of(model: Model) -> tuple[str, ...]:
    """Return the channels of a window, in order: axes of the acceleration, then of the turn rate."""
    return model.plan.channels or model.manifest.input.axes or ("acceleration",)


def window_of_model(model: Model, window_s: float | None = None) -> int:
    """Return how many samples a window has.

    Parameters
    ----------
    model : Model
        Of touches, unless `window_s` is given.
    window_s : float, optional
        Seconds; those of the touches it was trained on by default.

    Raises
    ------
    OnnxExportError
        If the model is of whole recordings and no length is given.
    """
    seconds = window_s or model.manifest.window_s
    if seconds is None:
        raise OnnxExportError(
            "the model was trained on whole recordings. Expected a model of touches (texclass train "
            "--window SECONDS), or a length (texclass export --window SECONDS)"
        )
    if not 0 < seconds < math.inf:
        raise OnnxExportError(f"the window must have a positive length, got {seconds!r} s")
    return max(1, round(seconds * model.manifest.fs))


def check_graphs(model: Model) -> None:
    """Check that all features of a model have a graph.

    Raises
    ------
    OnnxExportError
        Naming those that have none.
    """
    parts = [part for _, part in model.plan.parts]
    if lacking := tuple(dict.fromkeys(name for part in parts for name in without_graph(part))):
        raise OnnxExportError(
            f"no graph of {', '.join(lacking)}. Expected features of the movement that have one (texclass "
            "train --exportable chooses among these), or --from features"
        )


def build_of_samples(model: Model, n_samples: int, *, with_features: bool = False) -> Any:
    """Return a trained model as an ONNX model of windows, without metadata.

    Parameters
    ----------
    model : Model
        What is exported.
    n_samples : int
        Of a window.
    with_features : bool
        Whether the features are an output, too.

    Returns
    -------
    onnx.ModelProto
        One input, "samples"; the outputs of `graph.OUTPUTS`, and "features".

    Raises
    ------
    OnnxExportError
        If a feature, a step or the classifier has no export.
    """
    check_graphs(model)
    windows = Windows.of(model, n_samples)
    x, entry = windows_in(windows, "n", same_pieces=_same_pieces(model, n_samples))
    features = add_features(windows, x)
    broken = x.graph.add("IsNaN", (x * 0.0).reduced("ReduceSum", 1, 2, keepdims=False))
    outputs = add_answers(model, features, broken)
    if with_features:
        x.graph.add("Identity", features, name="features")
        outputs.append(tensor_of("features", np.float64, "n", len(model.columns)))
    return x.graph.model([entry], outputs, "surfaces", DOC)


def windows_in(windows: Windows, n: int | str, *, same_pieces: bool = False) -> tuple[Tensor, Any]:
    """Return n windows of samples in double precision, in a new graph, and the description of its input."""
    entry = tensor_of(SAMPLES, np.float32, n, len(windows.channels), windows.n_samples)
    return Tensor(Graph(same_pieces=same_pieces), SAMPLES).cast(np.float64), entry


def recording_of(model: Model, window: Samples) -> Recording:
    """Return a window (n_channels, n_samples) as the recording that a stream makes of it."""
    rows = np.asarray(window, dtype=np.float64).T
    builder = RecordingBuilder(model, rows.shape[1], model.manifest.fs, model.manifest.unit)
    return builder.build_window(rows, 0)


def _same_pieces(model: Model, n_samples: int) -> bool:
    """Return whether windows are too short to be cut, and all steps leave their equal pieces equal."""
    n_segments = model.classifier["columns"].shape[1] if model.classifier["operation"] == "vote" else 1
    given = [
        member.parameters.get("n_segments", 1) for _, part in model.plan.parts for member in part.members
    ]
    cut = n_samples >= n_segments * MIN_SEGMENT_SAMPLES
    if n_segments == 1 or cut or set(given) != {n_segments} or len(model.columns) % n_segments:
        return False
    rows = np.random.default_rng(0).standard_normal((2, len(model.columns) // n_segments))
    rows[1] = np.nan
    prepared = model.prepare(np.repeat(rows, n_segments, axis=1))
    if prepared.shape[1] % n_segments:
        return False
    pieces = prepared.reshape(2, -1, n_segments)
    return bool((pieces == pieces[:, :, :1]).all())


def feature_tensors(windows: Windows, x: Tensor) -> tuple[list[Tensor], list[str]]:
    """Add the columns of a plan, of windows (n, n_channels, n_samples) in double precision.

    Parameters
    ----------
    windows : Windows
        All features of the plan have a graph.
    x : Tensor
        The windows.

    Returns
    -------
    tensors : list of Tensor
        One a feature, shape (n, its columns).
    places : list of str
        The columns of these side by side.
    """
    plan = windows.plan
    apart = [(prefix.removesuffix("/"), part) for prefix, part in plan.parts if prefix]
    places: list[str] = []
    tensors: list[Tensor] = []
    if apart:  # the channels one after the other, as movements of their own
        names = [name for name, _ in apart]
        at = np.array([plan.channels.index(name) for name in names])
        rows = x.take(at).reshape(-1, 1, windows.n_samples)
        is_axis = np.array([name not in TURN for name in names])
        views = _movements(windows, rows, 1, is_axis)
        members = {member.name: member for _, part in apart for member in part.members}
        for member in members.values():
            values = member_graph(views[member.remove_hand_motion], member)
            tensors.append(values.reshape(-1, len(names) * len(member.all_columns)))
            places += [f"{name}/{column}" for name in names for column in member.all_columns]
    for part in (part for prefix, part in plan.parts if not prefix):
        views = _movements(windows, x, len(windows.channels))
        tensors += [member_graph(views[member.remove_hand_motion], member) for member in part.members]
        places += [column for member in part.members for column in member.all_columns]
    return tensors, places


def add_features(windows: Windows, x: Tensor) -> Tensor:
    """Add the columns of a plan in their order, shape (n, n_columns); see `feature_tensors`."""
    tensors, places = feature_tensors(windows, x)
    every = x.graph.beside(*tensors) if len(tensors) > 1 else tensors[0]
    order = [places.index(column) for column in windows.plan.columns]
    return every if order == list(range(len(places))) else every.take(np.array(order))


def _movements(windows: Windows, x: Tensor, n_axes: int, is_axis: Any = True) -> dict[bool, GraphView]:
    """Add conditioned movements of windows (n, n_axes, n_samples): with (False) and without the hand (True).

    See `Views.movement` and `Views.vibration`.
    """
    fs, n_samples = windows.fs, windows.n_samples
    n = trimmed_length(n_samples)
    kept = x.cut(0, n) if n < n_samples else x
    mean = kept.mean(2)
    axes = kept - mean
    samples = axes.reshape(0, n) if n_axes == 1 else _dft321(axes, n_axes, n)
    movement = GraphView(samples, fs, n)
    felt_by_hand = any(member.remove_hand_motion for _, part in windows.plan.parts for member in part.members)
    if windows.unit != "m/s^2" or not felt_by_hand:
        return {False: movement, True: movement}
    if windows.without_level:  # then the mean is no gravity
        largest, _ = x.graph.largest(x, n_samples // 2 + 1)
        level = largest.cut(n_samples // 2 - (n_samples % 2 == 0), n_samples // 2 + 1).mean(2)  # median
        if not np.all(is_axis):  # a turn rate keeps its own
            level = level.reshape(-1, len(is_axis)) * np.where(is_axis, 1.0, 0.0)
            level = level.reshape(-1, 1, 1)
        mean = mean - level
    weight = mean.reduced("ReduceSumSquare", 1, 2, keepdims=False).sqrt()
    is_gravity = (weight > STANDARD_GRAVITY / 2).unsqueeze()
    span = max(2 * round(HAND_WINDOW_S * fs / 2) + 1, 3)
    away = samples - movement.moving_average(samples, n, span)
    return {False: movement, True: GraphView(away.where(is_gravity, samples), fs, n)}


def _dft321(axes: Tensor, n_axes: int, n: int) -> Tensor:
    """Add one signal (n_rows, n) of several axes (n_rows, n_axes, n) without their means; see `dft321`."""
    add, n_bins = axes.graph.add, n // 2 + 1
    bins = np.arange(n_bins)
    real, imaginary = (part.reshape(-1, n_axes, n_bins) for part in rfft(axes.reshape(-1, n), n, n, n_bins))
    imaginary = imaginary * np.where((bins == 0) | (2 * bins == n), 0.0, 1.0)
    energy = (real * real + imaginary * imaginary).reduced("ReduceSum", 1, keepdims=False)
    size = (energy * np.where(bins == 0, 0.0, 1.0)).sqrt()
    weights = 1 + (n_axes - 1 - np.arange(n_axes)[:, None]) * TIE_BREAK_SINGLE
    real, imaginary = ((z * weights).reduced("ReduceSum", 1, keepdims=False) for z in (real, imaginary))
    magnitude = (real * real + imaginary * imaginary).sqrt()
    vanishing = add("Equal", magnitude, 0.0)
    scale = size / add("Where", vanishing, 1.0, magnitude)
    return irfft(add("Where", vanishing, 1.0, real) * scale, imaginary * scale, n)
