"""The commands train, predict, model and adapt."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.signal import lfilter
from toy_surfaces import FS, STRANGER, SURFACES, signal

from texclass.recognition import load_model, predict, train

PIPELINE = """
features = "few_features.toml"
seed = 1
[[steps]]
use = "sklearn.impute.SimpleImputer"
strategy = "median"
keep_empty_features = true
[[steps]]
use = "sklearn.preprocessing.StandardScaler"
[classifiers.lda]
use = "sklearn.discriminant_analysis.LinearDiscriminantAnalysis"
solver = "lsqr"
shrinkage = 0.1
[[rows]]
name = "Spectrum"
features = ["mfcc"]
[[rows]]
name = "Roughness"
features = ["temporal_roughness"]
"""


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """Return a folder of recordings in ADC counts with an offset, and its dataset card."""
    folder = tmp_path_factory.mktemp("work")
    (folder / "few.toml").write_text(PIPELINE)
    (folder / "few_features.toml").write_text("[features.mfcc]\n[features.temporal_roughness]\n")
    for surface, hum_hz in (*SURFACES.items(), ("stranger", STRANGER)):
        subfolder = folder / ("plates" if surface in SURFACES else "") / surface
        subfolder.mkdir(parents=True)
        for seed in range(8):
            codes = 2000 * signal(hum_hz, [*map(ord, surface), seed]) + 900
            name = subfolder / f"{surface}_{seed}.wav"
            soundfile.write(name, codes.clip(-32768, 32767).astype(np.int16), round(FS), subtype="PCM_16")
    (folder / "plates.toml").write_text(
        'title = "Plates"\nsource = "a test"\nlicence = "MIT"\nformat = "files"\nfolder = "plates"\n'
        'fs_hz = 4000\nunit = "counts"\nphases = "movement"\nremove_resting_level = true\n'
        "files = '(?P<surface>\\w+)/(?P<recording>\\w+_(?P<repetition>\\d+))\\.wav'\n"
    )
    return folder


@pytest.fixture
def run(command, work, monkeypatch):
    """Return a function that runs the command line in the folder of the recordings."""
    monkeypatch.chdir(work)
    return command


@pytest.fixture
def trained(run, work):
    if not (work / "surface.skops").exists():
        arguments = "train plates.toml -o surface.skops --pipeline few.toml --row Spectrum --jobs 1"
        code, out, err = run(*arguments.split())
        assert (code, err) == (0, "")
        assert "wrote surface.skops" in out
        assert "few: Spectrum with lda" in out
    return work / "surface.skops"


def test_files_are_read_as_the_training_files_were(run, trained):
    files = [f"plates/{surface}/{surface}_3.wav" for surface in SURFACES]
    code, out, err = run("predict", trained.name, *files, "--jsonl")
    answers = [json.loads(line) for line in out.splitlines()]
    assert (code, err) == (0, "")
    assert [answer["surface"] for answer in answers] == list(SURFACES)
    for answer, file in zip(answers, files, strict=True):
        assert answer["file"] == file
        assert set(answer) >= {"surface", "probability", "runner_up", "unknown", "reasons"}
        assert answer["probability"] > 0.9
    # The same recordings of the card have the same answers.
    code, out, _ = run("predict", trained.name, *(f"plates.toml:{s}_3" for s in SURFACES), "--jsonl")
    by_card = [json.loads(line) for line in out.splitlines()]
    assert [a["probability"] for a in by_card] == [a["probability"] for a in answers]
    # --json writes all answers into one file.
    out = run("predict", trained.name, *files, "--json", "answers.json")[1]
    assert "oak" in out
    assert json.loads(Path("answers.json").read_text(encoding="utf-8"))["recordings"] == answers


def test_functions_train_and_predict_as_the_commands_do(run, trained):
    loaded, model = load_model(trained), train("plates.toml", "few.toml", row="Spectrum")
    assert model.manifest.model_copy(update={"cost": loaded.manifest.cost}) == loaded.manifest
    files = [f"plates/{surface}/{surface}_3.wav" for surface in SURFACES]
    answers = model.predict(files)
    assert [answer.surface for answer in answers] == list(SURFACES)
    assert answers == [prediction.answer for prediction in predict(loaded, files)]
    assert model.predict(files[0]) == answers[0]


def test_a_file_of_another_format_is_read_with_options(run, trained, work):
    samples, _ = soundfile.read(work / "plates/oak/oak_3.wav", dtype="int16")
    columns = [np.arange(len(samples)) / FS, np.zeros(len(samples)), samples]
    np.savetxt(work / "odd.csv", np.column_stack(columns), delimiter=";")
    options = ("--delimiter", ";", "--column", "3", "--time-column", "1")
    answers = [
        json.loads(run("predict", trained.name, *arguments, "--jsonl")[1])
        for arguments in (("odd.csv", *options), ("plates/oak/oak_3.wav",))
    ]
    assert answers[0]["probability"] == pytest.approx(answers[1]["probability"], rel=1e-6)
    soundfile.write(work / "dense.wav", np.repeat(samples, 2), 2 * round(FS))
    answer = json.loads(run("predict", trained.name, "dense.wav", "--resample", "4000", "--jsonl")[1])
    assert answer["surface"] == "oak"
    assert not any("wrong rate" in reason for reason in answer["reasons"])


def test_an_untrained_surface_is_reported_as_unknown(run, trained):
    code, out, _ = run("predict", trained.name, "stranger/stranger_1.wav", "plates/oak/oak_1.wav")
    assert code == 0
    assert "unknown (nearest:" in " ".join(out.split())
    assert "unlike every" in out


def test_invalid_files_are_named_and_the_others_predicted(run, trained, work):
    (work / "empty.wav").write_bytes(b"")
    files = ["empty.wav", "none.wav", "plates/oak/oak_2.wav"]
    code, out, err = run("predict", trained.name, *files)
    assert code == 1
    assert "oak" in out
    assert "error: empty.wav: " in err
    assert "error: none.wav: " in err
    code, out, _ = run("predict", trained.name, *files, "--jsonl", "--skip-bad")
    lines = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert ["error" in line for line in lines] == [True, True, False]


def test_the_model_card_is_shown_as_text_and_json(run, trained):
    code, out, _ = run("model", trained.name, "--json", "-")
    manifest = json.loads(out)
    assert code == 0
    assert manifest["surfaces"] == sorted(SURFACES)
    assert manifest["input"]["unit"] == "counts"
    assert manifest["input"]["remove_resting_level"] is True
    assert {"scikit-learn", "skops", "texclass"} <= set(manifest["versions"])
    _, out, _ = run("model", trained.name)
    for word in (
        "cork, felt, oak, slate",
        "mfcc",
        "Accuracy",
        "false alarms",
        "ms per recording (segmentation",
        "scikit-learn",
    ):
        assert word in " ".join(out.split())


TRAIN = "train plates.toml -o m.skops --pipeline"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("model none.skops", "does not exist"),
        ("model few.toml", "few.toml: it is truncated or not an archive"),
        (f"{TRAIN} few.toml --row x", "no row 'x'"),
        (f"{TRAIN} nothing", "nothing is neither a TOML file"),
    ],
)
def test_invalid_input_gives_one_line(run, work, arguments, message):
    code, _, err = run(*arguments.split())
    assert code == 1
    assert err.startswith("error: ")
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_model_is_adapted_to_files_and_folders_of_another_sensor(run, trained, work):
    """The sensor has twice the rate and a soft mount; the adapted model resamples files."""
    for surface, hum_hz in SURFACES.items():
        (work / "new" / surface).mkdir(parents=True)
        for k in range(20, 24):
            dense = np.repeat(signal(hum_hz, [*map(ord, surface), k]), 2)
            soft = np.convolve(dense, np.full(6, 1 / 6), "same")
            name = work / "new" / surface / f"{surface}_{k}.wav"
            soundfile.write(name, (2000 * soft).astype(np.int16), 2 * round(FS), subtype="PCM_16")
    files = [f"new/{surface}/{surface}_23.wav" for surface in SURFACES]
    three = [f"{surface}=new/{surface}/{surface}_20.wav" for surface in list(SURFACES)[:3]]
    code, out, err = run("adapt", trained.name, *three, "--resample", "4000", "-o", "adapted.skops")
    assert (code, err) == (0, "")
    assert "adapted to 3 references, 3 labelled, 3 surfaces" in out
    assert "wrote adapted.skops" in out
    answers = [
        json.loads(line) for line in run("predict", "adapted.skops", *files, "--jsonl")[1].splitlines()
    ]
    assert [answer["surface"] for answer in answers] == list(SURFACES)
    assert not any("wrong rate" in reason for answer in answers for reason in answer["reasons"])
    assert "3 references" in " ".join(run("model", "adapted.skops")[1].split())
    # Surfaces are the names of subfolders, unless they are ignored by --unlabelled.
    folder = ("adapt", trained.name, "new", "--fs", "8000", "--resample", "4000", "-o", "adapted.skops")
    assert "16 references, 16 labelled, 4 surfaces" in run(*folder)[1]
    assert "16 references, unlabelled" in run(*folder, "--unlabelled")[1]
    for references, message in (
        (["tin=new/oak/oak_20.wav", *three], "surface 'tin' is not in the model. Expected one"),
        (["oak=nothing.wav"], "nothing.wav"),
        (["new/nothing.wav"], "nothing.wav"),
    ):
        code, _, err = run("adapt", trained.name, *references, "--resample", "4000", "-o", "no.skops")
        assert (code, message in err, len(err.splitlines())) == (1, True, 1), err
    assert not Path("no.skops").exists()
    code, _, err = run("adapt", trained.name, *three, "-o", "no.skops")
    assert (code, "--resample 4000 converts" in err) == (1, True), err


@pytest.fixture
def later(work):
    """Folder of later recordings: the mount of the sensor now resonates at 191 Hz."""
    resonance = [1, -2 * 0.97 * np.cos(0.3), 0.97**2]
    for surface, hum_hz in SURFACES.items():
        (work / "later" / surface).mkdir(parents=True, exist_ok=True)
        for k in range(30, 36):
            changed = lfilter([1], resonance, signal(hum_hz, [*map(ord, surface), k]))
            name = work / "later" / surface / f"{surface}_{k}.wav"
            samples = (2000 * changed / changed.std()).astype(np.int16)
            soundfile.write(name, samples, round(FS), subtype="PCM_16")
    return "later"


def test_drift_is_reported_in_one_line_and_in_json(run, trained, later):
    code, _, err = run("predict", trained.name, later, "--json", "answers.json")
    assert code == 0
    assert len(err.splitlines()) == 1
    assert err.startswith("drift: features have shifted as a whole, for ")
    assert "Adapt the model with --adapt, or with 'texclass adapt MODEL FOLDER --unlabelled'" in err
    written = json.loads(Path("answers.json").read_text(encoding="utf-8"))
    assert written["drift"]["is_detected"]
    assert written["drift"]["shift"]["n_shifted"] > 0
    assert (len(written["recordings"]), written["adapted"]) == (6 * len(SURFACES), {})
    lines = run("predict", trained.name, later, "--jsonl")[1].splitlines()
    assert [json.loads(line) for line in lines[:-1]] == written["recordings"]
    assert json.loads(lines[-1])["drift"] == written["drift"]
    # The recordings of the training set have not shifted.
    code, out, err = run("predict", trained.name, "plates", "--jsonl")
    assert (code, err) == (0, "")
    assert all("file" in json.loads(line) for line in out.splitlines())


def test_predict_adapts_the_model_to_the_recordings(run, trained, later):
    def share_correct(*arguments):
        answers = run("predict", *arguments, later, "--json", "answers.json")
        written = json.loads(Path("answers.json").read_text(encoding="utf-8"))
        hits = [a["surface"] == a["true_surface"] and not a["unknown"] for a in written["recordings"]]
        return np.mean(hits), written, answers[2]

    before = share_correct(trained.name)[0]
    after, written, err = share_correct(trained.name, "--adapt", "--save", "later.skops")
    assert before < 0.8
    assert after > 0.9
    assert written["adapted"]["map"] in ("affine", "shift")
    adapted_to, wrote = err.splitlines()
    assert adapted_to.startswith(f"adapted to {6 * len(SURFACES)} references, unlabelled (")
    assert "standard deviations within a surface (median; largest" in adapted_to
    assert wrote.startswith("wrote later.skops")
    again, saved, err = share_correct("later.skops")
    assert (again, saved["recordings"], err) == (after, written["recordings"], "")
    assert "standard deviations within a surface" in " ".join(run("model", "later.skops")[1].split())
    # An adapted model cannot be adapted again, and one surface is not enough.
    assert "is already adapted" in run("predict", "later.skops", later, "--adapt")[2]


def test_predict_does_not_adapt_to_one_surface(run, trained, later):
    files = [f"later/oak/oak_{k}.wav" for k in range(30, 36)] * 2
    code, out, err = run("predict", trained.name, *files, "--adapt", "--jsonl")
    assert (code, len(err.splitlines())) == (0, 1)
    assert err.startswith("not adapted, the answers are those of the original model: ")
    assert "cannot be separated" in err
    expected = run("predict", trained.name, *files, "--jsonl")[1].splitlines()
    assert out.splitlines()[: len(files)] == expected
    assert run("predict", trained.name, *files, "--save", "no.skops")[0] == 2
    assert not Path("no.skops").exists()


def test_a_folder_is_predicted_with_accuracy_and_confusion_matrix(run, trained, work):
    code, out, err = run("predict", trained.name, "plates", "--confusion", "confusion.csv")
    assert (code, err) == (0, "")
    n = 8 * len(SURFACES)
    assert f"{n} recordings" in out
    assert "accuracy 100.0 [" in out
    lines = (work / "confusion.csv").read_text().splitlines()
    assert lines[0].split(",") == ["true label", *sorted(SURFACES), "unknown"]
    counts = {line.split(",")[0]: list(map(int, line.split(",")[1:])) for line in lines[1:]}
    assert list(counts) == sorted(SURFACES)
    assert all(sum(row) == row[i] == 8 for i, row in enumerate(counts.values()))
    by_card = run("predict", trained.name, "plates.toml", "--jsonl")[1].splitlines()
    by_folder = run("predict", trained.name, "plates", "--jsonl")[1].splitlines()
    assert [json.loads(line)["probability"] for line in by_card] == [
        json.loads(line)["probability"] for line in by_folder
    ]
    assert {json.loads(line)["true_surface"] for line in by_card} == set(SURFACES)


def test_surfaces_that_were_not_trained_are_left_out_of_the_accuracy(run, trained, work):
    mixed = work / "mixed"
    for source in ("stranger/stranger_1.wav", "plates/oak/oak_1.wav", "plates/oak/oak_2.wav"):
        path = mixed / ("new" if "stranger" in source else "oak") / Path(source).name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes((work / source).read_bytes())
    code, out, _ = run("predict", trained.name, "mixed", "--confusion", "mixed.csv")
    text = " ".join(out.split())
    assert code == 0
    assert "accuracy 100.0 [" in text
    assert "on 2 recordings of trained surfaces" in text
    assert "not trained on new: 1 of 1 recording reported as unknown" in text
    assert (work / "mixed.csv").read_text().splitlines()[-1].startswith("new,")


def test_a_folder_of_unlabelled_files_is_predicted_without_accuracy(run, trained, work):
    flat = work / "flat"
    flat.mkdir()
    for surface in SURFACES:
        (flat / f"{surface}.wav").write_bytes((work / f"plates/{surface}/{surface}_4.wav").read_bytes())
    code, out, err = run("predict", trained.name, "flat")
    assert (code, err) == (0, "")
    assert f"{len(SURFACES)} recordings" in out
    assert "accuracy" not in out
    code, _, err = run("predict", trained.name, "flat", "--confusion", "none.csv")
    assert code == 1
    assert "no true surface is known" in err
    assert not (work / "none.csv").exists()
