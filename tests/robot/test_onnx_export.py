"""Export of models to ONNX, from features on: same answers in double precision, or no file."""

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
from texclass.robot.export.parity import check_rows, reference, run, stored_rows
from texclass.shipped import names
from texclass.tradeoff.pareto_front import cost_aware_selector, discriminant

PIECES = ("band_level",)
"""Feature with one column per segment (four) in the set `multiscale`."""


def imputer():
    return SimpleImputer(strategy="median", keep_empty_features=True)


def lda(**settings):
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.1, **settings)


def shipped_combinations():
    """Return the distinct combinations of steps and classifier in shipped pipelines."""
    combinations = {}
    for shipped in map(load_pipeline, sorted(names("pipelines"))):
        for name, use in shipped.classifiers.items():
            combinations.setdefault(f"{shipped.steps} {use}", (f"{shipped.name}-{name}", shipped.steps, use))
    return list(combinations.values())


def columns_of(model, X):
    """Return the columns that a pruned model computes."""
    return X[:, [plan_of().columns.index(column) for column in model.columns]]


COMBINATIONS = shipped_combinations()
N_COLUMNS = len(plan_of().columns)


def assert_same_answers(model, graph, X):
    """Compare row by row with `Model.classify`, independently of the parity check."""
    outputs = run(graph, X)
    p, p_known = model.classify(X)
    np.testing.assert_allclose(outputs["probabilities"], p, rtol=0, atol=1e-12)
    assert outputs["label"].tolist() == np.array(model.surfaces)[p.argmax(axis=1)].tolist()
    np.testing.assert_array_equal(outputs["p_known"], p_known)
    np.testing.assert_array_equal(outputs["unknown"], p_known <= model.novelty.false_alarms)


def export_and_check(model, X):
    """Export a model, compare the answers for X, and return the result of the parity check."""
    graph = build(model).SerializeToString()
    assert_same_answers(model, graph, X)
    return check_parity(model, graph)


@pytest.mark.parametrize("n_classes", [2, 5])
@pytest.mark.parametrize(("steps", "use"), [c[1:] for c in COMBINATIONS], ids=[c[0] for c in COMBINATIONS])
def test_exports_of_shipped_pipelines_have_the_answers_of_scikit_learn(steps, use, n_classes):
    plan = plan_of(PIECES, "multiscale") if "SegmentVoting" in use.use else plan_of()
    steps = [step.make() for step in steps]
    model, recogniser = fitted(steps, use.make(), n_classes=n_classes, plan=plan)
    X = rows_of(len(model.columns), n_classes, seed=7)[0]
    scores = class_scores(recogniser[-1], prepared_by(recogniser, X))
    np.testing.assert_allclose(model.classify(X)[0], model.calibration(scores), rtol=0, atol=1e-9)
    parity = export_and_check(model, X)
    assert parity.difference < 1e-12
    assert parity.n_predicted == parity.n_surfaces == n_classes
    assert 0 < parity.n_unknown < sum(parity.rows.values())
    assert single_precision(build(model)) == ()


def test_all_shipped_classifiers_are_tested():
    kinds = {use.use.rpartition(".")[2] for _, _, use in COMBINATIONS}
    assert kinds == {
        "GaussianNB", "KNeighborsClassifier", "KernelDiscriminant", "LinearDiscriminantAnalysis",
        "NearestCentroid", "SegmentVoting",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("steps", "classifier"),
    [
        ([imputer(), RobustScaler(), PCA(5)], lda()),
        ([imputer(), MaxAbsScaler(), PCA(8), SelectKBest(k=3)], GaussianNB()),
        (
            [imputer(), StandardScaler(), cost_aware_selector(np.ones(N_COLUMNS), max_features=3)],
            discriminant(),
        ),
        ([imputer(), PCA(6), cost_aware_selector(np.ones(6), max_features=3)], discriminant()),
        ([make_pipeline(imputer(), MinMaxScaler(clip=True)), "passthrough"], NearestCentroid()),
        ([SimpleImputer(strategy="mean"), StandardScaler()], KNeighborsClassifier(5)),
        ([imputer(), StandardScaler()], LogisticRegression()),
        ([imputer()], KernelDiscriminant(shrinkage=1.0, relevance=0.0)),
        ([imputer()], KernelDiscriminant(limit=0.8)),
        ([imputer()], KernelDiscriminant(max_kb=2.4)),
        ([imputer(), PCA(1)], KernelDiscriminant(max_kb=2)),
        ([imputer(), PCA(1)], KernelDiscriminant()),
        ([imputer()], make_pipeline(StandardScaler(), KernelDiscriminant())),
        ([imputer(), StandardScaler()], NearestCentroid(shrink_threshold=0.5)),
    ],
)
def test_further_steps_and_classifiers_can_be_exported(steps, classifier):
    model = model_of(steps, classifier)
    assert export_and_check(model, columns_of(model, rows_of(N_COLUMNS, 4, seed=7)[0])).n_ties == 0


@pytest.mark.parametrize("estimator", [None, GaussianNB(), make_pipeline(StandardScaler(), lda())])
@pytest.mark.parametrize("n_classes", [2, 3])
def test_segment_voting_with_any_estimator_has_the_answers_of_scikit_learn(estimator, n_classes):
    plan = plan_of(PIECES, "multiscale")
    model = model_of(
        [imputer()], SegmentVoting(estimator, n_segments=4, whole_weight=0.3), plan=plan, n_classes=n_classes
    )
    X = rows_of(len(plan.columns), n_classes, seed=7)[0]
    X[::3] = np.repeat(X[::3, ::4], 4, axis=1)  # equal segments: one vote
    export_and_check(model, X)


def test_segment_voting_with_tap_features_has_the_answers_of_scikit_learn():
    plan = plan_of(("band_level", "hardness", "damping"), "surfaces")
    vote = with_segment_columns(SegmentVoting(n_segments=4), plan.columns)
    model = model_of([imputer()], vote, plan=plan)
    n_features, n_segments = model.classifier["columns"].shape
    assert n_segments * (n_features - 2) + 2 == len(model.columns)
    export_and_check(model, rows_of(len(plan.columns), 4, seed=7)[0])


def test_an_adapted_model_is_exported(linear_model):
    recordings = [recording(surface, 50) for surface in ("cork", "felt", "oak")]
    references = [r.with_(acceleration=1.5 * r.acceleration) for r in recordings]
    adapted = adapt(linear_model, references)
    assert check_parity(adapted, build(adapted).SerializeToString()).n_ties == 0


def test_a_model_of_one_recording_of_each_surface_is_exported():
    model = train(surfaces(1), pipeline())
    graph = build(model).SerializeToString()
    assert check_parity(model, graph).n_unknown == 1  # the row without a defined feature


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.filterwarnings("ignore:Skipping features without any observed values")
def test_columns_without_any_value_in_training_are_dropped_or_imputed(keep):
    X, _ = rows_of(N_COLUMNS, 4)
    X[:, 3] = np.nan
    with_keep = SimpleImputer(strategy="median", keep_empty_features=keep)
    for steps in ([with_keep, StandardScaler()], [with_keep, PCA(4)]):
        model = model_of(steps, lda(), X=X)
        assert export_and_check(model, columns_of(model, rows_of(N_COLUMNS, 4, seed=7)[0])).n_ties == 0


@pytest.mark.parametrize("max_kb", [3, 20, None])
def test_an_exported_kernel_has_the_requested_size_and_stores_its_prototypes_once(max_kb):
    X, y = rows_of(20, 4, 100, undefined=0)
    graph, kernel = Graph(), KernelDiscriminant(max_kb=max_kb).fit(X, y)
    add_part(classifier_of(kernel), Tensor(graph, "rows"))
    size_kb = sum(numpy_helper.to_array(c).nbytes for c in graph.constants) / 1000
    if max_kb is None:
        assert len(kernel.dual_) * 20 * 8 / 1000 < size_kb < 2 * len(kernel.dual_) * 20 * 8 / 1000
    else:
        assert len(kernel.dual_) < len(X)
        assert 0.9 * max_kb < size_kb < 1.02 * max_kb


def test_half_a_megabyte_costs_a_kernel_less_than_three_points_as_documented():
    root = Path(__file__).parents[2]
    page = " ".join((root / "docs" / "onnx.md").read_text(encoding="utf-8").split())
    assert "half a megabyte, the loss of accuracy is less than three percentage points" in page
    study = json.loads((root / "reports" / "studies" / "kernel_size.json").read_text(encoding="utf-8"))
    accuracy = {row["max_kb"]: row["mean"] for row in study["rows"]}
    assert accuracy[None] - accuracy[500] < 0.03


def count_errors(model, graph, condition, change, message=r"ONNX differs from texclass in \d+ of \d+ rows"):
    """Assert that a change of each constant that meets a condition raises an error; return their number."""
    changed = changed_graphs(graph, condition, change)
    for changed_graph in changed:
        with pytest.raises(ParityError, match=message):
            check_parity(model, changed_graph)
    return len(changed)


@pytest.mark.parametrize("classifier", [KernelDiscriminant(), lda()])
def test_a_small_change_of_any_constant_raises_an_error(classifier):
    model = model_of([imputer(), StandardScaler()], classifier, n_classes=3)

    def is_number(a):
        return a.dtype == np.float64 and not np.isnan(a).all()

    assert count_errors(model, build(model), is_number, lambda a: 1.01 * a + 0.01) >= 10


def test_a_weight_changed_by_a_millionth_and_swapped_labels_raise_an_error():
    model = model_of([imputer(), StandardScaler()], lda())
    first = np.zeros((len(model.columns), 4))
    first[0, 0] = 1e-6
    assert count_errors(model, build(model), lambda a: a.shape == first.shape, lambda a: a * (1 + first)) == 1
    message = r"has label (cork|felt) in ONNX, (cork|felt) in texclass"
    assert count_errors(model, build(model), lambda a: a.dtype == object and a.shape == (4,),
                   lambda a: a[[1, 0, 2, 3]], message) == 1  # fmt: skip


def test_squared_distances_between_large_numbers_lose_no_digits():
    X, _ = rows_of(N_COLUMNS, 4, undefined=0.0)
    X = X / X.std(axis=0) + 1e4
    model = model_of([imputer()], NearestCentroid(), X=X)
    graph = build(model)
    assert check_parity(model, graph.SerializeToString()).difference < 1e-9
    first = 1e-3 * (np.arange(4 * len(model.columns)) == 0).reshape(1, 4, -1)
    assert count_errors(model, graph, lambda a: a.shape == first.shape, lambda a: a + first) == 1


@pytest.mark.parametrize("classifier", [RandomForestClassifier(7, random_state=0), SVC()])
def test_operators_in_single_precision_are_listed_and_raise_an_error(classifier):
    model = model_of([imputer(), StandardScaler()], classifier)
    graph = build(model)
    assert single_precision(graph)
    with pytest.raises(ParityError, match=r"has (probability|label) .* in ONNX"):
        check_parity(model, graph.SerializeToString())


@pytest.mark.parametrize("n_classes", [2, 4])
@pytest.mark.parametrize("classifier", [KernelDiscriminant(), lda(), NearestCentroid()])
@pytest.mark.parametrize("scaler", ["passthrough", StandardScaler(), MinMaxScaler()])
def test_a_single_column_loses_no_digits(scaler, classifier, n_classes):
    """onnxruntime fuses a scalar factor with a matrix product in single precision: graphs avoid it."""
    plan = plan_of().restricted_to(plan_of().columns[:1])
    model = model_of([imputer(), scaler], classifier, n_classes=n_classes, plan=plan)
    assert check_parity(model, build(model).SerializeToString()).difference < 1e-12


def test_neighbours_at_equal_distances_are_a_tie_and_not_an_error():
    X, y = rows_of(N_COLUMNS, 4, undefined=0.0)
    X[::2] = np.nan  # imputed with the same medians for all surfaces
    model = model_of([imputer(), MinMaxScaler()], KNeighborsClassifier(1), X=X)
    assert reference(model, X)["tied"].tolist() == (np.arange(len(X)) % 2 == 0).tolist()
    graph = build(model)
    assert check_parity(model, graph.SerializeToString()).difference == pytest.approx(0, abs=1e-12)
    labels = run(graph.SerializeToString(), X[1::2])["label"]
    assert labels.tolist() == y[1::2].tolist()


@pytest.mark.parametrize(
    ("steps", "classifier", "message"),
    [
        ([imputer()], QuadraticDiscriminantAnalysis(reg_param=0.5), r"Analysis to ONNX \("),
        ([imputer()], NearestCentroid(metric="manhattan"), "NearestCentroid: it predicts labels only"),
        ([SimpleImputer(add_indicator=True)], lda(), "SimpleImputer: add_indicator must be False"),
    ],
)
def test_the_error_for_a_step_or_classifier_that_cannot_be_exported_has_its_name(
    steps, classifier, message, tmp_path
):
    model = model_of([*steps, PCA(3)], classifier)
    expected = rf"surfaces\.onnx was not written: cannot export sklearn\..*{message}"
    with pytest.raises(OnnxExportError, match=expected):
        export_onnx(model, tmp_path / "surfaces.onnx")
    assert not list(tmp_path.iterdir())


def test_rows_without_a_defined_answer_have_no_label_and_are_unknown():
    with_imputer = model_of([imputer(), StandardScaler()], KernelDiscriminant())
    without_imputer = model_of([StandardScaler()], lda(), undefined=0.0)
    rows = rows_of(len(with_imputer.columns), 4, undefined=0.0)[0][:3]
    for model, value in ((with_imputer, np.inf), (with_imputer, -np.inf), (without_imputer, np.nan)):
        graph = build(model).SerializeToString()
        check_parity(model, graph)
        X = rows.copy()
        X[1, 2] = value
        with pytest.raises(ValueError, match="undefined"):
            model.classify(X)
        outputs = run(graph, X)
        assert outputs["label"][1] == ""
        assert outputs["unknown"][1]
        assert np.isnan(outputs["probabilities"][1]).all()
        assert np.isnan(outputs["p_known"][1])
        assert_same_answers(model, graph, X[[0, 2]])


def test_the_metadata_contain_columns_surfaces_and_a_self_check(tmp_path):
    model = model_of([imputer(), StandardScaler()], KernelDiscriminant())
    exported = export_onnx(model, tmp_path / "deep" / "surfaces.onnx")
    file = onnx.load(exported.path)
    facts = {item.key.removeprefix("texclass."): item.value for item in file.metadata_props}
    assert json.loads(facts["columns"]) == list(model.columns)
    assert json.loads(facts["surfaces"]) == list(model.surfaces)
    assert (float(facts["fs_hz"]), facts["unit"]) == (4000.0, "m/s^2")
    assert (float(facts["window_s"]), float(facts["shortest_s"])) == (0.5, 0.4)
    assert json.loads(facts["ranges"])["low"] == model.ranges.low.tolist()
    assert float(facts["false_alarms"]) == model.novelty.false_alarms
    assert json.loads(facts["parity"])["difference"] == exported.parity.difference
    assert json.loads(facts["parity"])["n_ties"] == exported.parity.n_ties == 0
    assert "NaN marks undefined features" in " ".join(file.doc_string.split())
    assert [entry.name for entry in file.graph.input] == ["features"]
    checks = json.loads(facts["self_check"])
    assert len({check["label"] for check in checks}) >= 3
    assert {check["unknown"] for check in checks} == {True, False}
    X = np.array([[np.nan if v is None else v for v in check["features"]] for check in checks])
    outputs = run(exported.path.read_bytes(), X)
    assert outputs["label"].tolist() == [check["label"] for check in checks]
    assert outputs["unknown"].tolist() == [check["unknown"] for check in checks]
    expected = [check["probabilities"] for check in checks]
    np.testing.assert_allclose(outputs["probabilities"], expected, atol=1e-12)


def test_boundary_rows_of_the_parity_check_are_on_both_sides_of_decision_boundaries(linear_model):
    X, kinds = check_rows(linear_model)
    boundary = X[kinds == "boundary"]
    assert len(boundary) == 512
    pairs = boundary.reshape(8, 64, -1)
    p, p_known = linear_model.classify(boundary)
    answers = np.stack([p.argmax(axis=1), p_known <= linear_model.novelty.false_alarms]).reshape(2, 8, 64)
    for side in range(0, 8, 2):
        differs = (answers[:, side] != answers[:, side + 1]).any(axis=0)
        assert differs.mean() > 0.9
    span = np.abs(pairs[0] - pairs[1]).max(axis=1) / np.abs(pairs[6] - pairs[7]).max(axis=1)
    assert (span < 1e-5).all()


def test_most_stored_rows_of_a_model_are_of_known_surfaces(kernel_model, linear_model):
    for model in (kernel_model, linear_model):
        p, p_known = model.classify(stored_rows(model))
        assert set(p.argmax(axis=1)) == set(range(len(SURFACES)))
        assert (p_known > model.novelty.false_alarms).mean() > 0.4


# Command `texclass export`


@pytest.fixture
def folder(linear_model, tmp_path, monkeypatch):
    linear_model.save(tmp_path / "surfaces.skops")
    for surface, hum_hz in (*SURFACES.items(), ("stranger", STRANGER)):
        np.savetxt(tmp_path / f"{surface}.txt", signal(hum_hz, [*map(ord, surface), 50]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_exported_file_has_the_same_answers_as_predict(command, folder):
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 0, err
    assert "same labels as texclass" in out
    assert "wrote surfaces.onnx" in out
    onnx.checker.check_model("surfaces.onnx", full_check=True)
    files = [f"{surface}.txt" for surface in (*SURFACES, "stranger")]
    code, out, err = command("predict", "surfaces.skops", *files, "--fs", str(FS), "--jsonl")
    assert code == 0, err
    answers = [json.loads(line) for line in out.splitlines()]
    session = onnxruntime.InferenceSession("surfaces.onnx", providers=["CPUExecutionProvider"])
    model = load_model("surfaces.skops")
    recordings = [model.manifest.input.find(name, fs=FS) for name in files]
    rows = [model.plan.compute(r.with_(phases=find_phases(r))).values for r in recordings]
    labels, p, p_known, unknown = session.run(None, {"features": np.stack(rows)})
    assert labels.tolist() == [answer["surface"] for answer in answers]
    assert unknown.tolist() == [answer["unknown"] for answer in answers]
    # `predict` prints six digits.
    assert p.max(axis=1).tolist() == pytest.approx([answer["probability"] for answer in answers], abs=1e-6)
    assert p_known.tolist() == pytest.approx([answer["p_known"] for answer in answers], abs=1e-6)


def test_a_graph_with_other_answers_raises_an_error_and_no_file_is_written(command, folder, monkeypatch):
    def build_changed(model):
        graph = export_build(model)
        weights = max(graph.graph.initializer, key=lambda c: len(c.raw_data))
        values = numpy_helper.to_array(weights) * (1 + 1e-3)
        weights.CopyFrom(numpy_helper.from_array(values, weights.name))
        return graph

    export_build = export.build
    monkeypatch.setattr(export, "build", build_changed)
    old_files = set(folder.iterdir())
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert err.startswith("error: surfaces.onnx was not written: ONNX differs from texclass in")
    assert "Expected the same label and verdict" in err
    assert not out
    assert set(folder.iterdir()) == old_files


@pytest.mark.parametrize("missing", ["onnx", "onnxruntime", "skl2onnx"])
def test_the_error_for_a_missing_extra_shows_how_to_install_it(command, folder, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    code, _, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert f"requires {missing}, which is not installed: pip install 'texclass[onnx]'" in err
    assert not (folder / "surfaces.onnx").exists()
    # --check does not need skl2onnx, because it converts nothing.
    is_unused = missing == "skl2onnx"
    message = "is not a model of texclass" if is_unused else f"checking ONNX files requires {missing}"
    assert message in command("export", "surfaces.skops", "--check")[2]
