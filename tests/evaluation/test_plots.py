"""Plots draw the numbers of a result on the given axes, with labels, and return these axes."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from texclass.evaluation import (
    BenchmarkResult,
    FeatureTable,
    plot_confusion_matrix,
    plot_features,
    plot_phases,
    plot_reliability,
)
from texclass.recording import Phases, Recording, Tap
from texclass.tradeoff.study import Tradeoff

DATA = Path(__file__).parents[1] / "reporting" / "data"


def result(kind):
    return json.loads((DATA / f"{kind}.json").read_text(encoding="utf-8"))


@pytest.fixture
def ax():
    return Figure(layout="constrained").add_subplot()


@pytest.fixture
def table():
    frame = pd.DataFrame(
        {
            "recording_id": list("abcd"),
            "surface": ["oak", "cork", "oak", "oak"],
            "rms": [1.0, 4.0, 3.0, np.nan],
        }
    )
    return FeatureTable(frame, ("rms",), np.zeros(4))


def test_phases_are_drawn_at_their_times(ax):
    recording = Recording(np.sin(np.arange(2000.0)), fs=1000.0, unit="m/s^2")
    phases = Phases(taps=(Tap(100, 120, 180),), movement=(500, 1500))
    assert plot_phases(recording, phases, ax) is ax
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time (s)", "acceleration (m/s²)")
    np.testing.assert_allclose(ax.lines[0].get_xdata()[:3], [0, 0.001, 0.002])
    edges = {(round(p.get_x(), 3), round(p.get_x() + p.get_width(), 3)) for p in ax.patches}
    assert edges == {(0.5, 1.5), (0.1, 0.12), (0.12, 0.18)}


def test_values_of_a_feature_are_drawn_per_surface_with_the_median(ax, table):
    assert plot_features(table, "rms", ax) is ax
    assert table.plot("rms", Figure().add_subplot()).get_xlabel() == "rms"
    assert [label.get_text() for label in ax.get_yticklabels()] == ["cork", "oak"]
    points = [line.get_xydata().tolist() for line in ax.lines]
    assert points == [[[4.0, 0.0]], [[4.0, 0.0]], [[1.0, 1.0], [3.0, 1.0]], [[2.0, 1.0]]]
    with pytest.raises(ValueError, match=r"unknown column 'mfcc'\. Expected a feature column .* rms"):
        plot_features(table, "mfcc", ax)


def test_a_confusion_matrix_has_true_labels_in_rows_and_predicted_labels_in_columns(ax):
    data = result("benchmark")
    assert BenchmarkResult(data).plot_confusion_matrix(ax) is ax
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Predicted label", "True label")
    counts = np.zeros((3, 3), dtype=int)
    for text in ax.texts:
        column, row = map(int, text.get_position())
        counts[row, column] = int(text.get_text())
    assert counts.tolist() == data["confusion"]["counts"]
    assert plot_confusion_matrix(data["confusion"], Figure().add_subplot()).get_ylabel() == "True label"
    with pytest.raises(ValueError, match="no row could be evaluated"):
        BenchmarkResult(data | {"confusion": None}).plot_confusion_matrix()


def test_a_benchmark_is_drawn_with_the_intervals_of_its_rows(ax):
    data = result("benchmark")
    assert BenchmarkResult(data).plot("lda", ax) is ax
    assert ax.get_xlabel() == "accuracy, %"
    rows = [row["accuracy"]["lda"] for row in data["rows"] if "lda" in row["accuracy"]]
    intervals = [list(line.get_xdata()) for line in ax.lines if len(line.get_xdata()) == 2]
    for accuracy in rows:
        assert pytest.approx([100 * accuracy["low"], 100 * accuracy["high"]]) in intervals
    means = [line.get_xdata()[0] for line in ax.lines if line.get_marker() == "o"]
    assert means == pytest.approx([100 * accuracy["mean"] for accuracy in rows])


def test_a_trade_off_is_drawn_as_its_pareto_front(ax):
    data = result("tradeoff")
    assert Tradeoff(data).plot(ax) is ax
    assert "latency" in ax.get_xlabel()
    assert ax.get_ylabel() == "accuracy, %"
    front = [[point["budget_ms"], 100 * point["accuracy"]["mean"]] for point in data["front"]]
    assert any(
        np.allclose(line.get_xydata(), front) for line in ax.lines if len(line.get_xdata()) == len(front)
    )


def test_a_reliability_diagram_shows_the_share_of_hits_in_each_bin(ax):
    confidence, hits = [0.31, 0.39, 0.95, 0.91, 1.0], [1, 0, 1, 1, 0]
    assert plot_reliability(confidence, hits, ax=ax) is ax
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Mean confidence", "Share of correct predictions")
    np.testing.assert_allclose(ax.lines[1].get_xydata(), [[0.35, 0.5], [2.86 / 3, 2 / 3]])
    with pytest.raises(ValueError, match=r"same length .* got shapes \(1,\) and \(0,\)"):
        plot_reliability([0.5], [])


def test_without_axes_a_new_figure_is_made(table):
    ax = table.plot("rms")
    assert ax.figure.get_figwidth() == 8.0
    plt.close(ax.figure)
