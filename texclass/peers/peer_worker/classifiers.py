"""The classifiers that peers are combined with."""

from collections.abc import Callable
from typing import Any

import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.naive_bayes import GaussianNB

CLASSIFIERS: dict[str, Callable[[int], Any]] = {
    "lda": lambda seed: LinearDiscriminantAnalysis(),
    "shrinkage_lda": lambda seed: LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
    "naive_bayes": lambda seed: GaussianNB(),
    "random_forest": lambda seed: RandomForestClassifier(200, random_state=seed),
    "ridge": lambda seed: RidgeClassifierCV(alphas=np.logspace(-3, 3, 10)),
    "extra_trees": lambda seed: ExtraTreesClassifier(
        200, max_features=0.1, criterion="entropy", random_state=seed
    ),
}
"""Name -> (seed -> unfitted classifier). Ridge and extra trees are set as in aeon's own classifiers."""
