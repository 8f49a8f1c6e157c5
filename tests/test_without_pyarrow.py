"""Without pyarrow (extra `parquet`), everything works except reading and writing Parquet files."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

PROGRAM = """
import sys


class WithoutPyarrow:
    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, *arguments):
        return None if name == "pyarrow" else self.finder.find_spec(name, *arguments)

    def __getattr__(self, name):
        return getattr(self.finder, name)


sys.meta_path[:] = map(WithoutPyarrow, sys.meta_path)
from texclass.cli import main

sys.argv = ["texclass", *sys.argv[1:]]
try:
    main()
finally:
    assert "pyarrow" not in sys.modules
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))

    def call(*arguments):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout, done.stderr

    return call


def test_recordings_are_written_extracted_evaluated_trained_and_classified(run, tmp_path):
    def passes(*arguments):
        code, out, err = run(*arguments)
        assert code == 0, err
        return out

    passes("sample", "recordings")
    read = ("recordings", "--fs", "10000", "--unit", "m/s^2", "--jobs", "1")
    passes("extract", *read, "--features", "coarse", "-o", "features.csv")
    passes("extract", *read, "--features", "coarse", "-o", "parts", "--partition", "20")
    whole = pd.read_csv(tmp_path / "features.csv")
    parts = pd.concat(map(pd.read_csv, sorted((tmp_path / "parts").iterdir())), ignore_index=True)
    pd.testing.assert_frame_equal(parts, whole)
    assert "accuracy" in passes("benchmark", *read, "--pipeline", "coarse", "--folds", "3").lower()
    passes("train", *read, "-o", "m.skops")
    one = next((tmp_path / "recordings" / "oak").iterdir())
    assert "oak" in passes("predict", "m.skops", str(one))


def test_parquet_files_name_the_extra(run, tmp_path):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    (tmp_path / "r" / "oak").mkdir(parents=True)
    np.savetxt(tmp_path / "r" / "oak" / "1.txt", np.zeros(10))
    pd.DataFrame({"acceleration": np.zeros(10)}).to_parquet(tmp_path / "1.parquet")
    read = ("--fs", "1000", "--unit", "g")
    for command in (
        ("inspect", "1.parquet", *read),
        ("extract", "r", *read, "-o", "t.parquet"),
        ("extract", "r", *read, "-o", "t", "--partition", "2", "--partition-format", "parquet"),
    ):
        code, out, err = run(*command)
        assert (code, out) == (1, "")
        assert err.startswith("error: ")
        assert ".parquet" in err
        assert "pip install 'texclass[parquet]'" in err
