"""The scripts of the gallery run as they stand."""

import ast
import runpy
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from texclass.features.contract import list_features
from texclass.haptics.scene import pages

GALLERY = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(p for header in GALLERY.glob("*/GALLERY_HEADER.rst") for p in header.parent.glob("*.py"))
SLOW = {
    "another_sensor",
    "few_recordings",
    "onnx_model",
    "operators",
    "own_feature",
    "samples_to_answer",
    "scene",
    "speed_against_accuracy",
    "train_and_predict",
    "unknown_surfaces",
}
"""Run where the documentation is built."""


@pytest.mark.parametrize("script", [s for s in SCRIPTS if s.stem not in SLOW], ids=lambda s: s.stem)
def test_a_script_runs(script, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: None)
    monkeypatch.setattr("texclass.features.contract._REGISTRY", list_features())
    monkeypatch.setattr(pages, "SLIDER_VALUES", (7.0,))  # one value per slider, for speed
    runpy.run_path(str(script))
    plt.close("all")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda s: s.stem)
def test_a_script_is_short_and_uses_public_names(script):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 70
    ours = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom | ast.Import)]
    assert "import texclass as tx" in map(ast.unparse, ours)
