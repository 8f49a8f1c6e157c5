"""What reports state about scores and their nulls holds in the results of the studies."""

import json
from pathlib import Path

import pytest

REPORTS = Path(__file__).parents[2] / "reports"
STUDY = json.loads((REPORTS / "studies" / "score_nulls.json").read_text(encoding="utf-8"))
CHAPTER = json.loads((REPORTS / "papers" / "abdulali2016.json").read_text(encoding="utf-8"))
GFC, PERCEPTUAL = "GFC (20 to 1000 Hz)", "perceptual distance (dB)"
ROWS = {(row["set"], row["score"]): row for row in STUDY["rows"]}


@pytest.mark.parametrize("name", ["stylus6", "fabric_speeds", "biotac20"])
def test_these_sets_prove_nothing_about_spectra(name):
    rows = [row for (set_, _), row in ROWS.items() if set_ == name]
    assert len(rows) == 6
    assert not any(row["proves"] for row in rows)


def test_excerpts_prove_something_with_two_scores():
    able = [score for (name, score), row in ROWS.items() if name == "lmt_excerpts" and row["proves"]]
    assert able == [GFC, "log spectral distance (dB)"]


@pytest.mark.parametrize("name", ["simulated surfaces", "simulated HaTT models"])
def test_simulated_surfaces_are_separated_by_every_spectral_score(name):
    rows = [row for (set_, score), row in ROWS.items() if set_ == name and not score.startswith("level")]
    assert len(rows) == 5
    assert all(row["proves"] for row in rows)
    assert ROWS[name, PERCEPTUAL]["pairs"]["low"] > 0.99


def test_different_textures_of_the_stylus_have_the_gfc_of_two_halves():
    medians = ROWS["stylus6", GFC]["medians"]
    assert medians["next surface"] >= medians["other half"] > 0.99
    assert ROWS["stylus6", GFC]["pairs"]["low"] < 0.5


def test_a_third_of_the_pairs_of_different_excerpts_have_a_good_gfc():
    assert 0.25 < STUDY["share_of_good_pairs"] < 0.4


def test_the_verdicts_follow_from_the_intervals():
    for (_, score), row in ROWS.items():
        assert row["proves"] == (row["ceiling"]["low"] > 0 and not score.startswith("level"))


def test_the_perceptual_distance_is_no_better_classifier_on_excerpts_and_fabrics():
    for name in ("lmt_excerpts", "fabric_speeds", "biotac20"):
        assert ROWS[name, PERCEPTUAL]["pairs"]["auroc"] < ROWS[name, GFC]["pairs"]["auroc"]


def test_the_first_table_of_abdulali2016_states_what_nulls_reach():
    text = (REPORTS / "papers" / "abdulali2016.md").read_text(encoding="utf-8")
    first = text.partition("## What the claims prove")[2].partition("##")[0]
    real, simulated = ([row["scores"] for row in CHAPTER[key]] for key in ("real", "simulated"))
    fields = ("gfc", "deviation", "level_db", "perceptual_db")
    gfc = fields.index("gfc")
    for way in ("network", "one AR model", "white noise", "next surface", "mean of others"):
        assert all(scores[way][gfc] > 0.9 for scores in real)
    assert "| GFC above 0.9, `stylus6` | 6 of 6 | 6 of 6 | 6 of 6 | 6 of 6 | 6 of 6 |" in first
    assert all(scores[way][gfc] > 0.9 for scores in simulated for way in ("network", "one AR model"))
    assert "| GFC above 0.9, simulated | 9 of 9 | 9 of 9 |" in first
    n_noise = sum(scores["white noise"][gfc] > scores["network"][gfc] for scores in real)
    assert f"| GFC above that of the network, `stylus6` |  | 5 of 6 | {n_noise} of 6 |" in first
    missed = [row["cpu_p999_us"] for row in CHAPTER["renders"]]
    assert min(missed) > 100
    assert f"| CPU p99.9 below 100 µs | 0 of 4 ({min(missed):,.0f} to {max(missed):,.0f} µs) |" in first
    assert "This proves nothing." in first


def test_every_page_states_the_speeds_of_the_fabrics_from_their_source():
    pages = [*REPORTS.glob("*/*.md")]
    assert not [page.name for page in pages if "unknown speeds" in page.read_text(encoding="utf-8")]
    for page in ("papers/oeztuerk2018.md", "papers/strese2015.md", "studies/haptics.md"):
        assert "20, 30, 50 and 60 mm/s" in (REPORTS / page).read_text(encoding="utf-8")
