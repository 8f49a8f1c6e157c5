import numpy as np
import pytest
from texclass.reporting.reproductions._guruswamy2011_text import table
from texclass.textures.guruswamy2011.comparison import random_paths
from texclass.textures.guruswamy2011.recorded import cleaned, excerpt
from texclass.textures.guruswamy2011.simulated import BIT, OBJECTS, lay_out, simulate_scan
from texclass.textures.guruswamy2011.study import BOUNDS, Recovery, published_row, recover

from texclass.textures.guruswamy2011 import published
from texclass.textures.scan import Scan


@pytest.mark.parametrize("thing", OBJECTS, ids=lambda thing: thing.name)
def test_simulated_scans_are_what_table_1_says(thing):
    truth = published.TABLE_1[thing.name]
    section = lay_out(thing, 10 * thing.speed, np.random.default_rng(0))
    scan = simulate_scan(thing, section, np.random.default_rng(1))
    assert section.position_mm.size / section.length_mm == pytest.approx(truth.segments_per_mm, rel=0.06)
    assert scan.speed.mean() == pytest.approx(truth.speed, rel=0.05)
    assert scan.force.mean() == pytest.approx(truth.force, rel=0.05)
    assert np.abs(scan.acceleration / BIT - np.round(scan.acceleration / BIT)).max() < 1e-9
    clean = simulate_scan(thing, section, np.random.default_rng(1), repeatability=0.0, quantised=False)
    level = thing.law.rms(clean.speed, clean.force)
    assert np.mean(clean.acceleration**2) == pytest.approx(np.mean(level**2), rel=1e-9)


@pytest.mark.parametrize("thing", OBJECTS, ids=lambda thing: thing.name)
def test_truth_is_recovered_within_the_bounds_of_the_study(thing):
    errors = np.median([np.abs(recover(thing, seed)) for seed in (71, 72, 73)], axis=0)
    assert np.all(errors <= list(BOUNDS.values()))


def test_a_recovery_counts_what_lies_within():
    errors = np.tile(np.array([[0.0], [1.9], [0.06], [-0.04]]), 4)
    summary = Recovery("x", errors).summary()
    assert [summary[name][2] for name in BOUNDS] == [4, 4, 0, 4]
    assert summary["a_0"][:2] == pytest.approx((0.04, 0.04))


def test_a_row_measures_the_scan_as_published(rubber_fit):
    row = published_row(rubber_fit.scan, rubber_fit.texture.scaling.law).row
    assert row.sad_bandpass < 153
    assert row.order > 5
    assert row.segments_per_mm == pytest.approx(0.316, rel=0.1)


def test_random_paths_stay_bounded(rubber_fit):
    result = random_paths([rubber_fit.texture], np.random.default_rng(0), n_paths=20)
    assert result.finite
    assert 0 < result.largest <= 8


def test_device_lines_are_left_out():
    t = np.arange(4000) / 1000
    a = np.sin(2 * np.pi * 40 * t) + np.sin(2 * np.pi * 200 * t) + np.sin(2 * np.pi * 400 * t)
    scan = cleaned(Scan.along_line(a, 100.0, 1.0, 1000.0))
    assert np.abs(scan.acceleration - np.sin(2 * np.pi * 40 * t))[1500:-1500].max() < 0.05


def test_an_excerpt_in_any_unit_gives_the_same_filters():
    rng = np.random.default_rng(2)
    a = np.convolve(
        rng.standard_normal(2000), np.exp(-np.arange(60) / 12) * np.sin(np.arange(60)), mode="same"
    )
    one, other = excerpt(a, 10_000.0, "x"), excerpt(1024 * a, 10_000.0, "x")
    assert one.segments_per_s == other.segments_per_s
    assert one.sad_bandpass == pytest.approx(other.sad_bandpass, rel=1e-9)


def test_tables_round_to_what_is_worth_reading():
    assert table(("a", "b"), [["x", 0.31649], [3, 1234.6]]).splitlines()[2:] == [
        "| x | 0.316 |",
        "| 3 | 1235 |",
    ]
