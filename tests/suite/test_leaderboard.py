"""Leaderboard: summary, reports, pages, command."""

import itertools
import json
import re
from pathlib import Path

import pandas as pd
import pytest
from chromium import needs_chromium

import texclass as tx
from texclass.leaderboard import Leaderboard, load_leaderboard, summarize
from texclass.leaderboard.leaderboard import render_leaderboard
from texclass.reporting import render_markdown
from texclass.reporting.result_files import read_result

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def result(table):
    return Leaderboard.from_table(table)


def test_summary_is_json_and_can_be_read_again(result, tmp_path):
    written = result.save(tmp_path)
    names = {path.name for path in written}
    assert {"leaderboard.json", "leaderboard.md", "leaderboard.html"} <= names
    again = read_result(tmp_path / "leaderboard.json")
    assert isinstance(again, Leaderboard)
    assert again.data == {
        key: value for key, value in result.to_dict().items() if key not in ("kind", "version")
    }


def test_report_begins_with_losses_and_names_leakage_failures_and_licences(result):
    text = render_markdown(result.document())
    headings = [line[3:] for line in text.splitlines() if line.startswith("## ")]
    assert headings[0] == "Where the default of texclass is not the best"
    assert headings[1:4] == ["By question", "Mean rank over datasets", "Published and honest splits"]
    assert "CC0-1.0" in text
    assert "chance level 33.3 %" in text


def test_losses_are_shown_with_the_best_method(table):
    # The default is the coarse pipeline here, made worse by force.
    worse = table.copy()
    is_default = worse["method"] == "coarse"
    worse.loc[is_default, "method"] = "surfaces"
    worse.loc[is_default, "unit_hits"] = worse.loc[is_default, "unit_hits"].str.replace(
        r":\d+/", ":0/", regex=True
    )
    text = render_markdown(Leaderboard.from_table(worse).document())
    lost = text.split("## By question")[0]
    assert lost.count("| noises |") == 3
    assert "Band energies, random forest" in lost
    assert "0 of 3" in lost


def test_simulated_recordings_have_their_own_report(table, tmp_path):
    both = pd.concat([table, table.assign(is_simulated=True, dataset="made_up")], ignore_index=True)
    result = Leaderboard.from_table(both)
    result.save(tmp_path)
    real, simulated = (
        (tmp_path / f"leaderboard{end}.md").read_text(encoding="utf-8") for end in ("", "-simulated")
    )
    assert "made_up" not in real
    assert "noises" not in simulated
    assert "made_up" not in (tmp_path / "leaderboard.html").read_text(encoding="utf-8")


def test_rows_of_several_versions_have_several_hashes(table):
    mixed = table.copy()
    mixed.loc[0, "code_hash"] = "another"
    assert ", " in Leaderboard.from_table(mixed).data["code_hash"]


def test_a_message_of_a_failure_is_escaped(table):
    failed = table.assign(message="<script>alert(1)</script>", status="failed")
    page = render_leaderboard(Leaderboard.from_table(failed).data, is_simulated=False)
    assert "<script>alert" not in page


def test_published_table_is_loaded_and_agrees_with_its_summary():
    table = tx.load_leaderboard()
    pd.testing.assert_frame_equal(table, load_leaderboard())
    folder = tx.leaderboard.leaderboard.shipped.leaderboard_folder()
    data = read_result(folder / "leaderboard.json").data
    assert Leaderboard.from_table(table).data["rows"] == data["rows"]
    assert Leaderboard.from_table(table).data["table_hash"] == data["table_hash"]
    assert len(summarize(table)) == len(data["rows"])


def test_page_states_the_size_and_the_gaps_of_the_published_table():
    table = tx.load_leaderboard()
    is_simulated = table.groupby("dataset")["is_simulated"].first()
    counts = (table["method"].nunique(), (~is_simulated).sum(), is_simulated.sum())
    text = " ".join((ROOT / "docs" / "leaderboard.md").read_text(encoding="utf-8").split())
    assert "contains {} methods on {} real datasets and {} simulated one.".format(*counts) in text
    everywhere = set(is_simulated.index)
    gaps = {method: everywhere - set(names) for method, names in table.groupby("method")["dataset"]}
    assert {method: names for method, names in gaps.items() if names} == {
        "minirocket": {"dogsurf", "floors10"},
        "multirocket_hydra": everywhere - {"fabric_speeds", "taps5"},
    }
    assert (
        "MiniRocket is missing on `dogsurf` and `floors10`, and MultiRocket-Hydra is evaluated only on "
        "`fabric_speeds` and `taps5`."
    ) in text


def test_command_writes_table_report_and_pages(command, card, tmp_path):
    out = tmp_path / "out"
    code, shown, errors = command(
        "suite", "--datasets", card, "--methods", "coarse", "--jobs", "1", "-o", out, "--json", "-"
    )
    assert code == 0, errors
    assert json.loads(shown)["kind"] == "leaderboard"
    assert "Every protocol" in errors
    table = load_leaderboard(out / "leaderboard.csv")
    assert set(table["method"]) == {"coarse"}
    code, shown, errors = command("suite", out / "leaderboard.csv", "--no-run", "-o", tmp_path / "joined")
    assert code == 0, errors
    assert (tmp_path / "joined" / "leaderboard.csv").read_bytes() == (out / "leaderboard.csv").read_bytes()
    code, _, errors = command("report", out / "leaderboard.json", "-o", tmp_path / "page.html")
    assert code == 0, errors


def test_command_lists_datasets_and_methods(command):
    code, shown, _ = command("suite", "--list")
    assert code == 0
    assert "dataset: simulated6" in shown
    assert "method: surfaces: texclass (default)" in shown
    assert "not evaluated: simulated69: takes hours" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--methods", "nothing"), "unknown method 'nothing'"),
        (("--datasets", "nothing", "--methods", "coarse"), "shipped datasets"),
        (("--no-run",), "needs the tables to join"),
        (("-o", "table.csv"), "Expected a folder"),
    ],
)
def test_command_refuses_what_it_cannot_do(command, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, errors = command("suite", *arguments)
    assert code != 0
    assert message in errors


def test_page_lists_the_best_method_of_each_protocol_first_and_failures_last(table):
    data = Leaderboard.from_table(table).data
    page = render_leaderboard(data | {"rows": data["rows"][::-1]}, is_simulated=False)
    shown = re.findall(r'data-question="(.+?)" data-method="(.+?)"', page)
    accuracy = {(row["question"], row["method"]): row["accuracy"] or 0 for row in data["rows"]}
    assert sorted(shown) == sorted(accuracy)
    assert 0 in accuracy.values()  # a method that failed
    for _, rows in itertools.groupby(shown, key=lambda row: row[0]):
        accuracies = [accuracy[row] for row in rows]
        assert len(accuracies) == len(accuracy) // 3
        assert accuracies == sorted(accuracies, reverse=True)


@needs_chromium
@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (1200, "dark"), (390, "light")])
def test_page_sorts_and_filters_in_a_browser(browser, table, tmp_path, width, scheme):
    page = tmp_path / "leaderboard.html"
    page.write_text(render_leaderboard(Leaderboard.from_table(table).data, is_simulated=False))
    browser.events.clear()
    browser.open(page, width=width, scheme=scheme)
    shown = "[...document.querySelectorAll('.board tbody tr')].filter(row => !row.hidden)"
    accuracy = "row => row.querySelector('.failed') ? null : Number(row.cells[4].textContent)"
    n = browser.run(f"{shown}.length")
    assert n == len(summarize(table))
    browser.run("document.querySelector('button[data-kind=number]').click()")
    accuracies = browser.run(f"{shown}.map({accuracy})")
    numbers = [value for value in accuracies if value is not None]
    assert numbers == sorted(numbers, reverse=True)
    assert None not in accuracies[: len(numbers)]  # failures last
    browser.run("document.querySelector('button[data-kind=number]').click()")
    again = browser.run(f"{shown}.map({accuracy})")
    assert [value for value in again if value is not None] == sorted(numbers)
    browser.run(
        "const s = document.getElementById('question'); s.value = 'later';"
        "s.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    assert browser.run(f"{shown}.every(row => row.dataset.question === 'later')")
    assert browser.run("document.getElementById('count').textContent") == f"{n // 3} rows"
    # The table may scroll, the page does not.
    assert browser.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert browser.noises(page) == []
