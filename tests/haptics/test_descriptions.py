"""Recordings are rated on perceptual scales, ranked among references, and missing values have a reason."""

import json

import numpy as np
import pytest

import texclass as tx
from texclass.haptics import description_document
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


def test_levels_in_another_unit_have_neither_value_nor_rank(references):
    counts = tx.Recording(references[0].acceleration, 10_000.0, "counts", "codes")
    description = tx.haptics.describe(counts, references).set_index("scale")
    assert np.isnan(description["value"]["rough"])
    assert "m/s^2" in description["reason"]["rough"]
    assert description["nearest"]["rough"] == ()
    assert description["value"].notna()["fine"]


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
    assert {row["scale"] for row in json.loads(out)} == set(tx.haptics.SCALES)
    code, _, err = command("describe", "none.txt", "--fs", "10000", "--unit", "m/s^2")
    assert code == 1
    assert "none.txt" in err
