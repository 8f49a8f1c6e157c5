"""Recordings are rated on perceptual scales, ranked among references, and missing values have a reason."""

import json

import numpy as np
import pytest

import texclass as tx
from texclass.haptics import description_document, descriptions
from texclass.haptics.descriptions import reference_features
from texclass.reporting import render_markdown

REFERENCES = """
title = "Six simulated surfaces"
format = "simulated"
[recipe]
n_surfaces = 6
n_recordings = 2
n_operators = 2
duration_s = 4.0
fs = 10000
seed = 12
"""


@pytest.fixture(scope="module")
def references(tmp_path_factory):
    folder = tmp_path_factory.mktemp("references")
    (folder / "six.toml").write_text(REFERENCES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXCLASS_CACHE", str(folder / "cache"))
        yield tx.open_dataset(folder / "six.toml")


def test_a_surface_is_ranked_among_the_references_and_next_to_itself(references):
    description = tx.haptics.describe([references[0], references[1]], references)
    assert description["recording"].nunique() == 2
    assert description["scale"].tolist()[:6] == ["hard", "rough", "bumpy", "sticky", "fine", "regular"]
    is_on_all = description["feature"] != "ridge_density"
    assert (description["n_references"][is_on_all] == 6).all()
    assert description["value"].notna().all()
    hard = description[description["scale"] == "hard"].iloc[0]
    assert references[0].surface in hard["nearest"]


def test_ranks_rise_with_the_feature_value(references):
    description = tx.haptics.describe(list(references), references)
    for _, rows in description.groupby(["scale", "feature"]):
        assert rows.sort_values("feature_value")["n_below"].is_monotonic_increasing


def test_missing_values_have_a_reason(references):
    strokes = references[0].with_(phases=tx.Phases(movement=(20_000, 40_000)), friction=None)
    description = tx.haptics.describe(strokes, references).set_index("scale")
    assert description["value"][["hard", "sticky"]].isna().all()
    assert description["reason"]["sticky"] == "no friction signal"
    assert "tap" in description["reason"]["hard"]
    text = render_markdown(description_document(description.reset_index()))
    assert "sticky: no friction signal" in text


def test_fine_and_regular_report_whether_they_use_ridges(references):
    with_ridges = [r for r in references if r.surface == references[0].surface]
    description = tx.haptics.describe(with_ridges, references).set_index("scale")
    assert set(description["feature"]["regular"]) == {"ridge_prominence"}
    assert set(description["unit"]["regular"]) == {"dB"}
    unknown_speed = [r.with_(speed=None) for r in with_ridges]
    without_speed = tx.haptics.describe(unknown_speed, references).set_index("scale")
    assert set(without_speed["feature"]["fine"]) == {"grain_frequency"}
    assert set(without_speed["feature"]["regular"]) == {"regularity"}
    assert (without_speed["n_references"] == 6).all()
    features = tx.extract(with_ridges, "scales")
    for i, values in enumerate(features.to_dict("records")):
        has_ridges = not np.isnan(values["ridge_density"])
        feature = "ridge_density" if has_ridges else "grain_frequency"
        assert description["feature"]["fine"].iloc[i] == feature
        assert description["n_references"]["fine"].iloc[i] == (3 if has_ridges else 6)
    assert "Fine in 1/mm: ridges" in render_markdown(description_document(description.reset_index()))


def test_levels_in_another_unit_have_no_value(references):
    counts = tx.Recording(references[0].acceleration, 10_000.0, "counts", "codes")
    description = tx.haptics.describe(counts, references).set_index("scale")
    assert np.isnan(description["value"]["rough"])
    assert "m/s^2, got counts" in description["reason"]["rough"]
    assert description["nearest"]["rough"] == ()
    assert description["value"].notna()["fine"]


def movement(x, name="signal", fs=10_000.0):
    return tx.Recording(x, fs, "m/s^2", name, phases=tx.Phases(movement=(0, len(x))))


N = 30_000
NOISE = np.random.default_rng(7).standard_normal(N)
SIGNALS = {
    **{
        f"tone of {hz} Hz, {level}": level * np.sin(2 * np.pi * hz * np.arange(N) / 10_000)
        for hz in (5, 20, 60, 200, 1500, 4990)
        for level in (1e-3, 1.0, 300.0)
    },
    "silence": np.zeros(N),
    "white noise": NOISE,
    "weak noise": 1e-30 * NOISE,
    "strong noise": 1e20 * NOISE,
    "brown noise": np.cumsum(NOISE),
    "clipped": np.clip(NOISE, -0.2, 0.2),
    "two levels": np.sign(NOISE),
    "three levels": np.rint(0.7 * NOISE).clip(-1, 1),
    "8 bits": np.rint(20 * NOISE).clip(-128, 127) / 128,
    "pulses": (np.arange(N) % 1000 == 0) + 0.01 * NOISE,
    "gravity": 9.81 + NOISE,
}


@pytest.mark.parametrize("name", SIGNALS)
def test_values_stay_on_the_scale_and_the_excess_is_stated(name):
    description = tx.haptics.describe(movement(SIGNALS[name]))
    values = description["value"].dropna()
    assert values.between(0, 10).all()
    at_ends = description["excess"].fillna(0.0) != 0
    assert (description["value"][at_ends] == np.where(description["excess"][at_ends] > 0, 10, 0)).all()
    assert (description["value"].isna() == (description["reason"] != "")).all()
    text = render_markdown(description_document(description))
    assert text.count("outside the reference surfaces") == at_ends.sum()


def test_a_pure_tone_is_regular_beyond_the_references_and_the_distance_is_stated():
    loud = tx.haptics.describe(movement(SIGNALS["tone of 200 Hz, 300.0"]))
    rows = loud.set_index("scale")
    highest = tx.haptics.reference_surfaces().max()
    assert (rows["value"]["regular"], rows["value"]["rough"]) == (10.0, 10.0)
    assert rows["excess"]["regular"] == pytest.approx(1.0 - highest["regularity"], abs=0.01)
    excess_db = 20 * np.log10(300.0 / np.sqrt(2)) - 20 * highest["vibration_level.rms"]
    assert rows["excess"]["rough"] == pytest.approx(excess_db, abs=0.1)
    assert rows["excess_unit"]["rough"] == "dB"
    text = render_markdown(description_document(loud))
    assert f"rough: outside the reference surfaces, {excess_db:.1f} dB above the highest (sandpaper" in text
    assert json.loads(loud.to_json(orient="records"))[1]["excess"] == pytest.approx(excess_db, abs=0.1)


@pytest.mark.parametrize("name", ["two levels", "three levels"])
def test_a_signal_with_too_few_levels_has_no_values_and_a_reason(name):
    description = tx.haptics.describe(movement(SIGNALS[name]))
    assert description["value"].isna().all()
    assert description["feature_value"].isna().all()
    assert description["reason"].str.startswith("few levels").all()
    text = render_markdown(description_document(description))
    assert "No values." in text
    assert "Record with a higher gain or more bits per sample" in text


def test_the_resolution_of_the_movement_decides_not_that_of_the_taps(references):
    recording = references[0]
    start, stop = tx.find_phases(recording).movement
    coarse = recording.acceleration.copy()
    step = 4 * coarse[start:stop].std(axis=0).max()
    coarse[start:stop] = step * np.rint(coarse[start:stop] / step)
    reasons = tx.haptics.describe(
        recording.with_(acceleration=coarse, phases=tx.find_phases(recording)), references
    )["reason"]
    assert reasons.str.startswith("few levels").all()
    assert (tx.haptics.describe(recording, references)["value"].notna()).all()


def test_references_without_ridges_rank_the_features_over_time(references, monkeypatch):
    table = reference_features(references).assign(ridge_density=np.nan, ridge_prominence=np.nan)
    monkeypatch.setattr(descriptions, "reference_features", lambda *arguments: table)
    description = tx.haptics.describe(references[0], references).set_index("scale")
    assert description["feature"]["regular"] == "regularity"
    assert description["n_references"]["regular"] == 6
    monkeypatch.setattr(descriptions, "reference_features", lambda *arguments: table.assign(friction=0.4))
    description = tx.haptics.describe(references[0], references).set_index("scale")
    assert np.isnan(description["value"]["sticky"])
    assert "fewer than two different reference surfaces" in description["reason"]["sticky"]


@pytest.mark.filterwarnings("ignore:.*excluded 1 sample of speed")  # a glitch of stylus6
@pytest.mark.parametrize("name", ["floors10", "fabric_speeds", "stylus6"])
def test_values_of_real_recordings_stay_on_the_scale(name, data_root):
    dataset = tx.open_dataset(name)
    description = tx.haptics.describe(
        [dataset[i] for i in range(0, len(dataset), max(1, len(dataset) // 10))]
    )
    assert description["value"].dropna().between(0, 10).all()
    assert description["value"].notna().any()


def test_describe_on_the_command_line(command, monkeypatch, tmp_path, references):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "six.toml").write_text(REFERENCES)
    (tmp_path / "recording.txt").write_text("\n".join(map(str, references[0].acceleration[:, 2])))
    recording = ("recording.txt", "--fs", "10000", "--unit", "m/s^2")
    arguments = ("describe", *recording, "--references", "six.toml", "--jobs", "1")
    code, out, _ = command(*arguments)
    assert code == 0
    assert "hard (0: soft)" in out
    assert "sticky: no friction signal" in out
    code, out, _ = command(*arguments, "--json", "-")
    assert code == 0
    assert {row["scale"] for row in json.loads(out)["descriptions"]} == set(tx.haptics.SCALES)
    code, _, err = command("describe", "none.txt", "--fs", "10000", "--unit", "m/s^2")
    assert code == 1
    assert "none.txt" in err


def test_a_vibration_that_never_rests_is_rated_as_a_movement_and_not_as_a_tap():
    fs, rng = 10_000.0, np.random.default_rng(2)
    decay = np.concatenate([np.zeros(1500), 0.3 + 4 * np.exp(-np.arange(8500) / 3000)])
    x = rng.standard_normal(10_000) * (0.02 + decay)
    stroke = tx.Recording(x, fs, "m/s^2")
    assert tx.find_phases(stroke).kind == "taps only"
    values = tx.haptics.describe(stroke).set_index("scale")["value"]
    assert np.isnan(values["hard"])
    assert values[["rough", "bumpy", "fine", "regular"]].notna().all()
    tap = tx.Recording(x * (0.001 + np.exp(-np.arange(10_000) / 400)), fs, "m/s^2")
    values = tx.haptics.describe(tap).set_index("scale")["value"]
    assert values["hard"] >= 0
    assert values[["rough", "bumpy"]].isna().all()


def test_no_excerpt_of_a_movement_is_rated_as_a_tap(data_root):
    excerpts = sorted((data_root / "lmt_excerpts").glob("*.wav"))
    description = tx.haptics.describe(excerpts, unit="m/s^2")
    by_scale = description.groupby("scale")["value"]
    assert by_scale.count().to_dict()["rough"] == len(excerpts)
    assert by_scale.count().to_dict()["hard"] == 0
