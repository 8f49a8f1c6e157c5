"""The example for people who have ROS cannot run here: its syntax and the names it uses are checked."""

import ast
import importlib
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "ros2_node.py"


@pytest.fixture(scope="module")
def tree():
    return ast.parse(EXAMPLE.read_text(encoding="utf-8"))


def test_it_says_that_it_was_not_run_with_ros(tree):
    assert "NOT run with ROS" in ast.get_docstring(tree)


def test_what_it_imports_of_texclass_exists(tree):
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    ours = [(node.module, name.name) for node in imported for name in node.names if "texclass" in node.module]
    assert len(ours) == 3
    for module, name in ours:
        assert hasattr(importlib.import_module(module), name)


def test_what_it_does_with_messages_is_what_timing_takes():
    import numpy as np

    from texclass.recognition.timing import Timing

    timing = Timing(100.0, "m/s^2")
    blocks = [
        b
        for i in range(5)
        for b in timing.push(np.array([i * 10**7]), np.array([i * 10**7]), np.ones((1, 1, 3)))
    ]
    assert [block.samples.shape for block in blocks] == [(1, 3)] * 5
