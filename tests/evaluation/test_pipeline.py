"""Pipeline files: only allowed classes, and every key has an effect."""

import numpy as np
import pandas as pd
import pytest
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import MinMaxScaler

from texclass.classifiers.forward_selection import ForwardSelector
from texclass.evaluation.allowed_estimators import resolve
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.pipeline import AblationSettings, MatchedRow, Use, load_pipeline
from texclass.shipped import names

START = 'features = "strese2015"\nseed = 1\n'
CLASSIFIER = '[classifiers.naive_bayes]\nuse = "sklearn.naive_bayes.GaussianNB"\n'
ROW = '[[rows]]\nname = "F"\nfeatures = ["friction"]\n'
KERNEL = '[classifiers.k]\nuse = "texclass.classifiers.kernel_discriminant.KernelDiscriminant"\n'
WHOLE = START + CLASSIFIER + ROW
MORE = f"""{WHOLE}[[rows]]
name = "W"
features = ["waviness"]
[[additions]]
name = "more"
features = ["waviness", "mfcc_constant.c2"]
"""


def of(parameter):
    """A pipeline whose classifier has a parameter."""
    return f"{START}{CLASSIFIER}{parameter}\n{ROW}"


def step(path):
    """A pipeline with a step of scikit-learn."""
    return f'{START}[[steps]]\nuse = "sklearn.{path}"\n{CLASSIFIER}{ROW}'


def write(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_shipped_pipelines_load():
    for name in names("pipelines"):
        assert load_pipeline(name).name == name


def test_the_default_pipeline_has_one_candidate_and_repeats_taps_and_friction_in_every_segment():
    pipeline = load_pipeline("surfaces")
    assert (len(pipeline.rows), list(pipeline.classifiers)) == (1, ["vote"])
    columns = pipeline.features.column_names
    frame = pd.DataFrame({"surface": ["a", "b"], **{c: [1.0, 2.0] for c in columns}})
    table = FeatureTable(frame, columns, np.zeros(2))
    row = MatchedRow.match(pipeline.rows[0], pipeline.features, table)
    classifier = pipeline.trial(row, "vote", table).keywords["classifier"]
    recording_features = {row.columns[i].split(".")[0] for i in classifier.recording_columns}
    phases = {m.name: m.feature.phase for m in pipeline.features.members}
    assert recording_features == {name for name, phase in phases.items() if phase in ("tap", "friction")}


def test_an_argument_of_a_classifier_may_be_an_estimator():
    judge = {"use": "texclass.classifiers.kernel_discriminant.KernelDiscriminant", "length": 1.0}
    new_estimator = Use(
        use="texclass.classifiers.segment_voting.SegmentVoting", estimator=judge, n_segments=4
    ).make()
    assert (new_estimator.estimator.length, new_estimator.n_segments) == (1.0, 4)


@pytest.mark.parametrize(
    ("judge", "problem"),
    [
        ('use = "os.system"', "use = 'os.system' is not an allowed estimator"),
        ('use = "sklearn.naive_bayes.GaussianNB", wrong = 1', "has no parameter 'wrong'"),
        ('use = "texclass.classifiers.kernel_discriminant.KernelDiscriminant", length = -1', "length == -1"),
    ],
)
def test_an_estimator_inside_another_keeps_the_same_rules(judge, problem, tmp_path):
    vote = '[classifiers.v]\nuse = "texclass.classifiers.segment_voting.SegmentVoting"\n'
    with pytest.raises(ValueError, match=problem) as raised:
        load_pipeline(write(tmp_path, f"{START}{vote}estimator = {{ {judge} }}\n{ROW}"))
    assert "\n" not in str(raised.value)


def test_the_rows_of_table_one_stand_in_order_with_their_dimensions_and_figures():
    pipeline = load_pipeline("strese2015")
    published = [row for row in pipeline.rows if row.published]
    assert not any(row.select for row in published)
    widths = [len(pipeline.features.columns_of(row.features)) for row in published]
    assert widths == [3, 2, 2, 5, 1, 13, 13, 30, 125, 1, 1, 10, 3, 5, 12, 13]
    columns = {name: [row.published[name] for row in published] for name in pipeline.classifiers}
    assert columns == {
        "naive_bayes": [48, 25, 14, 67, 10, 88, 89, 39, 70, 15, 11, 5, 20, 14, 91, 95],
        "lda": [38, 31, 11, 60, 8, 87, 88, 30, 62, 8, 10, 4, 10, 12, 87, 92],
        "euclidean": [32, 22, 10, 47, 7, 74, 71, 26, 15, 8, 10, 4, 7, 6, 70, 83],
    }


@pytest.mark.parametrize("name", ["strese2015", "strese2015+models", "texclass"])
def test_combined_rows_hold_the_columns_that_table_one_names_and_selected_ones_stand_beside_them(name):
    pipeline = load_pipeline(name)
    rows = {row.name: row for row in pipeline.rows}
    parts = ("Macroscopic Roughness", "Microscopic Roughness", "Hardness", "5 Modified MFCC (2, 5, 6, 8, 12)")
    named = [column for part in parts for column in rows[part].features]
    combined = rows["Micro- / Macro-Roughness, Hardness, 5 MFCC"]
    with_friction = rows["Micro- / Macro-Roughness, Hardness, 5 MFCC, Friction"]
    assert combined.select is with_friction.select is None
    assert list(combined.features) == named
    assert list(with_friction.features) == [*named, "friction"]
    selected = {row.name: row for row in pipeline.rows if row.select}
    assert [row.select.n for row in selected.values()] == [12, 13]
    for title, row in selected.items():
        n = len(pipeline.features.columns_of(row.features))
        assert title.startswith(f"Selected {row.select.n} of {n}: ")
        assert not row.published


def test_preparation_imputes_then_scales_then_selects_with_the_rows_classifier():
    pipeline = load_pipeline("strese2015")
    combined = next(row for row in pipeline.rows if row.select)
    imputer, scaler, selector = (step for _, step in pipeline.preparation(combined, "lda").steps)
    assert isinstance(imputer, SimpleImputer)
    assert isinstance(scaler, MinMaxScaler)
    assert isinstance(selector, ForwardSelector)
    assert type(selector.estimator).__name__ == "LinearDiscriminantAnalysis"


def test_a_pipeline_finds_a_feature_set_beside_it(tmp_path):
    (tmp_path / "own.toml").write_text("[features.friction]")
    pipeline = load_pipeline(write(tmp_path, WHOLE.replace("strese2015", "own.toml")))
    assert pipeline.features.column_names == ("friction",)


REFUSED = (
    "os.system", "subprocess.Popen", "builtins.eval", "sklearn", "sklearn.os.system",
    "sklearn.utils.os.system",
    "sklearn.datasets.fetch_openml", "sklearn.base.BaseEstimator.__init__", "sklearn.utils.fixes.np.load",
    "sklearnevil.tree.Tree", "texclass.evaluation.pipeline.importlib", "texclass.recording.Recording",
    "..sklearn.naive_bayes.GaussianNB", "sklearn.naive_bayes.Nothing", "sklearn.nothing.GaussianNB",
    "sklearn.tests.test_base.MyEstimator", "trap.sub.Class", "",
)  # fmt: skip


def test_use_accepts_allowed_estimators_only(tmp_path, monkeypatch):
    (tmp_path / "trap.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    for path in REFUSED:
        with pytest.raises(ValueError, match=r"use = .*(not an allowed estimator|does not exist)"):
            resolve(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (WHOLE + "[other]\n", r"mine\.toml: unknown key other \(expected one of features, "),
        (WHOLE.replace("seed = 1\n", ""), "missing key seed"),
        (WHOLE.replace("strese2015", "none"), r"mine\.toml: features: none is neither a TOML file"),
        (WHOLE.replace("friction", "smell"), "rows: F: features: .*'smell' is neither"),
        (WHOLE + "published = { svm = 3 }\n", "rows: F: published contains 'svm'"),
        (WHOLE + "published = { naive_bayes = 300 }\n", "published.naive_bayes is 300. .* 100"),
        (WHOLE + "classifiers = ['nobody']\n", "classifiers contains 'nobody'. .* of naive_bayes"),
        (WHOLE + "select = { n = 0 }\n", r"rows\.1\.select\.n is 0. Expected"),
        (WHOLE + ROW, "two entries have the name 'F'"),
        (START + CLASSIFIER, "missing key rows"),
        (START + CLASSIFIER + "rows = []\n", r"classifiers\.naive_bayes: .* has no parameter 'rows'"),
        ("rows = []\n" + START + CLASSIFIER, r"rows is \[\]. Expected"),
        (START + ROW + "[classifiers]\n", r"classifiers is \{\}. Expected"),
        (of("var_smoothin = 1"), "naive_bayes: .* has no parameter 'var_smoothin'. .* 'var_smoothing'"),
        (of("var_smoothing = 'x'"), "naive_bayes: The 'var_smoothing' parameter"),
        (step("feature_selection.SelectFromModel"), r"steps\.1: .*missing 1 required"),
        (START + KERNEL + "ridge = -1\n" + ROW, r"classifiers\.k: ridge == -1"),
        (
            WHOLE.replace("GaussianNB", "GaussianNb"),
            r"classifiers\.naive_bayes: use = .*mean 'sklearn.*GaussianNB'",
        ),
        (WHOLE.replace("sklearn.naive_bayes.GaussianNB", "os.system"), "is not an allowed estimator"),
        (
            WHOLE.replace("naive_bayes.GaussianNB", "preprocessing.MinMaxScaler"),
            r"classifiers\.naive_bayes: sklearn\.preprocessing\.MinMaxScaler is not a classifier",
        ),
        (step("naive_bayes.GaussianNB"), r"steps\.1: sklearn.naive_bayes.GaussianNB is not a transformer"),
        ("channels = 'some'\n" + WHOLE, "channels is 'some'. Expected .*combine"),
        (WHOLE + "[protocol]\nname = 'luck'\n", r"protocol\.name: unknown protocol 'luck'"),
        (WHOLE + "[protocol]\nfolds = 1\n", r"protocol\.folds is 1"),
        (MORE + "select = { n = 2 }\n", "additions: more: the key 'select' is allowed in .*rows"),
        (MORE.replace("mfcc_constant.c2", "smell"), "additions: more: features: .*'smell' is neither"),
        (MORE + "[gain]\nbase = 'W'\n", "gain.base is 'W'. .* without features of .*additions.*: F"),
        (MORE + "[gain]\nclassifier = 'svm'\n", "gain.classifier is 'svm'. Expected one of naive_bayes"),
        (MORE + "[gain]\nrepeats = 0\n", r"gain\.repeats is 0. Expected"),
        (MORE.replace('"friction"', '"waviness"'), "every row already contains features of .*additions"),
        (MORE + MORE[MORE.index("[[additions]]") :], "additions: two entries have the name 'more'"),
    ],
)
def test_an_invalid_pipeline_is_rejected_with_key_and_expectation(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        load_pipeline(write(tmp_path, text))


def test_additions_are_read(tmp_path):
    facts = 'reference = "mine"\nskip_missing = true\n[gain]\nbase = "F"\nrepeats = 3\n'
    pipeline = load_pipeline(write(tmp_path, MORE + facts))
    (group,) = pipeline.additions
    assert (group.name, group.reference, group.skip_missing) == ("more", "mine", True)
    assert pipeline.gain == AblationSettings(base="F", repeats=3)
    assert set(pipeline.needed[0].columns) == {"friction", "waviness", "mfcc_constant"}


def test_a_row_may_name_its_classifiers_and_all_features(tmp_path):
    assert {row.select_classifiers(["a", "b"]) for row in load_pipeline("strese2015").rows} == {("a", "b")}
    pipeline = load_pipeline("texclass")
    selected = [row for row in pipeline.rows if row.select]
    assert selected
    assert all("kernel" not in row.select_classifiers(pipeline.classifiers) for row in selected)
    everything = load_pipeline(write(tmp_path, WHOLE.replace('["friction"]', '"all"')))
    assert everything.rows[0].features == tuple(everything.features.columns)


def test_the_row_of_the_decreasing_mel_bank_states_why_it_equals_the_constant_one():
    rows = {row.name: row.note for row in load_pipeline("strese2015").rows}
    assert [name for name, note in rows.items() if "before the logarithm" in note] == [
        "Modified MFCC, Exp. Decreasing Mel Filter Bank"
    ]
