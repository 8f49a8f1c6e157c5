from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_families import K, lpc, network

from texclass.exchange import read_hatt, to_hatt, write_hatt
from texclass.textures.oeztuerk2018 import LpcTexture
from texclass.vibration import Autoregression, fit


def test_models_at_the_recorded_speeds_are_kept_at_the_same_rate():
    found = to_hatt(lpc(1000.0))
    assert found.mesh.largest == (150.0, 1.0)
    k, taps = found.at(150.0, 1.0)
    assert_allclose(k, K[1], atol=1e-12)
    assert np.linalg.norm(taps) == pytest.approx(float(Autoregression(K[1], np.array(0.5)).level))
    assert found.name == "slate"


def test_another_rate_keeps_the_spectrum_below_500_hz():
    texture = lpc(4000.0)
    found = to_hatt(texture, order=20)
    assert (found.fs, found.order) == (1000.0, 20)
    k, taps = found.at(150.0, 1.0)
    gain = np.linalg.norm(taps) * np.prod(np.sqrt(1 - k**2))
    hz = np.linspace(20, 450, 100)
    old = texture.at(150.0).log_spectrum_db(2 * np.pi * hz / 4000) - 10 * np.log10(4000)
    new = Autoregression(k, gain).log_spectrum_db(2 * np.pi * hz / 1000) - 10 * np.log10(1000)
    assert_allclose(new, old, atol=0.5)


def test_higher_orders_are_fitted_anew():
    x = np.random.default_rng(0).standard_normal(4000)
    long = fit(np.stack([x[:2000], x[2000:]]), 200)
    found = to_hatt(LpcTexture([50.0, 150.0], long, 3.0, 1000.0, "noise"), order=12)
    assert found.order == 12
    assert np.linalg.norm(found.at(50.0, 1.0)[1]) == pytest.approx(float(long.level[0]), rel=0.02)


def test_a_network_is_read_on_a_grid(tmp_path):
    found = to_hatt(network())
    assert found.mesh.largest == pytest.approx((160.0, 2.0))
    k, level = network().models([[160.0, 0.0]], [2.0])
    taps = found.at(160.0, 2.0)[1]
    assert_allclose(found.at(160.0, 2.0)[0], k[0], atol=1e-9)
    assert np.linalg.norm(taps) == pytest.approx(level[0])
    again = read_hatt(write_hatt(found, tmp_path / "a.xml"))
    assert_array_equal(again.ar_lsf, found.ar_lsf)


def test_units_of_known_size_become_metres(slate):
    assert_allclose(to_hatt(slate, unit="g").levels, 9.80665 * slate.levels)
    assert_array_equal(to_hatt(slate).variance, slate.variance)
    texture = lpc(1000.0)
    assert_allclose(to_hatt(texture, unit="g").levels, 9.80665 * to_hatt(texture).levels, rtol=1e-9)


def test_what_hatt_cannot_hold_is_refused(hum):
    for options, match in (
        ({"unit": "V"}, "unit is"),
        ({"fs": 2000.0}, "at most that of the texture"),
        ({"fs": -1.0}, "fs is"),
        ({"speeds": [0.0, 50.0]}, "above 0"),
        ({"forces": [np.nan]}, "above 0"),
    ):
        with pytest.raises(ValueError, match=match):
            to_hatt(lpc(1000.0), **options)
    with pytest.raises(ValueError, match="AR models"):
        to_hatt(hum)


def test_an_order_beyond_coefficients_is_not_written(slate, tmp_path):
    rng = np.random.default_rng(0)
    n, p = slate.mesh.speed.size, 400
    gaps = rng.uniform(0.001, 2, (n, p + 1))
    lsf = np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True) * np.pi
    with pytest.raises(ValueError, match="direct form"):
        write_hatt(replace(slate, ar_lsf=lsf), tmp_path / "a.xml")
    assert not list(tmp_path.iterdir())
