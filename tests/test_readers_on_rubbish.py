"""Whatever bytes a reader gets: a valid object, or a ValueError or OSError that names the file."""

import random
from functools import cache

import pytest
from fuzz.contract import Target, judge
from fuzz.mutate import of_bytes
from fuzz.targets import SHARES, parts_of, target_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SLOW = ("model", "recogniser", "feature set", "feature table")
"""Of these a few inputs are enough here: the study (tests/fuzz/run.py) has many."""


@cache
def _seeds(name: str) -> tuple[Target, list[bytes]]:
    target = target_of(name)
    return target, target.seeds()


@pytest.fixture(params=parts_of())
def reader(request, monkeypatch):
    if request.param in SHARES["bags"]:
        pytest.importorskip("rosbags", reason="the extra `robot` is not installed")
        pytest.importorskip("mcap", reason="the extra `robot` is not installed")
        pytest.importorskip("cyclonedds", reason="the extra `robot` is not installed")
    return _seeds(request.param)


def _holds(target, data, place):
    verdict = judge(target, data, place)
    assert not verdict.broken, f"{target.name}: {verdict.kind}: {verdict.detail}"
    return verdict.kind


def test_whole_inputs_are_read(reader, tmp_path):
    target, seeds = reader
    assert "accepted" in {_holds(target, data, tmp_path) for data in seeds}


@settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(number=st.integers(0, 2**32 - 1))
def test_spoilt_inputs_are_read_or_refused(reader, tmp_path, number):
    target, seeds = reader
    rng = random.Random(number)
    if target.name in SLOW and number % 4:
        return
    _holds(target, target.mutate(rng, rng.choice(seeds)), tmp_path)


@settings(
    max_examples=8,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(number=st.integers(0, 2**32 - 1), share=st.floats(0, 1))
def test_flipped_spliced_and_cut_bytes_are_read_or_refused(reader, tmp_path, number, share):
    target, seeds = reader
    rng = random.Random(number)
    first, second = rng.choice(seeds), rng.choice(seeds)
    for data in (
        first[: int(share * len(first))],
        first[: int(share * len(first))] + second[len(second) // 2 :],
    ):
        _holds(target, data if number % 2 else of_bytes(rng, data), tmp_path)


def test_nothing_and_noise_are_read_or_refused(reader, tmp_path):
    target, _ = reader
    rng = random.Random(0)
    for data in (b"", b"\0", b"\xff" * 300, rng.randbytes(1000), b"{" * 5000, b"[" * 5000, b"9" * 5000):
        _holds(target, data, tmp_path)
