"""The comparison with peers in words and pictures."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.paired import Paired
from texclass.peers import Contestant, Cost, PeerComparison
from texclass.reporting.peers import (
    HEADER,
    draw_peers,
    peer_cells,
    peer_markdown,
    peer_table,
    verdict,
    write_peer_report,
)

OURS = Contestant(
    "All", "lda", "All", True, "done", n_columns=40, n_folds=2, accuracy=Accuracy(95, 100, (0.94, 0.96)),
    cost=Cost(4.0, 0.01, 0.1, 0.4, 2.0, 0.02),
)  # fmt: skip
PEER = Contestant(
    "minirocket", "ridge", "MiniRocket", False, "done", reference="10,000 kernels", n_columns=9996, n_folds=2,
    accuracy=Accuracy(90, 100, (0.9, 0.9), balanced=0.875), cost=Cost(10.0, 1.5, 0.3, 4.0, 200.0, 18.0),
    difference=Paired(0.05, (0.01, 0.09), 0.012, "exact McNemar test", ((0.04, 0.06),), 8, 3),
)  # fmt: skip
LATE = replace(
    PEER, name="quant", title="QUANT", status="out of time", message="stopped after 9 s", n_folds=1
)
ABSENT = Contestant("tsfel", "", "TSFEL, all", False, "not installed", message="needs tsfel")


@pytest.fixture
def comparison():
    return PeerComparison(
        dataset={"name": "toy", "n_recordings": 100, "n_materials": 5, "notes": ["toy data"]},
        pipeline="texclass",
        pipeline_hash="abc",
        protocol="recording",
        protocol_description="stratified folds",
        n_folds=2,
        contestants=(OURS, PEER, LATE, ABSENT),
        signals="the very signals that our movement features read",
        time_limit_s=9.0,
        versions={"numpy": "2"},
        peer_versions={"aeon": "1.6"},
        seed=1,
        input_hash="def",
        notes=("chosen on these folds",),
    )


def test_cells_say_how_far_ours_is_ahead():
    found = dict(zip(HEADER, peer_cells(PEER), strict=True))
    assert found["Ours ahead by [95 %]"] == "+5.0 [+1.0, +9.0]"
    assert (found["Balanced %"], found["p"], found["Features ms"]) == ("87.5", "0.012", "10")
    assert dict(zip(HEADER, peer_cells(OURS), strict=True))["Ours ahead by [95 %]"] == "reference"
    assert "not installed: needs tsfel" in peer_cells(ABSENT)


def test_verdict_compares_with_the_best_peer_that_finished(comparison):
    assert "MiniRocket, Ridge; ours minus it: +5.0 points [+1.0, +9.0] (ahead)" in verdict(comparison)
    assert "0.1 times its total time and 0.4 times" in verdict(comparison)
    assert verdict(replace(comparison, contestants=(OURS, LATE, ABSENT))) == "No peer finished every fold."


def test_markdown_has_every_line_setting_and_version(comparison):
    text = peer_markdown(comparison)
    for told in (
        "ours: All",
        "QUANT",
        "1 of 2 folds",
        "needs tsfel",
        "10,000 kernels",
        "aeon 1.6",
        "toy data",
    ):
        assert told in text
    assert "Chosen on these folds." in text


def test_terminal_table_fits_and_names_everyone(comparison):
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(peer_table(comparison))
    text = console.export_text()
    assert all(name in text for name in ("ours: All", "MiniRocket", "QUANT", "TSFEL"))


def test_figure_shows_the_best_of_each_tool_that_ran(comparison):
    figure = draw_peers(comparison)
    listed = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert [line.split(",")[0] for line in listed] == ["1  ours: All", "2  MiniRocket", "3  QUANT"]
    assert {text.get_text() for text in figure.axes[0].texts} == {"1", "2", "3"}


def test_report_is_json_markdown_and_figure(comparison, tmp_path):
    paths = write_peer_report(comparison, tmp_path / "here")
    assert [path.name for path in paths] == [
        f"toy-texclass-recording-peers{ending}" for ending in (".json", ".md", ".png")
    ]
    assert all(path.stat().st_size > 500 for path in paths)
