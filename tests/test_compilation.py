"""Compilation is reported on standard error, from the start of a command, and only when it happens."""

import os
import pty
import subprocess
import sys

import numpy as np
import pytest

from texclass.cli.output import RECORDING_KERNELS, SCENE_KERNELS
from texclass.compilation import PACKAGE

COMMANDS = {
    "train": ("train", "data", "--fs", "2000", "--unit", "g", "--jobs", "1", "-o", "model.skops"),
    "benchmark": ("benchmark", "data", "--fs", "2000", "--unit", "g", "--folds", "2", "-o", "out"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(5)
    for i in range(8):
        (tmp_path / "data" / f"m{i % 2}").mkdir(parents=True, exist_ok=True)
        x = np.convolve(rng.normal(size=4000), np.ones(1 + 3 * (i % 2)), "same")
        np.savetxt(tmp_path / "data" / f"m{i % 2}" / f"{i}.txt", x, fmt="%.4f")
    return tmp_path


def run(folder, *arguments, terminal=False, code=0):
    """Run a command with the caches in `folder`. Return its standard error, with a terminal or a pipe."""
    caches = {"NUMBA_CACHE_DIR": str(folder / "numba"), "TEXCLASS_CACHE": str(folder / "cache")}
    command = [sys.executable, "-m", "texclass", *arguments]
    options = {"cwd": folder, "env": os.environ | caches, "stdout": subprocess.PIPE}
    if not terminal:
        return subprocess.run(command, **options, stderr=subprocess.PIPE, check=True).stderr.decode()
    main, end = pty.openpty()
    process = subprocess.Popen(command, **options, stderr=end)
    os.close(end)
    text = b""
    while True:
        try:
            text += os.read(main, 65536)
        except OSError:  # the command has closed its end
            break
    process.stdout.close()
    assert process.wait() == code
    return text.decode()


@pytest.mark.parametrize("name", COMMANDS)
def test_the_first_run_reports_what_it_compiles_and_the_second_is_silent(folder, name):
    first = run(folder, *COMMANDS[name]).splitlines()
    assert first[0] == "first run on this machine: compiling functions, which takes up to a minute"
    modules = [line.split()[1] for line in first if line.startswith("compiling")]
    assert modules
    assert len(set(modules)) == len(modules)
    assert all(module.startswith("texclass.") for module in modules)
    assert run(folder, *COMMANDS[name]) == ""


@pytest.mark.parametrize("subpackage", [*RECORDING_KERNELS, *SCENE_KERNELS])
def test_each_subpackage_whose_functions_are_announced_has_compiled_functions(subpackage):
    folder = PACKAGE.joinpath(*subpackage.split("."))
    assert any("@njit(cache=True" in file.read_text() for file in folder.rglob("*.py"))


def test_on_a_terminal_the_first_line_appears_before_libraries_are_loaded(folder):
    code = (
        "import sys\nfrom texclass.cli import output\noutput.announce_start('phases')\n"
        "print([m for m in ('numpy', 'numba', 'rich', 'sklearn') if m in sys.modules])"
    )
    main, end = pty.openpty()
    env = os.environ | {"NUMBA_CACHE_DIR": str(folder / "numba")}
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=end, env=env, check=True
    )
    os.close(end)
    assert os.read(main, 1000).decode().startswith("first run on this machine: compiling functions")
    assert done.stdout == b"[]\n"


def test_an_error_on_a_terminal_starts_on_an_empty_line(folder):
    text = run(folder, "predict", "none.skops", "none.txt", terminal=True, code=1)
    assert "loading libraries ...\r\x1b[2Kerror: " in text
