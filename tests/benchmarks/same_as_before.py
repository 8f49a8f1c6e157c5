"""Whether a change of the code changed any result: record what comes out, compare again after the change.

    python tests/benchmarks/same_as_before.py record            # writes tests/benchmarks/same_as_before/
    python tests/benchmarks/same_as_before.py compare           # exit code 1 if anything differs
    python tests/benchmarks/same_as_before.py compare --only vibration scene
    python tests/benchmarks/same_as_before.py list

Labels, folds, chosen columns and phases must be equal, floating-point numbers within the tolerance of their
part (`TOLERANCE`). Measured times, versions and digests of code are left out; where a choice depends on
measured times, fixed ones take their place. Parts that need recordings which are not here (`TEXCLASS_DATA`,
or `../shared/data` beside the project) are skipped. Everything is computed anew, in a cache of its own.

Whoever changes a figure on purpose records the
parts it changes again (`record --only PART`), and says in the commit what changed and why.
"""

import argparse
import contextlib
import hashlib
import io
import json
import math
import os
import re
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")  # before NumPy: sums must not depend on the number of threads
os.environ.setdefault("MPLBACKEND", "agg")

import numpy as np  # noqa: E402

PROJECT = Path(__file__).resolve().parents[2]
RECORD = Path(__file__).resolve().with_suffix("")
SCRATCH = Path(os.environ.get("SAME_AS_BEFORE_SCRATCH") or tempfile.mkdtemp(prefix="same_as_before_"))
TOLERANCE = {"recognition": 2e-6, "features": 1e-9}
"""Part (or what its name begins with) -> relative tolerance; `DEFAULT_TOLERANCE` of all others. Recognition
prints six decimals. Raise one to 1e-6 where a library has taken the place of our own code."""
DEFAULT_TOLERANCE = 1e-9
FLOOR = 1.0
"""Numbers this far below the typical size of their array count as 0, in units of the tolerance."""
UNTOLD = {
    "bytes", "classifiers_ms", "code_hash", "costs_of", "features_hash", "file", "fit_ms", "hash",
    "input_hash", "machine", "measured_ms", "met", "model_check", "ms", "ms_added", "ms_alone",
    "ms_per_recording", "predict_ms", "seconds", "segmentation_ms", "versions",
}  # fmt: skip
"""Keys of results that say how long something took, where it is, or with which code."""


# What is called: the only section that knows modules of texclass -------------------------------------------


def command(*words: object, stdin: bytes = b"") -> SimpleNamespace:
    """Run the command line in this process; return exit code, standard output and standard error."""
    from texclass.cli import main

    out, err = io.StringIO(), io.StringIO()
    given = io.TextIOWrapper(io.BytesIO(stdin), encoding="utf-8")
    before, code = (sys.argv, sys.stdin), 0
    sys.argv, sys.stdin = ["texclass", *map(str, words)], given
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(bool(ended.code))
    finally:
        sys.argv, sys.stdin = before
    return SimpleNamespace(code=code, out=out.getvalue(), err=err.getvalue())


def open_dataset(name: str | Path) -> Any:
    """Return a dataset: `len`, index -> recording, `materials`, `entries` with `recording_id`."""
    from texclass.loaders import open_dataset

    return open_dataset(name)


def recording_of(samples: Any, fs: float, name: str, unit: str = "m/s^2") -> Any:
    """Return a recording of samples."""
    from texclass.recording import Recording

    return Recording(samples, fs=fs, unit=unit, recording_id=name)


def load_recording(path: Path, **facts: Any) -> Any:
    """Return the recording of a file."""
    from texclass.loaders import load_recording

    return load_recording(path, **facts)


def simulated_runs() -> list[Any]:
    """Return four recordings under control: rising speed, rising force, rising taps."""
    from texclass.simulate import (
        operator_catalogue,
        record_rising_force,
        record_rising_speed,
        record_rising_taps,
        surface_catalogue,
    )

    plate, mesh = surface_catalogue(5, 3)[:2]
    who = operator_catalogue(2, 3)[1]
    return [
        record_rising_speed(plate, who, duration_s=4.0, seed=1),
        record_rising_force(mesh, who, duration_s=4.0, seed=2),
        record_rising_taps(plate, who, n_taps=5, seed=3),
        record_rising_taps(mesh, who, n_taps=3, seed=4),
    ]


def phases_of(recording: Any) -> Any:
    """Return the phases: `taps` of (start, impact, end), `movement`, `onset`, `notes`."""
    from texclass.phases import segment

    return segment(recording)


def feature_table(recordings: Sequence[Any], features: str, channels: str) -> tuple[Any, Any, Any]:
    """Return columns, values (recordings, columns), and (recording, feature, reason) of what is undefined."""
    from texclass.features import FeatureExtractor

    found = FeatureExtractor(features, channels=channels).fit(recordings).extract(recordings)
    return found.columns, found.values, [tuple(reason) for reason in found.reasons]


def predictions(
    dataset: str | Path, pipeline: str, protocol: str | None, folds: int | None
) -> dict[str, Any]:
    """Return folds (number of the fold that tests a recording) and predicted labels by row and classifier.

    Of rows that select no columns: what the others select is in the result of the benchmark.
    """
    from texclass.experiment import cached_table, find_protocol, load_pipeline
    from texclass.experiment.pipeline import MatchedRow

    definition = load_pipeline(pipeline)
    split_by = find_protocol(protocol or definition.protocol.name)
    table = cached_table(open_dataset(dataset), *definition.needed, channels=definition.channels, n_jobs=1)
    splits = split_by.split(
        table.frame, definition.protocol.folds if folds is None else folds, definition.seed
    )
    y = table.frame["material"].to_numpy(dtype=str)
    names = np.unique(y)
    fold = np.full(len(y), -1, dtype=np.int16)
    for number, (_, test) in enumerate(splits):
        fold[test] = number
    options = {"nested": split_by.nested, "clusters": split_by.clusters(table.frame)}
    labels: dict[str, Any] = {}
    for declared in (row for row in definition.rows if row.select is None):
        row = MatchedRow.of(declared, definition.features, table)
        for classifier in declared.judged_by(definition.classifiers) if row.columns else ():
            found = definition.trial(row, classifier, table)(splits, **options)
            said = np.searchsorted(names, np.concatenate(found.predicted)).astype(np.uint8)
            labels.setdefault(declared.name, {})[classifier] = said
    return {"materials": names.tolist(), "fold": fold, "predicted": labels}


@contextlib.contextmanager
def fixed_costs() -> Iterator[None]:
    """Let every part of a feature set cost what its name says, not what the clock says."""
    from texclass.experiment.cost import CostMeter

    measured = CostMeter.model

    def stated(self: Any, *args: Any, **options: Any) -> Any:
        model = measured(self, *args, **options)
        names = [FORMER_PARTS.get(name, name) for name in model.parts]
        ms = [0.05 + int(hashlib.sha256(name.encode()).hexdigest()[:6], 16) / 2**24 for name in names]
        return replace(model, parts=tuple(names), ms=np.array(ms), segmentation_ms=1.0)

    CostMeter.model = stated  # type: ignore[method-assign]
    try:
        yield
    finally:
        CostMeter.model = measured  # type: ignore[method-assign]


def fitted_textures(plates: Sequence[np.ndarray], speeds: Sequence[float]) -> dict[str, Any]:
    """Return a texture of each way of the four papers, fitted to simulated recordings."""
    from abdulali2016_simulated import simulate_scan as stroke_by_hand
    from abdulali2016_simulated import surface
    from guruswamy2011_objects import OBJECTS, lay_out, simulate_scan

    from texclass.textures import abdulali2016, guruswamy2011, oeztuerk2018

    hand = stroke_by_hand(surface("S7"), 10.0, 1000.0, np.random.default_rng(0))
    modelled = abdulali2016.model_scan(hand)
    network = modelled.network()
    rng = np.random.default_rng(3)
    rubber = OBJECTS[2]
    stroke = simulate_scan(rubber, lay_out(rubber, 60.0, rng), rng)
    return {
        "abdulali2016 network": network,
        "abdulali2016 delaunay": modelled.delaunay(),
        "abdulali2016 baked": abdulali2016.bake(network, "S7", (5, 5, 3)),
        "abdulali2016 as published": abdulali2016.fit_as_published(hand),
        "guruswamy2011": guruswamy2011.fit_texture(stroke, rubber.law).texture,
        "oeztuerk2018 lpc": oeztuerk2018.fit_lpc(plates, speeds, 10_000.0, order=40, name="felt"),
        "oeztuerk2018 lines": oeztuerk2018.fit_frequencies(plates, speeds, 10_000.0, name="felt"),
    }


def fitted_taps() -> tuple[Any, Any, np.ndarray]:
    """Return a library of taps, what it was fitted to (A, B, f), and the force of a virtual wall."""
    from okamura2001_taps import FS, TABLE_I, simulate_taps

    from texclass.textures import okamura2001

    rng, materials = np.random.default_rng(5), ("wood", "rubber")
    made = {name: simulate_taps(TABLE_I[name], rng, FS["wood"], n_taps=6) for name in materials}
    library, _ = okamura2001.fit_library(
        {name: taps for name, (taps, _) in made.items()},
        {name: velocity for name, (_, velocity) in made.items()},
        FS["wood"],
    )
    device = okamura2001.ForceDevice(limit_n=50.0)
    scaled = okamura2001.scale_into(library, device, 0.4)
    wall = okamura2001.VirtualWall(scaled["wood"], device)
    t = np.arange(4000)
    depth = 2 * np.sin(2 * np.pi * t / 1500 - 0.5)
    force = wall.renderer().process(depth, np.gradient(depth) * device.rate_hz)
    fits = [
        (m.amplitude_slope, m.decay_per_s, m.frequency_hz) for one in (library, scaled) for m in one.values()
    ]
    return library, np.array(fits), force


def arrays_of(texture: Any) -> dict[str, np.ndarray]:
    """Return a texture's arrays by the names they had in files of version 1."""
    if texture.family == "abdulali2016-baked":
        grid = texture.grid
        return {"grid": np.concatenate([grid.rows, np.sqrt(grid.power)[..., np.newaxis]], axis=-1)}
    parts: dict[str, list[np.ndarray]] = {}
    for name, array in texture.arrays().items():
        parts.setdefault(name.rpartition(".")[2], []).append(array)
    if texture.family == "oeztuerk2018-frequencies":
        parts["n_lines"] = [np.array([float(part.size) for part in parts["frequency_hz"]])]
    return {name: np.concatenate(each) if len(each) > 1 else each[0] for name, each in parts.items()}


def played_scene(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return a planned scene's default path (velocity and force) and its rendered samples."""
    from texclass.scene import load_scene, play_path, sweep_of

    scene = load_scene(path)
    hand = sweep_of(scene)
    velocity, force, _ = hand.at_rate(scene.fs)
    return np.column_stack([velocity, force]), play_path(scene, hand, seed=0).samples


FORMER_PARTS = {
    f"log_energies(20, 0.0, 1400.0, {decay}, 0.025, 0.015)": (
        f"log_energies(Bank(n_filters=20, low_hz=0.0, high_hz=1400.0, decay_hz={decay}), 0.025, 0.015)"
    )
    for decay in ("inf", "500.0")
}
"""Parts of a recording's cost that had another name when the record was made; stated costs hang on it."""
OWN_FEATURE = '''
import numpy as np
from texclass.features import Gain, feature


@feature(phase="movement", unit="1", reference="crest factor", gain=Gain())
def crest(view):
    """Peak over root mean square of the movement."""
    x = np.asarray(view.samples)
    return np.abs(x).max() / np.sqrt(np.mean(x**2))
'''

# What is recorded ------------------------------------------------------------------------------------------

PARTS: dict[str, tuple[Callable[[], Any], tuple[str, ...]]] = {}


def part(name: str, *needs: str) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Name a part, and the folders of recordings that it needs."""

    def register(function: Callable[[], Any]) -> Callable[[], Any]:
        PARTS[name] = (function, needs)
        return function

    return register


def card(name: str, text: str) -> Path:
    """Write a card (or another file) of our own and return its path."""
    path = SCRATCH / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def small(surfaces: int = 6, recordings: int = 8) -> Path:
    """Return the card of a small simulated dataset, 4 operators."""
    recipe = f"n_surfaces = {surfaces}\nn_recordings = {recordings}\nn_operators = 4\nduration_s = 4.0\n"
    text = f'title = "Small"\nformat = "simulated"\n[recipe]\n{recipe}fs = 10000\nseed = 12\n'
    return card(f"small{surfaces}.toml", text)


def few_of_biotac() -> Path:
    """Return the card of 6 materials of biotac20, 12 repetitions of each."""
    text = (PROJECT / "datasets" / "biotac20.toml").read_text(encoding="utf-8")
    files = r"files = '(?P<material>mat0[1-6])/(?P<recording>mat\\d+_(?P<repetition>0\\d|1[0-2]))\\.wav'"
    return card("biotac.toml", re.sub(r"^files = .*$", files, text, flags=re.MULTILINE))


def thin(values: Any, n: int = 40) -> Any:
    """Return at most `n` values of an array, evenly spread, and its size, mean and root mean square."""
    x = np.asarray(values, dtype=np.float64)
    flat = x.ravel()
    if flat.size <= n:
        return x
    with np.errstate(all="ignore"):
        some = flat[np.linspace(0, flat.size - 1, n).astype(int)]
        return {"shape": list(x.shape), "some": some, "mean": flat.mean(), "rms": np.sqrt(np.mean(flat**2))}


def attempt(function: Callable[..., Any], *args: Any, **options: Any) -> Any:
    """Return what a function returns, or the kind of error it refuses with."""
    try:
        return function(*args, **options)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        return f"refused: {type(error).__name__}"


def benchmark(name: str | Path, pipeline: str, *options: object) -> Any:
    """Return the JSON of `texclass benchmark`, what is measured and what is only drawn left out."""
    file = SCRATCH / "benchmark.json"
    file.unlink(missing_ok=True)
    asked = ("--pipeline", pipeline, "--jobs", 1, "--out", SCRATCH / "out", "--json", file)
    ended = command("benchmark", name, *asked, *options)
    if not file.exists():
        return {"code": ended.code, "error": ended.err.strip().splitlines()[-1:]}
    found = json.loads(file.read_text(encoding="utf-8"))
    return {key: value for key, value in found.items() if key != "example"}


def _benchmark_part(
    pipeline: str, name: str, dataset: Callable[[], str | Path], *needs: str, **asked: Any
) -> None:
    words = [word for key, value in asked.items() for word in (f"--{key}", value)]

    @part(f"benchmark-{pipeline}-{name}", *needs)
    def run() -> Any:
        found = {"result": benchmark(dataset(), pipeline, *words)}
        if "touch" not in asked and "rows" in found["result"]:
            found |= predictions(dataset(), pipeline, asked.get("protocol"), asked.get("folds"))
        return found


for _pipeline in ("strese2015", "texclass", "multiscale", "coarse"):
    _benchmark_part(_pipeline, "simulated", lambda: "simulated")
_benchmark_part("texclass", "biotac20", few_of_biotac, "biotac20", protocol="blocks")
_benchmark_part("multiscale", "biotac20", few_of_biotac, "biotac20", protocol="few-shot")
_benchmark_part("strese2015", "taps5", lambda: "taps5", "taps5", folds=4)
_benchmark_part("strese2015+models", "taps5", lambda: "taps5", "taps5", folds=4)
_benchmark_part("texclass", "taps5", lambda: "taps5", "taps5", folds=4)
_benchmark_part(
    "coarse", "borealtc", lambda: "borealtc", "borealtc", touch=5, touches=6, protocol="run", folds=5
)


@part("benchmark-protocols")
def protocols() -> Any:
    """Every protocol, choice inside the training part, touches, and a new feature, on a small dataset."""
    own = card("own_feature.py", OWN_FEATURE)
    return {
        "operator": benchmark(small(), "texclass", "--protocol", "operator"),
        "paper": benchmark(small(), "strese2015", "--protocol", "paper", "--folds", 4),
        "blocks": benchmark(small(), "multiscale", "--protocol", "blocks"),
        "few-shot": benchmark(small(), "coarse", "--protocol", "few-shot"),
        "choose": benchmark(small(), "coarse", "--protocol", "recording", "--folds", 4, "--choose"),
        "touches": benchmark(small(), "multiscale", "--touch", 0.8, "--touches", 2, "--folds", 3),
        "too many folds": benchmark(small(), "coarse", "--folds", 9),
        "new feature": benchmark(small(), "coarse", "--folds", 4, "--feature", f"{own}:crest"),
    }


def some(name: str | Path, n: int) -> list[Any]:
    """Return `n` recordings spread over a dataset."""
    dataset = open_dataset(name)
    return [dataset[int(i)] for i in np.linspace(0, len(dataset) - 1, n).astype(int)]


def simulated_recordings() -> dict[str, list[Any]]:
    """Return 20 simulated recordings: taps, strokes and friction."""
    return {"simulated": some("simulated", 10), "small": some(small(), 6), "controlled": simulated_runs()}


def real_recordings() -> dict[str, list[Any]]:
    """Return 24 real recordings."""
    counts = {"taps5": 5, "lmt_excerpts": 4, "stylus6": 4, "biotac20": 5, "borealtc": 3, "fabric_speeds": 3}
    return {name: some(name, n) for name, n in counts.items()}


REAL = ("taps5", "lmt_excerpts", "stylus6", "biotac20", "borealtc", "fabric_speeds")
SETS = ("strese2015", "strese2015+models", "texclass", "multiscale", "coarse")


def tables(groups: Mapping[str, Sequence[Any]], plans: Sequence[tuple[str, str]]) -> Any:
    """Return the feature tables of groups of recordings."""
    found: dict[str, Any] = {}
    for group, recordings in groups.items():
        for features, channels in plans:
            columns, values, reasons = feature_table(recordings, features, channels)
            undefined: dict[str, list[str]] = {}
            for recording, feature, reason in reasons:
                undefined.setdefault(f"{feature}: {reason}", []).append(recording)
            found[f"{group} {features} {channels}"] = {
                "columns": list(columns),
                "values": Columns(values),
                "undefined": {reason: sorted(who) for reason, who in sorted(undefined.items())},
            }
    return found


@part("features-simulated")
def features_simulated() -> Any:
    """Feature tables of every shipped set."""
    return tables(simulated_recordings(), [(name, "combine") for name in SETS])


@part("features-real", *REAL)
def features_real() -> Any:
    """The same of real recordings, and with channels apart."""
    groups = real_recordings()
    found = tables(groups, [(name, "combine") for name in SETS])
    apart = {name: groups[name][:2] for name in ("taps5", "borealtc")}
    return found | tables(apart, [("texclass", "auto"), ("coarse", "each")])


def phases(recordings: Iterator[Any] | Sequence[Any]) -> dict[str, Any]:
    """Return what was found in recordings, and what they are, in numbers."""
    found: dict[str, Any] = {}
    for recording in recordings:
        p = phases_of(recording)
        samples = np.asarray(recording.acceleration)
        found[recording.recording_id] = {
            "taps": np.array([(t.start, t.impact, t.end) for t in p.taps], dtype=np.int64).reshape(-1, 3),
            "movement": None if p.movement is None else list(map(int, p.movement)),
            "onset": None if p.onset is None else int(p.onset),
            "notes": list(p.notes),
            "fs": recording.fs,
            "unit": recording.unit,
            "shape": list(samples.shape),
            "rms": np.sqrt(np.mean(samples**2, axis=0)),
            "flags": list(recording.flags),
            "of": [recording.material, recording.operator, recording.session, recording.repetition],
        }
    return found


@part("phases-simulated")
def phases_simulated() -> Any:
    """Phases of the whole simulated dataset and of the other simulated recordings."""
    others = [r for name, group in simulated_recordings().items() if name != "simulated" for r in group]
    dataset = open_dataset("simulated")
    return {
        "simulated": phases(dataset),
        "others": phases(recording.with_(phases=None) for recording in others),
    }


@part("phases-real", *REAL)
def phases_real() -> Any:
    """Phases as declared by cards, and as found without their declaration."""
    groups = real_recordings()
    return {
        name: {"declared": phases(group), "found": phases(r.with_(phases=None) for r in group)}
        for name, group in groups.items()
    }


@part("files")
def files() -> Any:
    """One recording through every format of files, and a folder of materials."""
    import h5py
    import pandas as pd
    import scipy.io
    import soundfile

    rng = np.random.default_rng(8)
    x = np.round(rng.normal(0, 0.1, (3000, 3)), 5)
    folder = SCRATCH / "files"
    folder.mkdir(parents=True, exist_ok=True)
    frame = pd.DataFrame(x, columns=["ax", "ay", "az"])
    np.savetxt(folder / "a.txt", x[:, 0])
    frame.to_csv(folder / "a.csv", index=False)
    frame.assign(time=np.arange(3000) / 2000).to_csv(folder / "timed.csv", index=False)
    frame.to_parquet(folder / "a.parquet")
    soundfile.write(folder / "a.wav", x, 2000, subtype="FLOAT")
    soundfile.write(folder / "a.flac", x, 2000)
    np.savez(folder / "a.npz", acceleration=x)
    scipy.io.savemat(folder / "a.mat", {"acceleration": x})
    with h5py.File(folder / "a.h5", "w") as file:
        file["acceleration"] = x
    found: dict[str, Any] = {}
    for path in sorted(folder.iterdir()):
        stated = {} if path.suffix in (".wav", ".flac") or path.name == "timed.csv" else {"fs": 2000.0}
        read = attempt(load_recording, path, unit="g", **stated)
        is_told = isinstance(read, str)
        found[path.name] = read if is_told else {
            "fs": read.fs, "unit": read.unit, "channels": list(read.channels), "flags": list(read.flags),
            "samples": thin(read.acceleration, 12),
        }  # fmt: skip
    for i in range(6):
        one = SCRATCH / "folder" / ("felt", "oak")[i % 2] / f"run_{i:02d}.csv"
        one.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(one, rng.normal(0, 1 + i % 2, 4000), header="a", comments="")
    table = SCRATCH / "folder.parquet"
    ended = command("extract", SCRATCH / "folder", "--fs", 2000, "--unit", "g", "--jobs", 1, "-o", table)
    if ended.code:
        return found | {"folder": ended.err.strip().splitlines()[-1:]}
    read = pd.read_parquet(table)
    text = [name for name in read.columns if not pd.api.types.is_float_dtype(read[name])]
    numbers = [name for name in read.columns if name not in text]
    found["folder"] = {
        "text": {name: read[name].astype("string").fillna("").tolist() for name in text},
        "columns": numbers,
        "values": Columns(read[numbers].to_numpy(np.float64)),
    }
    return found


ROUNDED = False
"""Whether `hard_signals` are rounded another way: what that changes, another machine may change, too."""


def hard_signals() -> dict[str, np.ndarray]:
    """Return seeded signals, easy and hard ones, of 2000 samples."""
    rng = np.random.default_rng(2015)
    t = np.arange(2000.0)
    noise = rng.standard_normal(2000)
    colored = np.convolve(noise, np.hanning(25), "same")
    found = {
        "noise": noise,
        "colored": colored,
        "oversampled": np.convolve(noise, np.hanning(201), "same"),
        "tones": np.sin(0.3 * t) + 0.5 * np.sin(0.31 * t + 1) + 1e-6 * noise,
        "pure tone": np.sin(0.3 * t),
        "decay": np.exp(-0.01 * t) * np.sin(0.5 * t) + 1e-4 * noise,
        "quantized": np.round(3 * colored) / 3,
        "tiny": 1e-300 * noise,
        "huge": 1e150 * colored,
        "constant": np.full(2000, 0.7),
        "silence": np.zeros(2000),
        "impulse": np.eye(1, 2000, 700)[0],
        "trend": 1e3 + t + noise,
    }
    if ROUNDED:
        units = np.random.default_rng(99).integers(-1, 2, 2000) * np.finfo(np.float64).eps
        found |= {name: x * (1 + units) for name, x in found.items() if name != "constant"}
    return found


@part("vibration-models")
def vibration_models() -> Any:
    """Autoregressive models, line spectra, lattices, interpolation, choice of the order."""
    from texclass import vibration as v
    from texclass.vibration import interpolation
    from texclass.vibration import line_spectrum as ls
    from texclass.vibration.autoregressive import from_autocorrelation, from_direct_form
    from texclass.vibration.order import aicc, spectral_error

    found: dict[str, Any] = {}
    omega = np.linspace(0.01, 3.1, 50)

    def told(model: Any) -> dict[str, Any]:
        return {
            "k": thin(model.reflection), "gain": np.asarray(model.gain), "residual": thin(model.residual, 12),
            "fitted": np.asarray(model.fitted_order), "clipped": np.asarray(model.clipped),
            "fallback": np.asarray(model.fallback),
        }  # fmt: skip

    for name, x in hard_signals().items():
        here: dict[str, Any] = {}
        for method in ("burg", "autocorrelation", "modified_covariance"):
            for order in (1, 2, 6, 24, 120, 400) if method != "modified_covariance" else (1, 2, 6, 24, 120):
                model = v.fit(x, order, method=method)
                here[f"{method} {order}"] = told(model)
                if method == "burg" and order in (2, 24, 400) and name not in ("silence", "constant"):
                    lsf = ls.from_reflection(model.reflection)
                    here[f"lsf {order}"] = {
                        "lsf": thin(lsf),
                        "back": thin(attempt(ls.to_reflection, lsf)),
                        "spectrum": thin(v.Autoregression(model.reflection, 1.0).log_spectrum_db(omega), 20),
                    }
        here["yule_walker"] = told(v.fit(x, 12, variance="yule_walker"))
        found[name] = here
    signals = hard_signals()
    a, b = (v.fit(signals[name], 20) for name in ("colored", "decay"))
    frames = v.fit(signals["colored"].reshape(10, 200), 8)
    found["frames"] = told(frames)
    k400 = v.fit(signals["oversampled"], 400)
    whites = np.random.default_rng(1).standard_normal(3000)
    lsf20 = ls.from_reflection(np.stack([a.reflection, b.reflection]))
    glide = v.LatticeSynthesis(a)
    first = glide.process(whites[:500])
    varying = (
        np.linspace(0, 1, 1000)[:, None] * b.reflection + np.linspace(1, 0, 1000)[:, None] * a.reflection
    )
    w = np.arange(1, 1001) / 1000
    gliding = (1 - w)[:, None] * a.reflection + w[:, None] * b.reflection
    second = glide.process_varying(whites[500:1500], gliding, a.level ** (1 - w) * b.level**w)
    blend = v.ModelBlend([a, b])
    nearest = v.Autoregression(ls.to_reflection(ls.spread(lsf20.mean(axis=0))), np.exp(-1.5))
    found["lattice"] = {
        "synthesis": thin(np.concatenate([first, second, glide.process(whites[1500:])])),
        "varying": thin(
            v.LatticeSynthesis(a).process_varying(whites[:1000], varying, np.linspace(1, 2, 1000))
        ),
        "high order": thin(v.synthesize(k400, 3000, np.random.default_rng(2))),
        "whitened": thin(v.whiten(a, signals["colored"])),
        "inverse": thin(v.LatticeInverse(b).process(signals["decay"])),
        "settled": thin(v.LatticeSynthesis(a).settle(np.random.default_rng(3)).process(whites)),
    }
    found["between"] = {
        "blend": told(blend.at([0.3, 0.7])),
        "rows": told(blend.at(np.array([[1.0, 0.0], [0.5, 0.5], [0.1, 0.9]]))),
        "interpolate": told(interpolation.interpolate(a, b, 0.25)),
        "level": told(interpolation.interpolate(a, b, 0.5, loudness="level")),
        "from lines": told(nearest),
        "spread": ls.spread(np.array([0.5, 0.4, 0.4, 1.0, 3.3, 3.2]), 0.01),
        "conditioning": thin(ls.conditioning(lsf20)),
        "from autocorrelation": told(from_autocorrelation([4.0, 2.0, 0.5, -0.3])),
        "from coefficients": told(from_direct_form([1.0, -1.2, 0.9, -0.2], 0.5)),
    }
    chosen = [
        (criterion, v.select_order(signals[name], 60, criterion=criterion))
        for criterion in ("spectral_error", "aicc")
        for name in ("colored", "decay", "tones")
    ]
    found["order"] = [
        {"criterion": c, "order": int(s.order), "met": bool(s.met), "values": thin(s.values)}
        for c, s in chosen
    ]
    found["errors of orders"] = {
        "spectral": spectral_error(signals["colored"], a),
        "aicc": aicc(a, 2000),
    }
    return found


@part("vibration-modes")
def vibration_modes() -> Any:
    """Matrix pencil, Prony, taps, lines, pieces, bands and scores."""
    from texclass import vibration as v
    from texclass.vibration import major_frequencies, scores

    signals, found = hard_signals(), {}
    rng = np.random.default_rng(7)
    fs = 10_000.0
    rings = v.DecayingModes(
        [120.0, 333.0, 900.0, 0.0], [30.0, 80.0, 200.0, 50.0], [1, 0.5, 0.3, 0.2], [0.1, -1, 2, 0]
    )
    ring = rings.synthesize(600, fs)
    found["modes"] = {
        "ring": thin(ring), "sections": rings.sections(fs),
        "filtered": thin(rings.filter(signals["noise"], fs)),
        "strongest": rings.strongest(2, 0.05).frequency_hz,
    }  # fmt: skip

    def told(modes: Any) -> Any:
        if isinstance(modes, str):
            return modes
        return np.stack([modes.frequency_hz, modes.decay_per_s, modes.amplitude, modes.phase])

    noisy = {"clean": ring, "noisy": ring + 1e-3 * rng.standard_normal(600), "decay": signals["decay"][:400]}
    noisy |= {
        name: signals[name][:300] for name in ("noise", "tones", "constant", "silence", "impulse", "huge")
    }
    for name, x in noisy.items():
        found[f"pencil {name}"] = {
            "own order": told(attempt(v.fit_matrix_pencil, x, fs)),
            "order 6": told(attempt(v.fit_matrix_pencil, x, fs, order=6)),
            "projected": told(attempt(v.fit_matrix_pencil, x, fs, order=4, outside="project")),
        }
        prony = attempt(v.fit_prony, x, 0.05 * (float(np.abs(x).max()) or 1.0))
        if not isinstance(prony, str):
            steady = (
                {"radius": prony.pole_radius, "shown": thin(prony.synthesize(200))} if prony.is_stable else {}
            )
            prony = {"order": prony.order, "b": prony.b, "a": prony.a, "error": prony.error} | steady
        found[f"prony {name}"] = prony
        lines = attempt(v.fit_major_frequencies, x, fs)
        told_lines = (
            lines if isinstance(lines, str) else np.stack([lines.frequency_hz, lines.amplitude, lines.phase])
        )
        found[f"lines {name}"] = told_lines
    slow, fast = (
        v.fit_major_frequencies(signals[name], fs, n_frequencies=9) for name in ("colored", "tones")
    )
    for name, lines in {
        "between": major_frequencies.interpolate(slow, fast, 0.4),
        "at speed": major_frequencies.at_speed([slow, fast], [50.0, 100.0], 80.0),
    }.items():
        found[f"lines {name}"] = np.stack([lines.frequency_hz, lines.amplitude, lines.phase])
    found["lines played"] = thin(slow.synthesize(1000, fs, peak=1.0))
    velocity, t = np.array([0.1, 0.2, 0.35]), np.arange(300) / fs
    taps = [
        -800 * u * np.exp(-90 * t) * np.sin(2 * np.pi * 270 * t) + 0.2 * rng.standard_normal(300)
        for u in velocity
    ]
    for name, fit in (("okamura", v.fit_okamura), ("least squares", v.fit_tap_model)):
        model = fit(taps, velocity, fs)
        found[f"tap {name}"] = np.array([model.amplitude_slope, model.decay_per_s, model.frequency_hz])
    pieces = v.segment_rising_peaks(np.tile(ring[:200], 6) + 0.05 * rng.standard_normal(1200), 0.3)
    band = v.vibration_band(np.arange(500.0), 1 / ((np.arange(500.0) - 80) ** 2 + 400), smoothing_hz=3.0)
    found["pieces"] = {
        "bounds": pieces.bounds,
        "peaks": pieces.n_peaks,
        "band": [band.major_hz, band.upper_hz],
    }
    for name, other in (
        ("noise", "colored"),
        ("colored", "quantized"),
        ("decay", "tones"),
        ("tiny", "noise"),
    ):
        x, y = signals[name], signals[other]
        found[f"scores {name} {other}"] = {
            score: attempt(getattr(scores, score), x, y)
            for score in (
                "rms_spectral_error", "goodness_of_fit", "mean_absolute_difference", "log_spectral_distance",
            )
        } | {"band_energy_distance": attempt(scores.band_energy_distance, x, y, fs)}  # fmt: skip
    return found


def hand_path(n: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity (mm/s) and force (N) of a seeded path with a lift-off."""
    rng = np.random.default_rng(11)
    t = np.linspace(0, 7, n)
    velocity = np.column_stack([np.interp(t, np.arange(8), rng.uniform(-150, 150, 8)) for _ in range(2)])
    return velocity, np.where(np.sin(3 * t) > -0.9, 1 + 0.5 * np.sin(2 * t), 0.0)


@part("scene")
def scene() -> Any:
    """A planned scene and its samples, textures of all papers, and their files."""
    from texclass import exchange as e

    found: dict[str, Any] = {}
    file, told = SCRATCH / "example.texture", SCRATCH / "plan.json"
    command(
        "scene", "plan", "example", "--out", file, "--json", told
    )  # exit code 1: the machine was too slow
    plan = json.loads(told.read_text(encoding="utf-8"))
    plan.pop("budget")
    path, samples = played_scene(file)
    found["plan"], found["path"], found["played"] = plan, thin(path), thin(samples, 400)
    rng = np.random.default_rng(4)
    speeds = [50.0, 100.0, 200.0]
    plates = [v * np.convolve(rng.standard_normal(6000), np.hanning(round(4000 / v)), "same") for v in speeds]
    velocity, force = hand_path()
    textures = fitted_textures(plates, speeds)
    for name, texture in textures.items():
        x = texture.renderer(seed=3).process(velocity, force)
        saved = e.save_texture(texture, SCRATCH / f"{name}.texture", unit="m/s^2")
        again = e.load_texture(saved).renderer(seed=3).process(velocity, force)
        found[name] = {
            "fs": texture.fs, "operations": texture.operations, "rendered": thin(x, 100),
            "again": bool(np.array_equal(x, again)),
            "arrays": {k: thin(a, 20) for k, a in arrays_of(texture).items()},
        }  # fmt: skip
    library, fits, wall = fitted_taps()
    taps = e.load_taps(e.save_texture(library, SCRATCH / "taps.texture"))
    found["okamura2001"] = {
        "fits": fits, "wall": thin(wall, 100),
        "again": [(m.amplitude_slope, m.decay_per_s, m.frequency_hz) for m in taps.values()],
    }  # fmt: skip
    for name in ("abdulali2016 network", "oeztuerk2018 lpc"):
        hatt = e.to_hatt(textures[name], unit="m/s^2", fs=1000.0, order=12)
        again = e.read_hatt(e.write_hatt(hatt, SCRATCH / "hatt.xml"))
        xml = (SCRATCH / "hatt.xml").read_text(encoding="utf-8")
        found[f"HaTT of {name}"] = {
            "rendered": thin(hatt.renderer(seed=1).process(velocity, force), 60),
            "again": thin(again.renderer(seed=1).process(velocity, force), 60),
            "xml": [xml.count("<value>"), re.findall(r"<(\w+)", xml)[:20]],
        }
    for encoding in ("float32", "pcm16"):
        read = e.read_wav(e.write_wav(SCRATCH / "x.wav", samples, 1000.0, unit="g", encoding=encoding))
        found[f"WAV {encoding}"] = [thin(read.samples, 60), read.fs, read.unit, read.peak]
    return found


def objects(lines: str) -> list[Any]:
    """Return the JSON objects of lines."""
    return [json.loads(line) for line in lines.splitlines() if line.startswith("{")]


def columns_of(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return rows with about the same keys as columns: the records become smaller."""
    keys = dict.fromkeys(key for row in rows for key in row)
    return {key: [row.get(key) for row in rows] for key in keys}


@part("recognition-answers")
def recognition_answers() -> Any:
    """Models trained on a small dataset, their answers to 50 recordings, and those of streams."""
    dataset = open_dataset(small())
    names = [f"{small()}:{entry.recording_id}" for entry in dataset.entries]
    strangers = [f"simulated:{entry.recording_id}" for entry in open_dataset("simulated").entries[5:240:117]]
    found: dict[str, Any] = {}
    whole, touch = SCRATCH / "whole.skops", SCRATCH / "touch.skops"
    for file, row, classifier, options in (
        (whole, "Taps, movement, friction", "lda", ()),
        (touch, "Movement", "kernel", ("--touch", 1.0)),
    ):
        asked = ("--row", row, "--classifier", classifier, "--jobs", 1, *options)
        ended = command("train", small(), "-o", file, *asked)
        assert file.exists(), ended.err
        answers = objects(
            command("predict", file, "--json", *names[: 48 if file == whole else 16], *strangers).out
        )
        for answer in answers:
            answer["file"] = answer["file"].rpartition(":")[2]
            answer["reasons"] = "; ".join(answer.get("reasons", ()))
        found[f"predict {file.stem}"] = columns_of(answers)
    heard: list[Any] = []
    for i in range(len(dataset)):
        recording = dataset[i]
        x = np.asarray(recording.acceleration).reshape(recording.n_samples, -1)
        if i % 8 == 0:  # as text, a sample a line
            text = "\n".join(" ".join(map(repr, row)) for row in x.tolist()).encode()
            ended = command("stream", touch, "--rate", recording.fs, "--json", stdin=text)
        else:
            blocks = x.astype("<f4").tobytes()
            ended = command(
                "stream", touch, "--rate", recording.fs, "--channels", x.shape[1], "--json", stdin=blocks
            )
        heard += [
            {"of": recording.recording_id, "code": ended.code, **told} for told in _flat(objects(ended.out))
        ]
    for i in (3, 30):
        ended = command("stream", touch, "--source", names[i], "--evidence", "majority", "--json")
        heard += [{"of": f"file {i}", "code": ended.code, **told} for told in _flat(objects(ended.out))]
    found["stream"] = columns_of(heard)
    return found


def _flat(told: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return answers of a stream with those of the window beside those of the contact."""
    return [
        {key: value for key, value in one.items() if key not in ("window", "ms", "reasons")}
        | {"reasons": "; ".join(one.get("reasons", ()))}
        | {f"window {key}": value for key, value in one.get("window", {}).items()}
        for one in told
    ]


@part("recognition-tradeoff")
def recognition_tradeoff() -> Any:
    """The front, curves and chosen columns of a trade-off whose costs are stated, not measured."""
    file, found = SCRATCH / "tradeoff.json", {}
    with fixed_costs():
        for name, words in {
            "front": ("--features", "strese2015"),
            "few columns": ("--features", "coarse", "--max-features", 3, "--no-curves"),
        }.items():
            file.unlink(missing_ok=True)
            ended = command(
                "tradeoff", small(), "--jobs", 1, "--out", SCRATCH / "out", "--json", file, *words
            )
            assert file.exists(), ended.err
            found[name] = json.loads(file.read_text(encoding="utf-8"))
            found[name].pop("classifiers")
    return found


@part("stability")
def stability() -> Any:
    """Verdicts of the short battery on filters and transforms."""
    found: dict[str, Any] = {}
    for group in ("models", "filters", "transforms", "features"):
        file = SCRATCH / "stability.json"
        file.unlink(missing_ok=True)
        command("stability", "--quick", "--only", group, "--out", SCRATCH / "out", "--json", file)
        told = json.loads(file.read_text(encoding="utf-8"))
        for tally in told["tallies"]:
            if tally["library"] == "texclass":
                found[f"{group}, {tally['subject']}, {tally['family']}"] = tally["marks"]
        found[f"{group} wrong"] = [cell["subject"] for cell in told["ours_wrong"]]
    return found


# How it is written down and compared -----------------------------------------------------------------------


class Columns:
    """A table whose columns have scales of their own."""

    def __init__(self, values: Any) -> None:
        self.values = np.asarray(values, dtype=np.float64)


def flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every leaf of nested results under its path; lists of numbers are arrays."""
    is_list = isinstance(value, list | tuple)
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in UNTOLD:
                yield from flat(inner, f"{path} > {key}" if path else str(key))
    elif isinstance(value, Columns):
        yield f"{path} (by column)", shortened(value.values)
    elif isinstance(value, np.ndarray | np.generic):
        yield path, shortened(np.asarray(value))
    elif is_list and any(map(_is_number, value)) and all(v is None or _is_number(v) for v in value):
        whole = all(isinstance(v, int) for v in value)
        yield path, shortened(np.array(value, dtype=np.int64 if whole else np.float64))
    elif is_list and any(isinstance(v, Mapping | list | tuple | np.ndarray) for v in value):
        for i, inner in enumerate(value):
            yield from flat(inner, f"{path} > {i}")
    elif isinstance(value, float):
        yield path, shortened(np.array(value))
    else:
        yield path, list(value) if isinstance(value, tuple) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def shortened(x: np.ndarray) -> np.ndarray:
    """Return an array without the last 16 bits of its numbers (4e-12 of them), which compresses better."""
    if x.dtype != np.float64:
        return x.astype(np.int32) if x.dtype == np.int64 and np.all(np.abs(x) < 2**31) else x
    bits = np.array(x, order="C").reshape(-1).view(np.uint64)
    rounded = (bits + np.uint64(1 << 15)) & ~np.uint64((1 << 16) - 1)
    kept = np.where(np.isfinite(x.reshape(-1)), rounded.view(np.float64), x.reshape(-1))
    return kept.reshape(x.shape)


def write(name: str, leaves: Mapping[str, Any], loose: Mapping[str, float]) -> None:
    """Write the leaves of a part: numbers of all arrays in one compressed array a type, the rest as JSON."""
    RECORD.mkdir(exist_ok=True)
    plain = {path: leaf for path, leaf in leaves.items() if not isinstance(leaf, np.ndarray)}
    shapes: dict[str, list[Any]] = {}
    stores: dict[str, list[np.ndarray]] = {}
    for path, leaf in leaves.items():
        if isinstance(leaf, np.ndarray):
            shapes[path] = [leaf.dtype.str, *leaf.shape]
            stores.setdefault(leaf.dtype.str, []).append(leaf.ravel())
    arrays = {}
    for kind, pieces in stores.items():
        joined = np.concatenate(pieces)
        # Bytes of one significance beside each other compress far better.
        arrays[kind] = joined.view(np.uint8).reshape(-1, joined.itemsize).T.copy()
    facts = json.dumps({"plain": plain, "shapes": shapes, "loose": dict(loose)}, ensure_ascii=False).encode()
    np.savez_compressed(RECORD / f"{name}.npz", facts=np.frombuffer(facts, np.uint8), **arrays)


def read(name: str) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the leaves of a recorded part, and path -> tolerance of those that are ill-conditioned."""
    with np.load(RECORD / f"{name}.npz") as file:
        facts = json.loads(file["facts"].tobytes().decode())
        stores = {key: file[key] for key in file.files if key != "facts"}
    leaves, at = dict(facts["plain"]), dict.fromkeys(stores, 0)
    joined = {kind: np.ascontiguousarray(store.T).reshape(-1).view(kind) for kind, store in stores.items()}
    for path, (kind, *shape) in facts["shapes"].items():
        size = math.prod(shape)
        leaves[path] = joined[kind][at[kind] : at[kind] + size].reshape(shape)
        at[kind] += size
    return leaves, facts.get("loose", {})


def differences(
    before: Mapping[str, Any], now: Mapping[str, Any], tolerance: float, loose: Mapping[str, float]
) -> Iterator[tuple[str, str, float]]:
    """Yield what differs: path, before and now in words, relative difference (inf of what is no number)."""
    for path in [*before, *(path for path in now if path not in before)]:
        allowed = max(tolerance, loose.get(path, 0.0))
        if allowed == math.inf:
            continue
        if path not in before or path not in now:
            yield path, "is new" if path in now else "is gone", math.inf
            continue
        old, new = before[path], now[path]
        if not isinstance(old, np.ndarray) or not isinstance(new, np.ndarray):
            if isinstance(old, np.ndarray) or isinstance(new, np.ndarray) or old != new:
                yield path, f"{_brief(old)} before, {_brief(new)} now", math.inf
        elif old.shape != new.shape:
            yield path, f"shape {old.shape} before, {new.shape} now", math.inf
        elif old.dtype.kind in "iub" and new.dtype.kind in "iub":
            if not np.array_equal(old, new):
                at, n = np.argwhere(np.atleast_1d(old != new))[0], int((old != new).sum())
                told = f"{_at(old, at)} before, {_at(new, at)} now {_place(old, at)}, {n} differ"
                yield path, told, math.inf
        else:
            columns = before.get(path.replace("values (by column)", "columns"), ())
            yield from _numbers(path, old.astype(np.float64), new.astype(np.float64), allowed, columns)


def _numbers(
    path: str, old: np.ndarray, new: np.ndarray, tolerance: float, columns: Any
) -> Iterator[tuple[str, str, float]]:
    if not old.size:
        return
    axis = 0 if path.endswith("(by column)") else None
    with np.errstate(all="ignore"):
        size = np.where(np.isfinite(old), np.abs(old), np.nan)
        known = np.isfinite(size).any(axis=axis, keepdims=True)
        typical = np.nanmedian(np.where(known, size, 0.0), axis=axis, keepdims=True)
        relative = np.abs(new - old) / np.maximum(np.abs(old), FLOOR * typical)
    relative = np.where((old == new) | (np.isnan(old) & np.isnan(new)), 0.0, relative)
    relative = np.atleast_1d(np.where(np.isnan(relative), np.inf, relative))
    wrong = relative > tolerance
    if wrong.any():
        at = np.array(np.unravel_index(int(np.argmax(relative)), relative.shape))
        told = f"{_at(old, at):.17g} before, {_at(new, at):.17g} now {_place(old, at)}"
        count = f", {wrong.sum()} of {wrong.size} differ" if wrong.size > 1 else ""
        if path.endswith("(by column)"):
            named = [columns[i] for i in np.flatnonzero(wrong.any(axis=0))]
            count += f", in {', '.join(named[:6])}{' ...' if len(named) > 6 else ''}"
        yield path, f"{told}, relative difference {_at(relative, at):.2g}{count}", float(_at(relative, at))


def _place(x: np.ndarray, at: np.ndarray) -> str:
    return f"at [{', '.join(map(str, at))}]" if x.ndim else "alone"


def _at(x: np.ndarray, at: np.ndarray) -> Any:
    return np.atleast_1d(x)[tuple(at)]


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 160 else f"{text[:156]} ..."


def data_here(needs: Sequence[str]) -> bool:
    """Whether the folders of recordings are on this machine."""
    root = Path(os.environ["TEXCLASS_DATA"])
    return all((root / name).is_dir() for name in needs)


def compute(name: str) -> dict[str, Any]:
    """Return the leaves of a part, computed now."""
    return dict(flat(PARTS[name][0]()))


def ill_conditioned(name: str, leaves: Mapping[str, Any]) -> dict[str, float]:
    """Return path -> tolerance of numbers of vibrations that change by much more than their input.

    Infinite where another rounding of the input gives another order, or a number without a digit in common.
    """
    global ROUNDED  # noqa: PLW0603
    if not name.startswith("vibration"):
        return {}
    ROUNDED = True
    try:
        changed = differences(leaves, compute(name), 1e-11, {})
        return {path: 100 * change if change < 1e-4 else math.inf for path, _, change in changed}
    finally:
        ROUNDED = False


def main() -> int:
    """Record or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("record", "compare", "list"))
    parser.add_argument("--only", nargs="+", metavar="PART", help="parts, or what their names begin with")
    parser.add_argument("--most", type=int, default=20, help="differences that are printed for each part")
    asked = parser.parse_args()
    names = [name for name in PARTS if not asked.only or any(name.startswith(one) for one in asked.only)]
    if not names:
        parser.error(f"no part begins with {asked.only}; the parts are {', '.join(PARTS)}")
    if asked.what == "list":
        print("\n".join(names))
        return 0
    os.environ.setdefault("TEXCLASS_DATA", str(PROJECT.parent / "shared" / "data"))
    os.environ["TEXCLASS_CACHE"] = str(SCRATCH / "cache")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(PROJECT), os.environ.get("PYTHONPATH", "")])  # of workers
    sys.path[:0] = [str(PROJECT), str(PROJECT / "examples" / "papers")]
    n_different = 0
    for name in names:
        started = time.process_time()
        if not data_here(PARTS[name][1]):
            print(f"{name}: skipped, the recordings are not here", flush=True)
            continue
        try:
            now = compute(name)
        except Exception:
            if asked.what == "record":
                raise
            n_different += 1
            print(f"{name}: failed\n{traceback.format_exc(limit=-3)}", flush=True)
            continue
        took = f"{time.process_time() - started:.0f} s"
        if asked.what == "record":
            write(name, now, ill_conditioned(name, now))
            print(f"{name}: recorded, {(RECORD / f'{name}.npz').stat().st_size} bytes, {took}", flush=True)
            continue
        if not (RECORD / f"{name}.npz").exists():
            n_different += 1
            print(f"{name}: there is no record; `record --only {name}` makes one", flush=True)
            continue
        tolerance = next((t for key, t in TOLERANCE.items() if name.startswith(key)), DEFAULT_TOLERANCE)
        before, loose = read(name)
        found = list(differences(before, now, tolerance, loose))
        n_different += bool(found)
        print(f"{name}: {f'{len(found)} differences' if found else 'same'}, {took}", flush=True)
        for path, words, _ in found[: asked.most]:
            print(f"    {path}: {words}")
        if len(found) > asked.most:
            print(f"    and {len(found) - asked.most} more")
    return 1 if n_different else 0


if __name__ == "__main__":
    try:
        code = main()
    finally:
        if "SAME_AS_BEFORE_SCRATCH" not in os.environ:
            shutil.rmtree(SCRATCH, ignore_errors=True)
    sys.exit(code)
