"""SpaRSA against MultiTaskLasso, and the network against one AR model."""

import json
from pathlib import Path

import abdulali2016_real as real
import abdulali2016_sparsa as sparsa
import numpy as np
import pandas as pd
import pytest
import shared
from abdulali2016_simulated import get_surface, simulate_scan
from numpy.testing import assert_allclose

from texclass.haptics.textures import Scan

REPORT = Path(__file__).parents[2] / "reports" / "papers" / "abdulali2016-comparisons.json"


@pytest.fixture(scope="module")
def problem():
    scan = simulate_scan(get_surface("S4"), 10.0, 1000.0, np.random.default_rng(1))
    return sparsa.sparse_problem(scan)


@pytest.mark.parametrize("continuation", [True, False])
def test_both_solvers_find_the_same_optimum(problem, continuation):
    A, Y, largest = problem
    tau, scale = 0.1 * largest, 0.5 * np.sum(Y**2)
    W, _ = sparsa.sparsa(A, Y, tau, gap=1e-6, continuation=continuation)
    reference, _ = sparsa.lasso(A, Y, tau, tolerance=1e-8, max_iter=100_000)
    values = [sparsa.objective(A, Y, solution, tau) / scale for solution in (W, reference)]
    assert_allclose(*values, atol=1e-6)
    assert 0 <= sparsa.duality_gap(A, Y, W, tau) <= 1e-6 * scale
    strong = np.linalg.norm(reference, axis=1) > 1e-2 * np.linalg.norm(reference, axis=1).max()
    assert np.all(np.any(W[strong] != 0, axis=1))


def test_the_solution_is_0_from_the_largest_penalty_on(problem):
    A, Y, largest = problem
    W, n_steps = sparsa.sparsa(A, Y, 1.001 * largest)
    assert not W.any()
    assert n_steps == 0
    assert sparsa.sparsa(A, Y, 0.9 * largest)[0].any()


def test_the_solution_of_an_orthogonal_problem_is_a_shrinkage():
    rng = np.random.default_rng(0)
    A, _ = np.linalg.qr(rng.standard_normal((30, 30)))
    Y = rng.standard_normal((30, 3))
    W, _ = sparsa.sparsa(A, Y, 1.0, gap=1e-12)
    assert_allclose(W, sparsa.shrink(A.T @ Y, 1.0), atol=1e-5)


def test_the_report_states_the_same_optimum_and_a_longer_time():
    solvers = pd.DataFrame(json.loads(REPORT.read_text(encoding="utf-8"))["solvers"])
    same_gap = solvers[solvers["solver"] != "MultiTaskLasso as in fit_sparse"]
    assert same_gap["excess"].max() < 1e-4
    ms = solvers.pivot_table("ms", "sparsity", "solver", aggfunc="median")
    assert (ms["SpaRSA"] > 1.5 * ms["MultiTaskLasso"]).all()


def test_the_network_is_better_where_level_and_spectrum_follow_the_motion():
    rng = np.random.default_rng(0)
    surface = get_surface("S4")
    training, validation = (simulate_scan(surface, s, 1000.0, rng) for s in (20.0, 5.0))
    scores = real.compare_models(training, [validation])
    assert scores["network, level_db"] < 0.5 * scores["one model, level_db"]
    assert scores["explained"] > 0.8


def test_the_network_gains_nothing_where_nothing_follows_the_motion():
    rng = np.random.default_rng(0)
    scan = simulate_scan(get_surface("S4"), 15.0, 1000.0, rng)
    noise = Scan(rng.standard_normal(len(scan)), scan.position, scan.velocity, scan.force, scan.fs, "noise")
    training, validation = noise.crop(0, 10_000), noise.crop(10_000, len(noise))
    scores = real.compare_models(training, [validation])
    assert scores["explained"] < 0.2
    assert scores["network, gfc"] < scores["one model, gfc"] + 0.01
    assert scores["network, level_db"] > 0.9 * scores["one model, level_db"]


@pytest.mark.filterwarnings("ignore:scan 'T1'. excluded 1 sample of speed:UserWarning")
def test_the_reasons_of_the_report_hold_on_the_real_recordings():
    rows = pd.DataFrame(json.loads(REPORT.read_text(encoding="utf-8"))["real"]).set_index("set")
    assert rows.loc["stylus6", "explained"].max() < 0.5
    assert (rows.loc["biotac20", "segments"] == 1).all()
    recordings, _ = shared.recordings("stylus6")
    if not recordings:
        pytest.skip("stylus6 is not available")
    first = next(iter(real.stylus_pairs({"T1": recordings["T1"]})))
    computed, stored = real.compare_models(*first), rows.loc["stylus6"].iloc[0]
    assert computed["surface"] == stored["surface"]
    for key in ("explained", "network, gfc", "one model, gfc"):
        assert_allclose(computed[key], stored[key], atol=0.01)
