"""Models as ONNX: the answers of the model in double precision, or no file."""

import json
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from changed_graphs import changed_graphs
from onnx import numpy_helper
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis, QuadraticDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.feature_selection import SelectKBest
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LogisticRegression
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler
from sklearn.svm import SVC
from toy_models import fitted, model_of, plan_of, prepared_by, rows_of
from toy_surfaces import FS, STRANGER, SURFACES, pipeline, recording, signal, surfaces

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.classifiers.segment_voting import SegmentVoting, with_segment_columns
from texclass.evaluation.pipeline import load_pipeline
from texclass.phases import find_phases
from texclass.recognition import adapt, load_model, train
from texclass.recognition.array_form import classifier_of
from texclass.recognition.probabilities import class_scores
from texclass.robot import OnnxExportError, ParityError, check_parity, export_onnx
from texclass.robot.export import onnx_file as export
from texclass.robot.export.answers_graph import add_part, build
from texclass.robot.export.graph import Graph, Tensor
from texclass.robot.export.onnx_file import single_precision
from texclass.robot.export.parity import check_rows, reference, remembered, run
from texclass.shipped import names
from texclass.tradeoff.pareto_front import cost_aware_selector, discriminant

PIECES = ("band_level",)
"""A feature whose columns come in fours in the set `multiscale`."""


def filled():
    return SimpleImputer(strategy="median", keep_empty_features=True)


def lda(**settings):
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1, **settings)


def shipped_combinations():
    """Return every (steps, classifier) that a shipped pipeline names, once each."""
    found = {}
    for shipped in map(load_pipeline, sorted(names("pipelines"))):
        for name, use in shipped.classifiers.items():
            found.setdefault(f"{shipped.steps} {use}", (f"{shipped.name}-{name}", shipped.steps, use))
    return list(found.values())


def columns_of(model, X):
    """Return the columns that a pruned model still computes."""
    return X[:, [plan_of().columns.index(column) for column in model.columns]]


COMBINATIONS = shipped_combinations()
N_COLUMNS = len(plan_of().columns)


def assert_same_answers(model, graph, X):
    """Compare row by row with `Model.judge`, which the export's own check is not needed for."""
    got = run(graph, X)
    p, p_known = model.classify(X)
    np.testing.assert_allclose(got["probabilities"], p, rtol=0, atol=1e-12)
    assert got["label"].tolist() == np.array(model.surfaces)[p.argmax(axis=1)].tolist()
    np.testing.assert_array_equal(got["p_known"], p_known)
    np.testing.assert_array_equal(got["unknown"], p_known <= model.novelty.false_alarms)


def checked(model, X):
    """Export a model, compare the answers for X, and return what the export's own check says."""
    graph = build(model).SerializeToString()
    assert_same_answers(model, graph, X)
    return check_parity(model, graph)


@pytest.mark.parametrize("n_classes", [2, 5])
@pytest.mark.parametrize(("steps", "use"), [c[1:] for c in COMBINATIONS], ids=[c[0] for c in COMBINATIONS])
def test_whatever_shipped_pipelines_name_answers_as_scikit_learn_does(steps, use, n_classes):
    plan = plan_of(PIECES, "multiscale") if "SegmentVoting" in use.use else plan_of()
    steps = [step.make() for step in steps]
    model, recogniser = fitted(steps, use.make(), n_classes=n_classes, plan=plan)
    X = rows_of(len(model.columns), n_classes, seed=7)[0]
    scores = class_scores(recogniser[-1], prepared_by(recogniser, X))
    np.testing.assert_allclose(model.classify(X)[0], model.calibration(scores), rtol=0, atol=1e-9)
    parity = checked(model, X)
    assert parity.difference < 1e-12
    assert parity.n_answered == parity.n_surfaces == n_classes
    assert 0 < parity.n_unknown < sum(parity.rows.values())
    assert single_precision(build(model)) == ()


def test_the_shipped_classifiers_are_all_there():
    kinds = {use.use.rpartition(".")[2] for _, _, use in COMBINATIONS}
    assert kinds == {
        "GaussianNB", "KNeighborsClassifier", "KernelDiscriminant", "LinearDiscriminantAnalysis",
        "NearestCentroid", "SegmentVoting",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("steps", "classifier"),
    [
        ([filled(), RobustScaler(), PCA(5)], lda()),
        ([filled(), MaxAbsScaler(), PCA(8), SelectKBest(k=3)], GaussianNB()),
        (
            [filled(), StandardScaler(), cost_aware_selector(np.ones(N_COLUMNS), max_features=3)],
            discriminant(),
        ),
        ([filled(), PCA(6), cost_aware_selector(np.ones(6), max_features=3)], discriminant()),
        ([make_pipeline(filled(), MinMaxScaler(clip=True)), "passthrough"], NearestCentroid()),
        ([SimpleImputer(strategy="mean"), StandardScaler()], KNeighborsClassifier(5)),
        ([filled(), StandardScaler()], LogisticRegression()),
        ([filled()], KernelDiscriminant(shrinkage=1.0, relevance=0.0)),
        ([filled()], KernelDiscriminant(limit=0.8)),
        ([filled()], KernelDiscriminant(max_kb=2.4)),
        ([filled(), PCA(1)], KernelDiscriminant(max_kb=2)),
        ([filled(), PCA(1)], KernelDiscriminant()),
        ([filled()], make_pipeline(StandardScaler(), KernelDiscriminant())),
        ([filled(), StandardScaler()], NearestCentroid(shrink_threshold=0.5)),
    ],
)
def test_steps_and_classifiers_of_pipelines_of_ones_own(steps, classifier):
    model = model_of(steps, classifier)
    assert checked(model, columns_of(model, rows_of(N_COLUMNS, 4, seed=7)[0])).n_ties == 0


@pytest.mark.parametrize("estimator", [None, GaussianNB(), make_pipeline(StandardScaler(), lda())])
@pytest.mark.parametrize("n_classes", [2, 3])
def test_votes_of_any_voter_count_as_they_do_in_scikit_learn(estimator, n_classes):
    plan = plan_of(PIECES, "multiscale")
    model = model_of(
        [filled()], SegmentVoting(estimator, n_segments=4, whole_weight=0.3), plan=plan, n_classes=n_classes
    )
    X = rows_of(len(plan.columns), n_classes, seed=7)[0]
    X[::3] = np.repeat(X[::3, ::4], 4, axis=1)  # pieces all the same: one vote
    checked(model, X)


def test_segment_voting_beside_tap_features_gives_the_answers_of_scikit_learn():
    plan = plan_of(("band_level", "hardness", "damping"), "surfaces")
    vote = with_segment_columns(SegmentVoting(n_segments=4), plan.columns)
    model = model_of([filled()], vote, plan=plan)
    n_features, n_segments = model.classifier["columns"].shape
    assert n_segments * (n_features - 2) + 2 == len(model.columns)
    checked(model, rows_of(len(plan.columns), 4, seed=7)[0])


def test_an_adapted_model_is_exported(linear_model):
    recordings = [recording(surface, 50) for surface in ("cork", "felt", "oak")]
    references = [one.with_(acceleration=1.5 * one.acceleration) for one in recordings]
    adapted = adapt(linear_model, references)
    assert check_parity(adapted, build(adapted).SerializeToString()).n_ties == 0


def test_a_model_of_one_recording_of_each_surface_is_exported():
    model = train(surfaces(1), pipeline())
    graph = build(model).SerializeToString()
    assert check_parity(model, graph).n_unknown == 1  # the row without any value


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.filterwarnings("ignore:Skipping features without any observed values")
def test_columns_without_any_value_in_training_are_left_out_or_filled(keep):
    X, _ = rows_of(N_COLUMNS, 4)
    X[:, 3] = np.nan
    imputer = SimpleImputer(strategy="median", keep_empty_features=keep)
    for steps in ([imputer, StandardScaler()], [imputer, PCA(4)]):
        model = model_of(steps, lda(), X=X)
        assert checked(model, columns_of(model, rows_of(N_COLUMNS, 4, seed=7)[0])).n_ties == 0


@pytest.mark.parametrize("max_kb", [3, 20, None])
def test_a_kernel_is_as_small_as_it_was_asked_to_be_and_keeps_its_samples_once(max_kb):
    X, y = rows_of(20, 4, 100, undefined=0)
    graph, kernel = Graph(), KernelDiscriminant(max_kb=max_kb).fit(X, y)
    add_part(classifier_of(kernel), Tensor(graph, "rows"))
    taken = sum(numpy_helper.to_array(one).nbytes for one in graph.constants) / 1000
    if max_kb is None:
        assert len(kernel.dual_) * 20 * 8 / 1000 < taken < 2 * len(kernel.dual_) * 20 * 8 / 1000
    else:
        assert len(kernel.dual_) < len(X)
        assert 0.9 * max_kb < taken < 1.02 * max_kb


def test_half_a_megabyte_costs_a_kernel_less_than_three_points_as_the_page_says():
    root = Path(__file__).parents[2]
    page = " ".join((root / "docs" / "onnx.md").read_text(encoding="utf-8").split())
    assert "With half a megabyte, less than three points of accuracy are lost" in page
    told = json.loads((root / "reports" / "studies" / "kernel_size.json").read_text(encoding="utf-8"))
    right = {row["max_kb"]: row["mean"] for row in told["rows"]}
    assert right[None] - right[500] < 0.03


def refused(model, graph, chosen, change, said=r"ONNX differs from texclass in \d+ of \d+ rows"):
    """Check that a graph is refused once any one of its constants that are chosen is changed; count these."""
    changed = changed_graphs(graph, chosen, change)
    for tampered in changed:
        with pytest.raises(ParityError, match=said):
            check_parity(model, tampered)
    return len(changed)


@pytest.mark.parametrize("classifier", [KernelDiscriminant(), lda()])
def test_a_graph_with_any_constant_changed_a_little_is_refused(classifier):
    model = model_of([filled(), StandardScaler()], classifier, n_classes=3)

    def number(a):
        return a.dtype == np.float64 and not np.isnan(a).all()

    assert refused(model, build(model), number, lambda a: 1.01 * a + 0.01) >= 10


def test_one_weight_changed_by_a_millionth_and_swapped_labels_are_refused():
    model = model_of([filled(), StandardScaler()], lda())
    first = np.zeros((len(model.columns), 4))
    first[0, 0] = 1e-6
    assert refused(model, build(model), lambda a: a.shape == first.shape, lambda a: a * (1 + first)) == 1
    said = r"has label (cork|felt) in ONNX, (cork|felt) in texclass"
    assert refused(model, build(model), lambda a: a.dtype == object and a.shape == (4,),
                   lambda a: a[[1, 0, 2, 3]], said) == 1  # fmt: skip


def test_squared_distances_between_large_numbers_lose_no_digits():
    X, _ = rows_of(N_COLUMNS, 4, undefined=0.0)
    X = X / X.std(axis=0) + 1e4
    model = model_of([filled()], NearestCentroid(), X=X)
    graph = build(model)
    assert check_parity(model, graph.SerializeToString()).difference < 1e-9
    first = 1e-3 * (np.arange(4 * len(model.columns)) == 0).reshape(1, 4, -1)
    assert refused(model, graph, lambda a: a.shape == first.shape, lambda a: a + first) == 1


@pytest.mark.parametrize("classifier", [RandomForestClassifier(7, random_state=0), SVC()])
def test_what_onnxruntime_computes_in_single_precision_is_told_and_refused(classifier):
    model = model_of([filled(), StandardScaler()], classifier)
    graph = build(model)
    assert single_precision(graph)
    with pytest.raises(ParityError, match=r"has (probability|label) .* in ONNX"):
        check_parity(model, graph.SerializeToString())


@pytest.mark.parametrize("n_classes", [2, 4])
@pytest.mark.parametrize("classifier", [KernelDiscriminant(), lda(), NearestCentroid()])
@pytest.mark.parametrize("scaler", ["passthrough", StandardScaler(), MinMaxScaler()])
def test_a_single_column_loses_no_digits(scaler, classifier, n_classes):
    """Once refused: onnxruntime fuses a scalar scale and a matrix product, and keeps the scale as float32."""
    plan = plan_of().restricted_to(plan_of().columns[:1])
    model = model_of([filled(), scaler], classifier, n_classes=n_classes, plan=plan)
    assert check_parity(model, build(model).SerializeToString()).difference < 1e-12


def test_equally_far_neighbours_of_two_surfaces_are_a_tie_and_no_difference():
    X, y = rows_of(N_COLUMNS, 4, undefined=0.0)
    X[::2] = np.nan  # of all surfaces, filled with the same medians
    model = model_of([filled(), MinMaxScaler()], KNeighborsClassifier(1), X=X)
    assert reference(model, X)["tied"].tolist() == (np.arange(len(X)) % 2 == 0).tolist()
    graph = build(model)
    assert check_parity(model, graph.SerializeToString()).difference == pytest.approx(0, abs=1e-12)
    own = run(graph.SerializeToString(), X[1::2])["label"]
    assert own.tolist() == y[1::2].tolist()


@pytest.mark.parametrize(
    ("steps", "classifier", "message"),
    [
        ([filled()], QuadraticDiscriminantAnalysis(reg_param=0.5), r"Analysis has no export to ONNX \("),
        (
            [filled()],
            NearestCentroid(metric="manhattan"),
            "NearestCentroid has labels only",
        ),
        ([SimpleImputer(add_indicator=True)], lda(), "SimpleImputer has add_indicator = True"),
    ],
)
def test_a_step_or_classifier_without_an_export_is_named(steps, classifier, message, tmp_path):
    model = model_of([*steps, PCA(3)], classifier)
    with pytest.raises(OnnxExportError, match=rf"surfaces\.onnx: not written: sklearn\..*{message}"):
        export_onnx(model, tmp_path / "surfaces.onnx")
    assert not list(tmp_path.iterdir())


def test_rows_that_nothing_can_be_said_of_have_no_label():
    model = model_of([filled(), StandardScaler()], KernelDiscriminant())
    bare = model_of([StandardScaler()], lda(), undefined=0.0)
    rows = rows_of(len(model.columns), 4, undefined=0.0)[0][:3]
    for one, value in ((model, np.inf), (model, -np.inf), (bare, np.nan)):
        graph = build(one).SerializeToString()
        check_parity(one, graph)
        X = rows.copy()
        X[1, 2] = value
        with pytest.raises(ValueError, match="undefined"):
            one.classify(X)
        got = run(graph, X)
        assert got["label"][1] == ""
        assert got["unknown"][1]
        assert np.isnan(got["probabilities"][1]).all()
        assert np.isnan(got["p_known"][1])
        assert_same_answers(one, graph, X[[0, 2]])


def test_the_file_says_what_a_program_needs_to_check_itself(tmp_path):
    model = model_of([filled(), StandardScaler()], KernelDiscriminant())
    exported = export_onnx(model, tmp_path / "deep" / "surfaces.onnx")
    file = onnx.load(exported.path)
    said = {fact.key.removeprefix("texclass."): fact.value for fact in file.metadata_props}
    assert json.loads(said["columns"]) == list(model.columns)
    assert json.loads(said["surfaces"]) == list(model.surfaces)
    assert (float(said["fs_hz"]), said["unit"]) == (4000.0, "m/s^2")
    assert (float(said["window_s"]), float(said["shortest_s"])) == (0.5, 0.4)
    assert json.loads(said["ranges"])["low"] == model.ranges.low.tolist()
    assert float(said["false_alarms"]) == model.novelty.false_alarms
    assert json.loads(said["parity"])["difference"] == exported.parity.difference
    assert json.loads(said["parity"])["n_ties"] == exported.parity.n_ties == 0
    assert "NaN where a feature is undefined" in file.doc_string
    assert [entry.name for entry in file.graph.input] == ["features"]
    checks = json.loads(said["self_check"])
    assert len({check["label"] for check in checks}) >= 3
    assert {check["unknown"] for check in checks} == {True, False}
    X = np.array([[np.nan if v is None else v for v in check["features"]] for check in checks])
    got = run(exported.path.read_bytes(), X)
    assert got["label"].tolist() == [check["label"] for check in checks]
    assert got["unknown"].tolist() == [check["unknown"] for check in checks]
    np.testing.assert_allclose(got["probabilities"], [check["probabilities"] for check in checks], atol=1e-12)


def test_rows_of_the_check_lie_on_both_sides_of_boundaries(linear_model):
    X, kinds = check_rows(linear_model)
    near = X[kinds == "boundary"]
    assert len(near) == 512
    pairs = near.reshape(8, 64, -1)
    p, p_known = linear_model.classify(near)
    said = np.stack([p.argmax(axis=1), p_known <= linear_model.novelty.false_alarms]).reshape(2, 8, 64)
    for side in range(0, 8, 2):
        apart = (said[:, side] != said[:, side + 1]).any(axis=0)
        assert apart.mean() > 0.9
    span = np.abs(pairs[0] - pairs[1]).max(axis=1) / np.abs(pairs[6] - pairs[7]).max(axis=1)
    assert (span < 1e-5).all()


def test_models_remember_rows_that_are_answered_right(kernel_model, linear_model):
    for model in (kernel_model, linear_model):
        known = remembered(model)
        p, p_known = model.classify(known)
        assert set(p.argmax(axis=1)) == set(range(len(SURFACES)))
        assert (p_known > model.novelty.false_alarms).mean() > 0.4


# As a user calls it: texclass export.


@pytest.fixture
def folder(linear_model, tmp_path, monkeypatch):
    linear_model.save(tmp_path / "surfaces.skops")
    for surface, hum_hz in (*SURFACES.items(), ("stranger", STRANGER)):
        np.savetxt(tmp_path / f"{surface}.txt", signal(hum_hz, [*map(ord, surface), 50]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_exported_file_answers_files_as_predict_does(command, folder):
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 0, err
    assert "no label differs" in out
    assert "wrote surfaces.onnx" in out
    onnx.checker.check_model("surfaces.onnx", full_check=True)
    files = [f"{surface}.txt" for surface in (*SURFACES, "stranger")]
    code, out, err = command("predict", "surfaces.skops", *files, "--fs", str(FS), "--jsonl")
    assert code == 0, err
    answers = [json.loads(line) for line in out.splitlines()]
    session = onnxruntime.InferenceSession("surfaces.onnx", providers=["CPUExecutionProvider"])
    model = load_model("surfaces.skops")
    felt = [model.manifest.input.find(name, fs=FS) for name in files]
    rows = [model.plan.compute(one.with_(phases=find_phases(one))).values for one in felt]
    labels, p, p_known, unknown = session.run(None, {"features": np.stack(rows)})
    assert labels.tolist() == [answer["surface"] for answer in answers]
    assert unknown.tolist() == [answer["unknown"] for answer in answers]
    # `predict` prints six digits.
    assert p.max(axis=1).tolist() == pytest.approx([answer["probability"] for answer in answers], abs=1e-6)
    assert p_known.tolist() == pytest.approx([answer["p_known"] for answer in answers], abs=1e-6)


def test_a_graph_that_differs_is_refused_and_nothing_is_left(command, folder, monkeypatch):
    def tampered(model):
        graph = export_build(model)
        weights = max(graph.graph.initializer, key=lambda c: len(c.raw_data))
        values = numpy_helper.to_array(weights) * (1 + 1e-3)
        weights.CopyFrom(numpy_helper.from_array(values, weights.name))
        return graph

    export_build = export.build
    monkeypatch.setattr(export, "build", tampered)
    before = set(folder.iterdir())
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert err.startswith("error: surfaces.onnx: not written: ONNX differs from texclass in")
    assert "Expected the same label and verdict" in err
    assert not out
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize("missing", ["onnx", "onnxruntime", "skl2onnx"])
def test_a_missing_extra_is_told_how_to_install(command, folder, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    code, _, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert f"needs {missing}, which is not installed: pip install 'texclass[onnx]'" in err
    assert not (folder / "surfaces.onnx").exists()
    told = "not a model of texclass" if missing == "skl2onnx" else f"checking ONNX files needs {missing}"
    assert told in command("export", "surfaces.skops", "--check")[2]  # which converts nothing
