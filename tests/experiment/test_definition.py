"""Pipeline TOMLs: only sklearn and texclass classes, and no key that does nothing."""

import pytest
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import MinMaxScaler

from texclass.experiment.definition import load_pipeline
from texclass.experiment.selection import ForwardSelector
from texclass.experiment.use import resolve
from texclass.shipped import locate, names

START = 'features = "strese2015"\nseed = 1\n'
CLASSIFIER = '[classifiers.naive_bayes]\nuse = "sklearn.naive_bayes.GaussianNB"\n'
ROW = '[[rows]]\nname = "F"\nfeatures = ["friction"]\n'


def write(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", names("pipelines"))
def test_shipped_pipelines_load(name):
    assert load_pipeline(name).name == name


def test_the_rows_of_table_one_stand_in_order_with_their_dimensions_and_figures():
    pipeline = load_pipeline("strese2015")
    published = [row for row in pipeline.rows if row.published]
    widths = [
        row.select.n if row.select else len(pipeline.feature_set.columns_of(row.features))
        for row in published
    ]
    assert widths == [3, 2, 2, 5, 1, 13, 13, 30, 125, 1, 1, 10, 3, 5, 12, 13]
    columns = {name: [row.published[name] for row in published] for name in pipeline.classifiers}
    assert columns == {
        "naive_bayes": [48, 25, 14, 67, 10, 88, 89, 39, 70, 15, 11, 5, 20, 14, 91, 95],
        "lda": [38, 31, 11, 60, 8, 87, 88, 30, 62, 8, 10, 4, 10, 12, 87, 92],
        "euclidean": [32, 22, 10, 47, 7, 74, 71, 26, 15, 8, 10, 4, 7, 6, 70, 83],
    }


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
    pipeline = load_pipeline(write(tmp_path, 'features = "own.toml"\nseed = 1\n' + CLASSIFIER + ROW))
    assert pipeline.feature_set.column_names == ("friction",)


@pytest.mark.parametrize(
    "path",
    [
        "os.system",
        "subprocess.Popen",
        "builtins.eval",
        "sklearn",
        "sklearn.os.system",
        "sklearn.utils.os.system",
        "sklearn.datasets.fetch_openml",
        "sklearn.base.BaseEstimator.__init__",
        "sklearn.utils.fixes.np.load",
        "sklearnevil.tree.Tree",
        "texclass.experiment.definition.importlib",
        "texclass.recording.Recording",
        "..sklearn.naive_bayes.GaussianNB",
        "sklearn.naive_bayes.Nothing",
        "sklearn.nothing.GaussianNB",
        "",
    ],
)
def test_use_names_estimators_of_sklearn_and_texclass_only(path):
    with pytest.raises(ValueError, match=r"use = .*(refused|does not exist)"):
        resolve(path)


def test_a_module_on_the_path_is_not_imported_by_use(tmp_path, monkeypatch):
    (tmp_path / "trap.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match="refused"):
        resolve("trap.sub.Class")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (START + CLASSIFIER + ROW + "[other]\n", r"mine\.toml: unknown key 'other'; the known keys are"),
        ('features = "strese2015"\n' + CLASSIFIER + ROW, "no key 'seed'"),
        (START + CLASSIFIER + ROW.replace("friction", "smell"), r"rows 1 \(F\): .*'smell' is neither"),
        (START + CLASSIFIER + ROW + "colour = 1\n", "rows 1: unknown key 'colour'"),
        (START + CLASSIFIER + ROW + "published = { svm = 3 }\n", "rows 1: published: unknown key 'svm'"),
        (START + CLASSIFIER + ROW + "published = { naive_bayes = 300 }\n", "is 300; the rule is per cent"),
        (START + CLASSIFIER + ROW + "select = { n = 0 }\n", "select.n is 0; the rule is a whole number"),
        (START + CLASSIFIER + ROW + "select = 3\n", "select is 3; the rule is a table"),
        (START + CLASSIFIER + ROW + ROW, "two rows are named 'F'"),
        (START + CLASSIFIER + "var_smoothin = 1\n" + ROW, "naive_bayes: unknown key 'var_smoothin'"),
        (START + CLASSIFIER + "var_smoothing = 'x'\n" + ROW, "naive_bayes: The 'var_smoothing' parameter"),
        (
            START + CLASSIFIER.replace("GaussianNB", "X") + ROW,
            "classifiers.naive_bayes: use = .* does not exist",
        ),
        (START + CLASSIFIER.replace("sklearn.naive_bayes.GaussianNB", "os.system") + ROW, "is refused"),
        (
            START + '[classifiers.a]\nuse = "sklearn.preprocessing.MinMaxScaler"\n' + ROW,
            "MinMaxScaler is not a classifier",
        ),
        (
            START + '[[steps]]\nuse = "sklearn.naive_bayes.GaussianNB"\n' + CLASSIFIER + ROW,
            "steps 1: sklearn.naive_bayes.GaussianNB is not a transformer",
        ),
        (START + "channels = 'some'\n" + CLASSIFIER + ROW, "channels is 'some'"),
        (START + "[protocol]\nname = 'luck'\n" + CLASSIFIER + ROW, "no protocol is named 'luck'"),
        (START + "[protocol]\nfolds = 1\n" + CLASSIFIER + ROW, "protocol.folds is 1"),
    ],
)
def test_a_wrong_pipeline_is_refused_with_place_and_rule(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        load_pipeline(write(tmp_path, text))


def test_every_use_makes_a_new_object():
    use = load_pipeline("strese2015").classifiers["lda"]
    assert use.make() is not use.make()
    assert use.make().get_params() == use.make().get_params()


def test_a_row_may_name_its_classifiers(tmp_path):
    assert {row.judged_by(["a", "b"]) for row in load_pipeline("strese2015").rows} == {("a", "b")}
    pipeline = load_pipeline("texclass")
    selected = [row for row in pipeline.rows if row.select]
    assert selected
    assert all("kernel" not in row.judged_by(pipeline.classifiers) for row in selected)
    shipped = locate("pipelines", "texclass").read_text()
    (tmp_path / "mine.toml").write_text(shipped.replace('"nearest_neighbour"]', '"nobody"]'))
    with pytest.raises(ValueError, match=r"classifiers names 'nobody'; the rule is of naive_bayes"):
        load_pipeline(tmp_path / "mine.toml")
