"""What every registered feature keeps, whoever wrote it; a new feature gets these tests for free."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from texclass.features.contract import Feature, UndefinedFeatureError, registered
from texclass.features.phase_view import PhaseView, TapSignal, TapView
from texclass.features.sets import load_feature_set
from texclass.recording import Samples

FEATURES = registered()
View = PhaseView | TapView


def stroke(duration_s: float, fs: float, seed: int = 0) -> Samples:
    """Stationary noise up to 1 kHz with a 60 Hz grating: the same signal whatever the rate."""
    rng = np.random.default_rng(seed)
    base = rng.standard_normal(round(duration_s * 5000))
    noise = signal.sosfiltfilt(signal.butter(4, (15, 1000), "bandpass", fs=5000, output="sos"), base)
    x = signal.resample_poly(noise, round(fs), 5000)
    t = np.arange(x.size) / fs
    x = x / x.std() + 0.5 * np.sin(2 * np.pi * 60 * t) + 1e-3 * np.sin(2 * np.pi * 4 * t)
    return np.asarray(x - x.mean())


def taps(fs: float, gain: float = 1.0, n: int = 3) -> TapView:
    """Taps that ring at 300 Hz and bounce once."""

    def tap(strength: float) -> TapSignal:
        t = np.arange(round(0.1 * fs)) / fs
        ring = np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)
        bounce = np.where(t > 0.05, np.exp(-60 * (t - 0.05)) * np.sin(2 * np.pi * 300 * (t - 0.05)), 0)
        hand = 0.05 * np.sin(np.pi * np.arange(round(0.05 * fs)) / (0.05 * fs)) ** 2
        return TapSignal(gain * strength * hand, gain * strength * (ring + 0.3 * bounce))

    return TapView(tuple(tap(1 + 0.5 * i) for i in range(n)), fs, gain * 1e-4)


def view_of(feature: Feature, samples: Samples, fs: float = 10_000.0) -> View:
    """The samples as the phase that the feature reads; a tap has its contact after a quarter."""
    if feature.phase == "tap":
        contact = samples.size // 4
        return TapView((TapSignal(samples[:contact], samples[contact:]),), fs)
    return PhaseView(samples, fs)


def normal(feature: Feature, gain: float = 1.0) -> View:
    return taps(10_000.0, gain) if feature.phase == "tap" else PhaseView(gain * MOVEMENT, 10_000.0)


MOVEMENT = stroke(5.0, 10_000.0)
each = pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES.keys())


@each
def test_values_are_finite_and_as_many_as_the_names(feature: Feature) -> None:
    values = np.atleast_1d(feature.function(normal(feature)))
    assert np.isfinite(values).all()
    assert values.shape == (len(feature.columns(feature.name, {})),)


@each
def test_names_are_unique_and_every_declaration_is_filled_in(feature: Feature) -> None:
    columns = feature.columns(feature.name, {})
    assert len(set(columns)) == len(columns)
    assert feature.unit
    assert feature.reference
    assert feature.summary.endswith(".")


@each
@pytest.mark.parametrize("gain", [1e-100, 1e-6, 1e-2, 1e3, 1e100])
def test_gain_law_holds(feature: Feature, gain: float) -> None:
    expected = feature.gain.apply(feature.function(normal(feature)), gain)
    np.testing.assert_allclose(feature.function(normal(feature, gain)), expected, rtol=2e-6, atol=1e-300)


@each
def test_the_same_input_gives_the_same_value(feature: Feature) -> None:
    np.testing.assert_array_equal(feature.function(normal(feature)), feature.function(normal(feature)))


@each
def test_value_does_not_depend_on_what_was_computed_before_on_the_view(feature: Feature) -> None:
    shared = normal(feature)
    for other in FEATURES.values():
        if other.phase == feature.phase:
            other.function(shared)
    np.testing.assert_array_equal(feature.function(shared), feature.function(normal(feature)))


@each
def test_input_is_not_written_to(feature: Feature) -> None:
    view = normal(feature)
    arrays = (
        [view.samples] if isinstance(view, PhaseView) else [a for t in view.taps for a in (t.hand, t.impulse)]
    )
    for array in arrays:
        array.flags.writeable = False
    before = [array.copy() for array in arrays]
    feature.function(view)
    for array, old in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, old)


def free_of(what: str) -> list[Feature]:
    return [f for f in FEATURES.values() if what not in f.depends_on]


def spread(feature: Feature, fs: float = 10_000.0, duration_s: float = 5.0) -> Samples:
    """Values over independent recordings of one surface, shape (8, n_outputs)."""
    views = [PhaseView(stroke(duration_s, fs, seed), fs) for seed in range(8)]
    return np.array([np.atleast_1d(feature.function(view)) for view in views])


@pytest.mark.parametrize(
    "feature", [f for f in free_of("length") if f.phase == "movement"], ids=lambda f: f.name
)
def test_value_does_not_depend_on_length_unless_declared(feature: Feature) -> None:
    if feature.name == "spectral_peaks":
        pytest.skip("the order of peaks of equal height is chance; its own test covers it")
    short = spread(feature)
    long = np.array(
        [np.atleast_1d(feature.function(PhaseView(stroke(20.0, 10_000.0, s), 10_000.0))) for s in (20, 21)]
    )
    error = np.abs(short.mean(axis=0) - long.mean(axis=0))
    scatter = short.std(axis=0, ddof=1)
    assert (error <= 4 * scatter + 1e-3 * np.abs(long.mean(axis=0))).all()


@pytest.mark.parametrize("feature", free_of("rate"), ids=lambda f: f.name)
def test_value_does_not_depend_on_rate_unless_declared(feature: Feature) -> None:
    if feature.phase == "tap":
        slow, fast = feature.function(taps(10_000.0)), feature.function(taps(20_000.0))
    else:
        slow = feature.function(PhaseView(stroke(5.0, 10_000.0), 10_000.0))
        fast = feature.function(PhaseView(stroke(5.0, 20_000.0), 20_000.0))
    if feature.name == "discretized_spectrogram":  # cells at the edge of the band hold other frames and bins
        np.testing.assert_allclose(fast, slow, atol=0.5)
    else:
        np.testing.assert_allclose(fast, slow, rtol=0.03, atol=0.02)


DIMENSIONS_OF_TABLE_I = {
    ("waviness", "spikiness", "regularity"): 3,
    ("temporal_roughness", "spectral_roughness"): 2,
    ("hardness", "damping"): 2,
    ("mfcc_constant.c2", "mfcc_constant.c5", "mfcc_constant.c6", "mfcc_constant.c8", "mfcc_constant.c12"): 5,
    ("friction",): 1,
    ("mfcc_constant",): 13,
    ("mfcc_decreasing",): 13,
    ("gaussian_band_energies",): 30,
    ("discretized_spectrogram",): 125,
    ("spectral_centroid",): 1,
    ("standard_roughness",): 1,
    ("lpc_coefficients",): 10,
    ("mean_magnitude", "variance", "wavelet_energy"): 3,
    ("spectral_peaks",): 5,
}


@pytest.mark.parametrize("names", DIMENSIONS_OF_TABLE_I, ids=lambda names: names[0])
def test_rows_of_table_i_have_the_published_dimension(names: tuple[str, ...]) -> None:
    assert len(load_feature_set("strese2015").columns_of(names)) == DIMENSIONS_OF_TABLE_I[names]


def test_corrected_set_depends_on_neither_length_nor_rate_but_for_bands_that_scale_with_the_rate() -> None:
    scaling = {member.name for member in load_feature_set("multiscale").members}
    for member in load_feature_set("texclass").members:
        assert member.feature.depends_on <= ({"rate"} if member.name in scaling else set()), member.name


RNG = np.random.default_rng(1)
IMPULSE = np.zeros(20_000)
IMPULSE[9_000] = 1.0
DEGENERATE: dict[str, Samples] = {
    "silence": np.zeros(20_000),
    "constant": np.full(20_000, 0.1),
    "clipped square": np.sign(np.sin(2 * np.pi * 50 * np.arange(20_000) / 10_000) + 1e-9),
    "one impulse": IMPULSE,
    "one impulse, mean removed": IMPULSE - IMPULSE.mean(),
    "pure tone": np.sin(2 * np.pi * 123.4 * np.arange(20_000) / 10_000),
    "half silent": np.concatenate([np.zeros(10_000), RNG.standard_normal(10_000)]),
    "quantised to one step": np.round(0.6 * RNG.standard_normal(20_000)),
    "ramp": np.linspace(-1, 1, 20_000),
    "alternating": np.tile([1.0, -1.0], 10_000),
} | {
    f"{n} samples": RNG.standard_normal(n)
    for n in (0, 1, 2, 3, 5, 8, 31, 32, 64, 99, 199, 250, 400, 543, 544, 600)
}


def value_or_reason(call: Callable[[], object], n_outputs: int) -> str | None:
    """Return the reason if undefined; otherwise assert that the value is whole and finite."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.atleast_1d(np.asarray(call(), dtype=np.float64))
        except UndefinedFeatureError as reason:
            return str(reason)
    assert values.shape == (n_outputs,)
    assert np.isfinite(values).all()
    return None


@each
@pytest.mark.parametrize("kind", DEGENERATE)
@pytest.mark.parametrize("fs", [10_000.0, 100.0])
def test_degenerate_input_gives_a_value_or_a_reason(feature: Feature, kind: str, fs: float) -> None:
    reason = value_or_reason(
        lambda: feature.function(view_of(feature, DEGENERATE[kind], fs)),
        len(feature.columns(feature.name, {})),
    )
    assert reason is None or ("rule" in reason or "silence" in reason or "silent" in reason), reason


@each
def test_silence_has_no_value(feature: Feature) -> None:
    with pytest.raises(UndefinedFeatureError, match=r"silence"):
        feature.function(view_of(feature, np.zeros(20_000)))


@each
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_not_finite_is_refused_by_name(feature: Feature, bad: float) -> None:
    samples = MOVEMENT[:20_000].copy()
    samples[12_345] = bad
    with pytest.raises(UndefinedFeatureError, match="NaN or infinite"):
        feature.function(view_of(feature, samples))


@pytest.mark.parametrize("feature", [f for f in FEATURES.values() if f.phase == "tap"], ids=lambda f: f.name)
def test_no_tap_found_is_the_reason(feature: Feature) -> None:
    with pytest.raises(UndefinedFeatureError, match="no tap found"):
        feature.function(TapView((), 10_000.0))


@pytest.mark.parametrize("feature", [f for f in FEATURES.values() if f.phase == "tap"], ids=lambda f: f.name)
def test_taps_need_no_absolute_rate(feature: Feature) -> None:
    real = taps(10_000.0)
    nominal = TapView(real.taps, 1.0, real.noise)
    assert value_or_reason(lambda: feature.function(nominal), len(feature.columns(feature.name, {}))) is None
