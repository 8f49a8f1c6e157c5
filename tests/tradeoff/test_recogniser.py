"""Tests of pruned recognisers: they compute only what they need, with identical predictions."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.feature_selection import SelectKBest, VarianceThreshold
from sklearn.impute import SimpleImputer
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

from texclass.classifiers.forward_selection import ForwardSelector
from texclass.evaluation import skops_archive
from texclass.features import FeatureExtractor, load_feature_set
from texclass.recording import Phases, Recording
from texclass.tradeoff.cost_selection import CostAwareSelector
from texclass.tradeoff.recogniser import fit_recogniser, load_recogniser, prune, save_recogniser

RNG = np.random.default_rng(0)
SET = load_feature_set("texclass").restricted_to(["waviness", "fineness", "mfcc", "hardness", "friction"])


def recordings():
    """Return noise that is filtered differently for each surface; without taps, so hardness is undefined."""
    signals = []
    for surface, repetition in product(range(3), range(6)):
        noise = RNG.normal(size=4000)
        signals.append(
            Recording(
                np.convolve(noise, np.ones(1 + 3 * surface), "same") + 0.1 * RNG.normal(size=4000),
                fs=4000.0, unit="g", recording_id=f"{surface}-{repetition}", surface=f"m{surface}",
                friction=RNG.normal(size=4000) + surface, phases=Phases(movement=(0, 4000)),
            )
        )  # fmt: skip
    return signals, np.array([r.surface for r in signals])


X, Y = recordings()
KEEP = SimpleImputer(strategy="median", keep_empty_features=True)
STEPS = {
    "forward": [KEEP, MinMaxScaler(), ForwardSelector(GaussianNB(), n_features_to_select=3), GaussianNB()],
    "cost-aware": [
        KEEP, StandardScaler(),
        CostAwareSelector(LinearDiscriminantAnalysis(), unit="column", max_features=2),
        LinearDiscriminantAnalysis(),
    ],
    "scaler after": [KEEP, SelectKBest(k=4), RobustScaler(), LinearDiscriminantAnalysis()],
    "two selectors": [KEEP, MaxAbsScaler(), VarianceThreshold(1e-6), SelectKBest(k=2), GaussianNB()],
    "empty columns dropped": [SimpleImputer(), StandardScaler(), SelectKBest(k=3), GaussianNB()],
    "nested": [make_pipeline(KEEP, StandardScaler()), "passthrough", SelectKBest(k=3), GaussianNB()],
    "mixed": [SimpleImputer(), PCA(3, random_state=0), SelectKBest(k=2), GaussianNB()],
    "forest": [KEEP, SelectKBest(k=3), RandomForestClassifier(5, random_state=0)],
}  # fmt: skip


def columns_of(recogniser):
    return recogniser[0].plan_.columns


@cache
def fitted(name):
    """Return a fitted recogniser with the named steps, which tests share and do not modify."""
    named = [(f"step{i}", clone(step, safe=False)) for i, step in enumerate(STEPS[name])]
    return Pipeline([("features", FeatureExtractor(SET)), *named]).fit(X, Y)


@pytest.mark.filterwarnings(
    "ignore:Features.*are constant", "ignore:invalid value", "ignore:Skipping features"
)
@pytest.mark.parametrize("name", STEPS)
def test_pruned_predictions_are_identical_to_the_last_bit(name):
    recogniser = fitted(name)
    pruned = prune(recogniser)
    np.testing.assert_array_equal(pruned.predict(X), recogniser.predict(X))
    np.testing.assert_array_equal(pruned.predict_proba(X), recogniser.predict_proba(X))
    np.testing.assert_array_equal(pruned.predict_proba(X[3:4]), recogniser.predict_proba(X[3:4]))


def test_a_pruned_recogniser_computes_only_selected_columns():
    recogniser = fitted("forward")
    support = recogniser[3].get_support()
    pruned = prune(recogniser)
    assert columns_of(pruned) == tuple(np.array(columns_of(recogniser))[support])
    assert [type(step) for _, step in pruned.steps[1:]] == [SimpleImputer, MinMaxScaler, GaussianNB]
    assert columns_of(prune(pruned)) == columns_of(pruned)


@pytest.mark.filterwarnings("ignore:Skipping features")
def test_columns_that_a_mixing_step_needs_are_kept():
    pruned = prune(fitted("mixed"))
    assert "hardness" not in columns_of(pruned)
    assert len(columns_of(pruned)) == 16


def test_channels_are_pruned_one_by_one():
    stereo = [
        r.with_(acceleration=np.column_stack([r.acceleration, r.acceleration[::-1]]), channels=("a", "b"))
        for r in X
    ]
    steps = [("impute", KEEP), ("select", SelectKBest(k=3)), ("classify", GaussianNB())]
    recogniser = Pipeline([("features", FeatureExtractor(SET, channels="each")), *steps])
    with pytest.warns(UserWarning, match="constant"), np.errstate(invalid="ignore", divide="ignore"):
        recogniser.fit(stereo, Y)
    pruned = prune(recogniser)
    assert len(columns_of(pruned)) == 3
    np.testing.assert_array_equal(pruned.predict_proba(stereo), recogniser.predict_proba(stereo))


def test_fitting_to_a_table_equals_fitting_to_recordings():
    whole = fitted("cost-aware")
    values = whole[0].transform(X)
    steps = [("impute", KEEP), ("scale", StandardScaler()), ("classify", LinearDiscriminantAnalysis())]
    from_table = fit_recogniser(whole[0].plan_, values, Y, steps)
    from_recordings = Pipeline([("features", FeatureExtractor(SET)), *steps]).fit(X, Y)
    np.testing.assert_array_equal(from_table.predict_proba(X), from_recordings.predict_proba(X))


def test_a_loaded_recogniser_has_identical_predictions(tmp_path):
    whole, path = fitted("cost-aware"), tmp_path / "models" / "r.skops"
    for recogniser in (whole, prune(whole)):
        save_recogniser(recogniser, path)
        loaded = load_recogniser(path)
        np.testing.assert_array_equal(loaded.predict_proba(X), recogniser.predict_proba(X))
        assert columns_of(loaded) == columns_of(recogniser)
        assert loaded[0].plan_.parts[0][1].remove_hand_motion  # as in the set `texclass`
        assert columns_of(prune(loaded)) == columns_of(prune(whole))


def test_arrays_of_signals_keep_their_rate_and_unit(tmp_path):
    signals = np.array([r.acceleration for r in X])
    steps = [("impute", KEEP), ("select", SelectKBest(k=2)), ("classify", GaussianNB())]
    features = SET.restricted_to(["waviness", "mfcc"])
    recogniser = Pipeline([("features", FeatureExtractor(features, fs=4000.0, unit="g")), *steps]).fit(
        signals, Y
    )
    save_recogniser(prune(recogniser), tmp_path / "r.skops")
    loaded = load_recogniser(tmp_path / "r.skops")
    np.testing.assert_array_equal(loaded.predict(signals), recogniser.predict(signals))


def test_other_files_raise_a_value_error(tmp_path, monkeypatch):
    import skops.io

    with pytest.raises(FileNotFoundError):
        load_recogniser(tmp_path / "none.skops")
    (tmp_path / "text.skops").write_text("no")
    with pytest.raises(ValueError, match=r"text\.skops: not a recogniser of texclass"):
        load_recogniser(tmp_path / "text.skops")
    skops.io.dump({"f": np.testing.assert_array_equal}, tmp_path / "foreign.skops")
    with pytest.raises(ValueError, match=r"Expected only classes and parameters .* on the allow-list"):
        load_recogniser(tmp_path / "foreign.skops")
    monkeypatch.setattr(skops_archive, "find_disallowed", lambda data: ["texclass.evaluation.choice.Choice"])
    with pytest.raises(ValueError, match=r"contains texclass\.evaluation\.choice\.Choice.*another version"):
        load_recogniser(tmp_path / "foreign.skops")


def test_changed_feature_code_gives_a_warning(tmp_path, monkeypatch):
    save_recogniser(fitted("cost-aware"), tmp_path / "r.skops")
    monkeypatch.setattr("texclass.features.plan.code_hash", lambda feature_set: "other")
    with pytest.warns(UserWarning, match="Train it again"):
        load_recogniser(tmp_path / "r.skops")
