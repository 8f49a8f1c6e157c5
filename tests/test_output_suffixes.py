"""The suffix of an output file decides its format, in every command; others are refused before any work."""

import io
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from every_command import COMMANDS
from PIL import Image
from toy_noises import TINY

from texclass.cli.result_files import write_page
from texclass.evaluation import extract_table
from texclass.features import load_feature_set
from texclass.haptics.exchange import write_wav
from texclass.loaders import open_dataset
from texclass.recognition.model_files import write_model_file
from texclass.robot import export_onnx

PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
EXPECTED = {
    "benchmark output": "a folder",
    "benchmark confusion": ".csv",
    "extract output": ".csv or .parquet",
    "tradeoff output": "a folder",
    "stability output": "a folder",
    "report output": ".html or .htm or .md",
    "score-stream output": "a folder",
    "suite output": "a folder",
    "train output": ".skops",
    "predict confusion": ".csv",
    "predict save": ".skops",
    "adapt output": ".skops",
    "export output": ".onnx",
    "inspect output": " or ".join((*PICTURES, ".html")),
    "card output": ".toml",
    "explore output": "a folder",
    "scene plan output": ".texture",
    "scene plan report": "a folder",
    "scene render output": ".wav",
    "scene page output": ".html",
    "texture fit output": ".texture",
    "texture show page_file": ".html",
    "texture show slider_file": ".html",
    "convert output": ".texture or .xml or .hjif or .ahap or .wav or .h",
}
"""Command and option -> what a message lists; `--json` writes JSON everywhere."""


OUTPUTS = {
    f"{name} {p.name}": (name, p.opts[-1])
    for name, command in COMMANDS.items()
    for p in command.params
    if getattr(p, "rich_help_panel", None) == "Output" and p.metavar in {"FILE", "FOLDER"}
}
"""Command and option -> words of the command, and how the option is spelled."""


@pytest.mark.parametrize("output", OUTPUTS)
def test_each_output_option_refuses_another_suffix_before_any_work(command, tmp_path, monkeypatch, output):
    monkeypatch.chdir(tmp_path)
    name, flag = OUTPUTS[output]
    n_arguments = sum(p.required and p.param_type_name == "argument" for p in COMMANDS[name].params)
    code, out, err = command(*name.split(), *["absent"] * n_arguments, flag, "result.xlsx")
    assert (code, out) == (1, "")
    expected = EXPECTED.get(output, ".json")
    assert err == f"error: cannot write result.xlsx: the suffix is '.xlsx'. Expected {expected}\n"
    assert list(tmp_path.iterdir()) == []


def test_every_output_option_is_found():
    assert set(EXPECTED) <= set(OUTPUTS)
    assert {output.rpartition(" ")[2] for output in OUTPUTS.keys() - EXPECTED} == {"json_file"}


def test_extract_writes_the_format_of_the_suffix_and_resumes_both(command, tmp_path, monkeypatch):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    Path("tiny.toml").write_text(TINY, encoding="utf-8")
    for name in ("x.csv", "x.parquet", "y.CSV"):
        code, out, _ = command("extract", "tiny.toml", "-o", name, "--features", "coarse", "--jobs", "1")
        assert code == 0
        assert f"wrote {name}: 12 recordings" in out
    csv, parquet = pd.read_csv("x.csv"), pd.read_parquet("x.parquet")
    pd.testing.assert_frame_equal(csv, parquet, check_dtype=False)
    assert Path("y.CSV").read_bytes() == Path("x.csv").read_bytes()
    assert not list(tmp_path.rglob("*.parts"))
    with monkeypatch.context() as patch:  # the second time nothing is computed
        patch.setattr("texclass.evaluation.feature_table._compute_missing", None)
        Path("x.csv").unlink()
        assert command("extract", "tiny.toml", "-o", "x.csv", "--features", "coarse", "--jobs", "1")[0] == 0
    pd.testing.assert_frame_equal(pd.read_csv("x.csv"), csv)
    code, _, err = command("extract", "tiny.toml", "-o", "x.csv", "--partition", "4")
    assert (code, err) == (1, "error: cannot write x.csv: the suffix is '.csv'. Expected a folder\n")


def test_inspect_draws_in_the_format_of_the_suffix(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savetxt("oak.txt", np.random.default_rng(1).standard_normal(5000))
    for suffix in PICTURES:
        path = tmp_path / f"oak{suffix.upper()}"
        assert command("inspect", "oak.txt", "--fs", "1000", "--unit", "g", "-o", path)[0] == 0
        if suffix in {".pdf", ".svg"}:
            assert b"%PDF" in path.read_bytes()[:20] or b"<svg" in path.read_bytes()
        else:
            kinds = {"png": "PNG", "webp": "WEBP", "tif": "TIFF", "tiff": "TIFF"}
            assert Image.open(io.BytesIO(path.read_bytes())).format == kinds.get(suffix[1:], "JPEG")


def test_report_writes_html_or_markdown(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = next((Path(__file__).parents[1] / "reports" / "tables").glob("taps5-*.json"))
    for name, start in (("r.html", "<!doctype"), ("r.HTM", "<!doctype"), ("r.md", "#"), ("r.MD", "#")):
        assert command("report", result, "-o", name)[0] == 0
        assert Path(name).read_text(encoding="utf-8").lower().lstrip().startswith(start)


def test_json_and_confusion_may_have_no_suffix(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savetxt("oak.txt", np.random.default_rng(1).standard_normal(5000))
    code, _, err = command(
        "describe", "oak.txt", "--fs", "1000", "--unit", "g", "--json", "felt", "--jobs", "1"
    )
    assert (code, err) == (0, "")
    assert json.loads(Path("felt").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "write",
    [
        lambda path: extract_table(open_dataset("simulated"), load_feature_set("coarse"), path),
        lambda path: write_page([], path),
        lambda path: write_model_file(path, {}, None, is_arrays=True),
        lambda path: export_onnx(None, path),
        lambda path: write_wav(path, np.ones(10), 1000, unit="g"),
    ],
)
def test_python_functions_refuse_another_suffix(tmp_path, write):
    with pytest.raises(ValueError, match=r"cannot write .*x\.xlsx: the suffix is '\.xlsx'\. Expected \."):
        write(tmp_path / "x.xlsx")
