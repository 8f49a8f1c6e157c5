"""Simulate the controlled recordings of `strese2015`, compute its features, and measure what they depend on.

Simulated recordings have a known ground truth: stiffness, heights, friction, and the speed and force of the
hand. The real recordings are those of `texclass datasets`; a function returns nothing if they are missing.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import signal, stats
from sklearn.base import ClassifierMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.model_selection import StratifiedKFold, cross_val_predict, cross_validate
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MinMaxScaler

from texclass.features.cepstrum import mfcc
from texclass.features.fineness import fineness_as_printed
from texclass.features.friction import friction
from texclass.features.hardness import damping_as_printed, hardness, hardness_as_printed
from texclass.features.phase_view import PhaseView, TapView, UndefinedFeatureError, Views
from texclass.features.related_work import discretized_spectrogram, spectral_centroid, standard_roughness
from texclass.features.roughness import (
    regularity_as_printed,
    spectral_roughness_as_printed,
    spikiness_as_printed,
    temporal_roughness,
    temporal_roughness_as_printed,
    waviness_as_printed,
)
from texclass.recording import Phases, Recording
from texclass.signals import butterworth
from texclass.simulate import (
    Bumps,
    Grating,
    Sensor,
    Surface,
    operator_catalogue,
    record_freehand,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)
from texclass.simulate.profile import synthesize_profile

SEED, FS = 2015, 10_000
"""Seed of surfaces and operator, and sampling rate of the paper in Hz."""
N_STEPS, REST_S = 9, 0.5
"""Number of windows of 1 s per run, and start of the first window in s. The plate rests before 0.3 s."""
N_TAPS, TAP_SPEEDS_MM_S = 10, (10.0, 45.0)
WIDE = Sensor(bandwidth_hz=0.5 * FS, noise_ug_rt_hz=0.0, converter_bits=24)
"""Sensor without noise and with a bandwidth of half the sampling rate. The sensor of the paper, `Sensor()`,
ends near 1.8 kHz."""
PLAIN = Surface(
    "plain", "wood", rms_um=2.0, slope=3.9, corner_mm=1.3, gratings=(), bumps=None, stiffness_n_m=60e3,
    dissipation_s_m=9.0, static_friction=0.46, kinetic_friction=0.35,
)  # fmt: skip
"""Surface to which bumps or a grating are added. The values are typical of wood in the catalogue."""
BUMP_HEIGHTS_UM, GRATING_DEPTHS_UM = (0.0, 5.0, 10.0, 20.0, 40.0), (0.0, 5.0, 10.0, 20.0, 40.0)
FOLDS = StratifiedKFold(10, shuffle=True, random_state=SEED)
CLASSIFIERS = {
    "naive Bayes": GaussianNB(),
    "shrinkage LDA": LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto"),
}
OPERATOR = replace(operator_catalogue(1, SEED)[0], direction_deg=0.0)
MOVEMENT_FEATURES: Mapping[str, Callable[[PhaseView], float]] = {
    "temporal_roughness": temporal_roughness_as_printed,
    "temporal_roughness_corrected": temporal_roughness,
    "standard_roughness": lambda view: 0.5 * np.log10(standard_roughness(view)),
    "spectral_roughness": spectral_roughness_as_printed,
    "fineness": lambda view: np.log10(fineness_as_printed(view)),
}
"""Features of a window, all in log10, so that their deviations can be compared. The roughness of [7], a
power, is converted to the level of an amplitude, which is the unit of eq. 3."""
MACROSCOPIC = {
    "waviness": waviness_as_printed,
    "spikiness": spikiness_as_printed,
    "regularity": regularity_as_printed,
}


def value_of(function: Callable[[Any], float], view: Any) -> float:
    """Return the value of a feature, or NaN if it is undefined."""
    try:
        return float(function(view))
    except UndefinedFeatureError:
        return np.nan


def movement_of(recording: Recording, start_s: float, duration_s: float) -> Views:
    """Return the views of a part of the movement."""
    start = round(start_s * recording.fs)
    return Views(recording, Phases(movement=(start, start + round(duration_s * recording.fs))))


def controlled_runs(surfaces: Sequence[Surface]) -> pd.DataFrame:
    """Return the features of every second of runs with rising force and rising speed, one row per second.

    The run "force, wide band" repeats the run with rising force with the sensor `WIDE`.
    """
    runs: dict[str, tuple[Callable[..., Recording], Sensor, Sequence[str]]] = {
        "force": (record_rising_force, Sensor(), tuple(MOVEMENT_FEATURES)),
        "speed": (record_rising_speed, Sensor(), tuple(MOVEMENT_FEATURES)),
        "force, wide band": (record_rising_force, WIDE, ("temporal_roughness", "standard_roughness")),
    }
    rows = []
    for i, surface in enumerate(surfaces):
        for run, (record, sensor, names) in runs.items():
            recording = record(surface, OPERATOR, duration_s=REST_S + N_STEPS, seed=SEED + i, sensor=sensor)
            for step in range(N_STEPS):
                views = movement_of(recording, REST_S + step, 1.0)
                values = {name: value_of(MOVEMENT_FEATURES[name], views.movement) for name in names}
                values["friction"] = np.log10(friction(views.friction))
                rows.append({"surface": surface.name, "run": run, "step": step, **values})
    return pd.DataFrame(rows)


def rising_taps(surfaces: Sequence[Surface]) -> pd.DataFrame:
    """Return hardness and damping of every tap of runs with rising velocity, one row per tap."""
    rows = []
    for i, surface in enumerate(surfaces):
        recording = record_rising_taps(
            surface, OPERATOR, n_taps=N_TAPS, seed=SEED + i, tap_speed_mm_s=TAP_SPEEDS_MM_S
        )
        taps = Views(recording, recording.phases).tap
        for step, tap in enumerate(taps.taps):
            view = TapView((tap,), taps.fs, taps.noise)
            rows.append(
                {
                    "surface": surface.name,
                    "step": step,
                    "hardness": np.log10(value_of(hardness_as_printed, view)),
                    "hardness_corrected": np.log10(value_of(hardness, view)),
                    "damping": np.log10(value_of(damping_as_printed, view)),
                }
            )
    return pd.DataFrame(rows)


def spread(values: pd.DataFrame, column: str) -> dict[str, float]:
    """Return how much a feature differs between surfaces, and how much along the run of one surface.

    Parameters
    ----------
    values : DataFrame
        One row per surface and step of one run.
    column : str
        Name of the feature.

    Returns
    -------
    dict
        Standard deviation of the means of the surfaces (`between`), root of the mean variance of a surface
        along its run (`within`), their `ratio`, and the mean rank correlation with the step (`trend`).
    """
    by_surface = values.dropna(subset=[column]).groupby("surface")
    between = float(by_surface[column].mean().std())
    within = float(np.sqrt(by_surface[column].var().mean()))
    trend = by_surface[[column, "step"]].apply(lambda run: run[column].corr(run["step"], method="spearman"))
    return {
        "between": between, "within": within, "ratio": between / within, "trend": float(trend.mean()),
    }  # fmt: skip


def rms_height_um(surface: Surface, longest_mm: float = 10.0) -> float:
    """Return the RMS of the heights under the tip in µm, of wavelengths up to `longest_mm`."""
    heights_m, step_m = synthesize_profile(surface, 4, np.random.default_rng(SEED))
    spectrum = np.fft.rfft(heights_m, axis=1)
    spectrum[:, np.fft.rfftfreq(heights_m.shape[1], 1e3 * step_m) < 1.0 / longest_mm] = 0.0
    return float(1e6 * np.fft.irfft(spectrum, axis=1).std())


def rank_correlation(values: pd.DataFrame, column: str, truth: Mapping[str, float]) -> float:
    """Return the rank correlation over surfaces between the mean of a feature and a known property."""
    means = values.groupby("surface")[column].mean()
    return float(stats.spearmanr(means, [truth[name] for name in means.index]).statistic)


def variance_ratios(values: pd.DataFrame, run: str) -> pd.Series:
    """Return the variance of eq. 3 along a run, divided by that of the roughness of [7], for each surface."""
    by_surface = values[values["run"] == run].groupby("surface")
    return by_surface["temporal_roughness"].var() / by_surface["standard_roughness"].var()


def moving_average_effect(surfaces: Sequence[Surface]) -> pd.DataFrame:
    """Return the change of the waviness if force or speed rise instead of being constant at their mean.

    The column `with` contains the change of eq. 5, and `without` that of the same formula in which the
    moving average is replaced by the mean of the recording.
    """
    pairs: dict[str, tuple[Callable[..., Recording], dict[str, Any]]] = {
        "force": (record_rising_force, {"force_n": (1.45, 1.45)}),
        "speed": (record_rising_speed, {"speed_mm_s": (110.0, 110.0)}),
    }
    rows = []
    for i, surface in enumerate(surfaces):
        for run, (record, constant) in pairs.items():
            rising, steady = (
                movement_of(
                    record(surface, OPERATOR, duration_s=REST_S + N_STEPS, seed=SEED + i, **options),
                    REST_S,
                    N_STEPS,
                ).movement
                for options in ({}, constant)
            )
            lengths = {"with": 100, "without": rising.n_samples}  # in frames
            changes = {
                name: abs(waviness_as_printed(rising, average=n) - waviness_as_printed(steady, average=n))
                for name, n in lengths.items()
            }
            rows.append({"surface": surface.name, "run": run, **changes})
    return pd.DataFrame(rows)


def structured_surfaces() -> Iterator[tuple[str, float, Surface]]:
    """Yield kind and height in um of the structure on the plain surface, and the surface."""
    for height in BUMP_HEIGHTS_UM:
        bumps = Bumps(density_per_mm=0.08, height_um=height, width_mm=0.7) if height else None
        yield "bumps", height, replace(PLAIN, bumps=bumps)
    for depth in GRATING_DEPTHS_UM:
        gratings = (Grating(2.0, depth, sharpness=0.3, jitter=0.1),) if depth else ()
        yield "grating", depth, replace(PLAIN, gratings=gratings)


def macroscopic_features(n_seeds: int = 4) -> pd.DataFrame:
    """Return waviness, spikiness and regularity of the plain surface with bumps or a grating."""
    rows = []
    for kind, height, surface in structured_surfaces():
        for seed in range(n_seeds):
            recording = record_rising_force(
                surface, OPERATOR, duration_s=REST_S + 5, seed=seed, force_n=(1.0, 1.0)
            )
            view = movement_of(recording, REST_S, 5.0).movement
            values = {name: value_of(f, view) for name, f in MACROSCOPIC.items()}
            rows.append({"kind": kind, "height": height, **values})
    return pd.DataFrame(rows)


def noise_and_tone() -> tuple[float, float]:
    """Return the regularity of white noise, and that of a periodic signal of 30 Hz, both of 1 s."""
    noise = np.random.default_rng(SEED).standard_normal(FS)
    tone = np.sin(2 * np.pi * 30 * np.arange(FS) / FS)
    return regularity_as_printed(noise, fs=FS), regularity_as_printed(tone, fs=FS)


def level_of_bands(view: PhaseView, high_hz: float) -> np.ndarray:
    """Return the levels in bands of 50 Hz up to `high_hz`."""
    return discretized_spectrogram(view, n_times=1, n_bands=round(high_hz / 50), high_hz=high_hz)


def freehand_tables(seed: int, n_surfaces: int, n_recordings: int = 10) -> tuple[dict[str, Any], list[str]]:
    """Return feature tables of simulated freehand recordings of 6 s by 5 operators, and their surfaces."""
    tables: dict[str, list[Any]] = {}
    names, operators = [], operator_catalogue(5, seed)
    for i, surface in enumerate(surface_catalogue(n_surfaces, seed)):
        for j in range(n_recordings):
            recording = record_freehand(surface, operators[j % 5], duration_s=6.0, seed=(seed, i, j))
            views = Views(recording, recording.phases)
            rows = {
                "macroscopic": [value_of(f, views.movement) for f in MACROSCOPIC.values()],
                "macroscopic, from 10 Hz": [value_of(f, views.vibration) for f in MACROSCOPIC.values()],
                "bands to 1400 Hz": level_of_bands(views.movement, 1400.0),
                "bands to 600 Hz": level_of_bands(views.movement, 600.0),
                "13 MFCC": mfcc(views.movement),
                "125 cells of a spectrogram": discretized_spectrogram(views.movement),
            }
            for title, row in rows.items():
                tables.setdefault(title, []).append(row)
            names.append(surface.name)
    return {title: np.array(table) for title, table in tables.items()}, names


def ablations(tables: Mapping[str, Any], names: Sequence[str]) -> pd.DataFrame:
    """Return the accuracy with and without a part of the spectrum, one row per part and classifier.

    The parts are the frequencies below 10 Hz, for the three macroscopic features, and those above 600 Hz,
    for levels in bands of 50 Hz. Stratified ten-fold cross-validation.

    Returns
    -------
    DataFrame
        Accuracies `with` and `without` the part, their `difference`, and its 95 % interval (`low`, `high`; t
        distribution over surfaces).
    """
    parts = {
        "below 10 Hz": ("macroscopic", "macroscopic, from 10 Hz"),
        "above 600 Hz": ("bands to 1400 Hz", "bands to 600 Hz"),
    }
    rows = []
    for part, pair in parts.items():
        for title, classifier in CLASSIFIERS.items():
            correct = [
                cross_val_predict(pipeline(classifier), tables[name], names, cv=FOLDS) == np.array(names)
                for name in pair
            ]
            gain = pd.Series(np.subtract(*correct, dtype=float), names).groupby(level=0).mean()
            half = stats.t.ppf(0.975, len(gain) - 1) * gain.sem()
            rows.append(
                {
                    "part": part, "classifier": title, "with": correct[0].mean(),
                    "without": correct[1].mean(), "difference": gain.mean(), "low": gain.mean() - half,
                    "high": gain.mean() + half,
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def training_gaps(tables: Mapping[str, Any], names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return training and test accuracy of few and of many columns, with the naive Bayes classifier."""
    results = {}
    for title in ("13 MFCC", "125 cells of a spectrogram"):
        scores = cross_validate(
            pipeline(CLASSIFIERS["naive Bayes"]), tables[title], names, cv=FOLDS, return_train_score=True
        )
        results[title] = {"train": scores["train_score"].mean(), "test": scores["test_score"].mean()}
    return results


def pipeline(classifier: ClassifierMixin) -> Pipeline:
    """Return the preparation of `pipelines/strese2015.toml` with a classifier."""
    return make_pipeline(SimpleImputer(strategy="median"), MinMaxScaler(), classifier)


# Real recordings --------------------------------------------------------------------------------------------


def plate_taps(recordings: Mapping[str, Recording]) -> pd.DataFrame:
    """Return hardness and damping of the taps of `taps5`, both in log10, one row per tap.

    The second channel is used, which is clipped least. The sampling rate is unknown, but both printed
    formulas count samples.
    """
    rows = []
    for name, recording in recordings.items():
        view = Views(recording, recording.phases, channel=1).tap
        values = {
            "hardness": np.log10(value_of(hardness_as_printed, view)),
            "damping": np.log10(value_of(damping_as_printed, view)),
        }
        rows.append({"surface": name.rpartition("_")[0], **values})
    return pd.DataFrame(rows)


def fabric_fineness(recordings: Mapping[str, Recording]) -> pd.DataFrame:
    """Return fineness (eq. 2, and below 600 Hz as in [7]) of `fabric_speeds`, one row per fabric and speed.

    A finger moves over a fabric at 20, 30, 50 and 60 mm/s, v1 to v4 (`shared.FABRIC_MM_S`).
    """
    rows = []
    for name, recording in recordings.items():
        view = movement_of(recording, 0.0, recording.n_samples / recording.fs).movement
        surface, _, step = name.rpartition("_v")
        values = {"fineness": fineness_as_printed(view), "below 600 Hz": spectral_centroid(view)}
        rows.append({"surface": surface, "step": int(step), **values})
    return pd.DataFrame(rows)


def noise_above_sensor_band(recordings: Mapping[str, Recording]) -> pd.DataFrame:
    """Return how the band of d_1 of eq. 3, from 2.5 kHz, follows the vibration, one row per recording.

    The columns are the power density above 2.5 kHz relative to that from 100 to 600 Hz in dB, the
    coefficients of variation of the mean magnitudes in frames of 0.1 s from 150 to 1000 Hz and above 2.5 kHz,
    and their rank correlation.
    """
    rows = []
    for name, recording in recordings.items():
        x = recording.acceleration.ravel() - recording.acceleration.mean()
        f, power = signal.welch(x, recording.fs, nperseg=2048)
        density = [power[(f >= low) & (f < high)].mean() for low, high in ((100, 600), (2500, 5000))]
        n = round(0.1 * recording.fs)
        levels = [
            np.abs(signal.sosfiltfilt(band, x))[: x.size // n * n].reshape(-1, n).mean(axis=1)
            for band in (
                butterworth("bandpass", (150.0, 1000.0), recording.fs),
                butterworth("highpass", 2500.0, recording.fs),
            )
        ]
        rows.append(
            {
                "surface": name,
                "relative_db": 10 * np.log10(density[1] / density[0]),
                "variation": stats.variation(levels[0]),
                "variation_high": stats.variation(levels[1]),
                "correlation": stats.spearmanr(*levels).statistic,
            }
        )
    return pd.DataFrame(rows)
