"""The examples in docstrings are run."""

import doctest
import importlib
from pathlib import Path

import pytest

import texclass

PACKAGE = Path(texclass.__file__).parent
WITH_EXAMPLES = sorted(
    ".".join(("texclass", *file.relative_to(PACKAGE).with_suffix("").parts))
    for file in PACKAGE.rglob("*.py")
    if ">>>" in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_every_example_of_a_module_gives_what_it_says(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert (
        doctest.testmod(importlib.import_module(module), optionflags=doctest.NORMALIZE_WHITESPACE).failed == 0
    )
