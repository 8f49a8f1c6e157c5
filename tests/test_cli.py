import ast
import gc
import inspect
import io
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
import pandas as pd
import pytest
from every_command import COMMANDS, flags
from toy_noises import TINY

from texclass import __version__
from texclass.baselines.comparison import SignalChoice
from texclass.cli import main
from texclass.cli.parameters import reader_settings
from texclass.evaluation.protocols import PROTOCOLS
from texclass.evaluation.workers import Backend
from texclass.loaders import load_recording
from texclass.recognition.answers import Kind
from texclass.robot.export.onnx_file import Start
from texclass.stability.battery import Group

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


ROOT = Path(__file__).parents[1]
READERS = {
    name: command for name, command in COMMANDS.items() if any(p.name == "column" for p in command.params)
}
"""Commands that read files of recordings."""
SCIENTIFIC = ("numpy", "scipy", "pandas", "sklearn", "numba", "librosa", "matplotlib", "pyarrow")


def imported(*calls):
    """Run the command line in a new process; give output, errors and the scientific packages it imported."""
    code = (
        "import sys\nfrom texclass.cli import main\n"
        f"for words in {[[*map(str, words)] for words in calls]}:\n"
        "    sys.argv = ['texclass', *words]\n"
        "    try:\n        main()\n    except SystemExit as ended:\n        print('exit code', ended.code)\n"
        f"print([name for name in {SCIENTIFIC} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *lines, packages = done.stdout.splitlines()
    return lines, done.stderr, ast.literal_eval(packages)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def run(command, monkeypatch, tmp_path, cache):
    """Run the command line in an empty folder; give exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(cache))
    (tmp_path / "tiny.toml").write_text(TINY)
    return command


def test_help_imports_nothing_scientific():
    lines, _, packages = imported(*([*name.split(), "--help"] for name in ("", *COMMANDS)))
    assert lines.count("exit code 0") == 1 + len(COMMANDS)
    assert packages == []


WRONG_OPTIONS = {
    "benchmark --train repetition=1": "--train and --test must be given together",
    "benchmark --leave-out operator --protocol chronological": "only one of --protocol",
    "train d -o m.skops --shots 1 --protocol chronological": "--shots requires --protocol few-shot",
    "tradeoff --shots 1": "--shots requires --protocol few-shot",
    "benchmark --max-windows 2": "--max-windows requires --window",
    "benchmark --baseline mfcc": "--baseline requires --baselines",
    "benchmark --baselines --feature a:b": "only one of --baselines and --feature",
    "benchmark --confusion c.csv --feature a:b": "--confusion cannot be combined with --feature",
    "benchmark --scheduler tcp://nowhere:8786": "--scheduler requires --backend dask",
    "extract d -o x.csv --scheduler tcp://nowhere:8786": "--scheduler requires --backend dask",
    "tradeoff --scheduler tcp://nowhere:8786": "--scheduler requires --backend dask",
    "extract d -o x.csv --partition-format csv": "--partition-format requires --partition",
    "stream m.skops --diagnostics /d": "--diagnostics requires --publish",
    "stream m.skops --gesture-time tap": "--gesture-time must have the form NAME=NUMBER, got 'tap'",
    "export m.skops": "pass --output to write an ONNX file, or --check",
    "export m.skops -o m.onnx --window 1": "--window requires --from samples",
    "convert a.texture -o b.texture --scale rough": "--scale must have the form NAME=NUMBER",
    "benchmark --protocol random": "'random' is not one of",
    "stability --only lattice": "'lattice' is not one of",
}
"""Part of the message, by arguments."""


@pytest.mark.parametrize("arguments", WRONG_OPTIONS)
def test_wrong_options_end_with_exit_code_2_and_name_the_options(command, arguments):
    code, out, err = command(*arguments.split())
    assert (code, out) == (2, "")
    assert WRONG_OPTIONS[arguments] in " ".join(err.replace("│", " ").split())


def test_invalid_options_and_a_missing_unit_are_reported_before_slow_imports(tmp_path):
    lines, _, packages = imported(*map(str.split, WRONG_OPTIONS))
    assert (lines, packages) == (["exit code 2"] * len(WRONG_OPTIONS), [])
    (tmp_path / "oak").mkdir()
    (tmp_path / "oak" / "a.txt").write_text("1\n2\n")
    lines, errors, packages = imported(["train", tmp_path, "-o", "model.skops"])
    assert lines == ["exit code 1"]
    assert "unit is missing" in errors
    assert {"scipy", "sklearn", "numba", "librosa"}.isdisjoint(packages)


def choices(command):
    """Return the choices of each option that has some."""
    kinds = get_type_hints(inspect.unwrap(command.callback)).items()
    literals = {
        name: next((k for k in (kind, *get_args(kind)) if get_origin(k) is Literal), None)
        for name, kind in kinds
    }
    return {name: set(get_args(kind)) for name, kind in literals.items() if kind}


def test_choices_are_those_of_the_library():
    choices_of = {name: choices(command) for name, command in COMMANDS.items()}
    for name in ("benchmark", "train", "tradeoff"):
        assert choices_of[name]["protocol"] == set(PROTOCOLS)
    assert choices_of["stability"]["only"] == set(get_args(Group))
    assert choices_of["stream"]["evidence"] == set(get_args(Kind))
    assert choices_of["benchmark"]["baselines_signals"] == set(get_args(SignalChoice))
    assert choices_of["benchmark"]["backend"] == set(get_args(Backend))
    assert choices_of["export"]["start"] == set(get_args(Start))
    scenes = [path.stem for path in sorted((ROOT / "texclass/haptics/scene/examples").glob("*.toml"))]
    for name in ("scene plan", "scene render", "scene page"):
        assert ", ".join(scenes) in COMMANDS[name].params[0].help


def test_garbage_is_collected_rarely_and_not_at_the_end_of_a_command(monkeypatch):
    before, often = gc.get_threshold(), (700, 10, 10)  # a command in this process may have raised it
    monkeypatch.setattr(sys, "argv", ["texclass", "--version"])
    try:
        gc.set_threshold(*often)
        with pytest.raises(SystemExit):
            main()
        assert gc.get_threshold()[0] >= 100 * often[0]
        assert gc.get_freeze_count() > 10_000
    finally:
        gc.unfreeze()
        gc.set_threshold(*before)


def test_characters_that_an_output_cannot_encode_are_replaced(monkeypatch, tmp_path):
    card = tmp_path / "card.toml"
    card.write_text(TINY.replace("Three simulated surfaces", "Größe"), encoding="utf-8")
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "ascii"))
    monkeypatch.setattr(sys, "argv", ["texclass", "datasets", "show", str(card)])
    with pytest.raises(SystemExit) as ended:
        main()
    sys.stdout.flush()
    assert not ended.value.code
    assert b"Gr??e" in written.getvalue()


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_a_panel_an_example_and_options_with_help_and_kind(name):
    command = COMMANDS[name]
    options = flags(command)
    if " " not in name:
        assert command.rich_help_panel in {"Recordings", "Evaluation", "Models", "Rendering"}
    for flag in {"-o", "--json", "--jsonl"} & set(options):
        takes = {"-o": ("output", True), "--json": ("json", True), "--jsonl": ("jsonl", False)}[flag]
        assert ((f"--{takes[0]}" in options[flag].opts), not options[flag].is_flag) == (True, takes[1])
    for p in command.params:
        assert p.help, p.name
        if p.param_type_name == "option" and not p.is_flag and p.name not in choices(command):
            assert p.metavar == p.metavar.upper(), p.name
    example = command.epilog.removeprefix("Example: ")
    assert example.startswith(f"texclass {name}")
    assert {word for word in example.split() if word.startswith("--")} <= set(options)


@pytest.mark.parametrize("folder", ["docs", "datasets", "texclass"])
def test_every_option_that_a_page_or_a_message_names_exists(folder):
    options = {flag for command in COMMANDS.values() for flag in flags(command)} | {"--help", "--version"}
    options |= {"--rm", "--user"}  # of `docker run`
    options |= {"--table"}  # of `benchmarks/recompute_leaderboard.py`
    options |= {"--system-site-packages", "--from-paths", "--ignore-src"}  # of the README in `ros2`
    # Of chapters, `ros2 topic info` and the program itself.
    options |= {"--out", "--verbose", "--install-completion"}
    files = [path for path in (ROOT / folder).rglob("*.*") if path.suffix in {".md", ".py", ".toml"}]
    named = {
        option
        for path in (ROOT / "README.md", *files)
        for option in re.findall(r"(?<![\w-])(--[a-z]+(?:-[a-z]+)*)", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 20 or folder == "datasets"
    assert named <= options


@pytest.mark.parametrize(
    ("shell", "environment", "completion"),
    [
        ("bash", {"COMP_WORDS": "texclass bench", "COMP_CWORD": "1"}, "benchmark"),
        ("bash", {"COMP_WORDS": "texclass benchmark sim", "COMP_CWORD": "2"}, "simulated"),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "texclass extract --feat"}, "--features"),
    ],
)
def test_names_and_options_are_completed_in_a_shell(command, monkeypatch, shell, environment, completion):
    for name, value in (("_TEXCLASS_COMPLETE", f"complete_{shell}"), *environment.items()):
        monkeypatch.setenv(name, value)
    assert completion in command()[1]


def test_benchmark_prints_the_table_and_writes_its_report(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    options = ("--pipeline", "few.toml", "--folds", "4", "--jobs", "1")
    code, out, _ = run("benchmark", "tiny.toml", *options, "--output", "here", "--json", "here/x.json")
    assert code == 0
    assert "Level" in out
    (row,) = json.loads((tmp_path / "here" / "x.json").read_text())["rows"]
    assert list(row["accuracy"]) == ["bayes"]
    suffixes = {path.suffix for path in (tmp_path / "here").iterdir()}
    assert {".json", ".md", ".png"} <= suffixes


def test_benchmark_of_windows_reports_windows_and_the_vote_of_each_run(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    options = (
        "--window",
        "0.5",
        "--max-windows",
        "2",
        "--protocol",
        "grouped",
        "--folds",
        "4",
        "--jobs",
        "1",
    )
    options = (*options, "--pipeline", "few.toml")
    code, out, _ = run("benchmark", "tiny.toml", *options, "--output", "here", "--json", "x.json")
    assert code == 0
    assert "24 windows of 12 recordings" in out
    result = json.loads((tmp_path / "x.json").read_text())
    accuracy = result["rows"][0]["accuracy"]["bayes"]
    assert accuracy["interval"].endswith("over runs")
    assert {"mean", "low", "high", "balanced"} <= set(accuracy["per_run"])


def test_extract_writes_a_table_and_reads_it_the_second_time(run, tmp_path):
    code, out, _ = run("extract", "tiny.toml", "-o", "features.csv", "--jobs", "1")
    assert code == 0
    assert "12 recordings" in out
    first = (tmp_path / "features.csv").read_bytes()
    assert run("extract", "tiny.toml", "-o", "features.csv", "--jobs", "1")[0] == 0
    assert (tmp_path / "features.csv").read_bytes() == first
    frame = pd.read_csv(tmp_path / "features.csv")
    assert frame["surface"].nunique() == 3


def test_inspect_draws_a_recording_and_prints_its_phases(run, tmp_path):
    rng = np.random.default_rng(1)
    np.savetxt(tmp_path / "oak.txt", rng.standard_normal(20_000))
    code, out, _ = run("inspect", "oak.txt", "--fs", "10000", "--unit", "m/s^2")
    assert code == 0
    assert "movement only" in out
    assert (tmp_path / "oak.inspect.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("inspect", "absent.txt", "--fs", "1000", "--unit", "g"), "absent.txt"),
        (("inspect", "numbers.txt", "--unit", "g"), "--fs"),
        (("benchmark", "empty_folder", "--fs", "1000", "--unit", "g"), "empty_folder"),
        (("benchmark", "tiny.toml"), "has 4 recordings; 10 folds need at least 10 of each"),
        (("benchmark", "tiny.toml", "--window", "-1"), "-1"),
        (("benchmark", "tiny.toml", "--pipeline", "no_such_pipeline"), "no_such_pipeline"),
        (("extract", "tiny.toml", "-o", "x.csv", "--features", "no_such_set"), "no_such_set"),
    ],
)
def test_invalid_input_ends_with_one_line_that_names_it(run, tmp_path, arguments, message):
    (tmp_path / "numbers.txt").write_text("1\n2\n3\n4\n")
    (tmp_path / "empty_folder").mkdir()
    code, _, err = run(*arguments)
    assert code == 1
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("report", "absent.json"),
        ("predict", "absent.skops", "x.csv"),
        ("model", "absent.skops"),
        ("suite", "absent.csv", "--no-run"),
        ("texture", "absent.texture"),
    ],
)
def test_an_absent_file_is_named_with_the_current_folder(arguments, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, errors = command(*arguments)
    file = next(name for name in arguments if name.startswith("absent"))
    assert (code, errors.strip().splitlines()) == (
        1, [f"error: {file} does not exist. Check the path (the current folder is {tmp_path})"]
    )  # fmt: skip


def test_other_errors_of_the_operating_system_start_with_the_file(command, tmp_path):
    code, _, errors = command("report", tmp_path)
    assert (code, errors.strip()) == (1, f"error: {tmp_path}: Is a directory")


def test_an_invalid_recording_stops_the_command_unless_skip_bad_is_set(run, tmp_path):
    rng = np.random.default_rng(2)
    for surface in ("oak", "felt"):
        folder = tmp_path / "recordings" / surface
        folder.mkdir(parents=True)
        for k in range(3):
            np.savetxt(folder / f"{surface}_{k}.txt", rng.standard_normal(9_000))
    (tmp_path / "recordings" / "oak" / "oak_1.txt").write_text("0.5\nnan\n0.25\n")
    arguments = ("extract", "recordings", "--fs", "10000", "--unit", "g", "-o", "x.csv", "--jobs", "1")
    code, _, err = run(*arguments)
    assert code == 1
    assert "oak_1" in err
    code, out, _ = run(*arguments, "--skip-bad")
    assert code == 0
    assert "5 recordings" in out
    assert "left out" in out
    assert "oak_1" in out


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("--version",), f"texclass {__version__}\n"),
        (("datasets",), "simulated69"),
        (("datasets", "show", "simulated6"), "operator-4"),
        (("datasets", "show", "simulated6"), "other operator"),
        (("datasets", "show", "cluster118"), "leave-out direction"),
        (("features",), "waviness"),
        (("features", "texclass"), "waviness"),
    ],
)
def test_listings_contain_shipped_names(run, arguments, name):
    code, out, _ = run(*arguments)
    assert code == 0
    assert name in out


def test_benchmark_uses_the_given_training_set_and_test_set(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    arguments = ("benchmark", "tiny.toml", "--pipeline", "few.toml", "--jobs", "1", "--output", "here")
    code, _, err = run(*arguments, "--train", "repetition=0-1", "--test", "repetition=3")
    assert code == 0, err
    result = json.loads((tmp_path / "here/tiny-few-repetition-0-1-to-repetition-3.json").read_text())
    assert (result["protocol"], result["n_folds"]) == ("repetition=0-1 -> repetition=3", 1)
    assert np.sum(result["confusion"]["counts"]) == 3
    assert run(*arguments, "--leave-out", "operator")[0] == 0
    assert run(*arguments, "--protocol", "few-shot", "--shots", "1")[0] == 0
    result = json.loads((tmp_path / "here/tiny-few-few-shot-1.json").read_text())
    assert (result["protocol"], result["n_starts"], result["n_folds"]) == ("few-shot 1", 2, 4)
    code, _, err = run(*arguments, "--leave-out", "hand")
    assert (code, "the label 'hand'. Expected one of surface, operator, repetition" in err) == (1, True), err


def test_a_card_with_an_unknown_protocol_is_an_error_when_it_is_shown(run, tmp_path):
    protocol = '[[protocols]]\nquestion = "later"\nprotocol = "tomorrow"\n'
    (tmp_path / "odd.toml").write_text((tmp_path / "tiny.toml").read_text() + protocol)
    code, _, err = run("datasets", "show", "odd.toml")
    assert code == 1
    assert "odd.toml: protocols: unknown protocol 'tomorrow'. Expected one of recording, " in err


@pytest.mark.parametrize("name", READERS)
def test_every_reader_option_reaches_the_reader(command, monkeypatch, name):
    options = set(flags(READERS[name]))
    loading = {flag.replace("_", "-") for flag in inspect.signature(load_recording).parameters}
    assert {f"--{option}" for option in loading - {"path", "auxiliary"}} <= options
    without_labels = {"inspect", "stream", "score-stream", "describe", "texture fit"}
    assert ("--labels" in options) == (name not in without_labels)
    values = {
        "fs": 1000.0, "unit": "g", "column": "a, b", "delimiter": "tab", "time_column": "t",
        "time_unit": "ms", "skip_rows": 3, "comment": "!", "topic": "/imu",
    }  # fmt: skip
    settings = {}

    def stop(**options):
        settings.update(reader_settings(**options))
        raise ValueError("stopped")

    monkeypatch.setattr("texclass.cli.parameters.reader_settings", stop)
    options = [word for key, value in values.items() for word in (f"--{key.replace('_', '-')}", value)]
    required = [p.name for p in READERS[name].params if p.required]
    suffixes = {"extract": ".csv", "texture fit": ".texture"}
    files = {"output": ("-o", f"x{suffixes.get(name, '.skops')}"), "intervals": ("--intervals", "x.csv")}
    required = [word for argument in required for word in files.get(argument, ("absent",))]
    code, _, err = command(*name.split(), *required, *options, "--drop-incomplete")
    assert (code, err) == (1, "error: stopped\n")
    expected = values | {"column": ("a", "b"), "delimiter": "\t", "drop_incomplete": True, "resample": None}
    assert settings == expected | ({"unit": None} if name == "stream" else {})  # it passes --unit on its own
