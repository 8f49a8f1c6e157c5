"""How recordings feel: places among references, and what a recording cannot tell."""

import json

import numpy as np
import pytest

import texclass as tx
from texclass.haptics import felt_document
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
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("TEXCLASS_CACHE", str(folder / "cache"))
        yield tx.open_dataset(folder / "six.toml")


def test_a_surface_lies_among_its_references_and_next_to_itself(references):
    felt = tx.haptics.describe([references[0], references[1]], references)
    assert felt["recording"].nunique() == 2
    assert felt["scale"].tolist()[:6] == ["hard", "rough", "bumpy", "sticky", "fine", "regular"]
    assert (felt["of"][felt["feature"] != "ridge_density"] == 6).all()
    assert felt["value"].notna().all()
    hard = felt[felt["scale"] == "hard"].iloc[0]
    assert references[0].surface in hard["between"]


def test_places_rise_with_what_is_measured(references):
    felt = tx.haptics.describe(list(references), references)
    for _, of_scale in felt.groupby(["scale", "feature"]):
        ordered = of_scale.sort_values("measured")
        assert ordered["below"].is_monotonic_increasing


def test_what_a_recording_cannot_tell_is_said(references):
    strokes = references[0].with_(phases=tx.Phases(movement=(20_000, 40_000)), friction=None)
    felt = tx.haptics.describe(strokes, references).set_index("scale")
    assert felt["value"][["hard", "sticky"]].isna().all()
    assert felt["why"]["sticky"] == "no friction signal"
    assert "tap" in felt["why"]["hard"]
    text = render_markdown(felt_document(felt.reset_index()))
    assert "sticky: no friction signal" in text


def test_by_what_fine_and_regular_are_told_is_said(references):
    ribbed = [r for r in references if r.surface == references[0].surface]
    felt = tx.haptics.describe(ribbed, references).set_index("scale")
    assert set(felt["feature"]["regular"]) == {"ridge_prominence"}
    assert set(felt["unit"]["regular"]) == {"dB"}
    without = tx.haptics.describe([r.with_(speed=None) for r in ribbed], references).set_index("scale")
    assert set(without["feature"]["fine"]) == {"grain_frequency"}
    assert set(without["feature"]["regular"]) == {"regularity"}
    assert (without["of"] == 6).all()
    measured = tx.extract(ribbed, "scales")
    for i, values in enumerate(measured.to_dict("records")):
        ribs = not np.isnan(values["ridge_density"])
        assert felt["feature"]["fine"].iloc[i] == ("ridge_density" if ribs else "grain_frequency")
        assert felt["of"]["fine"].iloc[i] == (3 if ribs else 6)
    assert "Fine in 1/mm: ribs" in render_markdown(felt_document(felt.reset_index()))


def test_levels_of_another_unit_have_neither_value_nor_place(references):
    counts = tx.Recording(references[0].acceleration, 10_000.0, "counts", "codes")
    felt = tx.haptics.describe(counts, references).set_index("scale")
    assert np.isnan(felt["value"]["rough"])
    assert "m/s^2" in felt["why"]["rough"]
    assert felt["between"]["rough"] == ()
    assert felt["value"].notna()["fine"]


def test_describe_on_the_command_line(command, monkeypatch, tmp_path, references):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "six.toml").write_text(REFERENCES)
    (tmp_path / "felt.txt").write_text("\n".join(map(str, references[0].acceleration[:, 2])))
    reading = ("felt.txt", "--fs", "10000", "--unit", "m/s^2")
    asked = ("describe", *reading, "--references", "six.toml", "--jobs", "1")
    code, out, _ = command(*asked)
    assert code == 0
    assert "hard (0: soft)" in out
    assert "sticky: no friction signal" in out
    code, out, _ = command(*asked, "--json", "-")
    assert code == 0
    assert {one["scale"] for one in json.loads(out)} == set(tx.haptics.SCALES)
    code, _, err = command("describe", "none.txt", "--fs", "10000", "--unit", "m/s^2")
    assert code == 1
    assert "none.txt" in err
