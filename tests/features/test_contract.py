"""The contract that every registered feature meets; new features are tested automatically."""

import doctest
import functools
import inspect
import pickle
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from feature_signals import FS, noise, tone
from scipy import signal

from texclass import features
from texclass.features.contract import Feature, UndefinedFeatureError, find_feature, list_features
from texclass.features.contract_checks import degenerate_inputs, view_without_recording
from texclass.features.phase_view import PairView, PhaseView, TapSignal, TapView, views_of
from texclass.features.sets import load_feature_set
from texclass.recording import Recording

FEATURES = list_features()


@functools.cache
def stroke(duration_s, fs, seed=0):
    """Return noise up to 1 kHz with a 60 Hz grating: the same signal at any sampling rate."""
    sos = signal.butter(4, (15, 1000), "bandpass", fs=5000, output="sos")
    x = signal.resample_poly(signal.sosfiltfilt(sos, noise(round(duration_s * 5000), seed)), round(fs), 5000)
    x = x / x.std() + 0.5 * tone(60, x.size, fs) + 1e-3 * tone(4, x.size, fs)
    return np.asarray(x - x.mean())


def taps(fs, gain=1.0, n=3):
    """Return taps that ring at 300 Hz and bounce once."""

    def tap(strength):
        t = np.arange(round(0.1 * fs)) / fs
        ring = np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)
        bounce = np.where(t > 0.05, np.exp(-60 * (t - 0.05)) * np.sin(2 * np.pi * 300 * (t - 0.05)), 0)
        hand = 0.05 * np.sin(np.pi * np.arange(round(0.05 * fs)) / (0.05 * fs)) ** 2
        return TapSignal(gain * strength * hand, gain * strength * (ring + 0.3 * bounce))

    return TapView(tuple(tap(1 + 0.5 * i) for i in range(n)), fs, gain * 1e-4)


MOVEMENT = stroke(5.0, FS)


def normal(phase, gain=1.0, fs=FS, **length_and_seed):
    """Return a view with an empty cache."""
    arguments = {"duration_s": 5.0, "fs": fs, **length_and_seed}
    if phase == "pair":
        x, y = (stroke(**arguments | {"seed": seed}) for seed in (0, 1))
        return PairView((PhaseView(gain * x, fs), PhaseView(gain * (x + y), fs)))
    if phase == "travel":  # 300 ridges per m
        x = stroke(**arguments)
        return PhaseView(gain * (x + sum(tone(300 * h, x.size, fs) / h for h in (1, 2, 3))), fs)
    return taps(fs, gain) if phase == "tap" else PhaseView(gain * stroke(**arguments), fs)


shared = functools.cache(normal)
"""Views shared by all features, with the cached transforms of earlier ones."""


def each(*, phase=None, free_of=None):
    features = [
        f
        for f in FEATURES.values()
        if phase in (None, f.phase) and (not free_of or free_of not in f.depends_on)
    ]
    return pytest.mark.parametrize("feature", features, ids=lambda f: f.name)


def test_every_module_with_a_feature_is_registered():
    folder = Path(features.__file__).parent
    holding = {p.stem for p in folder.glob("*.py") if re.search(r"^@feature", p.read_text(), re.MULTILINE)}
    assert holding == {f.function.__module__.rpartition(".")[2] for f in FEATURES.values()}


@each()
def test_declaration_is_complete_and_values_are_finite_repeatable_and_match_the_columns(feature):
    columns = feature.columns(feature.name, {})
    assert len(set(columns)) == len(columns)
    assert feature.unit
    assert feature.reference
    assert feature.summary.endswith(".")
    assert pickle.loads(pickle.dumps(feature)) is feature  # pickled by name
    view = normal(feature.phase)
    parts = {"tap": lambda: view.taps, "pair": lambda: view.sides}.get(feature.phase, lambda: [view])()
    for array in (array for part in parts for array in vars(part).values() if isinstance(array, np.ndarray)):
        array.flags.writeable = False  # writing to the input raises
    values = np.atleast_1d(feature.function(view))
    assert np.isfinite(values).all()
    assert values.shape == (len(columns),)
    np.testing.assert_array_equal(feature.function(normal(feature.phase)), values)


@each()
def test_documentation_has_references_and_an_example_that_runs(feature):
    text = inspect.getdoc(feature.function)
    assert all(f"\n{title}\n-----" in text for title in ("Parameters", "Returns", "Raises", "References"))
    scope = dict(vars(inspect.getmodule(feature.function)))
    example = doctest.DocTestParser().get_doctest(text, scope, feature.name, None, None)
    assert example.examples
    assert doctest.DocTestRunner(verbose=False).run(example).failed == 0


@each()
def test_gain_law_holds(feature):
    value = feature.function(shared(feature.phase))
    for gain in (1e-100, 1e-6, 1e-2, 1e3, 1e100):
        expected = feature.gain.apply(value, gain)
        value_of_gain = feature.function(shared(feature.phase, gain))
        np.testing.assert_allclose(value_of_gain, expected, rtol=2e-6, atol=1e-300, err_msg=f"gain {gain}")


@pytest.mark.parametrize("phase", ["movement", "travel", "tap", "friction", "pair"])
def test_values_do_not_depend_on_cached_transforms(phase):
    every = [f for f in FEATURES.values() if f.phase == phase]
    view = normal(phase)
    for f in (*every, *every[::-1]):
        np.testing.assert_array_equal(f.function(view), f.function(normal(phase)), err_msg=f.name)


@each(phase="movement", free_of="length")
def test_value_does_not_depend_on_length_unless_declared(feature):
    if feature.name == "spectral_peaks":
        pytest.skip("the order of peaks of equal height is random; another test covers it")
    short, long = (
        np.array([np.atleast_1d(feature.function(shared("movement", duration_s=s, seed=i))) for i in seeds])
        for s, seeds in ((5.0, range(8)), (20.0, (20, 21)))
    )
    error = np.abs(short.mean(axis=0) - long.mean(axis=0))
    scatter = short.std(axis=0, ddof=1)
    assert (error <= 4 * scatter + 1e-3 * np.abs(long.mean(axis=0))).all()


@each(free_of="rate")
def test_value_does_not_depend_on_rate_unless_declared(feature):
    slow, fast = (feature.function(shared(feature.phase, fs=fs)) for fs in (10_000.0, 20_000.0))
    if feature.name == "discretized_spectrogram":  # cells at the edge contain other frames and bins
        np.testing.assert_allclose(fast, slow, atol=0.5)
    else:
        np.testing.assert_allclose(fast, slow, rtol=0.03, atol=0.02)


@each()
def test_value_does_not_depend_on_sign_unless_declared(feature):
    view = shared(feature.phase)
    is_even = []
    for step in (0.0, 0.5):  # not quantised, and coarsely quantised: adjacent samples are often equal
        change = lambda x, step=step: np.round(x / (step * x.std())) * step if step else x  # noqa: E731
        variant = with_samples(view, change)
        try:
            value, negated = feature.function(variant), feature.function(with_samples(variant, np.negative))
        except UndefinedFeatureError:
            assert step > 0, feature.name
            continue
        is_even.append(np.allclose(negated, value, rtol=1e-6, atol=1e-9))
    assert all(is_even) == ("sign" not in feature.depends_on)


def with_samples(view, change):
    """Return a view with a function applied to its samples."""
    if isinstance(view, PhaseView):
        return PhaseView(change(view.samples), view.fs)
    if isinstance(view, PairView):
        return PairView(tuple(PhaseView(change(side.samples), side.fs) for side in view.sides))
    taps = tuple(TapSignal(change(t.hand), change(t.impulse)) for t in view.taps)
    return TapView(taps, view.fs, view.noise)


@pytest.mark.filterwarnings("error")
@each()
def test_short_and_extreme_signals_have_a_finite_value_or_none(feature):
    rng = np.random.default_rng(0)
    long = rng.uniform(-1, 1, 20_000)
    signals = [(long[:n], 10_000.0) for n in range(1, 51)]
    signals += [(long, fs) for fs in (1.0, 10.0, 100.0, 1e3, 1e5, 1e6, 1e7)]
    signals += [(long * gain, 10_000.0) for gain in (1.7e308, 1e300, 1e160, 1e-160, 1e-300, 5e-324)]
    n_defined = 0
    for x, fs in signals:
        signal = np.column_stack((x, x[::-1])) if feature.phase == "pair" else x
        try:
            value = feature.function(signal, fs=fs)
        except UndefinedFeatureError:
            continue
        assert np.isfinite(value).all()
        n_defined += 1
    assert n_defined > 0 or feature.phase in ("tap", "travel")  # white noise contains neither


def test_rows_of_table_i_have_the_published_dimension():
    table = load_feature_set("strese2015")
    for names, dimension in (
        ("waviness spikiness regularity", 3), ("temporal_roughness spectral_roughness", 2),
        ("hardness damping", 2), (" ".join(f"mfcc_constant.c{i}" for i in (2, 5, 6, 8, 12)), 5),
        ("friction", 1), ("mfcc_constant", 13), ("mfcc_decreasing", 13), ("gaussian_band_energies", 30),
        ("discretized_spectrogram", 125), ("spectral_centroid", 1), ("standard_roughness", 1),
        ("lpc_coefficients", 10), ("mean_magnitude variance wavelet_energy", 3), ("spectral_peaks", 5),
    ):  # fmt: skip
        assert len(table.columns_of(names.split())) == dimension, names


def test_corrected_set_does_not_depend_on_length_or_rate_except_for_features_in_samples():
    scaling = {member.name for member in load_feature_set("multiscale").members}
    for member in load_feature_set("texclass").members:
        allowed = {"rate", "sign"} if member.name in scaling else {"sign"}
        assert member.feature.depends_on <= allowed, member.name


DEGENERATE = dict(degenerate_inputs())
BAD = {name: DEGENERATE.pop(name) for name in ("one NaN", "one infinite sample")}
BAD["one of minus infinity"] = -BAD["one infinite sample"]
DEGENERATE["one impulse, mean removed"] = DEGENERATE["one impulse"] - DEGENERATE["one impulse"].mean()
DEGENERATE["alternating"] = np.tile([1.0, -1.0], 10_000)
DEGENERATE |= {f"{n} samples": noise(n, n) for n in (3, 5, 8, 31, 32, 64, 99, 199, 250, 400, 543, 544, 600)}


@functools.cache
def degenerate(kind, phase, fs=FS):
    return view_without_recording(phase, (DEGENERATE | BAD)[kind], fs)


def reason_of(feature, view):
    """Return the reason if undefined; otherwise assert that all values are finite."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        except UndefinedFeatureError as reason:
            return str(reason)
    assert values.shape == (len(feature.columns(feature.name, {})),)
    assert np.isfinite(values).all()
    return None


@each()
def test_degenerate_input_gives_a_value_or_a_reason(feature):
    for kind in DEGENERATE:
        for fs in (FS, 100.0):
            reason = reason_of(feature, degenerate(kind, feature.phase, fs))
            assert reason is None or re.search("Expected|must be|silen(ce|t)", reason), (kind, fs, reason)
            assert (kind, fs) != ("silence", FS) or "silence" in reason
    for kind in BAD:
        assert "NaN or infinite" in reason_of(feature, degenerate(kind, feature.phase))


@each(phase="tap")
def test_features_of_taps_need_no_absolute_rate_but_at_least_one_tap(feature):
    real = taps(FS)
    assert reason_of(feature, TapView(real.taps, 1.0, real.noise)) is None
    assert reason_of(feature, TapView((), FS)) == "no tap found"


@each()
def test_a_feature_of_an_array_equals_that_of_its_view(feature):
    with pytest.raises(ValueError, match="fs is None"):
        feature.function(MOVEMENT)
    x = (normal("travel").samples if feature.phase == "travel" else MOVEMENT)[:20_000] + 3.0
    if feature.phase == "pair":
        both = np.column_stack([x, x[::-1]])
        with pytest.raises(ValueError, match="a pair must have 2 channels, got 1"):
            feature.function(x, fs=FS)
        np.testing.assert_allclose(
            feature.function(both, fs=FS), feature.function(view_without_recording("pair", x, FS))
        )
        return
    if feature.phase == "tap":
        x = 1e-3 * noise(20_000)
        for start in (5000, 9000, 13_000):
            x[start : start + 1000] += taps(FS).taps[0].impulse
        view = views_of(Recording(x, FS))[""].tap
    else:
        view = PhaseView(x if feature.phase == "friction" else x - x.mean(), FS)
    np.testing.assert_allclose(feature.function(x, fs=FS), feature.function(view), rtol=1e-9, atol=1e-12)


def test_names_of_outputs_follow_the_parameters():
    def columns(outputs, **parameters):
        return Feature("f", lambda view: 0, "movement", "1", "test", outputs).columns("f", parameters)

    assert columns(()) == ("f",)
    assert columns("b{n}", n=2) == ("f.b1", "f.b2")
    assert columns("t{n:02d}f{lags}", n=2, lags=(4, 8)) == ("f.t01f4", "f.t01f8", "f.t02f4", "f.t02f8")
    assert columns(("f{n}", "rest"), n=1) == ("f.f1", "f.rest")
    assert columns(lambda n: ("a",) * n, n=1) == ("f.a",)
    assert find_feature("lpc_coefficients").columns("lpc", {"order": 2}) == ("lpc.a1", "lpc.a2")
    assert find_feature("mfcc").columns("m", {"coefficients": (2, 12)}) == ("m.c2", "m.c12")
    assert find_feature("band_level").columns("low", {"n_bands": 2, "n_segments": 2}) == (
        "low.b1.segment1", "low.b1.segment2", "low.b2.segment1", "low.b2.segment2",
    )  # fmt: skip


def test_an_unknown_feature_name_suggests_the_closest_name():
    with pytest.raises(KeyError, match="Did you mean waviness"):
        find_feature("wavines")
