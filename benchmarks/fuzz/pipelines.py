"""Random pipelines from the allow-list, with arbitrary parameters that TOML can express."""

import inspect
from random import Random

from fuzz.mutate import toml_of
from texclass.evaluation.allowed_estimators import ESTIMATORS, REFUSED_PARAMETERS, resolve

TEXTS = (
    "auto",
    "cache",
    "/tmp/forged",
    "minkowski",
    "linear",
    "rbf",
    "uniform",
    "sqrt",
    "os.system",
    "l2",
    "lbfgs",
)
VALUES = (True, False, 0, 1, 2, 5, 10, -1, 0.0, 0.1, 0.5, 1e-3, [1], [2, 3], [0.0, 1.0], *TEXTS)


def draw(random: Random) -> str:
    """Return the TOML of a pipeline of one or two steps and a classifier."""
    classifiers, steps = [], []
    for path in sorted(ESTIMATORS):
        (classifiers if _classifies(path) else steps).append(path)
    tree = {
        "features": "strese2015",
        "seed": 1,
        "steps": [_use(random, random.choice(steps)) for _ in range(random.randint(0, 2))],
        "classifiers": {"c": _use(random, random.choice(classifiers))},
        "rows": [{"name": "all", "features": ["waviness"]}],
    }
    return toml_of(tree).decode()


def _classifies(path: str) -> bool:
    return any(base.__name__ == "ClassifierMixin" for base in inspect.getmro(resolve(path)))


def _use(random: Random, path: str, depth: int = 1) -> dict[str, object]:
    """Return an estimator with some parameters: mostly few, so that many can be fitted."""
    use: dict[str, object] = {"use": path}
    signature = inspect.signature(resolve(path)).parameters
    if "estimator" in signature and (depth < 3 or signature["estimator"].default is inspect.Parameter.empty):
        use["estimator"] = _use(random, "sklearn.tree.DecisionTreeClassifier", depth + 1)
    if random.random() < 0.1:
        use[random.choice(sorted(REFUSED_PARAMETERS))] = random.choice(VALUES)
    for name in random.sample(sorted(signature), min(len(signature), random.choice((0, 0, 0, 1, 2)))):
        default = signature[name].default
        alike = [value for value in VALUES if type(value) is type(default)]
        use.setdefault(name, random.choice(alike or VALUES))
    return use
