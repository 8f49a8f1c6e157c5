import numpy as np
import pytest

from texclass.textures.guruswamy2011.fit import (
    CANCELLING,
    MAX_POLES,
    RING_S,
    fit_modes,
    fit_responses,
    fit_sinusoid,
)
from texclass.vibration.decaying_modes import DecayingModes

FS = 500.0
RING = DecayingModes(*np.array([[30.0, 80.0], [25.0, 60.0], [3.0, 2.0], [-1.5, 0.3]]))


def test_modes_of_a_known_ring_are_found_with_as_many_poles_as_it_has():
    found = fit_modes(RING.synthesize(80, FS), FS, 1e-6)
    assert found.n_modes == 2
    assert np.sort(found.frequency_hz) == pytest.approx([30, 80], rel=1e-6)
    assert np.sort(found.decay_per_s) == pytest.approx([25, 60], rel=1e-5)


def test_a_coarser_resolution_needs_fewer_poles():
    piece = RING.synthesize(80, FS)
    assert fit_modes(piece, FS, 0.3).n_modes < fit_modes(piece, FS, 1e-6).n_modes
    assert fit_modes(piece, FS, 10.0).n_modes == 0


@pytest.mark.parametrize("n", [1, 2, 3, 5, 20, 300])
def test_any_segment_gives_stable_modes_that_end(n):
    piece = np.cumsum(np.random.default_rng(n).standard_normal(n))
    modes = fit_modes(piece, FS, 1e-3)
    assert np.all(modes.decay_per_s >= np.log(1000) / RING_S * (1 - 1e-9))
    assert np.sum(1 + (modes.frequency_hz > 0)) <= MAX_POLES
    assert np.all(np.isfinite(modes.synthesize(2000, FS)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_decaying_sinusoid_is_recovered(sign):
    t = np.arange(100) / FS
    found = fit_sinusoid(sign * 4 * np.exp(-30 * t) * np.sin(2 * np.pi * 22 * t), FS)
    assert found.frequency_hz == pytest.approx([22], rel=1e-2)
    assert found.decay_per_s == pytest.approx([30], rel=5e-2)
    assert found.amplitude == pytest.approx([4], rel=5e-2)


def test_subtracted_tails_make_the_sum_the_profile_again():
    early, late = RING.synthesize(200, FS), RING.synthesize(185, FS)
    x = early.copy()
    x[15:] -= late  # struck again before the first has decayed
    bounds = [0, 15, 200]
    subtracted, ignored = (
        fit_responses(x, bounds, FS, 1e-3, tails=tails).sum(200, FS) for tails in ("subtracted", "ignored")
    )
    assert np.mean(np.abs(subtracted - x)) < 2e-3
    assert np.mean(np.abs(ignored - x)) > 0.05


def test_modes_do_not_nearly_cancel():
    rng = np.random.default_rng(8)
    for n in (4, 9, 15, 30) * 6:
        piece = rng.standard_normal(n) * np.exp(-np.arange(n) / 5)
        amplitude = fit_modes(piece, FS, 1e-3).amplitude
        assert amplitude.max() <= CANCELLING * np.abs(piece).max()
