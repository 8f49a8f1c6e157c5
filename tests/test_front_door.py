"""What `import texclass as tx` offers, as a user types it."""

import subprocess
import sys
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

import texclass as tx

WHOLE = tx.Phases(movement=(0, 4000))
SIGNAL = np.random.default_rng(0).standard_normal((3, 4000))

ONE_AFTER_ANOTHER = """
import sys

def loaded(*names):
    return sorted(set(names) & set(sys.modules))

import texclass
assert not loaded("numpy", "scipy", "pandas", "sklearn", "numba", "librosa", "matplotlib", "pydantic")

import texclass.features as features
assert not loaded("numpy")
features.FeatureExtractor
others = ("evaluation", "recognition", "baselines", "haptics", "robot", "cli", "loaders")
assert not loaded("librosa", "texclass.features.roughness", *(f"texclass.{room}" for room in others))
assert "mfcc" in features.list_features()
assert loaded("texclass.features.roughness")
assert not loaded("librosa", "texclass.loaders")

import texclass.cli, texclass.robot.export.onnx_file
assert not loaded("onnx", "onnxruntime", "skl2onnx")
"""
"""Imports in one process, and checks that other modules are not loaded."""


def test_every_name_loads_and_no_function_has_the_name_of_a_subpackage():
    exports = {name: getattr(tx, name) for name in tx.__all__}
    subpackages = {name for name, value in exports.items() if isinstance(value, ModuleType)}
    assert 15 <= len(exports) - len(subpackages) <= 25
    assert all(exports[name].__name__ == f"texclass.{name}" for name in subpackages)
    assert tx.__version__.count(".") == 2


def test_importing_a_subpackage_does_not_load_the_others():
    result = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    "recordings",
    [
        SIGNAL[0],
        list(SIGNAL),
        [SIGNAL[0], SIGNAL[1, :3000]],
        SIGNAL[:, np.newaxis, :],
        [tx.Recording(x, fs=2000.0, phases=WHOLE) for x in SIGNAL],
        pd.Series([tx.Recording(x, fs=2000.0, phases=WHOLE) for x in SIGNAL], index=list("abc")),
    ],
    ids=["array", "arrays", "unequal", "panel", "recordings", "series"],
)
def test_features_of_all_inputs_are_one_table(recordings):
    X = tx.extract(recordings, "strese2015", fs=2000.0)
    assert isinstance(X, pd.DataFrame)
    assert len(X) == (1 if isinstance(recordings, np.ndarray) and recordings.ndim == 1 else len(recordings))
    pd.testing.assert_series_equal(
        X["fineness"].iloc[:1].reset_index(drop=True),
        tx.extract(SIGNAL[0], "strese2015", fs=2000.0)["fineness"].reset_index(drop=True),
        rtol=1e-9,
    )


def test_undefined_features_are_counted_in_one_warning():
    with pytest.warns(
        UserWarning, match=r"^236 of 236 columns without any value: .*no tap found"
    ) as warnings:
        table = tx.extract(np.zeros(100), fs=1000.0)
    assert len(warnings) == 1
    assert ("waviness", "silence: all 100 samples are 0", 1) in table.attrs["reasons"]


def test_signals_with_other_axes_are_refused():
    with pytest.raises(ValueError, match=r"row 1: 1 axis, but row 0 has 2 axes \(c1, c2\)"):
        tx.extract([SIGNAL[:2].T, SIGNAL[0]], "strese2015", fs=2000.0)


def test_a_recording_is_drawn():
    figure = tx.plot_recording(tx.Recording(SIGNAL.T, fs=2000.0))
    assert len(figure.axes) >= 3
    assert {"fineness", "DCT bin"} <= {text.get_text() for axes in figure.axes for text in axes.texts}
