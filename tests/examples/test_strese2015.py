"""Chapter of strese2015: its verdicts, and the study behind them."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
import shared
import strese2015
import strese2015_study as study
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.testing import assert_allclose

from texclass.recording import Recording
from texclass.simulate import surface_catalogue

COMMITTED = strese2015.REPORTS / "papers" / "strese2015.json"


@pytest.fixture(scope="module")
def chapter(tmp_path_factory):
    """Folder of the chapter, with fewer surfaces and without real recordings."""
    out = tmp_path_factory.mktemp("chapter")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [strese2015.KEY, "--out", str(out), "--small"])
        strese2015.main()
    return out


def verdicts(folder):
    claims = json.loads((folder / "strese2015.json").read_text(encoding="utf-8"))["claims"]
    return {claim["claim"]: claim["verdict"] for claim in claims}


def test_the_committed_verdicts_are_those_of_the_code(chapter):
    committed, computed = verdicts(COMMITTED.parent), verdicts(chapter)
    assert list(committed) == list(computed)
    differing = {text for text, verdict in committed.items() if computed[text] != verdict}
    assert differing <= {
        "Fineness hardly changes with velocity (real, `fabric_speeds`).",
        "The spectral centroid of a tap separates hard from soft plates (real, `taps5`).",
    }
    assert set(committed.values()) == set(strese2015.VERDICTS)


def test_the_chapter_contains_all_figures_and_names_skipped_recordings(chapter):
    text = (chapter / "strese2015.md").read_text(encoding="utf-8")
    pictures = sorted(path.name for path in chapter.glob("*.png"))
    assert pictures == sorted(path.name for path in COMMITTED.parent.glob("strese2015-*.png"))
    assert all(f"]({picture})" in text for picture in pictures)
    assert text.count(shared.ABSENT) == 5  # three sets, two of them also in claims
    assert f"| {strese2015.UNTESTABLE} |" in text


@pytest.mark.parametrize("name", ["fabric_speeds", "lmt_excerpts", "taps5"])
def test_the_verdict_on_real_recordings_is_that_of_the_report(name):
    recordings, _ = shared.recordings(name)
    if not recordings:
        pytest.skip(f"{name} is not available")
    if name == "fabric_speeds":
        claim = strese2015.claim_on_fabrics(study.fabric_fineness(recordings))
        assert verdicts(COMMITTED.parent)[claim["claim"]] == claim["verdict"] == "holds in part"
    elif name == "taps5":
        claim = strese2015.claim_on_plates(study.plate_taps(recordings))
        assert verdicts(COMMITTED.parent)[claim["claim"]] == claim["verdict"] == "holds in part"
    else:
        noise = study.noise_above_sensor_band(recordings)
        assert (noise["relative_db"] < -70).sum() == len(noise) - 1
        raw = noise.loc[noise["relative_db"].idxmax()]
        assert raw["variation_high"] < 0.1 * raw["variation"]
        assert abs(raw["correlation"]) < 0.2


def test_eq_3_varies_less_than_the_older_roughness_only_above_the_band_of_the_sensor():
    runs = study.controlled_runs(surface_catalogue(12, study.SEED))
    sensor, wide = (study.variance_ratios(runs, run) for run in ("force", "force, wide band"))
    assert sensor.median() < 0.5
    assert wide.median() > 2


def test_eq_3_as_printed_has_the_level_of_the_sensor_noise():
    noise = {}
    for density in (50.0, 200.0):
        sensor = study.Sensor(noise_ug_rt_hz=density)
        recording = study.record_rising_force(
            surface_catalogue(2, study.SEED)[1], study.OPERATOR, duration_s=2.5, seed=0, sensor=sensor
        )
        view = study.movement_of(recording, 0.5, 2.0).movement
        noise[density] = study.temporal_roughness_as_printed(view), study.temporal_roughness(view)
    printed, corrected = np.subtract(noise[200.0], noise[50.0])
    assert_allclose(printed, np.log10(4), atol=0.1)  # four times the noise
    assert corrected < 0.1


def test_a_spread_is_that_of_known_deviations():
    rng = np.random.default_rng(0)
    means = rng.normal(0, 3, 200)
    values = pd.DataFrame(
        {
            "surface": np.repeat(np.arange(200), 30),
            "step": np.tile(np.arange(30), 200),
            "x": np.repeat(means, 30) + rng.normal(0, 0.5, 6000),
        }
    )
    spread = study.spread(values, "x")
    assert_allclose([spread["between"], spread["within"]], [3, 0.5], rtol=0.1)
    assert abs(spread["trend"]) < 0.05
    rising = study.spread(values.assign(x=values["step"] + 0.0), "x")
    assert rising["trend"] == 1


def test_a_claim_holds_in_part_if_one_of_its_conditions_is_true():
    for conditions, verdict in (
        ((True, True), "holds"),
        ((True, False), "holds in part"),
        ((False, False), "does not hold"),
    ):
        assert strese2015.claim("Fig. 1", "text", conditions, "")["verdict"] == verdict


def test_the_band_of_d_1_follows_the_vibration_if_it_contains_some():
    rng = np.random.default_rng(0)
    level = np.repeat(np.linspace(0.1, 1, 20), 1000)
    white, noise = rng.standard_normal((2, 20_000))
    low = study.signal.sosfiltfilt(study.butterworth("bandpass", (150.0, 1000.0), 10_000.0), white)
    recordings = {
        "sensor noise": Recording(level * low + 0.01 * noise, fs=10_000),
        "vibration": Recording(level * white, fs=10_000),
    }
    result = study.noise_above_sensor_band(recordings).set_index("surface")
    assert abs(result.loc["sensor noise", "correlation"]) < 0.5
    assert result.loc["vibration", "correlation"] > 0.9
    assert result.loc["sensor noise", "variation_high"] < 0.1 < result.loc["vibration", "variation_high"]


def test_table_i_has_every_row_for_three_classifiers_and_ten_seeds():
    table = strese2015.read_table()
    accuracy = table["accuracy"]
    assert table["settings"]["n_surfaces"] == 69
    n_seeds = accuracy["seed"].nunique()
    assert n_seeds == 10
    assert len(accuracy) == n_seeds * 16 * 3
    combined = strese2015.by_seed(accuracy, strese2015.WITH_FRICTION, "lda")
    mean, low, high = strese2015.interval(combined)
    assert low < mean < high
    assert_allclose(mean, combined.mean())


def test_figures_have_complete_labels():
    surfaces = surface_catalogue(4, study.SEED)
    runs, taps = study.controlled_runs(surfaces), study.rising_taps(surfaces)
    names = [surface.name for surface in surfaces]
    for figure in (
        strese2015.figures.draw_hardness(taps, names, None, 9.2),
        strese2015.figures.draw_roughness(runs, names, 9.2),
        strese2015.figures.draw_fineness(runs, names, None, 9.2),
        strese2015.figures.draw_two_roughnesses(runs, names[0], 9.2),
    ):
        FigureCanvasAgg(figure).draw()
        for axes in figure.axes:
            assert axes.get_xlabel()
            assert axes.get_title()
            assert len(axes.lines) >= 2
