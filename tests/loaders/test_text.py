import time

import numpy as np
import pytest

from texclass.loaders import load_recording
from texclass.recording import RecordingError


def load(path):
    return load_recording(path, fs=1000, unit="counts").acceleration.tolist()


@pytest.mark.parametrize("content", ["1\n2\n3\n", "1\r\n2\r\n3", "  1.0\n 2e0\n+3.\n\n", "\ufeff1\n2\n3\n"])
def test_one_value_per_line_in_its_spellings(tmp_path, content):
    (tmp_path / "r.txt").write_text(content, encoding="utf-8", newline="")
    assert load(tmp_path / "r.txt") == [1, 2, 3]


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("1\nabc\n3\n", "line 2 is 'abc'"),
        ("time\n1\n2\n", "line 1 is 'time'"),
        ("1\n2\n3 4\n", "line 3 is '3 4'"),
        ("1\n2,5\n3\n", "line 2 is '2,5'"),
        ("1;2\n", "line 1 is '1;2'"),
        ("1\n2\n1_000\n", "line 3 is '1_000'"),
        ("1\n0x10\n", "line 2 is '0x10'"),
    ],
)
def test_a_line_that_is_not_one_number_is_named(tmp_path, content, line):
    (tmp_path / "r.txt").write_text(content)
    with pytest.raises(RecordingError, match=f"r.txt: {line}; the rule is one number per line"):
        load(tmp_path / "r.txt")


def test_nan_and_infinity_are_refused(tmp_path):
    (tmp_path / "r.txt").write_text("1\nnan\ninf\n")
    with pytest.raises(RecordingError, match=r"holds 2 values that are NaN or infinite \(first at \[1\]\)"):
        load(tmp_path / "r.txt")


@pytest.mark.parametrize("content", ["\n\n", "5\n"])
def test_fewer_than_two_samples_are_refused(tmp_path, content):
    (tmp_path / "r.txt").write_text(content)
    with pytest.raises(RecordingError, match="at least"):
        load(tmp_path / "r.txt")


@pytest.mark.benchmark
def test_25_seconds_at_10_khz_load_in_50_ms(tmp_path):
    np.savetxt(tmp_path / "r.txt", np.random.default_rng(0).standard_normal(250_000), fmt="%16.7e")
    durations = []
    for _ in range(6):
        begin = time.perf_counter()
        load_recording(tmp_path / "r.txt", fs=10_000, unit="g")
        durations.append(time.perf_counter() - begin)
    assert min(durations) < 0.05
