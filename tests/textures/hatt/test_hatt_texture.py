from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import freqz, lfilter

from texclass.textures import Renderer, Texture
from texclass.textures.hatt import HattTexture
from texclass.textures.hatt.texture import LIMIT
from texclass.vibration import Autoregression
from texclass.vibration.line_spectrum import to_reflection

FS = 1000.0


def _lsf(rng, n, p):
    gaps = rng.uniform(0.5, 1.5, (n, p + 1))
    return np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True) * np.pi


def make(q=6, p=8, n=7, seed=0):
    rng = np.random.default_rng(seed)
    speed, force = rng.uniform(40, 200, n), rng.uniform(0.5, 3, n)
    variance, gain = rng.uniform(0.01, 0.1, n), rng.uniform(0.5, 3, n)
    return HattTexture.from_models(
        speed, force, _lsf(rng, n, p), variance, FS, ma_lsf=_lsf(rng, n, q), gain=gain, name="slate", mu=0.3
    )


def arma(texture, speed, force):
    """Return A, C and the factor of unit noise, mixed as the toolkit mixes them."""
    nodes, w = texture.mesh.weights(speed, force)
    direct = [
        Autoregression(to_reflection(w @ lsf[nodes]), np.array(1.0)).direct_form()
        if lsf.shape[1]
        else np.ones(1)
        for lsf in (texture.ar_lsf, texture.ma_lsf)
    ]
    return *direct, (w @ texture.gain[nodes]) * np.sqrt(w @ texture.variance[nodes])


def stroke(n, speed, force):
    return np.tile([speed, 0.0], (n, 1)), np.full(n, force)


TEXTURE = make()


def test_it_is_a_texture():
    assert isinstance(TEXTURE, Texture)
    assert isinstance(TEXTURE.renderer(), Renderer)
    assert TEXTURE.operations > 6 * 8


@pytest.mark.parametrize(("p", "q"), [(8, 6), (7, 0), (4, 9), (1, 1)])
def test_constant_stroke_is_the_arma_process_after_the_first_glide(p, q):
    texture = make(q, p)
    A, C, factor = arma(texture, 97.0, 1.3)
    y = texture.renderer(seed=3).process(*stroke(3000, 97.0, 1.3))
    e = np.random.default_rng(3).standard_normal(3072)[:3000]
    expected = lfilter(factor * C, A, e)
    assert_allclose(y[texture.hop :], expected[texture.hop :], atol=1e-10 * np.abs(expected).max())


def test_first_contact_fades_in_without_a_click():
    A, C, factor = arma(TEXTURE, 97.0, 1.3)
    hop = TEXTURE.hop
    y = TEXTURE.renderer(seed=3).process(*stroke(hop, 97.0, 1.3))
    steady = lfilter(factor * C, A, np.random.default_rng(3).standard_normal(1024)[:hop])
    assert_allclose(y, np.arange(1, hop + 1) / hop * steady, atol=1e-12)


def test_taps_hold_the_rms_of_the_process():
    A, C, factor = arma(TEXTURE, 120.0, 2.0)
    _, h = freqz(C, A, worN=1 << 15, whole=True)
    _, taps = TEXTURE.at(120.0, 2.0)
    assert np.linalg.norm(taps) == pytest.approx(factor * np.sqrt(np.mean(np.abs(h) ** 2)), rel=1e-9)


def test_reflection_is_that_of_the_mixed_line_spectra():
    nodes, w = TEXTURE.mesh.weights(60.0, 0.8)
    k, _ = TEXTURE.at(60.0, 0.8)
    assert_array_equal(k, to_reflection(w @ TEXTURE.ar_lsf[nodes]))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(cuts=st.lists(st.integers(0, 1500), max_size=6))
def test_any_pieces_are_the_same_samples(cuts):
    v = np.column_stack([90 + 80 * np.sin(np.arange(1500) / 70), 20 * np.cos(np.arange(1500) / 50)])
    f = 1.5 + 2 * np.sin(np.arange(1500) / 90)
    edges = [0, *sorted(cuts), 1500]
    renderer = TEXTURE.renderer(seed=1)
    pieces = [renderer.process(v[a:b], f[a:b]) for a, b in pairwise(edges)]
    assert_array_equal(np.concatenate(pieces), TEXTURE.renderer(seed=1).process(v, f))


def test_single_samples_are_the_same_samples_and_reset_starts_anew():
    v, f = stroke(60, 80.0, 1.0)
    v[25:] *= 1.5
    renderer = TEXTURE.renderer(seed=2)
    whole = renderer.process(v, f)
    renderer.reset()
    assert_array_equal(
        np.concatenate([renderer.process(v[i : i + 1], f[i : i + 1]) for i in range(60)]), whole
    )


@pytest.mark.parametrize(("speed", "force"), [(0.0, 1.0), (80.0, 0.0), (80.0, -1.0), (0.0, 0.0)])
def test_rest_and_no_contact_are_silent_at_once_and_within_two_hops(speed, force):
    loud = replace(TEXTURE, variance=np.ones_like(TEXTURE.variance))  # at the nodes of rest, too
    assert not loud.renderer().process(*stroke(50, speed, force)).any()
    renderer = loud.renderer()
    assert renderer.process(*stroke(205, 80.0, 1.0)).any()
    assert not renderer.process(*stroke(100, speed, force))[2 * loud.hop :].any()
    assert not loud.at(speed, force)[1].any()


def test_random_paths_stay_finite_and_within_the_bound():
    rng = np.random.default_rng(5)
    bound = LIMIT * TEXTURE.levels.max()
    for seed in range(20):
        v, f = rng.uniform(-500, 500, (400, 2)), rng.uniform(-1, 9, 400)
        y = TEXTURE.renderer(seed=seed).process(v, f)
        assert np.all(np.abs(y) <= bound)


def test_what_is_written_down_is_restored():
    again = HattTexture.restore(TEXTURE.parameters(), TEXTURE.arrays())
    assert again.parameters() == TEXTURE.parameters()
    for name, array in TEXTURE.arrays().items():
        assert_array_equal(again.arrays()[name], array)
        assert array.dtype == np.float64


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"fs": 0.0}, "above 0 Hz"),
        ({"mu": -1.0}, "mu is"),
        ({"variance": np.ones(3)}, "one a node"),
        ({"gain": np.full(TEXTURE.gain.size, -1.0)}, "gain of a node"),
        ({"ar_lsf": TEXTURE.ar_lsf[:, ::-1]}, "stable"),
        ({"ma_lsf": TEXTURE.ma_lsf * np.nan}, "stable"),
        ({"ar_lsf": TEXTURE.ar_lsf[:, :0]}, "orders"),
        ({"ar_lsf": TEXTURE.ar_lsf + 1}, "stable"),
    ],
)
def test_broken_textures_are_refused_with_the_rule(change, rule):
    with pytest.raises(ValueError, match=rule):
        replace(TEXTURE, **change)


def test_more_work_than_a_file_may_ask_for_is_refused(monkeypatch):
    monkeypatch.setattr("texclass.textures.hatt.texture.MOST_WORK", 100)
    with pytest.raises(ValueError, match=r"p\^2"):
        replace(TEXTURE)


def test_restoring_names_what_is_missing_or_superfluous():
    with pytest.raises(ValueError, match="the rule is"):
        HattTexture.restore({"name": "x", "fs": 1000.0}, TEXTURE.arrays())


@pytest.mark.parametrize(("v", "f"), [(np.ones((3, 2)), np.ones(2)), (np.ones(3), np.ones(3))])
def test_wrong_paths_are_refused(v, f):
    with pytest.raises(ValueError, match="the rule is"):
        TEXTURE.renderer().process(v, f)


def test_nan_in_a_path_is_refused():
    with pytest.raises(ValueError, match="NaN"):
        TEXTURE.renderer().process(*stroke(5, np.nan, 1.0))
