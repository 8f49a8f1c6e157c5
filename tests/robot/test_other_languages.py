"""The exported file in other languages: the example programs have the same answers as texclass."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from toy_surfaces import SURFACES, recording

from texclass.robot import export_onnx
from texclass.robot.export.sample_graph import recording_of

EXAMPLES = Path(__file__).parents[2] / "examples" / "robot"
ONNXRUNTIME = Path(os.environ.get("ONNXRUNTIME_ROOT", "/usr"))
"""Folder with include/onnxruntime_cxx_api.h and lib/libonnxruntime.so."""


@pytest.fixture(scope="module")
def windows_and_answers(window_model, tmp_path_factory):
    """Return a folder with a model, its metadata and windows, and the answers of texclass."""
    folder = tmp_path_factory.mktemp("windows")
    model = window_model
    exported = export_onnx(model, folder / "windows.onnx", start="samples")
    (folder / "windows.json").write_text(json.dumps(exported.facts), encoding="utf-8")
    recordings = [model.cut(recording(surface, 61))[0] for surface in (*SURFACES, "stranger")]
    windows = np.array([r.acceleration[None] for r in recordings], dtype="<f4")
    windows.tofile(folder / "windows.f32")
    return folder, [model.answer(recording_of(model, window)) for window in windows]


def run(command, folder):
    with (folder / "windows.f32").open("rb") as samples:
        process = subprocess.run(
            command, stdin=samples, capture_output=True, text=True, cwd=folder, check=False
        )
    assert process.returncode == 0, process.stderr
    return [line.split("\t") for line in process.stdout.splitlines()]


def assert_answers(lines, answers):
    assert [line[0] for line in lines] == [answer.surface for answer in answers]
    assert [line[3:] == ["unknown"] for line in lines] == [answer.unknown for answer in answers]
    for line, answer in zip(lines, answers, strict=True):
        assert float(line[1]) == pytest.approx(answer.probability, abs=1e-6)
        assert float(line[2]) == pytest.approx(answer.p_known, abs=1e-9)
    assert {answer.unknown for answer in answers} == {True, False}


def test_the_program_in_node_has_the_same_answers_and_a_self_check(windows_and_answers):
    process = subprocess.run(
        ["node", "-e", "require('onnxruntime-node')"], capture_output=True, check=False
    ) if shutil.which("node") else None  # fmt: skip
    if process is None or process.returncode:
        pytest.skip("Node with onnxruntime-node is not installed (see $NODE_PATH)")
    folder, answers = windows_and_answers
    program = ["node", str(EXAMPLES / "surface.cjs"), "windows.onnx"]
    assert_answers(run(program, folder), answers)
    assert run([*program, "windows.json"], folder) == [["8 checks with the stored answers"]]
    facts = json.loads((folder / "windows.json").read_text(encoding="utf-8"))
    facts["self_check"][3]["gain"] *= 1.5
    facts["self_check"][3]["smooth"] *= 0.9
    (folder / "others.json").write_text(json.dumps(facts), encoding="utf-8")
    command = [*program, "others.json"]
    process = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    assert process.returncode == 1
    assert process.stderr.startswith("error: check 3 gives")


def test_the_program_in_cpp_has_the_same_answers(windows_and_answers, tmp_path):
    headers, libraries = ONNXRUNTIME / "include", ONNXRUNTIME / "lib"
    if shutil.which("g++") is None or not (headers / "onnxruntime_cxx_api.h").exists():
        pytest.skip("g++ or the headers of ONNX Runtime are not installed (see $ONNXRUNTIME_ROOT)")
    folder, answers = windows_and_answers
    program = tmp_path / "surface"
    subprocess.run(
        ["g++", "-std=c++17", str(EXAMPLES / "surface.cpp"), "-I", str(headers), "-L", str(libraries),
         "-lonnxruntime", f"-Wl,-rpath,{libraries}", "-o", str(program)],
        check=True,
    )  # fmt: skip
    assert_answers(run([str(program), "windows.onnx"], folder), answers)
