from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import freqz, lfilter

from texclass.haptics.textures.hatt import PEAK_FACTOR, HattTexture, Mesh, triangulate
from texclass.vibration import Autoregression
from texclass.vibration.line_spectrum import to_reflection

SQUARE = {
    "speed": [0.0, 100.0, 0.0, 100.0],
    "force": [0.0, 0.0, 4.0, 4.0],
    "triangles": [[0, 1, 2], [1, 3, 2]],
}


def _lsf(rng, n, p):
    gaps = rng.uniform(0.5, 1.5, (n, p + 1))
    return np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True) * np.pi


def make(q=6, p=8, n=7):
    rng = np.random.default_rng(0)
    speed, force = rng.uniform(40, 200, n), rng.uniform(0.5, 3, n)
    variance, gain = rng.uniform(0.01, 0.1, n), rng.uniform(0.5, 3, n)
    return HattTexture.from_models(
        speed, force, _lsf(rng, n, p), variance, 1000.0, ma_lsf=_lsf(rng, n, q), gain=gain, name="slate"
    )


def arma(texture, speed, force):
    """Return A, C and the gain of unit noise, interpolated as in the toolkit."""
    nodes, w = texture.mesh.weights(speed, force)
    direct = [
        Autoregression(to_reflection(w @ lsf[nodes]), 1.0).direct_form() if lsf.shape[1] else np.ones(1)
        for lsf in (texture.ar_lsf, texture.ma_lsf)
    ]
    return *direct, (w @ texture.gain[nodes]) * np.sqrt(w @ texture.variance[nodes])


def stroke(n, speed, force):
    return np.tile([speed, 0.0], (n, 1)), np.full(n, force)


TEXTURE = make()


def test_weights_reproduce_linear_functions_inside_and_the_nearest_edge_point_outside():
    rng = np.random.default_rng(0)
    mesh, _ = triangulate(rng.uniform(10, 200, 9), rng.uniform(0.2, 3, 9))
    points = rng.uniform([0, 0], mesh.largest, (50, 2))
    nodes, weights = mesh.weights(*points.T)
    assert weights.min() >= 0
    assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
    for axis, expected in zip((mesh.speed, mesh.force), points.T, strict=True):
        assert_allclose((weights * axis[nodes]).sum(axis=1), expected, atol=1e-9)
    square = Mesh(**SQUARE)
    for outside, nearest in (((300, 2), (100, 2)), ((50, 9), (50, 4)), ((300, 9), (100, 4))):
        nodes, weights = square.weights(*outside)
        assert_allclose(weights @ np.column_stack([square.speed, square.force])[nodes], nearest, atol=1e-12)


def test_the_triangulation_fills_the_rectangle_and_lists_the_models_first():
    rng = np.random.default_rng(1)
    speed, force = rng.uniform(10, 200, 12), rng.uniform(0.2, 3, 12)
    mesh, source = triangulate(speed, force)
    assert_allclose(mesh.speed[:12], speed)
    assert source[:12].tolist() == list(range(12))
    areas = np.abs(np.linalg.det(np.diff(mesh.points[mesh.triangles], axis=1))) / 2
    assert areas.sum() == pytest.approx(1, abs=1e-9)
    assert len(mesh.triangles) >= 16  # the toolkit starts its search at triangle 16
    distance = np.hypot(speed / speed.max() - mesh.points[-1, 0], force / force.max() - mesh.points[-1, 1])
    assert source[-1] == distance.argmin()
    single, source = triangulate([80.0], [1.5])
    assert (single.largest, source.any()) == ((80.0, 1.5), False)


def test_invalid_meshes_are_refused():
    for change, message in (
        ({"speed": [0.0, np.nan, 0.0, 100.0]}, "finite"),
        ({"force": [0.0, 0.0, -4.0, 4.0]}, "at least 0"),
        ({"force": [0.0, 0.0]}, "shape"),
        ({"triangles": [[0, 1, 4]]}, "from 0 to 3, got 4"),
        ({"triangles": [[0, 1, 1]]}, "area"),
        ({"triangles": [[0, 1, 1.5]]}, "got 1.5"),
        ({"triangles": np.zeros((0, 3))}, "n between 1"),
    ):
        with pytest.raises(ValueError, match=message):
            Mesh(**(SQUARE | change))
    for speed, force in (([0.0], [1.0]), ([1.0], [0.0]), ([np.inf], [1.0]), ([], [])):
        with pytest.raises(ValueError, match="with positive maxima"):
            triangulate(speed, force)


@pytest.mark.parametrize(("p", "q"), [(8, 6), (7, 0), (4, 9), (1, 1)])
def test_a_constant_stroke_is_the_arma_process_after_a_fade_in_and_its_taps_have_the_rms(p, q):
    texture = make(q, p)
    hop = texture.hop
    A, C, factor = arma(texture, 97.0, 1.3)
    y = texture.renderer(seed=3).process(*stroke(3000, 97.0, 1.3))
    expected = lfilter(factor * C, A, np.random.default_rng(3).standard_normal(3000))
    assert_allclose(y[hop:], expected[hop:], atol=1e-10 * np.abs(expected).max())
    assert_allclose(y[:hop], np.arange(1, hop + 1) / hop * expected[:hop], atol=1e-12)
    _, h = freqz(C, A, worN=1 << 15, whole=True)
    taps = texture.at(97.0, 1.3)[1]
    assert np.linalg.norm(taps) == pytest.approx(factor * np.sqrt(np.mean(np.abs(h) ** 2)), rel=1e-9)


def test_rest_and_no_contact_are_silent_from_the_start_or_within_two_hops():
    loud = replace(TEXTURE, variance=np.ones_like(TEXTURE.variance))  # also at the nodes at rest
    for speed, force in ((0.0, 1.0), (80.0, 0.0), (80.0, -1.0), (0.0, 0.0)):
        assert not loud.renderer().process(*stroke(50, speed, force)).any()
        renderer = loud.renderer()
        assert renderer.process(*stroke(205, 80.0, 1.0)).any()
        assert not renderer.process(*stroke(100, speed, force))[2 * loud.hop :].any()
        assert not loud.at(speed, force)[1].any()


def test_random_paths_stay_finite_and_within_the_bound():
    rng = np.random.default_rng(5)
    bound = PEAK_FACTOR * TEXTURE.levels.max()
    for seed in range(5):
        v, f = rng.uniform(-500, 500, (400, 2)), rng.uniform(-1, 9, 400)
        assert np.all(np.abs(TEXTURE.renderer(seed=seed).process(v, f)) <= bound)


def test_invalid_textures_are_refused(monkeypatch):
    for change, message in (
        ({"fs": 0.0}, "fs must be positive and finite, got 0.0"),
        ({"mu": -1.0}, "mu must be"),
        ({"variance": np.ones(3)}, r"variance must have shape.*got shape \(3,\)"),
        ({"gain": np.full(TEXTURE.gain.size, -1.0)}, "gain must be.*got -1"),
        ({"variance": np.full(TEXTURE.gain.size, 1e308), "gain": np.full(TEXTURE.gain.size, 1e300)}, "RMS"),
        ({"ar_lsf": TEXTURE.ar_lsf[:, ::-1]}, "stable"),
        ({"ma_lsf": TEXTURE.ma_lsf * np.nan}, "ma_lsf.*finite"),
        ({"ar_lsf": TEXTURE.ar_lsf[:, :0]}, "AR order"),
        ({"ar_lsf": TEXTURE.ar_lsf + 1}, "stable"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(TEXTURE, **change)
    monkeypatch.setattr("texclass.haptics.textures.hatt.MAX_WORK", 100)
    with pytest.raises(ValueError, match=r"p\^2"):
        replace(TEXTURE)


def test_a_mesh_without_a_model_of_a_stroke_has_the_range_of_its_nodes():
    mesh = Mesh([0.0, 100.0, 0.0], [0.0, 0.0, 2.0], [[0, 1, 2]])
    texture = HattTexture(mesh, [[0.6, 1.1]] * 3, np.zeros((3, 0)), [1.0] * 3, [1.0] * 3, 1000.0)
    assert (texture.speeds.tolist(), texture.forces.tolist()) == ([100.0], [2.0])
