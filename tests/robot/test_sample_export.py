"""Export of models to ONNX, from samples on: same features, labels and verdicts, or no file."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import onnx
import pytest
from changed_graphs import changed_graphs
from onnx import numpy_helper
from onnxruntime import InferenceSession
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import StandardScaler
from toy_models import model_of
from toy_surfaces import FS, SURFACES, pipeline, recording, surfaces

from texclass.classifiers.segment_voting import SegmentVoting
from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.features.contract import list_features
from texclass.features.phase_view import PhaseView, UndefinedFeatureError
from texclass.features.plan import Plan
from texclass.features.sets import Member
from texclass.recognition import train
from texclass.robot import OnnxExportError, ParityError, export_onnx
from texclass.robot.export import fourier_graphs, graph_view
from texclass.robot.export.graph import Graph, Tensor, tensor_of
from texclass.robot.export.graph_view import GraphView, builders, graph_of
from texclass.robot.export.parity import run
from texclass.robot.export.sample_graph import SAMPLES, build_sample_graph, recording_of
from texclass.robot.export.sample_parity import (
    check_sample_parity,
    create_window,
    features_of_windows,
    window_recipes,
)


def compute(build, rows):
    """Return the values of the tensors (n, n_columns) that `build` adds to a graph with the input `x`."""
    graph = Graph()
    result = build(Tensor(graph, "x"))
    tensors = [result] if isinstance(result, Tensor) else list(result)
    outputs = [tensor_of(tensor.name, np.float64, None, None) for tensor in tensors]
    entry = tensor_of("x", np.float64, "n", *rows.shape[1:])
    model = graph.model([entry], outputs, "test", "")
    session = InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": rows})


@pytest.fixture(scope="module")
def recorded_windows(window_model):
    """Return windows of all surfaces and of an unknown one, in single precision."""
    windows = [
        window
        for s in (*SURFACES, "stranger")
        for k in (51, 52)
        for window in window_model.cut(recording(s, k))
    ]
    return np.array([window.acceleration[None] for window in windows], dtype=np.float32)


@pytest.mark.parametrize("n", [7, 64, 97, 500, 2200, 2310])
def test_fourier_transforms_equal_those_of_numpy(n):
    rows = np.random.default_rng(0).standard_normal((3, n))
    for n_fft, n_bins in ((n, n // 2 + 1), (2 * n, n // 3)):
        real, imaginary = compute(partial(fourier_graphs.rfft, n=n, n_fft=n_fft, n_bins=n_bins), rows)
        X = np.fft.rfft(rows, n_fft)[:, :n_bins]
        np.testing.assert_allclose(real + 1j * imaginary, X, rtol=0, atol=1e-11)

    def round_trip(x):
        real, imaginary = fourier_graphs.rfft(x, n, n, n // 2 + 1)
        bins = np.arange(n // 2 + 1)
        ends = np.where((bins == 0) | (2 * bins == n), 0.0, 1.0)
        return fourier_graphs.irfft(real, imaginary * ends, n)

    np.testing.assert_allclose(compute(round_trip, rows)[0], rows, rtol=0, atol=1e-12)


def test_fourier_transforms_need_less_than_a_quarter_megabyte():
    graph = Graph()
    fourier_graphs.rfft(Tensor(graph, "x"), 10_000, 10_000, 5001)
    assert sum(c.ByteSize() for c in graph.constants) < 250_000


def special_signals(n):
    """Return movements (n_signals, n): noise with two spectra, integers, a burst, a tone, and silence."""
    rng = np.random.default_rng(5)
    t = np.arange(n)
    walk = np.cumsum(rng.standard_normal(n))
    counts = np.round(20 * rng.standard_normal(n)) - 3.0
    burst = np.where((t > n // 2) & (t < n // 2 + 40), rng.standard_normal(n), 0.0)
    signals = [
        rng.standard_normal(n),
        1e-6 * walk,
        counts,
        burst,
        np.sin(t / 3),
        np.zeros(n),
        np.full(n, 4.0),
    ]
    return np.array([s - s.mean() if s.any() and np.ptp(s) else s for s in signals])


def members(n_segments):
    for name in builders():
        feature = list_features()[name]
        yield Member(
            name, feature, {"n_segments": n_segments} if n_segments > 1 and feature.divisible else {}
        )
    yield Member(
        "fine", list_features()["band_course"], {"n_parts": 6, "octaves": (0, 6), "n_segments": n_segments}
    )
    yield Member("deep", list_features()["octave_level"], {"octaves": (5, 7), "n_segments": n_segments})
    yield Member("some", list_features()["mfcc"], {"coefficients": (2, 5), "decay_hz": 500.0})


@pytest.mark.parametrize(
    ("fs", "n", "n_segments"), [(2200.0, 2200, 1), (10_000.0, 1000, 4), (4000.0, 4200, 2)]
)
def test_graphs_of_features_equal_their_functions(fs, n, n_segments):
    signals = special_signals(n)
    n_defined = 0
    for member in members(n_segments):
        expected = []
        for x in signals:
            try:
                expected.append(member.feature.function(PhaseView(x, fs), **member.parameters))
            except UndefinedFeatureError:
                expected.append(np.full(len(member.all_columns), np.nan))
        expected = np.array([np.atleast_1d(row) for row in expected])
        (values,) = compute(
            lambda x, member=member: graph_view.member_graph(GraphView(x, fs, n), member), signals
        )
        assert np.isnan(values).tolist() == np.isnan(expected).tolist(), member.name
        is_count = "agreement" in member.name
        scale = np.maximum(np.nan_to_num(np.abs(expected)).max(axis=0), 1.0)
        # A tone has only rounding errors in most bands, and a burst in its prediction residual.
        excluded = (
            [] if is_count else [3, 4] if member.name in {"log_area_ratios", "prediction_gain"} else [4]
        )
        rows = ~np.isin(np.arange(len(signals)), excluded)
        np.testing.assert_allclose(
            (values / scale)[rows], (expected / scale)[rows], rtol=0, atol=1e-12 if is_count else 2e-5,
            err_msg=member.name,
        )  # fmt: skip
        n_defined += bool(np.isfinite(expected).any())
    assert n_defined >= len(builders()) - 2


def test_most_features_of_the_movement_have_a_graph():
    of_texclass = {"regularity", "spectral_roughness", "line_spectral_frequencies"}
    missing = {"multiscale": set(), "coarse": {"clipping"}, "texclass": of_texclass}
    for name, expected in missing.items():
        feature_set = load_feature_set(name).with_phases("movement")
        assert set(graph_view.features_without_graph(feature_set)) == expected


def fitted(features, feature_set, *, channels=(), axes=(), rest=False, unit="m/s^2", classifier=None):
    plan = Plan.of(load_feature_set(feature_set).restricted_to(list(features)), channels)
    steps = [SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler()]
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
    model = model_of(steps if classifier is None else steps[:1], classifier or lda, plan=plan)
    files = model.manifest.input.model_copy(update={"axes": axes, "remove_resting_level": rest, "unit": unit})
    return replace(model, manifest=model.manifest.model_copy(update={"input": files, "unit": unit}))


def simulate_window(n, n_axes, *, gravity=0.0, seed=0):
    rng = np.random.default_rng(seed)
    hand = 3 * np.sin(2 * np.pi * 8 / 3 * np.arange(n) / FS)[:, None]
    x = (
        rng.standard_normal((n, n_axes))
        + hand * rng.standard_normal(n_axes)
        + gravity * (np.arange(n_axes) == 0)
    )
    return x.T.astype(np.float32)


def assert_same_features(model, windows):
    n = windows.shape[2]
    graph = build_sample_graph(model, n, with_features=True)
    features = run(graph.SerializeToString(), windows, SAMPLES, ("features",))["features"]
    expected = features_of_windows(model, windows)
    np.testing.assert_allclose(features, expected, rtol=0, atol=2e-6)
    return expected


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("unit", ["m/s^2", "arbitrary"])
def test_windows_are_conditioned_like_recordings(unit, rest):
    xyz = ("x", "y", "z")
    model = fitted(
        ("band_level", "vibration_level", "slope_level"), "texclass", axes=xyz, rest=rest, unit=unit
    )
    windows = np.stack(
        [simulate_window(1500, 3, gravity=g, seed=s) for s, g in enumerate((0.0, 9.81, -6.0, 4.0))]
    )
    values = assert_same_features(model, windows)
    without_gravity = windows - windows.mean(axis=2, keepdims=True)
    level = model.columns.index("vibration_level.rms")
    without = assert_same_features(model, without_gravity.astype(np.float32))
    removed = np.abs(values - without)[:, level] > 0.01
    assert removed.tolist() == [False, unit == "m/s^2" and not rest, unit == "m/s^2" and not rest, False]


@pytest.mark.parametrize("rest", [False, True])
def test_separate_channels_and_long_windows_are_conditioned_like_recordings(rest):
    names = ("ax", "ay", "turn_x", "turn_y", "turn_z")
    model = fitted(("band_level",), "coarse", channels=names, axes=names[:2], rest=rest)
    long = 5003  # a prime: three samples at the end are omitted
    windows = np.stack([simulate_window(long, 5, gravity=g, seed=s) for s, g in enumerate((0.0, 9.81))])
    windows[:, 1] += np.float32(6.0) * (np.arange(long) > 0.7 * long)  # mean and median differ
    windows[0, 2] += np.float32(6.0)
    values = assert_same_features(model, windows)
    without_mean = assert_same_features(model, windows - windows.mean(axis=2, keepdims=True))
    changed = np.abs(values - without_mean)[:, [c.endswith("band_level.b1") for c in model.columns]] > 1e-4
    assert changed[0].tolist() == [False, False, True, False, False]
    assert changed[1].tolist() == [not rest, False, False, False, False]


@pytest.mark.parametrize("n", [2000, 4 * 2048])
def test_segment_voting_has_the_same_answers_as_in_texclass(n):
    vote = SegmentVoting(n_segments=4)
    model = fitted(("band_level", "slope_agreement"), "multiscale", unit="arbitrary", classifier=vote)
    windows = np.stack([simulate_window(n, 1, seed=s) for s in range(4)])
    values = assert_same_features(model, windows)
    graph = build_sample_graph(model, n).SerializeToString()
    outputs = run(graph, windows, SAMPLES)
    p, p_known = model.classify(values)
    np.testing.assert_allclose(outputs["probabilities"], p, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(outputs["p_known"], p_known)


def test_the_file_has_the_same_answers_for_windows_as_the_model(window_model, recorded_windows, tmp_path):
    exported = export_onnx(window_model, tmp_path / "surfaces.onnx", start="samples")
    parity = exported.sample_parity
    assert parity.n_windows > 60
    assert parity.n_predicted >= 3
    assert parity.feature_difference < 1e-5
    graph = exported.path.read_bytes()
    assert len(graph) < 200_000
    outputs = run(graph, recorded_windows, SAMPLES)
    answers = [window_model.answer(recording_of(window_model, window)) for window in recorded_windows]
    assert outputs["label"].tolist() == [answer.surface for answer in answers]
    assert outputs["unknown"].tolist() == [answer.unknown for answer in answers]
    p = [list(answer.probabilities.values()) for answer in answers]
    np.testing.assert_allclose(outputs["probabilities"], p, rtol=0, atol=1e-6)
    assert {True, False} == set(outputs["unknown"].tolist())
    assert set(outputs["label"]) == set(SURFACES)


def test_windows_without_a_defined_answer_are_unknown(window_model, recorded_windows):
    graph = build_sample_graph(window_model, recorded_windows.shape[2]).SerializeToString()
    odd = recorded_windows[:4].copy()
    odd[0, 0, 7], odd[1, 0, 9], odd[2] = np.nan, np.inf, 0.0
    outputs = run(graph, odd, SAMPLES)
    assert outputs["label"].tolist()[:2] == ["", ""]
    assert np.isnan(outputs["probabilities"][:2]).all()
    assert outputs["unknown"].tolist()[:3] == [True, True, True]
    assert outputs["label"][3] == run(graph, recorded_windows[3:4], SAMPLES)["label"][0]
    silence = window_model.answer(recording_of(window_model, odd[2]))
    assert (outputs["label"][2], outputs["p_known"][2]) == (silence.surface, silence.p_known)


def test_a_small_change_of_any_table_raises_an_error(window_model, recorded_windows):
    n = recorded_windows.shape[2]
    with_drift = recorded_windows[:1] + np.linspace(5, 15, n, dtype=np.float32)
    windows = np.concatenate([recorded_windows, with_drift, 0 * recorded_windows[:1]])
    graph, X = (
        build_sample_graph(window_model, n, with_features=True),
        features_of_windows(window_model, windows),
    )
    parity = check_sample_parity(window_model, graph.SerializeToString(), windows, X)
    assert parity.difference < 1e-6

    def change(values):
        return values * (1 + np.linspace(0.0, 0.05, values.size).reshape(values.shape)) + 0.01

    changed = changed_graphs(graph, lambda values: values.dtype == np.float64 and values.size >= 8, change)
    assert len(changed) >= 18
    for changed_graph in changed:
        with pytest.raises(ParityError, match=r"differs from texclass in \d+ of \d+ windows; window \d+ has"):
            check_sample_parity(window_model, changed_graph, windows, X)


def test_the_file_contains_only_the_features_of_the_model():
    small, large = (
        build_sample_graph(fitted(features, "texclass", unit="arbitrary"), 1000)
        for features in (("mfcc.c2",), ("mfcc", "band_level", "slope_agreement"))
    )
    assert len(small.graph.node) < len(large.graph.node) / 1.5
    assert not [node for node in small.graph.node if node.op_type == "CumSum"]


def test_the_error_for_features_without_a_graph_has_their_names(tmp_path):
    model = fitted(("spectral_roughness", "mfcc", "regularity"), "texclass")
    message = r"was not written: cannot export the features regularity, spectral_roughness. Train"
    with pytest.raises(OnnxExportError, match=message):
        export_onnx(model, tmp_path / "surfaces.onnx", start="samples")
    assert not list(tmp_path.iterdir())


def test_a_graph_can_be_registered_for_any_feature(monkeypatch):
    monkeypatch.setattr(graph_view, "GRAPHS", dict(builders()))
    model = fitted(("regularity",), "texclass")
    graph_of("regularity")(lambda view, **_: view.log_level)
    graph = build_sample_graph(model, 400, with_features=True).SerializeToString()
    window = simulate_window(400, 1)[None]
    level = np.log10(np.abs(window[0] - window[0].astype(float).mean()).max())
    assert run(graph, window, SAMPLES, ("features",))["features"][0, 0] == pytest.approx(level)


def test_a_model_of_whole_recordings_needs_a_window_length(linear_model, tmp_path):
    with pytest.raises(OnnxExportError, match=r"whole recordings. Train it on windows"):
        export_onnx(linear_model, tmp_path / "surfaces.onnx", start="samples")
    exported = export_onnx(linear_model, tmp_path / "surfaces.onnx", start="samples", window_s=0.5)
    (entry,) = onnx.load(exported.path).graph.input
    assert [d.dim_param or d.dim_value for d in entry.type.tensor_type.shape.dim] == ["n", 1, 2000]


def test_generated_windows_follow_the_formula_and_one_is_silent(window_model):
    window = create_window({"seed": 1, "smooth": 0.5, "gain": 2.0, "offset": [0.0, 9.0]}, 2, 2)
    s, expected = 1, []
    for offset in (0.0, 9.0):
        y = 0.0
        for _ in range(2):
            s = (1664525 * s + 1013904223) % 4294967296
            y = 0.5 * y + s / 4294967296 - 0.5
            expected.append(np.float32(offset + 2.0 * y))
    assert window.ravel().tolist() == expected
    assert not create_window(window_recipes(window_model)[-1], 1, 1000).any()


# Commands `texclass export --from samples` and `texclass export --check`


@pytest.fixture
def folder(window_model, tmp_path, monkeypatch):
    window_model.save(tmp_path / "surfaces.skops")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_with_samples_as_input_has_a_self_check(command, folder):
    code, out, err = command("export", "surfaces.skops", "--from", "samples", "-o", "surfaces.onnx")
    assert code == 0, err
    assert "same labels and verdicts as texclass for 73 windows" in out
    assert "decided by less than 0.0001" in out
    code, out, err = command("export", "surfaces.onnx", "--check")
    assert code == 0, err
    assert "8 of 8 checks with the stored answers" in out
    file = onnx.load("surfaces.onnx")
    facts = {fact.key.removeprefix("texclass."): fact.value for fact in file.metadata_props}
    assert json.loads(facts["window"]) == {
        "n_samples": 1000, "fs_hz": FS, "unit": "m/s^2", "channels": ["c1"],
    }  # fmt: skip
    checks = json.loads(facts["self_check"])
    assert len({check["label"] for check in checks}) >= 3
    assert "1664525" in facts["formula"]
    weights = next(c for c in file.graph.initializer if tuple(c.dims) == (13, 4))
    weights.CopyFrom(numpy_helper.from_array(1.02 * numpy_helper.to_array(weights), weights.name))
    onnx.save(file, "surfaces.onnx")
    code, _, err = command("export", "surfaces.onnx", "--check")
    assert code == 1
    assert "surfaces.onnx: check 0 must give" in err


def test_a_file_with_features_as_input_has_a_self_check(command, folder):
    command("export", "surfaces.skops", "-o", "surfaces.onnx")
    code, out, err = command("export", "surfaces.onnx", "--check")
    assert code == 0, err
    assert "input features" in out
    code, _, err = command("export", "surfaces.skops", "--check")
    assert code == 1
    assert "surfaces.skops is not a model of texclass" in err


@pytest.fixture
def _without_roughness(monkeypatch):
    """Remove the graph of one feature of the toy pipeline."""
    graphs = {name: builder for name, builder in builders().items() if name != "temporal_roughness"}
    monkeypatch.setattr(graph_view, "GRAPHS", graphs)


@pytest.mark.usefixtures("_without_roughness")
def test_training_for_export_omits_features_without_graph_and_reports_the_accuracy_with_them(command, folder):
    options = {"row": "Roughness", "classifier": "lda", "window_s": 0.025}
    model = train(surfaces(), pipeline(), **options, exportable=True)
    assert model.columns == ("fineness",)
    accuracy = model.manifest.accuracy
    assert accuracy["not_exportable"] == ["temporal_roughness"]
    whole = train(surfaces(), pipeline(), **options)
    assert accuracy["with_all_features"] == whole.manifest.accuracy["mean"] != accuracy["mean"]
    export_onnx(model, folder / "surfaces.onnx", start="samples")
    model.save("surfaces.skops")
    _, out, _ = command("model", "surfaces.skops")
    assert "temporal_roughness, which cannot be exported to ONNX; accuracy with" in " ".join(out.split())
    nothing = train(surfaces(), pipeline(), **options | {"row": "Spectrum"}, exportable=True)
    assert "not_exportable" not in nothing.manifest.accuracy


@pytest.mark.usefixtures("_without_roughness")
def test_rows_without_an_exportable_feature_raise_an_error():
    rows = (RowDefinition(name="Taps", features=("temporal_roughness",)),)
    with pytest.raises(
        ValueError, match="no row has an exportable feature: temporal_roughness cannot be computed"
    ):
        train(surfaces(), pipeline(rows=rows), exportable=True, window_s=0.25)
