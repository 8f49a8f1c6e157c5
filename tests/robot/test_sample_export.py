"""From samples to answers in one ONNX file: features, labels and verdicts are texclass's, or no file."""

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
from texclass.robot.export.sample_graph import SAMPLES, build_of_samples, recording_of
from texclass.robot.export.sample_parity import (
    check_sample_parity,
    features_of_windows,
    made,
    recipes,
)


def computed(build, rows):
    """Return what tensors (n, n_columns) are that `build` adds to a graph of an input `x`."""
    graph = Graph()
    built = build(Tensor(graph, "x"))
    tensors = [built] if isinstance(built, Tensor) else list(built)
    outputs = [tensor_of(one.name, np.float64, None, None) for one in tensors]
    entry = tensor_of("x", np.float64, "n", *rows.shape[1:])
    model = graph.model([entry], outputs, "test", "")
    session = InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": rows})


@pytest.fixture(scope="module")
def felt_windows(touch_model):
    """Return windows of surfaces, the stranger among them, in single precision."""
    touches = [
        touch for s in (*SURFACES, "stranger") for k in (51, 52) for touch in touch_model.cut(recording(s, k))
    ]
    return np.array([touch.acceleration[None] for touch in touches], dtype=np.float32)


@pytest.mark.parametrize("n", [7, 64, 97, 500, 2200, 2310])
def test_transforms_are_those_of_numpy(n):
    rows = np.random.default_rng(0).standard_normal((3, n))
    for n_fft, n_bins in ((n, n // 2 + 1), (2 * n, n // 3)):
        real, imaginary = computed(partial(fourier_graphs.rfft, n=n, n_fft=n_fft, n_bins=n_bins), rows)
        X = np.fft.rfft(rows, n_fft)[:, :n_bins]
        np.testing.assert_allclose(real + 1j * imaginary, X, rtol=0, atol=1e-11)

    def back_again(x):
        real, imaginary = fourier_graphs.rfft(x, n, n, n // 2 + 1)
        bins = np.arange(n // 2 + 1)
        ends = np.where((bins == 0) | (2 * bins == n), 0.0, 1.0)
        return fourier_graphs.irfft(real, imaginary * ends, n)

    np.testing.assert_allclose(computed(back_again, rows)[0], rows, rtol=0, atol=1e-12)


def test_transforms_keep_the_file_small():
    graph = Graph()
    fourier_graphs.rfft(Tensor(graph, "x"), 10_000, 10_000, 5001)
    assert sum(c.ByteSize() for c in graph.constants) < 250_000


def odd_signals(n):
    """Return movements (n_signals, n): noise of several colours, counts, a burst, a tone, and silence."""
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
def test_graphs_of_features_are_what_their_functions_compute(fs, n, n_segments):
    signals = odd_signals(n)
    n_defined = 0
    for member in members(n_segments):
        expected = []
        for x in signals:
            try:
                expected.append(member.feature.function(PhaseView(x, fs), **member.parameters))
            except UndefinedFeatureError:
                expected.append(np.full(len(member.all_columns), np.nan))
        expected = np.array([np.atleast_1d(row) for row in expected])
        (found,) = computed(
            lambda x, member=member: graph_view.member_graph(GraphView(x, fs, n), member), signals
        )
        assert np.isnan(found).tolist() == np.isnan(expected).tolist(), member.name
        counts = "agreement" in member.name
        scale = np.maximum(np.nan_to_num(np.abs(expected)).max(axis=0), 1.0)
        # A tone leaves nothing but rounding in most bands, and a burst in what it leaves to be predicted.
        hang = [] if counts else [3, 4] if member.name in {"log_area_ratios", "prediction_gain"} else [4]
        kept = ~np.isin(np.arange(len(signals)), hang)
        np.testing.assert_allclose(
            (found / scale)[kept], (expected / scale)[kept], rtol=0, atol=1e-12 if counts else 2e-5,
            err_msg=member.name,
        )  # fmt: skip
        n_defined += bool(np.isfinite(expected).any())
    assert n_defined >= len(builders()) - 2


def test_most_features_of_the_movement_have_a_graph():
    of_texclass = {"regularity", "spectral_roughness", "line_spectral_frequencies"}
    lacking = {"multiscale": set(), "coarse": {"clipping"}, "texclass": of_texclass}
    for name, expected in lacking.items():
        of_set = load_feature_set(name).with_phases("movement")
        assert set(graph_view.without_graph(of_set)) == expected


def fitted(features, feature_set, *, channels=(), axes=(), rest=False, unit="m/s^2", classifier=None):
    plan = Plan.of(load_feature_set(feature_set).restricted_to(list(features)), channels)
    steps = [SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler()]
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1)
    model = model_of(steps if classifier is None else steps[:1], classifier or lda, plan=plan)
    files = model.manifest.input.model_copy(update={"axes": axes, "remove_resting_level": rest, "unit": unit})
    return replace(model, manifest=model.manifest.model_copy(update={"input": files, "unit": unit}))


def shaken(n, n_axes, *, gravity=0.0, seed=0):
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
    graph = build_of_samples(model, n, with_features=True)
    found = run(graph.SerializeToString(), windows, SAMPLES, ("features",))["features"]
    expected = features_of_windows(model, windows)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)
    return expected


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("unit", ["m/s^2", "arbitrary"])
def test_windows_are_conditioned_as_recordings_are(unit, rest):
    xyz = ("x", "y", "z")
    model = fitted(
        ("band_level", "vibration_level", "slope_level"), "texclass", axes=xyz, rest=rest, unit=unit
    )
    windows = np.stack([shaken(1500, 3, gravity=g, seed=s) for s, g in enumerate((0.0, 9.81, -6.0, 4.0))])
    values = assert_same_features(model, windows)
    without_gravity = windows - windows.mean(axis=2, keepdims=True)
    level = model.columns.index("vibration_level.rms")
    without = assert_same_features(model, without_gravity.astype(np.float32))
    removed = np.abs(values - without)[:, level] > 0.01
    assert removed.tolist() == [False, unit == "m/s^2" and not rest, unit == "m/s^2" and not rest, False]


@pytest.mark.parametrize("rest", [False, True])
def test_channels_apart_and_long_windows_are_conditioned_as_recordings_are(rest):
    names = ("ax", "ay", "turn_x", "turn_y", "turn_z")
    model = fitted(("band_level",), "coarse", channels=names, axes=names[:2], rest=rest)
    long = 5003  # a prime: three samples at the end are left out
    windows = np.stack([shaken(long, 5, gravity=g, seed=s) for s, g in enumerate((0.0, 9.81))])
    windows[:, 1] += np.float32(6.0) * (np.arange(long) > 0.7 * long)  # its mean is not its median
    windows[0, 2] += np.float32(6.0)
    values = assert_same_features(model, windows)
    still = assert_same_features(model, windows - windows.mean(axis=2, keepdims=True))
    changed = np.abs(values - still)[:, [c.endswith("band_level.b1") for c in model.columns]] > 1e-4
    assert changed[0].tolist() == [False, False, True, False, False]
    assert changed[1].tolist() == [not rest, False, False, False, False]


@pytest.mark.parametrize("n", [2000, 4 * 2048])
def test_pieces_vote_as_they_do_in_texclass(n):
    vote = SegmentVoting(n_segments=4)
    model = fitted(("band_level", "slope_agreement"), "multiscale", unit="arbitrary", classifier=vote)
    windows = np.stack([shaken(n, 1, seed=s) for s in range(4)])
    values = assert_same_features(model, windows)
    graph = build_of_samples(model, n).SerializeToString()
    found = run(graph, windows, SAMPLES)
    p, p_known = model.classify(values)
    np.testing.assert_allclose(found["probabilities"], p, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(found["p_known"], p_known)


def test_the_file_answers_windows_as_the_model_does(touch_model, felt_windows, tmp_path):
    exported = export_onnx(touch_model, tmp_path / "surfaces.onnx", start="samples")
    parity = exported.of_samples
    assert parity.n_windows > 60
    assert parity.n_answered >= 3
    assert parity.feature_difference < 1e-5
    graph = exported.path.read_bytes()
    assert len(graph) < 200_000
    found = run(graph, felt_windows, SAMPLES)
    answers = [touch_model.answer(recording_of(touch_model, window)) for window in felt_windows]
    assert found["label"].tolist() == [answer.surface for answer in answers]
    assert found["unknown"].tolist() == [answer.unknown for answer in answers]
    p = [list(answer.probabilities.values()) for answer in answers]
    np.testing.assert_allclose(found["probabilities"], p, rtol=0, atol=1e-6)
    assert {True, False} == set(found["unknown"].tolist())
    assert set(found["label"]) == set(SURFACES)


def test_windows_that_nothing_can_be_said_of_are_unknown(touch_model, felt_windows):
    graph = build_of_samples(touch_model, felt_windows.shape[2]).SerializeToString()
    odd = felt_windows[:4].copy()
    odd[0, 0, 7], odd[1, 0, 9], odd[2] = np.nan, np.inf, 0.0
    found = run(graph, odd, SAMPLES)
    assert found["label"].tolist()[:2] == ["", ""]
    assert np.isnan(found["probabilities"][:2]).all()
    assert found["unknown"].tolist()[:3] == [True, True, True]
    assert found["label"][3] == run(graph, felt_windows[3:4], SAMPLES)["label"][0]
    silence = touch_model.answer(recording_of(touch_model, odd[2]))
    assert (found["label"][2], found["p_known"][2]) == (silence.surface, silence.p_known)


def test_a_graph_with_any_table_changed_a_little_is_refused(touch_model, felt_windows):
    n = felt_windows.shape[2]
    turning = felt_windows[:1] + np.linspace(5, 15, n, dtype=np.float32)
    asked = np.concatenate([felt_windows, turning, 0 * felt_windows[:1]])
    graph, X = build_of_samples(touch_model, n, with_features=True), features_of_windows(touch_model, asked)
    whole = check_sample_parity(touch_model, graph.SerializeToString(), asked, X)
    assert whole.difference < 1e-6

    def change(values):
        return values * (1 + np.linspace(0.0, 0.05, values.size).reshape(values.shape)) + 0.01

    changed = changed_graphs(graph, lambda values: values.dtype == np.float64 and values.size >= 8, change)
    assert len(changed) >= 18
    for tampered in changed:
        with pytest.raises(ParityError, match=r"differs from texclass in \d+ of \d+ windows; window \d+ has"):
            check_sample_parity(touch_model, tampered, asked, X)


def test_only_what_the_model_needs_is_in_the_file():
    few, many = (
        build_of_samples(fitted(features, "texclass", unit="arbitrary"), 1000)
        for features in (("mfcc.c2",), ("mfcc", "band_level", "slope_agreement"))
    )
    assert len(few.graph.node) < len(many.graph.node) / 1.5
    assert not [node for node in few.graph.node if node.op_type == "CumSum"]


def test_features_without_a_graph_are_named(tmp_path):
    model = fitted(("spectral_roughness", "mfcc", "regularity"), "texclass")
    said = r"not written: no graph of regularity, spectral_roughness. Expected"
    with pytest.raises(OnnxExportError, match=said):
        export_onnx(model, tmp_path / "surfaces.onnx", start="samples")
    assert not list(tmp_path.iterdir())


def test_a_feature_of_ones_own_may_have_a_graph(monkeypatch):
    monkeypatch.setattr(graph_view, "GRAPHS", dict(builders()))
    model = fitted(("regularity",), "texclass")
    graph_of("regularity")(lambda view, **_: view.log_level)
    graph = build_of_samples(model, 400, with_features=True).SerializeToString()
    window = shaken(400, 1)[None]
    level = np.log10(np.abs(window[0] - window[0].astype(float).mean()).max())
    assert run(graph, window, SAMPLES, ("features",))["features"][0, 0] == pytest.approx(level)


def test_a_model_of_whole_recordings_needs_a_length(linear_model, tmp_path):
    with pytest.raises(OnnxExportError, match=r"whole recordings. Expected a model of touches"):
        export_onnx(linear_model, tmp_path / "surfaces.onnx", start="samples")
    exported = export_onnx(linear_model, tmp_path / "surfaces.onnx", start="samples", window_s=0.5)
    (entry,) = onnx.load(exported.path).graph.input
    assert [d.dim_param or d.dim_value for d in entry.type.tensor_type.shape.dim] == ["n", 1, 2000]


def test_windows_of_the_formula_are_those_of_its_words_and_one_is_silent(touch_model):
    window = made({"seed": 1, "smooth": 0.5, "gain": 2.0, "offset": [0.0, 9.0]}, 2, 2)
    s, said = 1, []
    for offset in (0.0, 9.0):
        y = 0.0
        for _ in range(2):
            s = (1664525 * s + 1013904223) % 4294967296
            y = 0.5 * y + s / 4294967296 - 0.5
            said.append(np.float32(offset + 2.0 * y))
    assert window.ravel().tolist() == said
    assert not made(recipes(touch_model)[-1], 1, 1000).any()


# As a user calls it: texclass export --from samples, --check.


@pytest.fixture
def folder(touch_model, tmp_path, monkeypatch):
    touch_model.save(tmp_path / "surfaces.skops")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_of_samples_holds_windows_that_it_can_be_checked_by(command, folder):
    code, out, err = command("export", "surfaces.skops", "--from", "samples", "-o", "surfaces.onnx")
    assert code == 0, err
    assert "as texclass on 73 windows: no label or verdict differs" in out
    assert "within 0.0001 of another" in out
    code, out, err = command("export", "surfaces.onnx", "--check")
    assert code == 0, err
    assert "8 of 8 checks answered as when it was written" in out
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
    assert "surfaces.onnx: check 0 gives" in err


def test_a_file_of_features_can_be_checked_too(command, folder):
    command("export", "surfaces.skops", "-o", "surfaces.onnx")
    code, out, err = command("export", "surfaces.onnx", "--check")
    assert code == 0, err
    assert "from features on" in out
    code, _, err = command("export", "surfaces.skops", "--check")
    assert code == 1
    assert "surfaces.skops: not a model of texclass" in err


@pytest.fixture
def _without_roughness(monkeypatch):
    """Let one of the features of the toys have no graph."""
    kept = {name: builder for name, builder in builders().items() if name != "temporal_roughness"}
    monkeypatch.setattr(graph_view, "GRAPHS", kept)


@pytest.mark.usefixtures("_without_roughness")
def test_training_for_export_leaves_out_what_has_no_graph_and_says_what_that_costs(command, folder):
    asked = {"row": "Roughness", "classifier": "lda", "window_s": 0.025}
    model = train(surfaces(), pipeline(), **asked, exportable=True)
    assert model.columns == ("fineness",)
    accuracy = model.manifest.accuracy
    assert accuracy["not_exportable"] == ["temporal_roughness"]
    whole = train(surfaces(), pipeline(), **asked)
    assert accuracy["with_all_features"] == whole.manifest.accuracy["mean"] != accuracy["mean"]
    export_onnx(model, folder / "surfaces.onnx", start="samples")
    model.save("surfaces.skops")
    _, out, _ = command("model", "surfaces.skops")
    assert "temporal_roughness: not exportable to ONNX; with them" in " ".join(out.split())
    nothing = train(surfaces(), pipeline(), **asked | {"row": "Spectrum"}, exportable=True)
    assert "not_exportable" not in nothing.manifest.accuracy


@pytest.mark.usefixtures("_without_roughness")
def test_rows_without_any_graph_cannot_be_trained_for_export():
    rows = (RowDefinition(name="Taps", features=("temporal_roughness",)),)
    with pytest.raises(
        ValueError, match="no row has an exportable feature: temporal_roughness cannot be computed"
    ):
        train(surfaces(), pipeline(rows=rows), exportable=True, window_s=0.25)
