"""Chapter of guruswamy2011 on spatial filters, its simulated objects and its measurements."""

import json

import guruswamy2011
import numpy as np
import pytest
from guruswamy2011_figures import draw_speeds
from guruswamy2011_measures import (
    BOUNDS,
    clean,
    excerpt,
    fit_published,
    fits_by_order,
    published_row,
    random_paths,
    recover,
    within_bounds,
)
from guruswamy2011_objects import BIT, OBJECTS, ROW, TABLE_1, TABLE_2, TABLE_3, lay_out, simulate_scan

from texclass.haptics.textures.guruswamy2011 import fit_texture
from texclass.haptics.textures.scan import Scan
from texclass.vibration import DecayingModes

FS = 500.0
RING = DecayingModes(*np.array([[30.0, 80.0], [25.0, 60.0], [3.0, 2.0], [-1.5, 0.3]]))


@pytest.fixture(scope="module")
def rubber_fit():
    rng, rubber = np.random.default_rng(3), OBJECTS[2]
    return fit_texture(simulate_scan(rubber, lay_out(rubber, 80.0, rng), rng), rubber.law)


def test_the_chapter_has_every_table_and_figure_and_reports_what_is_simulated(tmp_path):
    paths = guruswamy2011.main(tmp_path, small=True)
    assert all(path.stat().st_size > 0 for path in paths)
    assert sum(path.suffix == ".png" for path in paths) == 8
    text = (tmp_path / "guruswamy2011.md").read_text(encoding="utf-8")
    for part in (
        "What is simulated",
        "Table I:",
        "Table II:",
        "Table III:",
        "k_v 1/s",
        "not on this machine",
    ):
        assert part in text
    for row in (row for rows in TABLE_3.values() for row in rows):
        assert " | ".join(f"{value:.3g}" for value in row[:3]) in text
    for (mean, sigma), _ in TABLE_2.values():
        assert f"{mean:.3g} ({sigma:.3g})" in text
    numbers = json.loads((tmp_path / "guruswamy2011.json").read_text(encoding="utf-8"))
    assert set(numbers["scans"]) == set(TABLE_1)
    assert numbers["paths"]["finite"]


def test_scan_and_texture_are_each_drawn_around_a_labelled_zero(rubber_fit):
    scan = rubber_fit.scan
    axes = draw_speeds(9.2, scan.name, [{"scan": scan, "rendered": np.zeros(len(scan))}]).axes[0]
    labels = [label.get_text() for label in axes.get_yticklabels()]
    zeros = [y for y, label in zip(axes.get_yticks(), labels, strict=True) if label == "0"]
    above, below = (np.median(line.get_ydata()) for line in axes.lines)
    assert [below, above] == pytest.approx(zeros, abs=1.0)


def test_simulated_scans_have_the_values_of_table_1():
    for thing in OBJECTS:
        truth = dict(zip(ROW, TABLE_1[thing.name], strict=True))
        section = lay_out(thing, 10 * thing.speed, np.random.default_rng(0))
        scan = simulate_scan(thing, section, np.random.default_rng(1))
        per_mm = section.position_mm.size / section.length_mm
        assert per_mm == pytest.approx(truth["segments_per_mm"], rel=0.06)
        assert scan.speed.mean() == pytest.approx(truth["speed"], rel=0.05)
        assert scan.force.mean() == pytest.approx(truth["force"], rel=0.05)
        assert np.abs(scan.acceleration / BIT - np.round(scan.acceleration / BIT)).max() < 1e-9
        clean = simulate_scan(thing, section, np.random.default_rng(1), repeatability=0.0, quantised=False)
        level = thing.law.rms(clean.speed, clean.force)
        assert np.mean(clean.acceleration**2) == pytest.approx(np.mean(level**2), rel=1e-9)


def test_the_ground_truth_is_recovered_within_the_bounds_of_the_study():
    for thing in OBJECTS:
        errors = np.median([np.abs(recover(thing, seed)) for seed in (71, 72, 73)], axis=0)
        assert np.all(errors <= list(BOUNDS.values())), thing.name


def test_a_recovery_counts_the_trials_within_the_bounds():
    errors = np.tile(np.array([[0.0], [1.9], [0.06], [-0.04]]), 4)
    summary = within_bounds(errors)
    assert [summary[name][2] for name in BOUNDS] == [4, 4, 0, 4]
    assert summary["a_0"][:2] == pytest.approx((0.04, 0.04))


def test_a_row_measures_the_scan_as_published_and_random_paths_stay_bounded(rubber_fit):
    row = published_row(rubber_fit.scan, rubber_fit.texture.scaling.law)["row"]
    assert row["sad_bandpass"] < 153
    assert row["order"] > 5
    assert row["segments_per_mm"] == pytest.approx(0.316, rel=0.1)
    result = random_paths([rubber_fit.texture], np.random.default_rng(0), n_paths=20)
    assert result["finite"]
    assert 0 < result["largest"] <= 8


def test_device_lines_are_removed():
    t = np.arange(4000) / 1000
    a = np.sin(2 * np.pi * 40 * t) + np.sin(2 * np.pi * 200 * t) + np.sin(2 * np.pi * 400 * t)
    scan = clean(Scan.along_line(a, 100.0, 1.0, 1000.0))
    assert np.abs(scan.acceleration - np.sin(2 * np.pi * 40 * t))[1500:-1500].max() < 0.05


def test_an_excerpt_in_any_unit_gives_the_same_filters():
    noise, ring = (
        np.random.default_rng(2).standard_normal(2000),
        np.exp(-np.arange(60) / 12) * np.sin(np.arange(60)),
    )
    a = np.convolve(noise, ring, mode="same")
    one, other = excerpt(a, 10_000.0, "x"), excerpt(1024 * a, 10_000.0, "x")
    assert one["segments_per_s"] == other["segments_per_s"]
    assert one["sad_bandpass"] == pytest.approx(other["sad_bandpass"], rel=1e-9)


def test_published_filters_reach_the_resolution_and_two_modes_need_more_than_a_sinusoid():
    segments = [RING.synthesize(n, FS) for n in (40, 3, 1, 90)]
    filters = fit_published(segments, 0.153)
    assert all(f.error < 0.153 for f in filters)
    fits = {(fit["method"], fit["order"]): fit for fit in fits_by_order(RING.synthesize(90, FS), FS, 0.05)}
    assert fits["decaying sinusoid", 2]["error"] > 0.1
    assert fits["stable modes", 4]["error"] < 0.05
    assert fits["stable modes", 4]["pole_radius"] < 1
    assert fits["Prony", 106]["error"] < 1e-9
