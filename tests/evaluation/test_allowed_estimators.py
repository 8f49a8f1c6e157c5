"""Pipelines and models from untrusted sources: only allowed classes, parameters and sizes are accepted."""

import inspect
import json
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import joblib
import numpy as np
import pytest
import skops.io
from sklearn.cluster import FeatureAgglomeration
from sklearn.decomposition import NMF
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MinMaxScaler

from texclass.classifiers.fitting import fit
from texclass.cli.app import main
from texclass.evaluation import load_pipeline
from texclass.evaluation.allowed_estimators import (
    ESTIMATORS,
    LIMITS,
    REFUSED_PARAMETERS,
    resolve,
)
from texclass.evaluation.pipeline import Use
from texclass.evaluation.skops_archive import UnsafeFileError, load_archive

HEAD = 'features = "strese2015"\nseed = 1\n'
ROW = '[[rows]]\nname = "F"\nfeatures = ["waviness"]\n'
FOREST, BAGGING = "sklearn.ensemble.RandomForestClassifier", "sklearn.ensemble.BaggingClassifier"


def pipeline(path, use, parameters="", steps=""):
    """Write a pipeline with one classifier."""
    path.write_text(f'{HEAD}{steps}\n[classifiers.c]\nuse = "{use}"\n{parameters}\n{ROW}')
    return path


class Forged:
    """Runs a command when it is unpickled."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return (Path.touch, (self.marker,))


def test_a_pipeline_cannot_load_a_forged_cache(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cache, marker = tmp_path / "cache", tmp_path / "marker"
    X = np.random.default_rng(0).normal(size=(20, 4))
    FeatureAgglomeration(memory=str(cache)).fit(X)
    for output in cache.rglob("output.pkl"):
        joblib.dump(Forged(marker), output)
    with suppress(TypeError):  # what was unpickled is no result
        FeatureAgglomeration(memory=str(cache)).fit(X)
    assert marker.exists()  # what scikit-learn does with such a file
    step = '{ use = "sklearn.cluster.FeatureAgglomeration", memory = "cache" }'
    value = pipeline(tmp_path / "p.toml", "sklearn.naive_bayes.GaussianNB", steps=f"steps = [{step}]")
    with pytest.raises(
        ValueError, match=r"p\.toml: steps\.1: use = .*FeatureAgglomeration' is not an allowed estimator"
    ):
        load_pipeline(value)


@pytest.mark.parametrize(
    ("use", "parameters", "message"),
    [
        (FOREST, "n_jobs = 2", "parameter 'n_jobs' is not allowed"),
        (FOREST, "verbose = 1", "parameter 'verbose' is not allowed"),
        (BAGGING, f"estimator = {{ use = '{FOREST}', n_jobs = 2 }}", "parameter 'n_jobs' is not allowed"),
        (BAGGING, "estimator = { use = 'os.system' }", r"use = 'os\.system' is not an allowed estimator"),
        (FOREST, "class_weight = { a = 1.0 }", "class_weight is .*Expected a number, a string"),
        (FOREST, "max_depth = 2026-01-01", "max_depth"),
        ("sklearn.feature_extraction.text.CountVectorizer", "", "is not an allowed estimator"),
        (FOREST, "n_estimators = 1_000_000_000", "n_estimators is 1000000000. Expected at most 10000"),
        (
            BAGGING,
            f"n_estimators = 1000\nestimator = {{ use = '{FOREST}', n_estimators = 1000 }}",
            "would fit 1000000 models. Expected at most 10000",
        ),
        (
            "sklearn.neural_network.MLPClassifier",
            "hidden_layer_sizes = [100_000, 100_000]",
            "hidden_layer_sizes is 100000. Expected at most 10000",
        ),
        (
            "sklearn.neural_network.MLPClassifier",
            "hidden_layer_sizes = [10_000, 10_000]",
            "hidden_layer_sizes requires 100,000,000 weights. Expected at most 10,000,000",
        ),
        ("sklearn.neural_network.MLPClassifier", f"hidden_layer_sizes = {[1] * 1001}", "has 1001 elements"),
        ("sklearn.neural_network.MLPClassifier", "hidden_layer_sizes = [[1]]", "Expected numbers"),
        ("sklearn.svm.SVC", f"kernel = '{'x' * 201}'", "kernel has 201 characters. Expected at most 200"),
        (
            BAGGING,
            "estimator = " + f"{{ use = '{BAGGING}', estimator = " * 4 + "{ use = 'x' }" + "}" * 4,
            "is nested 5 levels deep. Expected at most 4",
        ),
    ],
)
def test_disallowed_parameters_and_sizes_raise_one_message(
    tmp_path, monkeypatch, capsys, use, parameters, message
):
    value = pipeline(tmp_path / "p.toml", use, parameters)
    with pytest.raises(ValueError, match=rf"p\.toml: classifiers\.c: .*{message}"):
        load_pipeline(value)
    monkeypatch.setattr(sys, "argv", ["texclass", "benchmark", "simulated", "--pipeline", str(value)])
    with pytest.raises(SystemExit):
        main()
    error = capsys.readouterr().err
    assert re.search(message, error.replace("\n", " "))
    assert "Traceback" not in error


def test_every_allowed_estimator_exists_and_none_of_its_parameters_names_a_place_or_a_process():
    suspicious = re.compile(r"path|file|folder|cache(?!_size)|jobs|callback|verbos|memory|backend|getter")
    for path in sorted(ESTIMATORS):
        parameters = set(inspect.signature(resolve(path)).parameters) - REFUSED_PARAMETERS
        assert not [name for name in parameters if suspicious.search(name)], path


def test_an_estimator_that_lacks_memory_ends_in_a_message():
    class Hungry(KNeighborsClassifier):
        def fit(self, X, y):
            raise MemoryError("Unable to allocate 74.5 GiB")

    X, y = np.zeros((4, 2)), np.arange(4) % 2
    with pytest.raises(ValueError, match="Hungry cannot be fitted to 4 rows of 2 columns: Unable"):
        fit(make_pipeline(Hungry()), X, y)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (FeatureAgglomeration(memory="cache", pooling_func=None), r"contains sklearn\.cluster"),
        (Pipeline([("c", KNeighborsClassifier())], memory="cache"), "contains the parameter 'memory'"),
        (KNeighborsClassifier(n_jobs=-1), "contains the parameter 'n_jobs'"),
        (NMF(), r"contains sklearn\.decomposition\._nmf\.NMF"),
    ],
)
def test_a_model_file_is_checked_with_the_same_allow_list(made, message):
    assert load_archive(skops.io.dumps(make_pipeline(MinMaxScaler(), KNeighborsClassifier())))
    with pytest.raises(UnsafeFileError, match=message):
        load_archive(skops.io.dumps({"fitted": [made]}))


GENERATED = """
import json, random, sys, warnings
from pathlib import Path
sys.path.insert(0, BENCHMARKS)
import numpy as np
from fuzz.contract import WATCH
from threadpoolctl import threadpool_info
from fuzz.pipelines import draw
from texclass.evaluation import load_pipeline
from texclass.classifiers.fitting import fit
from texclass.evaluation.pipeline import Use

place = Path(sys.argv[1])
warnings.simplefilter("ignore")
threadpool_info()  # searches for the C library once, with ldconfig
rng = np.random.default_rng(0)
X, y = rng.normal(size=(40, 4)), np.repeat(["a", "b"], 20)
WATCH.install(place / "p.toml")
outcomes = {"fitted": 0, "refused": 0, "used": set()}
for seed in range(int(sys.argv[2])):
    (place / "p.toml").write_text(draw(random.Random(seed)))
    with WATCH.over():
        try:
            found = load_pipeline(place / "p.toml")
            made = [use.make() for use in (*found.steps, found.classifiers["c"])]
            Xt = X
            for step in made[:-1]:
                Xt = fit(step, Xt, y).transform(Xt)
            fit(made[-1], Xt, y).predict(Xt)
            outcomes["fitted"] += 1
            outcomes["used"] |= {type(one).__name__ for one in made}
        except ValueError:
            outcomes["refused"] += 1
    seen = [event for event in WATCH.seen if not event.startswith("ctypes.dlopen")]  # threadpoolctl
    assert not seen, (seed, seen)
assert sorted(path.name for path in place.iterdir()) == ["p.toml"]
print(json.dumps({**outcomes, "used": len(outcomes["used"])}))
"""


def test_no_generated_pipeline_writes_a_file_opens_a_socket_starts_a_process_or_unpickles(tmp_path):
    code = GENERATED.replace("BENCHMARKS", repr(str(Path(__file__).parents[2] / "benchmarks")))
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path), "150"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    outcomes = json.loads(run.stdout)
    assert outcomes["fitted"] >= 30
    assert outcomes["used"] >= 25


def test_whole_numbers_up_to_the_limit_are_allowed(tmp_path):
    load_pipeline(
        pipeline(tmp_path / "p.toml", FOREST, f"n_estimators = {LIMITS.integer}\nrandom_state = 12345678")
    )


def test_a_fitted_network_is_named_again_by_its_own_parameters():
    network = "sklearn.neural_network.MLPClassifier"
    made = Use(use=network, hidden_layer_sizes=(64, 32)).make()
    assert Use(use=network, hidden_layer_sizes=made.hidden_layer_sizes).make().hidden_layer_sizes == (64, 32)
