"""The options --json, --output and --resample mean the same in every command."""

import json
from pathlib import Path

import numpy as np
import pytest
from every_command import COMMANDS, flags
from toy_noises import TINY
from toy_surfaces import FS, recording

from texclass.haptics.exchange import load_texture, save_texture
from texclass.haptics.textures import pack

RESULT = Path(__file__).parent / "reporting" / "data" / "benchmark.json"
LEADERBOARD = Path(__file__).parents[1] / "reports" / "leaderboard" / "leaderboard.csv"
FEW = """
features = "coarse"
seed = 1
channels = "combine"
[[steps]]
use = "sklearn.impute.SimpleImputer"
keep_empty_features = true
[classifiers.bayes]
use = "sklearn.naive_bayes.GaussianNB"
[[rows]]
name = "Level"
features = ["band_level"]
"""
SCENE = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[motion]
speeds_mm_s = [60, 120]
forces_n = [0.8, 1.2]
[tolerance]
score = "log_spectral_db"
limit = 4
[budget]
microseconds = 1e6
bytes = 1_000_000
contacts = 2
[surfaces.wood]
simulated = "abdulali2016/S8"
friction = 0.4
"""
SIGNAL = ("--fs", str(FS), "--unit", "m/s^2")
JSON_CALLS = {
    "benchmark": ("tiny.toml", "--pipeline", "few.toml", "--folds", "2", "--jobs", "1"),
    "tradeoff": ("tiny.toml", "--features", "coarse", "--no-curves", "--max-features", "2", "--jobs", "1"),
    "stability": ("--quick", "--only", "transforms"),
    "report": ("a.json", "a.json", "--compare"),
    "suite": (str(LEADERBOARD), "--no-run"),
    "model": ("model.skops",),
    "predict": ("model.skops", "signal.txt", *SIGNAL),
    "stream": ("model.skops", "signal.txt", *SIGNAL),
    "score-stream": ("model.skops", "signal.txt", *SIGNAL, "--intervals", "intervals.csv"),
    "export": ("model.skops", "-o", "model.onnx"),
    "describe": ("signal.txt", *SIGNAL, "--references", "tiny.toml", "--jobs", "1"),
    "scene plan": ("small.toml",),
    "texture show": ("a.texture",),
    "texture fit": (
        "stroke.csv",
        *SIGNAL,
        "--column",
        "a",
        "--speed-column",
        "v",
        "--force-column",
        "f",
        "-o",
        "b.texture",
    ),
}
"""Arguments of each command with --json."""
IDENTICAL = ("--json", "--jsonl", "--resample", "--topic", "--skip-rows", "--jobs", "--labels")


@pytest.mark.parametrize("flag", IDENTICAL)
def test_an_option_has_the_same_description_in_every_command(flag):
    options = [flags(command)[flag] for command in COMMANDS.values() if flag in flags(command)]
    assert len(options) > 1
    for attribute in ("metavar", "help", "is_flag", "multiple", "opts", "rich_help_panel"):
        assert len({str(getattr(option, attribute, None)) for option in options}) == 1, attribute


@pytest.mark.parametrize("name", COMMANDS)
def test_output_is_a_checked_file_or_folder_and_stands_in_the_panel_of_outputs(name):
    options = flags(COMMANDS[name])
    assert ("-o" in options) == ("--output" in options)
    for flag in {"--output", "--json"} & set(options):
        assert options[flag].metavar in ("FILE", "FOLDER")
        assert options[flag].rich_help_panel == "Output"
    if options.get("-o"):
        assert options["-o"] is options["--output"]
        assert options["-o"].help.split()[0] not in ("Also", "With")


def test_every_command_that_reads_recordings_resamples_them():
    readers = {name for name, command in COMMANDS.items() if {"--fs", "--unit"} <= set(flags(command))}
    assert readers == {name for name, command in COMMANDS.items() if "--resample" in flags(command)}
    assert {"extract", "benchmark", "train", "predict", "stream", "adapt", "convert"} <= readers


def test_every_command_with_json_is_called_below():
    assert set(JSON_CALLS) == {name for name, command in COMMANDS.items() if "--json" in flags(command)}


@pytest.fixture
def folder(tmp_path, monkeypatch, kernel_model):
    """Folder with a dataset card, a pipeline, a recording, a stroke with speed, a model and a texture."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    (tmp_path / "few.toml").write_text(FEW)
    (tmp_path / "small.toml").write_text(SCENE)
    kernel_model.save(tmp_path / "model.skops")
    one = recording(kernel_model.surfaces[0], 1)
    x = one.acceleration.ravel()
    np.savetxt("signal.txt", x, fmt="%.6f")
    y = np.random.default_rng(0).standard_normal(int(6 * FS))
    (tmp_path / "intervals.csv").write_text(f"start_s,end_s,surface\n0,0.5,{one.surface}\n")
    stroke = np.column_stack([y, np.linspace(50, 150, y.size), np.ones(y.size)])
    np.savetxt("stroke.csv", stroke, delimiter=",", header="a,v,f", comments="", fmt="%.6f")
    save_texture(pack(one, 64), tmp_path / "a.texture")
    result = json.loads(RESULT.read_text())
    tests = {"folds_hash": "0", "recordings": [["r"], ["s"]], "units": None, "n_train": [1, 1]}
    result["tests"] = tests | {"hits": {"best": ["1", "0"]}}
    (tmp_path / "a.json").write_text(json.dumps(result))
    return tmp_path


@pytest.mark.parametrize("name", JSON_CALLS)
def test_json_to_standard_output_is_one_object_and_text_goes_to_standard_error(name, folder, command):
    if name == "export":
        pytest.importorskip("skl2onnx")
    code, out, err = command(*name.split(), *JSON_CALLS[name], "--json", "-")
    assert code == 0, err
    assert isinstance(json.loads(out), dict)
    assert err


def test_report_compares_two_results_and_refuses_others(folder, command):
    code, out, _ = command("report", "a.json", "a.json", "--compare", "-o", "page.html", "--json", "c.json")
    assert code == 0
    assert "No setting, version or code has changed." in out
    assert "wrote page.html" in out
    assert "Comparison of two results" in (folder / "page.html").read_text()
    assert command("report", "c.json", "-o", "again.md")[0] == 0
    assert "# Comparison of two results" in (folder / "again.md").read_text()
    code, _, err = command("report", "a.json", RESULT, "--compare")
    assert (code, f"{RESULT} contains no predictions" in err) == (1, True)
    broken = json.loads((folder / "a.json").read_text())
    broken["tests"]["recordings"] = 3
    (folder / "broken.json").write_text(json.dumps(broken))
    code, _, err = command("report", "a.json", "broken.json", "--compare")
    assert (code, "the result is damaged" in err) == (1, True)
    assert command("report", "a.json", "--compare")[0] == 2
    assert command("report", "a.json", "--json", "x.json")[0] == 2


def test_convert_resamples_a_recording_and_rejects_other_sources(folder, command):
    assert (
        command("convert", "signal.txt", *SIGNAL, "--bytes", 64, "--resample", 2000, "-o", "p.texture")[0]
        == 0
    )
    assert load_texture(folder / "p.texture").fs == 2000
    code, _, err = command("convert", "a.texture", "-o", "b.wav", "--resample", 1000)
    assert (code, "--resample applies to a recording" in " ".join(err.split())) == (2, True)
