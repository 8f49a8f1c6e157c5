"""Warnings that texclass raises or causes are errors in tests; deprecations inside libraries are not."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODE = """
import warnings
def test_it():
    warnings.warn_explicit("old", {category}, "x.py", 1, module={module!r})
"""


@pytest.mark.parametrize(
    ("category", "module", "fails"),
    [
        ("DeprecationWarning", "librosa.core", False),
        ("FutureWarning", "sklearn.base", False),
        ("DeprecationWarning", "texclass.signals", True),
        ("FutureWarning", "texclass", True),
        ("RuntimeWarning", "numpy", True),
        ("UserWarning", "scipy.io", True),
    ],
)
def test_only_deprecations_inside_libraries_are_no_errors(tmp_path, category, module, fails):
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    filters = settings["tool"]["pytest"]["ini_options"]["filterwarnings"]
    lines = "".join(f"    {line}\n" for line in filters)
    (tmp_path / "pytest.ini").write_text(f"[pytest]\nfilterwarnings =\n{lines}")
    (tmp_path / "test_it.py").write_text(CODE.format(category=category, module=module))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "test_it.py"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode != 0) == fails, run.stdout
