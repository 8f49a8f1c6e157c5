"""Parts of the golden record, which `golden_record.py` records and compares."""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

os.environ.setdefault("MPLBACKEND", "agg")

from study import ROOT

sys.path.insert(0, str(ROOT / "examples" / "papers"))
import abdulali2016_simulated
import abdulali2016_study
import guruswamy2011_objects
import numpy as np
import oeztuerk2018_study
import okamura2001_taps
import pandas as pd
import scipy.io
import soundfile

from texclass import cli, vibration
from texclass.evaluation.cost import CostMeter
from texclass.features import FeatureExtractor
from texclass.haptics import exchange
from texclass.haptics.scene import default_path, load_scene, render_path
from texclass.haptics.textures import abdulali2016, guruswamy2011, oeztuerk2018, okamura2001
from texclass.loaders import load_recording, open_dataset
from texclass.phases import find_phases
from texclass.simulate import (
    operator_catalogue,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)
from texclass.stability.inputs import cases_of
from texclass.vibration import scores

SCRATCH = Path(tempfile.gettempdir())
"""Where files are written: `golden_record.py` makes a folder of its own for each run."""
SETS = ("strese2015", "strese2015+models", "texclass", "multiscale", "coarse")
REAL = {"taps5": 5, "lmt_excerpts": 4, "stylus6": 4, "biotac20": 5, "borealtc": 3, "fabric_speeds": 3}
"""Data sets, and how many of their recordings are looked at."""
OWN_FEATURE = '''
import numpy as np
from texclass.features import Gain, feature


@feature(phase="movement", unit="1", reference="crest factor", gain=Gain())
def crest(view):
    """Peak over root mean square of the movement."""
    x = np.asarray(view.samples)
    return np.abs(x).max() / np.sqrt(np.mean(x**2))
'''


def command(*words: object, stdin: bytes = b"") -> str:
    """Run the command line in this process; return its output, or the last message after a failure."""
    out, err = io.StringIO(), io.StringIO()
    streams = {"stdin": io.TextIOWrapper(io.BytesIO(stdin), encoding="utf-8"), "stdout": out, "stderr": err}
    try:
        with mock.patch.multiple(sys, argv=["texclass", *map(str, words)], **streams):
            cli.main()
    except SystemExit as ended:
        if ended.code and not out.getvalue():
            return err.getvalue().strip().splitlines()[-1]
    return out.getvalue()


def result_of(*words: object) -> Any:
    """Return the JSON that a command writes, or how it fails."""
    file = SCRATCH / "result.json"
    file.unlink(missing_ok=True)
    message = command(*words, "--output", SCRATCH / "out", "--json", file)
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else message


def rows_of(lines: str) -> pd.DataFrame:
    """Return the JSON objects of lines as a table."""
    return pd.json_normalize([json.loads(line) for line in lines.splitlines() if line.startswith("{")])


def written(name: str, text: str) -> Path:
    """Write a text file and return its path."""
    path = SCRATCH / name
    path.write_text(text, encoding="utf-8")
    return path


def small() -> Path:
    """Return the card of a small simulated dataset, 4 operators."""
    recipe = "n_surfaces = 6\nn_recordings = 8\nn_operators = 4\nduration_s = 4.0\nfs = 10000\nseed = 12\n"
    return written("small6.toml", f'title = "Small"\nformat = "simulated"\n[recipe]\n{recipe}')


def biotac6() -> Path:
    """Return the card of 6 surfaces of biotac20, 12 repetitions of each."""
    text = (ROOT / "datasets" / "biotac20.toml").read_text(encoding="utf-8")
    files = r"files = '(?P<surface>mat0[1-6])/(?P<recording>mat\\d+_(?P<repetition>0\\d|1[0-2]))\\.wav'"
    return written("biotac.toml", re.sub(r"^files = .*$", files, text, flags=re.MULTILINE))


def spread(name: str | Path, n: int) -> list[Any]:
    """Return `n` recordings spread over a dataset."""
    dataset = open_dataset(name)
    return [dataset[int(i)] for i in np.linspace(0, len(dataset) - 1, n).astype(int)]


def simulated() -> dict[str, list[Any]]:
    """Return simulated recordings: taps, strokes and friction; rising speed, force and taps."""
    plate, mesh = surface_catalogue(5, 3)[:2]
    operator = operator_catalogue(2, 3)[1]
    controlled = [
        record_rising_speed(plate, operator, duration_s=4.0, seed=1),
        record_rising_force(mesh, operator, duration_s=4.0, seed=2),
        record_rising_taps(plate, operator, n_taps=5, seed=3),
        record_rising_taps(mesh, operator, n_taps=3, seed=4),
    ]
    controlled = [recording.with_(recording_id=f"{i}") for i, recording in enumerate(controlled)]
    return {"simulated": spread("simulated", 10), "small": spread(small(), 6), "controlled": controlled}


def real() -> dict[str, list[Any]]:
    """Return real recordings."""
    return {name: spread(name, n) for name, n in REAL.items()}


# Parts ------------------------------------------------------------------------------------------------------


def benchmark(name: str | Callable[[], Path], pipeline: str, *options: object) -> Any:
    """Return the JSON of `texclass benchmark`."""
    dataset = name() if callable(name) else name
    return result_of("benchmark", dataset, "--pipeline", pipeline, "--jobs", 1, *options)


def protocols() -> Any:
    """Return benchmarks of a small dataset: every protocol, nested selection, windows, a new feature."""
    feature = f"{written('own_feature.py', OWN_FEATURE)}:crest"
    return {
        "operator": benchmark(small, "texclass", "--protocol", "operator"),
        "paper": benchmark(small, "strese2015", "--protocol", "paper", "--folds", 4),
        "chronological": benchmark(small, "multiscale", "--protocol", "chronological"),
        "few-shot": benchmark(small, "coarse", "--protocol", "few-shot"),
        "nested cv": benchmark(small, "coarse", "--protocol", "recording", "--folds", 4, "--nested-cv"),
        "windows": benchmark(small, "multiscale", "--window", 0.8, "--max-windows", 2, "--folds", 3),
        "new feature": benchmark(small, "coarse", "--folds", 4, "--feature", feature),
    }


def features(groups: Callable[[], Mapping[str, Sequence[Any]]]) -> Any:
    """Return the feature table of every shipped set; in one, channels are kept apart."""
    tables = {}
    for group, recordings in groups().items():
        for name, channels in [*((name, "combine") for name in SETS), ("texclass", "auto")]:
            table = FeatureExtractor(name, channels=channels).fit(recordings).extract(recordings).table
            tables[f"{group}, {name}, {channels}"] = table
    return tables


def phases(groups: Callable[[], Mapping[str, Sequence[Any]]]) -> Any:
    """Return phases as declared by the dataset card, and as segmented without a declaration."""
    return {
        f"{group}, {recording.recording_id}": {
            "segmented": find_phases(recording.with_(phases=None)),
            "declared": find_phases(recording),
            "rms": np.sqrt(np.mean(recording.acceleration**2, axis=0)),
            "fs": recording.fs,
        }
        for group, recordings in groups().items()
        for recording in recordings
    }


def files() -> Any:
    """Return one recording through every file format, and the features of a folder without a card."""
    rng, folder = np.random.default_rng(8), SCRATCH / "files"
    frame = pd.DataFrame(np.round(rng.normal(0, 0.1, (3000, 3)), 5), columns=["ax", "ay", "az"])
    x = frame.to_numpy()
    folder.mkdir()
    frame.to_csv(folder / "a.csv", index=False)
    frame.assign(time=np.arange(3000) / 2000).to_csv(folder / "timed.csv", index=False)
    frame.to_parquet(folder / "a.parquet")
    soundfile.write(folder / "a.wav", x, 2000, subtype="FLOAT")
    soundfile.write(folder / "a.flac", x, 2000)
    np.savez(folder / "a.npz", acceleration=x)
    scipy.io.savemat(folder / "a.mat", {"acceleration": x})
    read: dict[str, Any] = {}
    for path in sorted(folder.iterdir()):
        rate = {} if path.suffix in (".wav", ".flac") or path.name == "timed.csv" else {"fs": 2000.0}
        recording = load_recording(path, unit="g", **rate)
        read[path.name] = {"fs": recording.fs, "unit": recording.unit, "samples": recording.acceleration}
    for i in range(6):
        path = SCRATCH / "folder" / ("felt", "oak")[i % 2] / f"run_{i:02d}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, rng.normal(0, 1 + i % 2, 4000), header="a", comments="")
    table = SCRATCH / "folder.parquet"
    command("extract", SCRATCH / "folder", "--fs", 2000, "--unit", "g", "--jobs", 1, "-o", table)
    return read | {"folder": pd.read_parquet(table).set_index("recording_id")}


def models() -> Any:
    """Return autoregressive models of signals that determine them, line spectra, and a model between two."""
    results: dict[str, Any] = {}
    for case in cases_of("plain", "silent", "poles", "gain", "clipped"):
        for order in (2, 18, 120) if case.family == "plain" else (2, 10):
            for method in ("burg", "autocorrelation", "modified_covariance"):
                results[f"{case.name}, {method} {order}"] = vibration.fit(case.x, order, method=method)
            k = results[f"{case.name}, burg {order}"].reflection
            results[f"{case.name}, line spectrum {order}"] = vibration.line_spectrum.from_reflection(k)
        for criterion in ("spectral_error", "aicc"):
            results[f"{case.name}, {criterion}"] = vibration.select_order(case.x, 40, criterion=criterion)
    two = [results[f"{name}, burg 18"] for name in ("plain", "white")]
    results["between"] = vibration.ModelBlend(two).at([0.3, 0.7])
    results["synthesized"] = vibration.synthesize(two[0], 3000, np.random.default_rng(1))
    results["whitened"] = vibration.whiten(two[1], results["synthesized"])
    return results


def modes() -> Any:
    """Return modes, Prony's filters, lines, segments and taps of vibrations, and scores of pairs of them."""
    fs, rng, results = 10_000.0, np.random.default_rng(7), {}
    truth = vibration.DecayingModes([120.0, 333.0, 900.0], [30.0, 80.0, 200.0], [1, 0.5, 0.3], [0.1, -1, 2])
    ring = truth.synthesize(600, fs) + 1e-3 * rng.standard_normal(600)
    signals = {case.name: case.x for case in cases_of("plain", "silent", "gain", "clipped")}
    results["ring, Prony"] = vibration.fit_prony(ring, 0.05)
    for name in ("plain", "white", "zeros", "gain 1e-160", "gain 1e+150", "ring"):
        x = ring if name == "ring" else signals[name][:300]
        results[f"{name}, pencil"] = vibration.fit_matrix_pencil(x, fs)
        results[f"{name}, pencil of order 6"] = vibration.fit_matrix_pencil(x, fs, order=6)
        results[f"{name}, lines"] = vibration.fit_major_frequencies(x, fs)
        results[f"{name}, segments"] = vibration.segment_rising_peaks(x, 0.3)
    tap, velocity = vibration.TapModel(-800.0, 90.0, 270.0), [0.1, 0.2, 0.35]
    taps = [tap.synthesize(v, 300, fs) + 0.2 * rng.standard_normal(300) for v in velocity]
    results["tap, Okamura"] = vibration.fit_okamura(taps, velocity, fs)
    results["tap, maximum likelihood"] = vibration.fit_tap_model(taps, velocity, fs)
    for name in ("white", "clipped noise", "quantised to one step"):
        for score in ("rms_spectral_error", "goodness_of_fit", "log_spectral_distance"):
            results[f"{name}, {score}"] = getattr(scores, score)(signals["plain"], signals[name])
    return results


def scene() -> Any:
    """Return a planned scene and its samples, and textures of all papers, rendered and read back."""
    file, plan = SCRATCH / "example.texture", SCRATCH / "plan.json"
    command("scene", "plan", "example", "--output", file, "--json", plan)
    planned = load_scene(file)
    hand = default_path(planned)
    velocity, force, _ = hand.resample(planned.fs)
    results: dict[str, Any] = {
        "plan": {key: value for key, value in json.loads(plan.read_text()).items() if key != "measurement"},
        "played": render_path(planned, hand, seed=0).samples,
    }
    rng, rubber = np.random.default_rng(3), guruswamy2011_objects.OBJECTS[2]
    surface = abdulali2016_simulated.get_surface("S7")
    scan = abdulali2016_simulated.simulate_scan(surface, 10.0, 1000.0, np.random.default_rng(0))
    section = guruswamy2011_objects.lay_out(rubber, 60.0, rng)
    stroke = guruswamy2011_objects.simulate_scan(rubber, section, rng)
    (plates,), speeds = oeztuerk2018_study.simulate_recordings(0, 1).values(), oeztuerk2018_study.SPEEDS_MM_S
    scanned = abdulali2016.model_scan(scan)
    textures = {
        "abdulali2016, network": scanned.network(),
        "abdulali2016, delaunay": scanned.delaunay(),
        "abdulali2016, as published": abdulali2016_study.fit_as_published(scan),
        "guruswamy2011": guruswamy2011.fit_texture(stroke, rubber.law).texture,
        "oeztuerk2018, lpc": oeztuerk2018.fit_lpc(plates, speeds, 10_000.0, order=40, name="plate"),
        "oeztuerk2018, lines": oeztuerk2018.fit_frequencies(plates, speeds, 10_000.0, name="plate"),
    }
    textures["abdulali2016, baked"] = abdulali2016.bake(textures["abdulali2016, network"], "S7", (5, 5, 3))
    textures["HaTT"] = exchange.to_hatt(textures["abdulali2016, network"], unit="m/s^2", fs=1000.0, order=12)
    for name, texture in textures.items():
        saved = exchange.save_texture(texture, SCRATCH / "one.texture", unit="m/s^2")
        loaded = exchange.load_texture(saved)
        rendered = [one.renderer(seed=3).process(velocity, force) for one in (texture, loaded)]
        arrays = {"arrays": texture.arrays(), "read back": np.array_equal(*rendered)}
        results[name] = {"operations": texture.operations, "rendered": rendered[0], **arrays}
    fs = okamura2001_taps.FS["wood"]
    taps, speed = okamura2001_taps.simulate_taps(okamura2001_taps.TABLE_I["wood"], rng, fs, n_taps=6)
    library, _ = okamura2001.fit_library({"wood": taps}, {"wood": speed}, fs)
    return results | {
        "okamura2001": okamura2001.scale_to_device(library, okamura2001.ForceDevice(limit_n=50.0), 0.4)
    }


def answers() -> Any:
    """Return answers of models trained on a small dataset to its recordings, to others, and to streams."""
    dataset, whole, window = open_dataset(small()), SCRATCH / "whole.skops", SCRATCH / "window.skops"
    of_whole = ("--row", "Taps, movement, friction", "--classifier", "lda")
    of_window = ("--row", "Movement", "--classifier", "kernel", "--window", 1.0)
    for model, options in ((whole, of_whole), (window, of_window)):
        command("train", small(), "-o", model, "--jobs", 1, *options)
    arguments = [f"{small()}:{entry.recording_id}" for entry in dataset.entries]
    arguments += [f"simulated:{entry.recording_id}" for entry in open_dataset("simulated").entries[5:240:117]]
    results: dict[str, Any] = {}
    for model in (whole, window):
        table = rows_of(command("predict", model, "--jsonl", *arguments))
        results[f"predict, {model.stem}"] = table.set_index("recording")
    for recording in list(dataset)[::6]:
        x = recording.acceleration.reshape(recording.n_samples, -1)
        words = ("--fs", recording.fs, "--channels", x.shape[1], "--jsonl")
        table = rows_of(command("stream", window, *words, stdin=x.astype("<f4").tobytes()))
        results[f"stream, {recording.recording_id}"] = table
    return results


@contextlib.contextmanager
def fixed_costs() -> Iterator[None]:
    """Let every part of a feature set cost what its name says, not what the clock says."""
    measure = CostMeter.model

    def constant_costs(self: Any, *args: Any, **options: Any) -> Any:
        model = measure(self, *args, **options)
        digests = [hashlib.sha256(name.encode()).hexdigest() for name in model.parts]
        ms = np.array([0.05 + int(digest[:6], 16) / 2**24 for digest in digests])
        return dataclasses.replace(model, ms=ms, segmentation_ms=1.0)

    with mock.patch.object(CostMeter, "model", constant_costs):
        yield


def tradeoff() -> Any:
    """Return the Pareto front, curves and selected columns of a trade-off with stated costs."""
    fast_options = ("--features", "coarse", "--max-features", 3, "--no-curves")
    with fixed_costs():
        return {
            "front": result_of("tradeoff", small(), "--jobs", 1, "--features", "strese2015"),
            "few columns": result_of("tradeoff", small(), "--jobs", 1, *fast_options),
        }


def stability() -> Any:
    """Return how often each subject of texclass ended how on each family of inputs of the short battery."""
    results: dict[str, Any] = {}
    for group in ("models", "filters", "transforms", "features"):
        for tally in result_of("stability", "--quick", "--only", group)["tallies"]:
            if tally["library"] == "texclass":
                results[f"{group}, {tally['subject']}, {tally['family']}"] = tally["marks"]
    return results


class Part(NamedTuple):
    """Part of the record: function, relative tolerance of its numbers, and required recordings."""

    results: Callable[[], Any]
    tolerance: float = 1e-9
    needs: tuple[str, ...] = ()


PARTS = {
    "benchmark-strese2015-simulated": Part(partial(benchmark, "simulated", "strese2015")),
    "benchmark-texclass-simulated": Part(partial(benchmark, "simulated", "texclass")),
    "benchmark-multiscale-simulated": Part(partial(benchmark, "simulated", "multiscale")),
    "benchmark-coarse-simulated": Part(partial(benchmark, "simulated", "coarse")),
    "benchmark-protocols": Part(protocols),
    "features-simulated": Part(partial(features, simulated)),
    "phases-simulated": Part(partial(phases, lambda: simulated() | {"simulated": open_dataset("simulated")})),
    "files": Part(files),
    "vibration-models": Part(models, 1e-6),
    "vibration-modes": Part(modes, 1e-6),
    "scene": Part(scene),
    "recognition-answers": Part(answers, 2e-6),  # printed with six decimals
    "recognition-tradeoff": Part(tradeoff, 2e-6),
    "stability": Part(stability),
    "features-real": Part(partial(features, real), needs=tuple(REAL)),
    "phases-real": Part(partial(phases, real), needs=tuple(REAL)),
}
"""Name -> part."""
for _name, _dataset, _pipeline, _options in (
    ("taps5", "taps5", "strese2015", ("--folds", 4)),
    ("taps5", "taps5", "strese2015+models", ("--folds", 4)),
    ("taps5", "taps5", "texclass", ("--folds", 4)),
    ("biotac20", biotac6, "texclass", ("--protocol", "chronological")),
    ("biotac20", biotac6, "multiscale", ("--protocol", "few-shot")),
    (
        "borealtc",
        "borealtc",
        "coarse",
        ("--window", 5, "--max-windows", 6, "--protocol", "grouped", "--folds", 5),
    ),
):
    _results = partial(benchmark, _dataset, _pipeline, *_options)
    PARTS[f"benchmark-{_pipeline}-{_name}"] = Part(_results, needs=(_name,))
