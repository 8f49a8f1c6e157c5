import numpy as np
import pytest
from scipy.signal import resample_poly

from texclass.recognition.sources.blocks import Block, Resampler, resampled


def _pushed(x, fs, to, sizes):
    resampler, parts, at = Resampler(fs, to), [], 0
    for size in sizes:
        parts.append(resampler.push(x[at : at + size]))
        at += size
    return np.concatenate(parts)


@pytest.mark.parametrize(("fs", "to"), [(1000, 500), (1000, 2000), (10_000, 4000), (100, 250), (997, 1000)])
def test_the_stream_is_scipy_resampling_of_the_whole(fs, to):
    x = np.random.default_rng(0).normal(size=(2000, 2))
    y = _pushed(x, fs, to, [2000])
    p, q = (to // (g := np.gcd(fs, to)), fs // g)
    whole = resample_poly(x, p, q, axis=0)
    np.testing.assert_allclose(y, whole[: len(y)], atol=1e-9)
    assert len(whole) - len(y) <= 1 + 10 * max(p, q) / q


@pytest.mark.parametrize("size", [1, 7, 250])
def test_any_division_into_blocks_gives_the_same_numbers(size):
    x = np.random.default_rng(1).normal(size=(1000, 3))
    sizes = [size] * (1000 // size + 1)
    np.testing.assert_array_equal(_pushed(x, 1000, 400, sizes), _pushed(x, 1000, 400, [1000]))


def test_the_same_rate_changes_nothing():
    x = np.random.default_rng(1).normal(size=(10, 1))
    assert Resampler(100, 100).push(x) is x


def test_what_would_alias_is_removed():
    t = np.arange(20_000) / 10_000
    y = _pushed(np.sin(2 * np.pi * 1800 * t)[:, None], 10_000, 2000, [20_000])
    assert np.abs(y[100:]).max() < 0.02


@pytest.mark.parametrize("to", [0, -1, float("nan"), 1e9])
def test_an_impossible_rate_is_refused(to):
    with pytest.raises(ValueError, match="the rule is above 0"):
        Resampler(1000, to)


def test_a_loss_starts_anew_and_is_counted_at_the_new_rate():
    x = np.ones((400, 1))
    blocks = [Block(0.0, x, 1000, "g"), Block(0.5, x, 1000, "g", 100)]

    out = list(resampled((block for block in blocks), 500.0))
    assert [block.lost for block in out] == [0, 50]
    assert [block.t_s for block in out] == [0.0, 0.5]
    assert out[0].flags == ("resampled (band-limited) from 1000 Hz to 500 Hz",)
    assert {block.fs for block in out} == {500.0}
