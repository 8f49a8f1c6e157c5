import numpy as np
import pytest
from texclass.reporting.reproductions._guruswamy2011_result import Study
from texclass.reporting.reproductions._guruswamy2011_text import markdown
from texclass.textures.guruswamy2011.comparison import PathsResult, SpeedPair
from texclass.textures.guruswamy2011.orders import fits_by_order
from texclass.textures.guruswamy2011.simulated import OBJECTS
from texclass.textures.guruswamy2011.study import BOUNDS, ModesRow, PronyRow, Recovery

from texclass.reporting.reproductions import _guruswamy2011_figures as figures
from texclass.textures.guruswamy2011 import LevelFit, published

NAMES = [thing.name for thing in OBJECTS]
RECOVERY = [Recovery(name, np.zeros((4, 2))) for name in NAMES]


@pytest.fixture(scope="module")
def study() -> Study:
    summary = {each.name: each.summary() for each in RECOVERY}
    return Study(
        seed=0,
        n_trials=2,
        scans={name: [PronyRow(row, 0.25, 60.0)] * 5 for name, row in published.TABLE_1.items()},
        modes=dict.fromkeys(NAMES, ModesRow(4.5, 90.0, 100.0, 400.0)),
        zero_phase=dict.fromkeys(NAMES, 1.0),
        orders=[("Prony", 11, 0.9, 0.04)],
        laws={thing.name: (thing.law, 0.99) for thing in OBJECTS},
        force_laws={thing.name: thing.law for thing in OBJECTS},
        recovery=summary,
        recovery_loose=summary,
        speeds={name: [(20.0, 0.99, 1.0, 1.5)] for name in NAMES},
        paths=PathsResult(10, 2.0, 0.0, 40, True),
        held_out=[],
        excerpts=[],
        input_hash={"simulated": "0123456789abcdef"},
        versions={"numpy": "2"},
    )


def test_the_report_has_every_table_and_says_what_is_simulated(study):
    text = markdown(study)
    for part in (
        "What is simulated",
        "Table I:",
        "Table II:",
        "Table III:",
        "k_v 1/s",
        "not on this machine",
    ):
        assert part in text
    for row in (row for rows in published.TABLE_3.values() for row in rows):
        assert f"| {row.f_max_hz:.3g} | {row.f_major_hz:.3g} | {row.segments_per_mm:.3g} |" in text
    for (mean, sigma), _ in published.TABLE_2.values():
        assert f"{mean:.3g} ({sigma:.3g})" in text


def test_every_row_of_a_table_has_as_many_cells_as_its_header(study):
    block: list[int] = []
    for line in [*markdown(study).splitlines(), ""]:
        if line.startswith("|"):
            block.append(line.count("|"))
        else:
            assert len(set(block)) <= 1
            block = []


def test_every_figure_is_drawn(rubber_fit):
    piece = rubber_fit.profile.segmentation.pieces(rubber_fit.profile.samples)[3]
    law = published.LAWS["Rubber mat"]
    fit = LevelFit(law, np.array([10.0, 20.0]), np.ones(2), law.rms([10.0, 20.0], 1.0), 1.0)
    pair = SpeedPair(rubber_fit.scan, np.zeros(len(rubber_fit.scan)), 1.0, 1.0, 1.0)
    drawn = {
        "orders": (figures.draw_orders(piece, fits_by_order(piece, 500.0, 0.153), 500.0), 2),
        "segments": (figures.draw_segmentation(rubber_fit, 3), 1),
        "spectra": (figures.draw_spectra(dict.fromkeys(NAMES, rubber_fit)), 6),
        "textures": (figures.draw_textures(dict.fromkeys(NAMES, rubber_fit)), 5),
        "laws": (figures.draw_laws(dict.fromkeys(published.LAWS, fit)), 2),
        "speeds": (figures.draw_speeds("Rubber mat", [pair, pair, pair]), 6),
        "recovery": (figures.draw_recovery(RECOVERY), len(BOUNDS)),
    }
    for name, (figure, n_panels) in drawn.items():
        assert len(figure.axes) == n_panels, name
