"""What reports state about scores and their nulls holds in the results of the studies."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from texclass.vibration.null_scores import distance_to_null

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
    assert ROWS[name, PERCEPTUAL]["pairs"]["low"] > 0.95


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


def held_out_margins(rows, key, sign):
    """Return the margins of packed surfaces of 64 bytes, held out, to the best null, per recording."""
    best = {(row["part"], row["name"]): row[key] for row in rows if row["known"] == "best null"}
    is_simulated = rows[0]["set"].startswith("simulated")
    known = {"first half", "the others", "all"} if is_simulated else {"first half", "the others"}
    margins = {}
    for row in rows:
        if row["asked"] == 64 and row["known"] in known:
            margin = sign * (row[key] - best[row["part"], row["name"]])
            margins.setdefault(row["name"], []).append(margin)
    return pd.Series({name: np.mean(values) for name, values in margins.items()})


@pytest.mark.parametrize("name", ["lmt_excerpts", "fabric_speeds", "stylus6", "simulated HaTT models"])
def test_the_report_of_packed_surfaces_states_whether_64_bytes_beat_the_nulls(name):
    study = json.loads((REPORTS / "studies" / "packed_surfaces.json").read_text(encoding="utf-8"))
    rows = [row for row in study["rows"] if row["set"] == name and not row["known"].startswith("MPEG")]
    statements = []
    for key, sign, title in (("gfc", 1, "GFC"), ("perceptual", -1, "perceptual distance")):
        margins = held_out_margins(rows, key, sign)
        none = pd.DataFrame({"best null": 0 * margins})
        distance = distance_to_null(margins, none, higher_is_better=True)
        verdict = "better than" if distance["low"] > 0 else "not better than"
        verdict = "worse than" if distance["high"] < 0 else verdict
        statements.append(f"{verdict} the best null by its {title}")
    page = (REPORTS / "studies" / "haptics.md").read_text(encoding="utf-8")
    assert f"`{name}`, 64 bytes held out: {', '.join(statements)}." in page


def test_packed_surfaces_are_next_to_nulls_and_ceiling_on_the_same_recordings():
    study = json.loads((REPORTS / "studies" / "packed_surfaces.json").read_text(encoding="utf-8"))
    nulls = {"white noise", "next surface", "mean of others", "other half"}
    frame = pd.DataFrame(study["rows"])
    frame = frame[~frame["known"].str.startswith("MPEG") & (frame["judged"] != "all of it")]
    for _, rows in frame.groupby(["set", "judged"]):
        assert nulls < set(rows["known"])


@pytest.mark.parametrize("kind", ["simulated", "fabric_speeds"])
def test_the_chapter_of_oeztuerk2018_states_that_interpolation_is_no_better_than_nulls(kind):
    chapter = json.loads((REPORTS / "papers" / "oeztuerk2018.json").read_text(encoding="utf-8"))
    for key, higher in (("gfc", True), ("perceptual_db", False)):
        rows = [
            (p["surface"], p["scores"]["LPC, log level"][key], p["scores"]["best null"][key])
            for p in chapter["predictions"][kind]["predictions"]
        ]
        means = pd.DataFrame(rows, columns=["surface", "score", "best null"]).groupby("surface").mean()
        distance = distance_to_null(means["score"], means[["best null"]], higher_is_better=higher)
        assert distance["low"] < 0 < distance["high"]
    text = (REPORTS / "papers" / "oeztuerk2018.md").read_text(encoding="utf-8")
    assert text.count("positive is better). This proves nothing.") == 2


def test_the_report_of_the_recovery_states_how_many_nulls_reach_its_limit():
    study = json.loads((REPORTS / "papers" / "abdulali2016-recovery.json").read_text(encoding="utf-8"))
    best = [row["best null"] for row in study["nulls"]]
    text = (REPORTS / "papers" / "abdulali2016-recovery.md").read_text(encoding="utf-8")
    assert f"{sum(gfc > 0.95 for gfc in best)} of {len(best)} best nulls are above 0.95, too" in text
