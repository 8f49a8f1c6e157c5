"""Whatever bytes a reader gets: a valid object, or a ValueError or OSError that names the file.

Each reader has a few inputs here; with `TEXCLASS_EXAMPLES=2000` in the environment as many, and the study
(benchmarks/fuzz/run.py) has many more.
"""

import os
import random
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from fuzz.contract import Target, judge
from fuzz.mutate import of_bytes
from fuzz.recordings import OF_BAGS, SEEDS
from fuzz.targets import LIBRARIES, SHARES, parts_of, target_of

from texclass.loaders.readers import FORMATS, formats

N_SPOILT = (
    {"model": 10, "recogniser": 5, "feature set": 5, "feature table": 5}
    | dict.fromkeys(SHARES["bags"], 60)
    | dict.fromkeys([*SHARES["exchange"], "scene", "path of a hand"], 120)
)
"""Fewer for readers that are slow, more for bags and for files that are exchanged; 20 for all others."""


@cache
def _seeds(name: str) -> tuple[Target, list[bytes]]:
    target = target_of(name)
    seeds = target.seeds()
    with TemporaryDirectory() as place:  # compiles what it has to, on nobody's time
        judge(target, seeds[0], Path(place))
    return target, seeds


OF_EXTRAS = dict.fromkeys(SHARES["bags"], "robot") | {
    suffix[1:]: kind.extra for suffix, kind in FORMATS.items() if kind.extra
}
"""Reader -> the extra that it needs."""


def _skip_without_libraries(name):
    extra = OF_EXTRAS.get(name, "")
    for library in LIBRARIES.get(extra, ()):
        pytest.importorskip(library, reason=f"the extra `{extra}` is not installed")


@pytest.fixture(params=parts_of())
def reader(request):
    _skip_without_libraries(request.param)
    return _seeds(request.param)


@pytest.mark.parametrize("suffix", formats())
def test_every_registered_suffix_has_valid_files(suffix):
    assert suffix in SEEDS or suffix in OF_BAGS, f"{suffix} has no valid files in fuzz/recordings.py"
    name = OF_BAGS.get(suffix, suffix[1:])
    assert name in parts_of()
    _skip_without_libraries(name)
    assert target_of(name).file.endswith(suffix)


def _holds(target, data, place):
    verdict = judge(target, data, place)
    assert not verdict.broken, f"{target.name}: {verdict.kind}: {verdict.detail}"
    return verdict.kind


def test_valid_inputs_are_read(reader, tmp_path):
    target, seeds = reader
    assert "accepted" in {_holds(target, data, tmp_path) for data in seeds}


def test_mutated_inputs_are_read_or_raise_the_documented_error(reader, tmp_path):
    target, seeds = reader
    for number in range(int(os.environ.get("TEXCLASS_EXAMPLES", N_SPOILT.get(target.name, 20)))):
        rng = random.Random(number)
        _holds(target, target.mutate(rng, rng.choice(seeds)), tmp_path)


def test_flipped_spliced_and_cut_bytes_are_read_or_raise_the_documented_error(reader, tmp_path):
    target, seeds = reader
    rng = random.Random(0)
    for number in range(8):
        first, second = rng.choice(seeds), rng.choice(seeds)
        cut = first[: rng.randrange(len(first) + 1)]
        for data in (cut, cut + second[len(second) // 2 :]):
            _holds(target, data if number % 2 else of_bytes(rng, data), tmp_path)


def test_empty_files_and_noise_are_read_or_raise_the_documented_error(reader, tmp_path):
    target, _ = reader
    rng = random.Random(0)
    for data in (b"", b"\0", b"\xff" * 300, rng.randbytes(1000), b"{" * 5000, b"[" * 5000, b"9" * 5000):
        _holds(target, data, tmp_path)
