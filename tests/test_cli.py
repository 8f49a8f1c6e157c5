import gc
import inspect
import io
import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import typer
from toy_noises import TINY

from texclass import __version__
from texclass.cli import app, main
from texclass.cli.app import GROUPS
from texclass.loaders import load_recording

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


COMMANDS = typer.main.get_command(app)


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


def test_version_and_help_import_nothing_heavy():
    heavy = ["numpy", "scipy", "pandas", "sklearn", "numba", "librosa", "matplotlib", "pyarrow"]
    code = (
        "import sys\nfrom texclass.cli import main\n"
        "for sys.argv in (['texclass', '--help'], ['texclass', 'benchmark', '--help']):\n"
        "    try:\n        main()\n    except SystemExit:\n        pass\n"
        f"sys.exit(str([m for m in {heavy} if m in sys.modules] or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 or done.stderr.strip() == "", done.stderr
    assert "benchmark" in done.stdout


def test_options_are_told_where_python_keeps_no_docstrings():
    words = [sys.executable, "-OO", "-m", "texclass", "train", "--help"]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert "-o, --output" in told
    assert "Model file to write (.skops)." in " ".join(told.split())


def test_a_command_seldom_looks_for_garbage_and_leaves_none_to_look_for_at_its_end(monkeypatch):
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


def test_what_an_output_cannot_show_is_left_out_of_it(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "ascii"))
    monkeypatch.setattr(sys, "argv", ["texclass", "features"])
    with pytest.raises(SystemExit) as ended:
        main()
    sys.stdout.flush()
    assert not ended.value.code
    assert b"hardness" in written.getvalue()
    assert b"?" in written.getvalue()


LISTED = {
    f"{group}{name}": command
    for group, of in (("", COMMANDS), *((f"{g} ", COMMANDS.commands[g]) for g in ("datasets", "scene")))
    for name, command in of.commands.items()
    if not command.hidden and name != "scene"
}


def test_help_lists_every_command_under_a_heading():
    listed = [name for names in GROUPS.values() for name in names]
    shown = {name for name, command in COMMANDS.commands.items() if not command.hidden}
    assert len(listed) == len(set(listed))
    assert set(listed) == shown


@pytest.mark.parametrize("name", LISTED)
def test_options_mean_one_thing_and_each_help_has_an_example(name):
    command = LISTED[name]
    options = {spelled: p for p in command.params for spelled in p.opts}
    assert {"--out", "--window", "--rate"}.isdisjoint(options)
    for spelled in {"-o", "--json", "--jsonl"} & set(options):
        takes = {"-o": ("output", True), "--json": ("json", True), "--jsonl": ("jsonl", False)}[spelled]
        assert ((f"--{takes[0]}" in options[spelled].opts), not options[spelled].is_flag) == (True, takes[1])
    assert [p.name for p in command.params if not (p.help or p.hidden)] == []
    example = command.epilog.removeprefix("Example: ")
    assert example.startswith(f"texclass {name}")
    assert {word for word in example.split() if word.startswith("--")} <= set(options)


@pytest.mark.parametrize(
    ("shell", "asked", "offered"),
    [
        ("bash", {"COMP_WORDS": "texclass bench", "COMP_CWORD": "1"}, "benchmark"),
        ("bash", {"COMP_WORDS": "texclass benchmark sim", "COMP_CWORD": "2"}, "simulated"),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "texclass extract --feat"}, "--features"),
    ],
)
def test_a_shell_is_offered_what_begins_so(command, monkeypatch, shell, asked, offered):
    for name, value in (("_TEXCLASS_COMPLETE", f"complete_{shell}"), *asked.items()):
        monkeypatch.setenv(name, value)
    assert offered in command()[1]


def test_a_missing_unit_is_said_before_anything_heavy_is_imported(tmp_path):
    (tmp_path / "oak").mkdir()
    (tmp_path / "oak" / "a.txt").write_text("1\n2\n")
    code = (
        "import sys\nfrom texclass.cli import main\ntry:\n    main()\nexcept SystemExit:\n"
        "    sys.exit(str([m for m in ('scipy', 'sklearn', 'numba', 'librosa') if m in sys.modules]))"
    )
    asked = [sys.executable, "-c", code, "train", tmp_path, "-o", "model.skops"]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1] == "[]"
    assert "unit is missing" in done.stderr


def test_benchmark_prints_the_table_and_writes_its_report(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    told = ("--pipeline", "few.toml", "--folds", "4", "--jobs", "1")
    code, out, _ = run("benchmark", "tiny.toml", *told, "--output", "here", "--json", "here/x.json")
    assert code == 0
    assert "Level" in out
    (row,) = json.loads((tmp_path / "here" / "x.json").read_text())["rows"]
    assert list(row["accuracy"]) == ["bayes"]
    written = {path.suffix for path in (tmp_path / "here").iterdir()}
    assert {".json", ".md", ".png"} <= written


def test_benchmark_of_touches_reports_windows_and_the_vote_of_each_run(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    told = ("--touch", "0.5", "--touches", "2", "--protocol", "run", "--folds", "4", "--jobs", "1")
    told = (*told, "--pipeline", "few.toml")
    code, out, _ = run("benchmark", "tiny.toml", *told, "--output", "here", "--json", "x.json")
    assert code == 0
    assert "24 windows of 12 recordings" in out
    result = json.loads((tmp_path / "x.json").read_text())
    accuracy = result["rows"][0]["accuracy"]["bayes"]
    assert accuracy["interval"].endswith("over runs")
    assert {"mean", "low", "high", "balanced"} <= set(accuracy["per_run"])


def test_extract_writes_a_table_and_reads_it_the_second_time(run, tmp_path):
    code, out, _ = run("extract", "tiny.toml", "-o", "features.parquet", "--jobs", "1")
    assert code == 0
    assert "12 recordings" in out
    first = (tmp_path / "features.parquet").read_bytes()
    assert run("extract", "tiny.toml", "-o", "features.parquet", "--jobs", "1")[0] == 0
    assert (tmp_path / "features.parquet").read_bytes() == first
    frame = pd.read_parquet(tmp_path / "features.parquet")
    assert frame["material"].nunique() == 3


def test_inspect_draws_a_recording_and_says_what_it_found(run, tmp_path):
    rng = np.random.default_rng(1)
    np.savetxt(tmp_path / "oak.txt", rng.standard_normal(20_000))
    code, out, _ = run("inspect", "oak.txt", "--fs", "10000", "--unit", "m/s^2")
    assert code == 0
    assert "movement only" in out
    assert (tmp_path / "oak.inspect.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("inspect", "absent.txt", "--fs", "1000", "--unit", "g"), "absent.txt"),
        (("inspect", "numbers.txt", "--unit", "g"), "--fs"),
        (("benchmark", "empty_folder", "--fs", "1000", "--unit", "g"), "empty_folder"),
        (("benchmark", "tiny.toml"), "has 4 recordings; 10 folds need at least 10 of each"),
        (("benchmark", "tiny.toml", "--touch", "-1"), "-1"),
        (("benchmark", "tiny.toml", "--touches", "2"), "--touch"),
        (("benchmark", "tiny.toml", "--pipeline", "no_such_pipeline"), "no_such_pipeline"),
        (("extract", "tiny.toml", "-o", "x.parquet", "--features", "no_such_set"), "no_such_set"),
    ],
)
def test_bad_input_ends_with_one_line_that_names_it(run, tmp_path, arguments, told):
    (tmp_path / "numbers.txt").write_text("1\n2\n3\n4\n")
    (tmp_path / "empty_folder").mkdir()
    code, _, err = run(*arguments)
    assert code == 1
    assert err.startswith("error: ")
    assert told in err
    assert "Traceback" not in err


def test_one_bad_recording_stops_the_run_unless_it_may_be_skipped(run, tmp_path):
    rng = np.random.default_rng(2)
    for material in ("oak", "felt"):
        folder = tmp_path / "recordings" / material
        folder.mkdir(parents=True)
        for k in range(3):
            np.savetxt(folder / f"{material}_{k}.txt", rng.standard_normal(9_000))
    (tmp_path / "recordings" / "oak" / "oak_1.txt").write_text("0.5\nnan\n0.25\n")
    asked = ("extract", "recordings", "--fs", "10000", "--unit", "g", "-o", "x.parquet", "--jobs", "1")
    code, _, err = run(*asked)
    assert code == 1
    assert "oak_1" in err
    code, out, _ = run(*asked, "--skip-bad")
    assert code == 0
    assert "5 recordings" in out
    assert "left out" in out
    assert "oak_1" in out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--version",), f"texclass {__version__}\n"),
        (("datasets",), "simulated69"),
        (("features",), "waviness"),
        (("features", "texclass"), "waviness"),
    ],
)
def test_listings_name_what_is_shipped(run, words, named):
    code, out, _ = run(*words)
    assert code == 0
    assert named in out


def test_benchmark_trains_on_these_and_tests_on_those(run, tmp_path):
    (tmp_path / "few.toml").write_text(FEW)
    asked = ("benchmark", "tiny.toml", "--pipeline", "few.toml", "--jobs", "1", "--output", "here")
    code, _, said = run(*asked, "--train", "repetition=0-1", "--test", "repetition=3")
    assert code == 0, said
    result = json.loads((tmp_path / "here/tiny-few-repetition-0-1-to-repetition-3.json").read_text())
    assert (result["protocol"], result["n_folds"]) == ("repetition=0-1 -> repetition=3", 1)
    assert np.sum(result["confusion"]["counts"]) == 3
    assert run(*asked, "--leave-out", "operator")[0] == 0
    assert run(*asked, "--protocol", "few-shot", "--shots", "1")[0] == 0
    result = json.loads((tmp_path / "here/tiny-few-few-shot-1.json").read_text())
    assert (result["protocol"], result["n_starts"], result["n_folds"]) == ("few-shot 1", 2, 4)
    for wrong, rule in (
        (("--train", "repetition=0"), "the rule is both"),
        (("--leave-out", "operator", "--protocol", "blocks"), "are alternatives"),
        (("--leave-out", "hand"), "no label of recordings is 'hand'"),
        (("--shots", "1", "--protocol", "blocks"), "but the protocol is not few-shot; the rule is both"),
    ):
        code, _, said = run(*asked, *wrong)
        assert (code, rule in said) == (1, True), said


def test_every_command_that_takes_files_takes_what_says_how_they_are_read(run, tmp_path):
    files = {f"--{name.replace('_', '-')}" for name in inspect.signature(load_recording).parameters}
    files -= {"--path", "--auxiliary", "--topic"}
    of_one_recording = {"inspect", "stream", "describe"}
    commands = {
        name: {flag for option in command.params for flag in option.opts}
        for name, command in COMMANDS.commands.items()
    }
    reading = {name: flags for name, flags in commands.items() if "--column" in flags}
    assert of_one_recording < set(reading)
    for name, taken in reading.items():
        assert files <= taken, name
        assert ("--labels" in taken) == (name not in of_one_recording), name
    for material in ("wood", "steel"):
        (tmp_path / "felt" / material).mkdir(parents=True)
        rows = np.random.default_rng(0).normal(size=(2000, 3))
        np.savetxt(tmp_path / "felt" / material / "r.csv", rows, delimiter=";")
    told = ("--fs", "1000", "--unit", "m/s^2", "--jobs", "1", "--features", "coarse", "-o", "t.parquet")
    code, _, said = run("extract", "felt", *told)
    assert (code, "--column c1,c2,c3" in said) == (1, True)
    code, out, said = run("extract", "felt", *told, "--delimiter", ";", "--column", "1,2,3")
    assert (code, out.startswith("wrote t.parquet: 2 recordings")) == (0, True), said
