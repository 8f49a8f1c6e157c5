"""What a small computer has to have: counted as a graph would run, and the accuracy of just that."""

import json

import numpy as np
import pytest
from onnxruntime import InferenceSession
from toy_noises import write_plates

from texclass.experiment import extract_table, touches
from texclass.experiment.feature_table import metadata
from texclass.experiment.protocols import find_protocol
from texclass.features import load_feature_set
from texclass.features.plan import Plan
from texclass.loaders import open_dataset
from texclass.recognition import SmallLimits, embedded, embedded_tradeoff, load_model
from texclass.recognition.embedded import chosen_of, front_of
from texclass.recognition.export.graph import Graph, Tensor, tensor_of
from texclass.recognition.export.sample_graph import Windows
from texclass.recognition.holding_out import HoldingOut
from texclass.recognition.small_computers import cut_of, decisions_of, in_bits, rounded, shortened, work_of
from texclass.reporting.result_files import read_document
from texclass.tradeoff.front import knee

FEW = """
name = "few"
reference = "a test"
[features.band_level]
[features.slope_level]
[features.vibration_level]
[features.hardness]
"""


def small_graph():
    """Return rows of 200 samples times a table (200, 70), plus an offset, squared, summed, times 3."""
    graph = Graph()
    turn = np.cos(2 * np.pi * np.arange(200) / 200)
    at = np.outer(np.arange(200), np.arange(70)) % 200
    table = graph.constant(turn).take(at, axis=0) * 0.5
    rows = Tensor(graph, "samples").cast(np.float64).reshape(0, 200)
    spectrum = rows @ table + np.ones(70)
    graph.add("Mul", (spectrum * spectrum).sum(1), 3.0, name="power")
    entry = tensor_of("samples", np.float32, 1, 1, 200)
    return graph.model([entry], [tensor_of("power", np.float64, 1, 1)], "toy", "")


def test_a_small_graph_costs_what_is_counted_by_hand():
    work = work_of(small_graph())
    # 200 samples as numbers, 200 x 70 multiply-adds, 70 sums, 70 squares, 70 to sum, 1 product; the table is
    # made once, in two steps.
    assert sum(work.operations) == 200 + 200 * 70 + 3 * 70 + 1
    # The table, the offset; the 3, which is no table; where to reshape (2 numbers) and what to sum (1).
    constants = {bits: (200 * 70 + 70) * bits // 8 + 4 + 3 * 2 for bits in (32, 16, 8)}
    assert {bits: work.constant_bytes(bits) for bits in constants} == constants
    # The product, in whose place its sum and squares are written, and at last what they add up to.
    assert work.intermediate_bytes() == 70 * 4 + 4
    # Samples of fewer bits become numbers first.
    assert work.intermediate_bytes(16) == 200 * 4 + 70 * 4


def test_tables_of_fewer_bits_lie_on_equal_steps_and_short_ones_stay():
    graph, x = small_graph(), np.random.default_rng(0).normal(size=(1, 1, 200)).astype(np.float32)
    found = {}
    for bits in (32, 16, 8, 3):
        model = shortened(graph, bits)
        (found[bits],) = InferenceSession(model.SerializeToString()).run(None, {"samples": x})
        assert found[bits].dtype == np.float32
    (exact,) = InferenceSession(graph.SerializeToString()).run(None, {"samples": x})
    error = {bits: abs(found[bits] / exact - 1).max() for bits in found}
    assert error[32] < 1e-5
    assert error[32] < error[16] < error[8] < error[3] < 1
    values = np.linspace(-1, 1, 101)
    assert np.unique(rounded(values, 3)).tolist() == pytest.approx(np.arange(-3, 4) / 3)
    assert rounded(values, 32) is values


@pytest.fixture(autouse=True, scope="module")
def _few_sizes():
    """Try few numbers of columns: each takes its selections and its networks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(embedded, "N_COLUMNS", (4, 8))
        yield


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """Three materials that differ in level and colour, six recordings of 1.2 s at 1 kHz each."""
    folder = tmp_path_factory.mktemp("work")
    write_plates(folder / "plates", 1000, louder=2.2)
    (folder / "few.toml").write_text(FEW)
    return folder


@pytest.fixture(scope="module")
def recordings(plates):
    return open_dataset(plates / "plates", unit="arbitrary")


@pytest.fixture(scope="module")
def told(plates, recordings, _own_cache):
    """The whole study at one rate, within a limit that leaves some points out."""
    return embedded_tradeoff(
        recordings, plates / "few.toml", SmallLimits(max_bytes=3000, max_ops=50_000), max_seconds=0.25,
        model_file=plates / "small.skops",
    )  # fmt: skip


def cut(recordings, features, step=0.25):
    """Return windows of 0.25 s, held out at random, with their features."""
    windows = Windows(Plan.of(features, ()), ("acceleration",), 0, 1000.0, "arbitrary", False)
    tests = HoldingOut(metadata(recordings.entries), find_protocol("recording"), "asked for", True, 0)
    return cut_of(recordings, windows, 0.25, step, 1.0, tests)


def test_features_of_the_graph_in_single_precision_are_those_of_texclass(plates, recordings):
    features = load_feature_set(plates / "few.toml").restricted_to(["band_level", "slope_level"])
    found = cut(recordings, features)
    table = extract_table(touches(recordings, 0.25), features, plates / "table.parquet")
    assert found.tests.table["recording_id"].tolist() == table.frame["recording_id"].tolist()
    both = np.isfinite(table.values)
    np.testing.assert_allclose(found.X[32, 32][both], table.values[both], atol=1e-4)
    errors = [np.nanmax(abs(found.X[word] - found.X[32, 32])) for word in ((16, 16), (8, 8))]
    assert 0 < errors[0] < errors[1]


def test_a_transform_that_features_share_is_bought_once(recordings):
    features = load_feature_set("texclass").restricted_to(["band_level", "octave_level", "slope_level"])
    costs = cut(recordings, features, step=1.0).costs
    of = {name: [c for c in costs.columns if c.startswith(name)] for name in ("band", "octave", "slope")}
    alone = {name: costs.cost(columns) for name, columns in of.items()}
    assert costs.cost(of["band"][:1]) == alone["band"]
    assert costs.cost(of["band"] + of["octave"]) < 0.7 * (alone["band"] + alone["octave"])
    assert alone["slope"] < 0.6 * alone["band"]


def test_what_is_chosen_keeps_the_limits_as_it_is_saved(told, plates):
    chosen = told.data["chosen"]
    assert chosen["bytes"] <= 3000
    assert chosen["ops_per_s"] <= 50_000
    assert chosen["accuracy"]["mean"] > 0.8
    fitting = [p for p in told.data["points"] if p["bytes"] <= 3000 and p["ops_per_s"] <= 50_000]
    assert len(fitting) < len(told.data["points"])
    assert chosen["accuracy"]["mean"] == max(p["accuracy"]["mean"] for p in fitting)
    model = load_model(plates / "small.skops")
    assert model.manifest.touch_s == chosen["window_s"]
    assert list(model.columns) == chosen["columns"]
    assert model.manifest.accuracy["mean"] == chosen["accuracy"]["mean"]
    windows = Windows.of(model, round(chosen["window_s"] * model.manifest.fs))
    steps = [step for _, step in model.recogniser.steps[1:]]
    work = decisions_of(windows, model.columns, steps)
    assert chosen["constant_bytes"] == work.constant_bytes(chosen["bits"])
    assert chosen["intermediate_bytes"] == work.intermediate_bytes(chosen["sample_bits"])
    assert chosen["window_bytes"] == windows.n_samples * chosen["sample_bits"] // 8
    assert chosen["bytes"] == sum(chosen[f"{part}_bytes"] for part in ("window", "constant", "intermediate"))
    assert chosen["ops_per_s"] == pytest.approx(sum(work.operations) / windows.n_samples * 1000)


def test_the_front_holds_what_nothing_beats_and_the_knee_is_on_it(told):
    points, front = told.data["points"], told.data["front"]
    assert front == front_of(points)
    assert told.data["knee"] == knee(front)

    def figures(point):
        return point["accuracy"]["mean"], -point["bytes"], -point["ops_per_s"]

    for point in points:
        better = [
            p
            for p in points
            if figures(p) != figures(point)
            and all(a >= b for a, b in zip(figures(p), figures(point), strict=True))
        ]
        assert (point in front) == (not better)


def test_a_result_is_told_and_read_again(told, plates):
    assert "hardness" in told.data["without_graph"]
    written = told.save(plates / "reports")
    assert {path.name for path in written} >= {"plates-embedded.json", "plates-embedded.md"}
    text = (plates / "reports" / "plates-embedded.md").read_text()
    assert "Without a graph, so not on offer: hardness." in text
    assert f"{100 * told.data['chosen']['accuracy']['mean']:.1f} %" in text
    document = read_document(plates / "reports" / "plates-embedded.json")
    assert document.title == "plates, for small computers"


def test_nothing_within_the_limits_names_what_the_least_takes(told):
    least = min(point["bytes"] for point in told.data["points"])
    with pytest.raises(ValueError, match=f"at most 10 bytes .* the rule is at least {least:g}"):
        chosen_of(told.data["points"], SmallLimits(max_bytes=10))
    with pytest.raises(ValueError, match="max_bytes is -1; the rule is above 0"):
        SmallLimits(max_bytes=-1)


def test_limits_that_nothing_keeps_are_refused_before_any_fold_is_judged(plates, recordings, monkeypatch):
    def judged(*_):
        raise AssertionError("a fold was judged")

    monkeypatch.setattr(embedded, "_hits_of", judged)
    few = load_feature_set(plates / "few.toml").restricted_to(["slope_level"])
    for limits, rule in (
        (SmallLimits(max_ops=10), "at most inf bytes and 10 operations a second; the rule is at least"),
        (SmallLimits(max_bytes=30), "max_bytes is 30; the rule is at least 31: the shortest window alone"),
    ):
        with pytest.raises(ValueError, match=rule):
            embedded_tradeoff(recordings, few, limits, max_seconds=0.125)


def test_weights_of_few_bits_change_a_copy(told):
    class Fitted:
        coefs_ = (np.linspace(-1, 1, 200).reshape(100, 2), np.linspace(-1, 1, 10).reshape(2, 5))

    found = in_bits(Fitted(), 3)
    assert len(np.unique(found.coefs_[0])) == 7
    assert found.coefs_[1] is Fitted.coefs_[1]
    assert len(np.unique(Fitted.coefs_[0])) == 200


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        (
            ("--for", "embedded", "--max-ms", 5),
            "--max-ms is 5.0; the rule is with --for embedded: --max-bytes",
        ),
        (("--max-bytes", 64000), "--max-bytes is 64000.0; the rule is with --for embedded"),
        (("--for", "embedded", "--max-ops", 0), "max_ops is 0.0; the rule is above 0"),
        (("--for", "embedded", "--features", "none.toml"), "none.toml"),
    ],
)
def test_options_of_the_other_trade_are_refused(command, plates, monkeypatch, options, rule):
    monkeypatch.chdir(plates)
    code, out, err = command("tradeoff", "plates", "--unit", "arbitrary", *options)
    assert (code, out) == (1, "")
    assert rule in err


def test_the_command_writes_a_model_and_a_report(command, plates, monkeypatch):
    monkeypatch.chdir(plates)
    options = ("--max-seconds", 0.125, "--max-bytes", 3000, "--jobs", 1, "--json", "small.json", "-o", "out")
    code, out, err = command(
        "tradeoff", "plates", "--unit", "arbitrary", "--features", "few.toml", "--for", "embedded", *options
    )
    assert code == 0, err
    assert "wrote out/plates-embedded.skops" in out
    assert json.loads((plates / "small.json").read_text())["max_bytes"] == 3000
    assert load_model(plates / "out" / "plates-embedded.skops").manifest.fs == 1000
