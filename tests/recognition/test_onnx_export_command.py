"""texclass export, as a user calls it."""

import json
import sys

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import numpy_helper
from toy_surfaces import FS, STRANGER, SURFACES, signal

from texclass.recognition import load_model
from texclass.recognition.export import onnx_file as export


@pytest.fixture
def folder(linear_model, tmp_path, monkeypatch):
    linear_model.save(tmp_path / "surfaces.skops")
    for surface, hum_hz in (*SURFACES.items(), ("stranger", STRANGER)):
        np.savetxt(tmp_path / f"{surface}.txt", signal(hum_hz, [*map(ord, surface), 50]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_exported_file_answers_files_as_predict_does(command, folder):
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 0, err
    assert "no label differs" in out
    assert "wrote surfaces.onnx" in out
    onnx.checker.check_model("surfaces.onnx", full_check=True)
    files = [f"{surface}.txt" for surface in (*SURFACES, "stranger")]
    code, out, err = command("predict", "surfaces.skops", *files, "--fs", str(FS), "--json")
    assert code == 0, err
    answers = [json.loads(line) for line in out.splitlines()]
    session = onnxruntime.InferenceSession("surfaces.onnx", providers=["CPUExecutionProvider"])
    model = load_model("surfaces.skops")
    rows = [model.plan.compute(_segmented(model.manifest.input.find(name, fs=FS))).values for name in files]
    labels, p, p_known, unknown = session.run(None, {"features": np.stack(rows)})
    assert labels.tolist() == [answer["surface"] for answer in answers]
    assert unknown.tolist() == [answer["unknown"] for answer in answers]
    # `predict` prints six digits.
    assert p.max(axis=1).tolist() == pytest.approx([answer["probability"] for answer in answers], abs=1e-6)
    assert p_known.tolist() == pytest.approx([answer["p_known"] for answer in answers], abs=1e-6)


def _segmented(recording):
    from texclass.phases import segment

    return recording.with_(phases=segment(recording))


def test_a_graph_that_differs_is_refused_and_nothing_is_left(command, folder, monkeypatch):
    def tampered(model):
        graph = export_build(model)
        weights = max(graph.graph.initializer, key=lambda c: len(c.raw_data))
        values = numpy_helper.to_array(weights) * (1 + 1e-3)
        weights.CopyFrom(numpy_helper.from_array(values, weights.name))
        return graph

    export_build = export.build
    monkeypatch.setattr(export, "build", tampered)
    before = set(folder.iterdir())
    code, out, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert err.startswith("error: surfaces.onnx: not written: ONNX differs from scikit-learn in")
    assert "the rule is the same label and verdict" in err
    assert not out
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize("missing", ["onnx", "onnxruntime", "skl2onnx"])
def test_a_missing_extra_is_told_how_to_install(command, folder, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    code, _, err = command("export", "surfaces.skops", "-o", "surfaces.onnx")
    assert code == 1
    assert f"needs {missing}, which is not installed: pip install 'texclass[onnx]'" in err
    assert not (folder / "surfaces.onnx").exists()
