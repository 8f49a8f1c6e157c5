"""Whether a change of the code changed any result: record what comes out, compare again after the change.

    python benchmarks/same_as_before.py record            # writes benchmarks/same_as_before/
    python benchmarks/same_as_before.py compare           # exit code 1 if anything differs
    python benchmarks/same_as_before.py compare --only vibration scene
    python benchmarks/same_as_before.py list

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
import lzma
import math
import os
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

os.environ.setdefault("MPLBACKEND", "agg")

from study import ROOT, own_data  # sets the number of threads, on which sums would depend

sys.path.insert(0, str(ROOT / "examples" / "papers"))
import h5py
import numpy as np
import pandas as pd
import scipy.io
import soundfile
from abdulali2016_simulated import simulate_scan as stroke_by_hand
from abdulali2016_simulated import surface
from abdulali2016_study import fit_as_published
from guruswamy2011_objects import OBJECTS, lay_out
from guruswamy2011_objects import simulate_scan as stroke_an_object
from okamura2001_taps import FS as TAPS_HZ
from okamura2001_taps import TABLE_I, simulate_taps

from texclass import vibration
from texclass.cli import main as texclass
from texclass.evaluation import cached_table, find_protocol, load_pipeline
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.pipeline import MatchedRow
from texclass.features import FeatureExtractor
from texclass.haptics import exchange
from texclass.haptics.scene import load_scene, play_path, sweep_of
from texclass.haptics.textures import abdulali2016, guruswamy2011, oeztuerk2018, okamura2001
from texclass.loaders import load_recording, open_dataset
from texclass.phases import segment
from texclass.simulate import (
    operator_catalogue,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    surface_catalogue,
)
from texclass.vibration import interpolation, major_frequencies, scores
from texclass.vibration import line_spectrum as ls
from texclass.vibration.autoregressive import from_autocorrelation, from_direct_form
from texclass.vibration.order import aicc, spectral_error

RECORD = Path(__file__).resolve().with_suffix("")
SCRATCH = Path(tempfile.gettempdir())
"""A folder of its own for each run; none of it is left."""
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
RATINGS = ("rms_spectral_error", "goodness_of_fit", "mean_absolute_difference", "log_spectral_distance")
LINES = ("frequency_hz", "amplitude", "phase")
MODES = ("frequency_hz", "decay_per_s", "amplitude", "phase")
TAP = ("amplitude_slope", "decay_per_s", "frequency_hz")
"""What is told of lines, modes and taps."""
NESTED = (Mapping, list, tuple, np.ndarray)
BY_COLUMN = "values (by column)"
"""Key of a table whose columns, named under `columns` beside it, have scales of their own."""
REAL = {"taps5": 5, "lmt_excerpts": 4, "stylus6": 4, "biotac20": 5, "borealtc": 3, "fabric_speeds": 3}
"""Data sets, and how many of their recordings are looked at."""
SETS = ("strese2015", "strese2015+models", "texclass", "multiscale", "coarse")
OWN_FEATURE = '''
import numpy as np
from texclass.features import Gain, feature


@feature(phase="movement", unit="1", reference="crest factor", gain=Gain())
def crest(view):
    """Peak over root mean square of the movement."""
    x = np.asarray(view.samples)
    return np.abs(x).max() / np.sqrt(np.mean(x**2))
'''
PARTS: dict[str, tuple[Callable[[], Any], Sequence[str]]] = {}


def part(name: str, *needs: str) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Name a part, and the folders of recordings that it needs."""
    return lambda function: PARTS.setdefault(name, (function, needs))[0]


def command(*words: object, stdin: bytes = b"") -> tuple[Any, str, str]:
    """Run the command line in this process; return exit code, standard output and standard error."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    given = io.TextIOWrapper(io.BytesIO(stdin), encoding="utf-8")
    argv = ["texclass", *map(str, words)]
    try:
        with mock.patch.multiple(sys, argv=argv, stdin=given, stdout=out, stderr=err):
            texclass()
    except SystemExit as ended:
        code = ended.code or 0
    return code, out.getvalue(), err.getvalue()


def result_of(*words: object) -> Any:
    """Return the JSON that a command writes, or its exit code and how it refuses."""
    file = SCRATCH / "result.json"
    file.unlink(missing_ok=True)
    code, _, err = command(*words, "--output", SCRATCH / "out", "--json", file)
    if not file.exists():
        return {"code": code, "error": err.strip().splitlines()[-1:]}
    return json.loads(file.read_text(encoding="utf-8"))


def objects(lines: str) -> list[Any]:
    """Return the JSON objects of lines."""
    return [json.loads(line) for line in lines.splitlines() if line.startswith("{")]


def columns_of(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return rows with about the same keys as columns."""
    frame = pd.json_normalize(rows).astype(object)
    return frame.where(frame.notna(), None).to_dict("list")


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


def card(name: str, text: str) -> Path:
    """Write a card (or another file) of our own and return its path."""
    path = SCRATCH / name
    path.write_text(text, encoding="utf-8")
    return path


def small() -> Path:
    """Return the card of a small simulated dataset, 4 operators."""
    recipe = "n_surfaces = 6\nn_recordings = 8\nn_operators = 4\nduration_s = 4.0\n"
    return card(
        "small6.toml",
        f'title = "Small"\nformat = "simulated"\n[recipe]\n{recipe}fs = 10000\nseed = 12\n',
    )


def few_of_biotac() -> Path:
    """Return the card of 6 materials of biotac20, 12 repetitions of each."""
    text = (ROOT / "datasets" / "biotac20.toml").read_text(encoding="utf-8")
    files = r"files = '(?P<material>mat0[1-6])/(?P<recording>mat\\d+_(?P<repetition>0\\d|1[0-2]))\\.wav'"
    return card("biotac.toml", re.sub(r"^files = .*$", files, text, flags=re.MULTILINE))


def some(name: str | Path, n: int) -> list[Any]:
    """Return `n` recordings spread over a dataset."""
    dataset = open_dataset(name)
    return [dataset[int(i)] for i in np.linspace(0, len(dataset) - 1, n).astype(int)]


def simulated_recordings() -> dict[str, list[Any]]:
    """Return 20 simulated recordings: taps, strokes and friction; rising speed, force and taps."""
    plate, mesh = surface_catalogue(5, 3)[:2]
    who = operator_catalogue(2, 3)[1]
    controlled = [
        record_rising_speed(plate, who, duration_s=4.0, seed=1),
        record_rising_force(mesh, who, duration_s=4.0, seed=2),
        record_rising_taps(plate, who, n_taps=5, seed=3),
        record_rising_taps(mesh, who, n_taps=3, seed=4),
    ]
    return {"simulated": some("simulated", 10), "small": some(small(), 6), "controlled": controlled}


def real_recordings() -> dict[str, list[Any]]:
    """Return 24 real recordings."""
    return {name: some(name, n) for name, n in REAL.items()}


# What is recorded ------------------------------------------------------------------------------------------


def benchmark(name: str | Path, pipeline: str, *options: object) -> Any:
    """Return the JSON of `texclass benchmark`, what is only drawn left out."""
    found = result_of("benchmark", name, "--pipeline", pipeline, "--jobs", 1, *options)
    return {key: value for key, value in found.items() if key != "example"}


def predictions(
    dataset: str | Path, pipeline: str, protocol: str | None = None, folds: int | None = None
) -> dict[str, Any]:
    """Return folds (number of the fold that tests a recording) and predicted labels by row and classifier.

    Of rows that select no columns: what the others select is in the result of the benchmark.
    """
    definition = load_pipeline(pipeline)
    split_by = find_protocol(protocol or definition.protocol.name)
    table = cached_table(open_dataset(dataset), *definition.needed, channels=definition.channels, n_jobs=1)
    splits = split_by.split(
        table.frame, definition.protocol.folds if folds is None else folds, definition.seed
    )
    y = table.frame["material"].to_numpy(dtype=str)
    names = np.unique(y)
    fold = np.full(len(y), -1)
    for number, (_, test) in enumerate(splits):
        fold[test] = number
    options = {"nested": split_by.is_nested, "clusters": split_by.clusters(table.frame)}
    labels: dict[str, Any] = {}
    for declared in (row for row in definition.rows if row.select is None):
        row = MatchedRow.of(declared, definition.features, table)
        for classifier in declared.judged_by(definition.classifiers) if row.columns else ():
            found = definition.trial(row, classifier, table)(splits, **options)
            said = np.searchsorted(names, np.concatenate(found.predicted))
            labels.setdefault(declared.name, {})[classifier] = said
    return {"materials": names.tolist(), "fold": fold, "predicted": labels}


def benchmark_and_labels(pipeline: str, name: Callable[[], str | Path], **asked: Any) -> Any:
    """Return the result of a benchmark and, of whole recordings, what each classifier says of them."""
    options = [word for key, value in asked.items() for word in (f"--{key}", value)]
    found = {"result": benchmark(name(), pipeline, *options)}
    if "touch" not in asked and "rows" in found["result"]:
        found |= predictions(name(), pipeline, **asked)
    return found


for _pipeline, _name, _dataset, _asked in (
    *((name, "simulated", None, {}) for name in ("strese2015", "texclass", "multiscale", "coarse")),
    ("texclass", "biotac20", few_of_biotac, {"protocol": "chronological"}),
    ("multiscale", "biotac20", few_of_biotac, {"protocol": "few-shot"}),
    *((name, "taps5", None, {"folds": 4}) for name in ("strese2015", "strese2015+models", "texclass")),
    ("coarse", "borealtc", None, {"touch": 5, "touches": 6, "protocol": "grouped", "folds": 5}),
):
    _of = _dataset or (lambda name=_name: name)
    _needs = () if _name == "simulated" else (_name,)
    PARTS[f"benchmark-{_pipeline}-{_name}"] = partial(benchmark_and_labels, _pipeline, _of, **_asked), _needs


@part("benchmark-protocols")
def protocols() -> Any:
    """Every protocol, choice inside the training part, touches, and a new feature, on a small dataset."""
    own = card("own_feature.py", OWN_FEATURE)
    asked: dict[str, tuple[object, ...]] = {
        "operator": ("texclass", "--protocol", "operator"),
        "paper": ("strese2015", "--protocol", "paper", "--folds", 4),
        "chronological": ("multiscale", "--protocol", "chronological"),
        "few-shot": ("coarse", "--protocol", "few-shot"),
        "choose": ("coarse", "--protocol", "recording", "--folds", 4, "--nested-cv"),
        "touches": ("multiscale", "--window", 0.8, "--max-windows", 2, "--folds", 3),
        "too many folds": ("coarse", "--folds", 9),
        "new feature": ("coarse", "--folds", 4, "--feature", f"{own}:crest"),
    }
    return {name: benchmark(small(), *words) for name, words in asked.items()}


def tables(groups: Mapping[str, Sequence[Any]], plans: Sequence[tuple[str, str]]) -> Any:
    """Return the feature tables of groups of recordings, and what is undefined of which."""
    found: dict[str, Any] = {}
    for group, recordings in groups.items():
        for features, channels in plans:
            table = FeatureExtractor(features, channels=channels).fit(recordings).extract(recordings)
            undefined: dict[str, list[str]] = {}
            for recording, feature, reason in table.reasons:
                undefined.setdefault(f"{feature}: {reason}", []).append(recording)
            found[f"{group} {features} {channels}"] = {
                "columns": list(table.columns),
                BY_COLUMN: table.values,  # noqa: PD011, no DataFrame
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
        p, samples = segment(recording), recording.acceleration
        found[recording.recording_id] = {
            "taps": np.array([(tap.start, tap.impact, tap.end) for tap in p.taps]),
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
    found = phases(recording.with_(phases=None) for recording in others)
    return {"simulated": phases(open_dataset("simulated")), "others": found}


@part("phases-real", *REAL)
def phases_real() -> Any:
    """Phases as declared by cards, and as found without their declaration."""
    return {
        name: {"declared": phases(group), "found": phases(r.with_(phases=None) for r in group)}
        for name, group in real_recordings().items()
    }


@part("files")
def files() -> Any:
    """One recording through every format of files, and a folder of materials."""
    rng = np.random.default_rng(8)
    x = np.round(rng.normal(0, 0.1, (3000, 3)), 5)
    folder = SCRATCH / "files"
    folder.mkdir()
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
    return found | {"folder": folder_of_materials(rng)}


def folder_of_materials(rng: np.random.Generator) -> Any:
    """Return the features of a folder without a card."""
    for i in range(6):
        one = SCRATCH / "folder" / ("felt", "oak")[i % 2] / f"run_{i:02d}.csv"
        one.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(one, rng.normal(0, 1 + i % 2, 4000), header="a", comments="")
    table = SCRATCH / "folder.parquet"
    code, _, err = command(
        "extract", SCRATCH / "folder", "--fs", 2000, "--unit", "g", "--jobs", 1, "-o", table
    )
    if code:
        return err.strip().splitlines()[-1:]
    read = pd.read_parquet(table)
    numbers = list(read.select_dtypes("floating"))
    text = read.drop(columns=numbers).astype("string").fillna("")
    return {"text": text.to_dict("list"), "columns": numbers, BY_COLUMN: read[numbers].to_numpy(np.float64)}


def hard_signals(*, rounded: bool = False) -> dict[str, np.ndarray]:
    """Return seeded signals, easy and hard ones, of 2000 samples; rounded another way if asked for."""
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
    if rounded:
        units = np.random.default_rng(99).integers(-1, 2, 2000) * np.finfo(np.float64).eps
        found |= {name: x * (1 + units) for name, x in found.items() if name != "constant"}
    return found


def of_model(model: Any) -> dict[str, Any]:
    """Return what an autoregressive model is."""
    return {
        "k": thin(model.reflection), "gain": np.asarray(model.gain), "residual": thin(model.residual, 12),
        "fitted": np.asarray(model.fitted_order), "clipped": np.asarray(model.clipped),
        "fallback": np.asarray(model.fallback),
    }  # fmt: skip


@part("vibration-models")
def vibration_models(signals: Mapping[str, np.ndarray] | None = None) -> Any:
    """Autoregressive models, line spectra, lattices, interpolation, choice of the order."""
    v, found, omega = vibration, {}, np.linspace(0.01, 3.1, 50)
    signals = hard_signals() if signals is None else signals
    for name, x in signals.items():
        here: dict[str, Any] = {}
        for method in ("burg", "autocorrelation", "modified_covariance"):
            for order in (1, 2, 6, 24, 120, 400) if method != "modified_covariance" else (1, 2, 6, 24, 120):
                model = v.fit(x, order, method=method)
                here[f"{method} {order}"] = of_model(model)
                if method == "burg" and order in (2, 24, 400) and name not in ("silence", "constant"):
                    lsf = ls.from_reflection(model.reflection)
                    here[f"lsf {order}"] = {
                        "lsf": thin(lsf),
                        "back": thin(attempt(ls.to_reflection, lsf)),
                        "spectrum": thin(v.Autoregression(model.reflection, 1.0).log_spectrum_db(omega), 20),
                    }
        here["yule_walker"] = of_model(v.fit(x, 12, variance="yule_walker"))
        found[name] = here
    a, b = (v.fit(signals[name], 20) for name in ("colored", "decay"))
    found["frames"] = of_model(v.fit(signals["colored"].reshape(10, 200), 8))
    found["lattice"] = of_lattices(a, b, v.fit(signals["oversampled"], 400), signals)
    lsf20 = ls.from_reflection(np.stack([a.reflection, b.reflection]))
    nearest = v.Autoregression(ls.to_reflection(ls.spread(lsf20.mean(axis=0))), np.exp(-1.5))
    blend = v.ModelBlend([a, b])
    found["between"] = {
        "blend": of_model(blend.at([0.3, 0.7])),
        "rows": of_model(blend.at(np.array([[1.0, 0.0], [0.5, 0.5], [0.1, 0.9]]))),
        "interpolate": of_model(interpolation.interpolate(a, b, 0.25)),
        "level": of_model(interpolation.interpolate(a, b, 0.5, loudness="level")),
        "from lines": of_model(nearest),
        "spread": ls.spread(np.array([0.5, 0.4, 0.4, 1.0, 3.3, 3.2]), 0.01),
        "conditioning": thin(ls.conditioning(lsf20)),
        "from autocorrelation": of_model(from_autocorrelation([4.0, 2.0, 0.5, -0.3])),
        "from coefficients": of_model(from_direct_form([1.0, -1.2, 0.9, -0.2], 0.5)),
    }
    found["order"] = []
    for criterion in ("spectral_error", "aicc"):
        for name in ("colored", "decay", "tones"):
            chosen = v.select_order(signals[name], 60, criterion=criterion)
            told = {"criterion": criterion, "order": int(chosen.order), "values": thin(chosen.values)}
            found["order"].append(told)
    found["errors of orders"] = {"spectral": spectral_error(signals["colored"], a), "aicc": aicc(a, 2000)}
    return found


def of_lattices(a: Any, b: Any, k400: Any, signals: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what lattices of two models make of noise, alone and gliding, and what their inverses leave."""
    v, rng = vibration, np.random.default_rng
    whites, w = rng(1).standard_normal(3000), np.arange(1, 1001)[:, None] / 1000
    glide = v.LatticeSynthesis(a)
    first = glide.process(whites[:500])
    gliding = (1 - w) * a.reflection + w * b.reflection
    level = (a.level ** (1 - w) * b.level**w).ravel()
    second = glide.process_varying(whites[500:1500], gliding, level)
    u = np.linspace(0, 1, 1000)[:, None]
    varying, rising = u * b.reflection + u[::-1] * a.reflection, np.linspace(1, 2, 1000)
    return {
        "synthesis": thin(np.concatenate([first, second, glide.process(whites[1500:])])),
        "varying": thin(v.LatticeSynthesis(a).process_varying(whites[:1000], varying, rising)),
        "high order": thin(v.synthesize(k400, 3000, rng(2))),
        "whitened": thin(v.whiten(a, signals["colored"])),
        "inverse": thin(v.LatticeInverse(b).process(signals["decay"])),
        "settled": thin(v.LatticeSynthesis(a).settle(rng(3)).process(whites)),
    }


def facts_of(found: Any, names: Sequence[str]) -> Any:
    """Return some attributes of what a fit found, one row each, or how it is refused."""
    return found if isinstance(found, str) else np.stack([getattr(found, name) for name in names])


def of_prony(found: Any) -> Any:
    """Return the filter of Prony's method; its poles and sound where it is stable."""
    if isinstance(found, str):
        return found
    told = {"order": found.order, "b": found.b, "a": found.a, "error": found.error}
    return told | (
        {"radius": found.pole_radius, "shown": thin(found.synthesize(200))} if found.is_stable else {}
    )


@part("vibration-modes")
def vibration_modes(signals: Mapping[str, np.ndarray] | None = None) -> Any:
    """Matrix pencil, Prony, taps, lines, pieces, bands and scores."""
    signals = hard_signals() if signals is None else signals
    v, found, rng, fs = vibration, {}, np.random.default_rng(7), 10_000.0
    rings = v.DecayingModes(
        [120.0, 333.0, 900.0, 0.0], [30.0, 80.0, 200.0, 50.0], [1, 0.5, 0.3, 0.2], [0.1, -1, 2, 0]
    )
    ring = rings.synthesize(600, fs)
    found["modes"] = {
        "ring": thin(ring), "sections": rings.sections(fs),
        "filtered": thin(rings.filter(signals["noise"], fs)),
        "strongest": rings.strongest(2, 0.05).frequency_hz,
    }  # fmt: skip
    noisy = {"clean": ring, "noisy": ring + 1e-3 * rng.standard_normal(600), "decay": signals["decay"][:400]}
    short = ("noise", "tones", "constant", "silence", "impulse", "huge")
    for name, x in (noisy | {name: signals[name][:300] for name in short}).items():
        found[f"pencil {name}"] = {
            "own order": facts_of(attempt(v.fit_matrix_pencil, x, fs), MODES),
            "order 6": facts_of(attempt(v.fit_matrix_pencil, x, fs, order=6), MODES),
            "projected": facts_of(attempt(v.fit_matrix_pencil, x, fs, order=4, outside="project"), MODES),
        }
        found[f"prony {name}"] = of_prony(attempt(v.fit_prony, x, 0.05 * (float(np.abs(x).max()) or 1.0)))
        found[f"lines {name}"] = facts_of(attempt(v.fit_major_frequencies, x, fs), LINES)
    slow, fast = (
        v.fit_major_frequencies(signals[name], fs, n_frequencies=9) for name in ("colored", "tones")
    )
    found["lines between"] = facts_of(major_frequencies.interpolate(slow, fast, 0.4), LINES)
    between = oeztuerk2018.FrequencyTexture([50.0, 100.0], [slow, fast], 1.0, fs)
    found["lines at speed"] = facts_of(between.at(80.0), LINES)
    played = slow.synthesize(1000, fs)
    found["lines played"] = thin(played / np.abs(played).max())
    velocity, t = np.array([0.1, 0.2, 0.35]), np.arange(300) / fs
    taps = [
        -800 * u * np.exp(-90 * t) * np.sin(2 * np.pi * 270 * t) + 0.2 * rng.standard_normal(300)
        for u in velocity
    ]
    for name, fit in (("okamura", v.fit_okamura), ("least squares", v.fit_tap_model)):
        found[f"tap {name}"] = facts_of(fit(taps, velocity, fs), TAP)
    pieces = v.segment_rising_peaks(np.tile(ring[:200], 6) + 0.05 * rng.standard_normal(1200), 0.3)
    f = np.arange(500.0)
    band = v.vibration_band(f, 1 / ((f - 80) ** 2 + 400), smoothing_hz=3.0)
    bounds = {"bounds": pieces.bounds, "peaks": pieces.n_peaks}
    found["pieces"] = bounds | {"band": [band.major_hz, band.upper_hz]}
    pairs = ("noise", "colored"), ("colored", "quantized"), ("decay", "tones"), ("tiny", "noise")
    for one, other in pairs:
        x, y = signals[one], signals[other]
        rated = {name: attempt(getattr(scores, name), x, y) for name in RATINGS}
        rated["band_energy_distance"] = attempt(scores.band_energy_distance, x, y, fs)
        found[f"scores {one} {other}"] = rated
    return found


def fitted_textures() -> dict[str, Any]:
    """Return a texture of each way of the papers, fitted to simulated recordings."""
    rng, speeds = np.random.default_rng(4), [50.0, 100.0, 200.0]
    plates = [np.convolve(rng.standard_normal(6000), np.hanning(round(4000 / v)), "same") for v in speeds]
    plates = [v * plate for v, plate in zip(speeds, plates, strict=True)]
    hand = stroke_by_hand(surface("S7"), 10.0, 1000.0, np.random.default_rng(0))
    modelled = abdulali2016.model_scan(hand)
    network = modelled.network()
    rng, rubber = np.random.default_rng(3), OBJECTS[2]
    stroke = stroke_an_object(rubber, lay_out(rubber, 60.0, rng), rng)
    return {
        "abdulali2016 network": network,
        "abdulali2016 delaunay": modelled.delaunay(),
        "abdulali2016 baked": abdulali2016.bake(network, "S7", (5, 5, 3)),
        "abdulali2016 as published": fit_as_published(hand),
        "guruswamy2011": guruswamy2011.fit_texture(stroke, rubber.law).texture,
        "oeztuerk2018 lpc": oeztuerk2018.fit_lpc(plates, speeds, 10_000.0, order=40, name="felt"),
        "oeztuerk2018 lines": oeztuerk2018.fit_frequencies(plates, speeds, 10_000.0, name="felt"),
    }


def of_taps() -> dict[str, Any]:
    """Return A, B, f of taps as fitted, scaled and loaded again, and the force of a virtual wall."""
    rng, fs = np.random.default_rng(5), TAPS_HZ["wood"]
    made = {name: simulate_taps(TABLE_I[name], rng, fs, n_taps=6) for name in ("wood", "rubber")}
    taps, velocity = ({name: one[i] for name, one in made.items()} for i in range(2))
    library, _ = okamura2001.fit_library(taps, velocity, fs)
    device = okamura2001.ForceDevice(limit_n=50.0)
    scaled = okamura2001.scale_into(library, device, 0.4)
    wall = okamura2001.VirtualWall(scaled["wood"], device)
    depth = 2 * np.sin(2 * np.pi * np.arange(4000) / 1500 - 0.5)
    force = wall.renderer().process(depth, np.gradient(depth) * device.rate_hz)
    again = exchange.load_taps(exchange.save_texture(library, SCRATCH / "taps.texture"))
    return {
        "fits": np.array([facts_of(one, TAP) for some in (library, scaled) for one in some.values()]),
        "wall": thin(force, 100),
        "again": np.array([facts_of(one, TAP) for one in again.values()]),
    }


def hand_path(n: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity (mm/s) and force (N) of a seeded path with a lift-off."""
    rng = np.random.default_rng(11)
    t = np.linspace(0, 7, n)
    velocity = np.column_stack([np.interp(t, np.arange(8), rng.uniform(-150, 150, 8)) for _ in range(2)])
    return velocity, np.where(np.sin(3 * t) > -0.9, 1 + 0.5 * np.sin(2 * t), 0.0)


@part("scene")
def scene() -> Any:
    """A planned scene and its samples, textures of all papers, and their files."""
    e, file, plan_file = exchange, SCRATCH / "example.texture", SCRATCH / "plan.json"
    command("scene", "plan", "example", "--output", file, "--json", plan_file)  # 1: the machine was too slow
    plan = json.loads(plan_file.read_text(encoding="utf-8"))
    plan.pop("budget")
    planned = load_scene(file)
    hand = sweep_of(planned)
    velocity, force, _ = hand.at_rate(planned.fs)
    samples = play_path(planned, hand, seed=0).samples
    path = thin(np.column_stack([velocity, force]))
    found: dict[str, Any] = {"plan": plan, "path": path, "played": thin(samples, 400)}
    motion = hand_path()
    textures = fitted_textures()
    for name, texture in textures.items():
        x = texture.renderer(seed=3).process(*motion)
        saved = e.save_texture(texture, SCRATCH / f"{name}.texture", unit="m/s^2")
        again = e.load_texture(saved).renderer(seed=3).process(*motion)
        found[name] = {
            "fs": texture.fs, "operations": texture.operations, "rendered": thin(x, 100),
            "again": bool(np.array_equal(x, again)),
            "arrays": {k: thin(a, 20) for k, a in texture.arrays().items()},
        }  # fmt: skip
    found["okamura2001"] = of_taps()
    for name in ("abdulali2016 network", "oeztuerk2018 lpc"):
        hatt = e.to_hatt(textures[name], unit="m/s^2", fs=1000.0, order=12)
        again = e.read_hatt(e.write_hatt(hatt, SCRATCH / "hatt.xml"))
        xml = (SCRATCH / "hatt.xml").read_text(encoding="utf-8")
        found[f"HaTT of {name}"] = {
            "rendered": thin(hatt.renderer(seed=1).process(*motion), 60),
            "again": thin(again.renderer(seed=1).process(*motion), 60),
            "xml": [xml.count("<value>"), re.findall(r"<(\w+)", xml)[:20]],
        }
    for encoding in ("float32", "pcm16"):
        read = e.read_wav(e.write_wav(SCRATCH / "x.wav", samples, 1000.0, unit="g", encoding=encoding))
        found[f"WAV {encoding}"] = [thin(read.samples, 60), read.fs, read.unit, read.peak]
    return found


@part("recognition-answers")
def recognition_answers() -> Any:
    """Models trained on a small dataset, their answers to 50 recordings, and those of streams."""
    dataset = open_dataset(small())
    names = [f"{small()}:{entry.recording_id}" for entry in dataset.entries]
    strangers = [f"simulated:{entry.recording_id}" for entry in open_dataset("simulated").entries[5:240:117]]
    found: dict[str, Any] = {}
    whole, touch = SCRATCH / "whole.skops", SCRATCH / "touch.skops"
    for file, n_asked, words in (
        (whole, 48, ("--row", "Taps, movement, friction", "--classifier", "lda")),
        (touch, 16, ("--row", "Movement", "--classifier", "kernel", "--window", 1.0)),
    ):
        _, _, err = command("train", small(), "-o", file, "--jobs", 1, *words)
        assert file.exists(), err
        answers = objects(command("predict", file, "--jsonl", *names[:n_asked], *strangers)[1])
        for answer in answers:
            answer["asked"] = answer.pop("file").rpartition(":")[2]
        found[f"predict {file.stem}"] = columns_of(answers)
    heard: list[Any] = []
    for i, recording in enumerate(dataset):
        x = recording.acceleration.reshape(recording.n_samples, -1)
        words, told = ("--channels", x.shape[1]), x.astype("<f4").tobytes()
        if i % 8 == 0:  # as text, a sample a line
            words, told = (), "\n".join(" ".join(map(repr, row)) for row in x.tolist()).encode()
        code, out, _ = command("stream", touch, "--fs", recording.fs, *words, "--jsonl", stdin=told)
        heard += [{"of": recording.recording_id, "code": code, **one} for one in objects(out)]
    for i in (3, 30):
        code, out, _ = command("stream", touch, names[i], "--evidence", "majority", "--jsonl")
        heard += [{"of": f"file {i}", "code": code, **one} for one in objects(out)]
    told = columns_of(heard)
    by_clock_or_place = ("age_s", "ms", "window.ms", "source")
    found["stream"] = {key: column for key, column in told.items() if key not in by_clock_or_place}
    return found


@contextlib.contextmanager
def fixed_costs() -> Iterator[None]:
    """Let every part of a feature set cost what its name says, not what the clock says."""
    measured = CostMeter.model

    def stated(self: Any, *args: Any, **options: Any) -> Any:
        model = measured(self, *args, **options)
        digests = [hashlib.sha256(name.encode()).hexdigest() for name in model.parts]
        ms = [0.05 + int(digest[:6], 16) / 2**24 for digest in digests]
        return replace(model, ms=np.array(ms), segmentation_ms=1.0)

    with mock.patch.object(CostMeter, "model", stated):
        yield


@part("recognition-tradeoff")
def recognition_tradeoff() -> Any:
    """The front, curves and chosen columns of a trade-off whose costs are stated, not measured."""
    found = {}
    with fixed_costs():
        for name, words in {
            "front": ("--features", "strese2015"),
            "few columns": ("--features", "coarse", "--max-features", 3, "--no-curves"),
        }.items():
            found[name] = result_of("tradeoff", small(), "--jobs", 1, *words)
            found[name].pop("classifiers", None)
    return found


@part("stability")
def stability() -> Any:
    """Verdicts of the short battery on models, filters, transforms and features."""
    found: dict[str, Any] = {}
    for group in ("models", "filters", "transforms", "features"):
        told = result_of("stability", "--quick", "--only", group)
        for tally in told["tallies"]:
            if tally["library"] == "texclass":
                found[f"{group}, {tally['subject']}, {tally['family']}"] = tally["marks"]
        found[f"{group} wrong"] = [cell["subject"] for cell in told["ours_wrong"]]
    return found


# How it is written down and compared -----------------------------------------------------------------------


def flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every leaf of nested results under its path; an array is a leaf, and a list without lists."""
    if isinstance(value, np.ndarray | np.generic):
        yield path, value.tolist()
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in UNTOLD:
                yield from flat(inner, f"{path} > {key}" if path else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(one, NESTED) for one in value):
        for i, inner in enumerate(value):
            yield from flat(inner, f"{path} > {i}")
    else:
        yield path, list(value) if isinstance(value, tuple) else value


def is_numeric(value: Any) -> bool:
    """Whether a leaf holds numbers, perhaps None among them, and nothing else."""
    if isinstance(value, list | tuple):
        return any(v is not None for v in value) and all(v is None or is_numeric(v) for v in value)
    return isinstance(value, int | float) and not isinstance(value, bool)


def rounded(leaf: Any) -> Any:
    """Return a leaf with 12 digits of its numbers."""
    if isinstance(leaf, list):
        return [rounded(inner) for inner in leaf]
    return float(f"{leaf:.12g}") if isinstance(leaf, float) else leaf


def write(name: str, leaves: Mapping[str, Any], loose: Mapping[str, float]) -> int:
    """Write the leaves of a part and the tolerance of those that are ill-conditioned; return the bytes."""
    RECORD.mkdir(exist_ok=True)
    told = {"leaves": {path: rounded(leaf) for path, leaf in leaves.items()}, "loose": loose}
    packed = lzma.compress(json.dumps(told, ensure_ascii=False, separators=(",", ":")).encode())
    return (RECORD / f"{name}.json.xz").write_bytes(packed)


def read(name: str) -> dict[str, Any]:
    """Return what `write` wrote."""
    return json.loads(lzma.decompress((RECORD / f"{name}.json.xz").read_bytes()))


def differences(
    before: Mapping[str, Any], now: Mapping[str, Any], tolerance: float, loose: Mapping[str, float]
) -> Iterator[tuple[str, str, float]]:
    """Yield what differs: path, before and now in words, relative difference (inf of what is no number)."""
    for path in dict.fromkeys((*before, *now)):
        allowed = max(tolerance, loose.get(path, 0.0))
        if path not in before or path not in now:
            yield path, "is new" if path in now else "is gone", math.inf
            continue
        old, new = before[path], now[path]
        if allowed == math.inf or old == new:
            continue
        if not (is_numeric(old) and is_numeric(new)):
            yield path, f"{brief(old)} before, {brief(new)} now", math.inf
            continue
        x, y = np.array(old, dtype=np.float64), np.array(new, dtype=np.float64)
        if x.shape != y.shape:
            yield path, f"shape {x.shape} before, {y.shape} now", math.inf
            continue
        relative = relative_difference(x, y, axis=0 if path.endswith(BY_COLUMN) else None)
        if path.endswith("mean"):  # of values that cancel it is rounding, beside their root mean square
            relative = np.where(np.abs(x - y) <= 1e-15 * before.get(f"{path[:-4]}rms", 0.0), 0.0, relative)
        if are_whole(old) and are_whole(new):
            relative = np.where(x == y, 0.0, math.inf)
        if np.any(relative > allowed):
            at = np.unravel_index(np.argmax(relative), x.shape)
            told = f"{x[at]:.17g} before, {y[at]:.17g} now at {list(map(int, at))}"
            count = f"{np.sum(relative > allowed)} of {x.size} differ"
            if path.endswith(BY_COLUMN):
                columns = np.array(before[path.replace(BY_COLUMN, "columns")])
                count += f", in {', '.join(columns[(relative > allowed).any(axis=0)][:6])}"
            largest = float(relative[at])
            yield path, f"{told}, relative difference {largest:.2g}, {count}", largest


def relative_difference(old: np.ndarray, new: np.ndarray, axis: int | None) -> np.ndarray:
    """Return |new - old| over |old|, or over the typical size along an axis where that is larger."""
    size = np.where(np.isfinite(old), np.abs(old), np.nan)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a column without a number
        typical = np.nan_to_num(np.nanmedian(size, axis=axis, keepdims=True))
        relative = np.abs(new - old) / np.maximum(np.abs(old), FLOOR * typical)
    relative = np.where((old == new) | (np.isnan(old) & np.isnan(new)), 0.0, relative)
    return np.nan_to_num(relative, nan=math.inf, posinf=math.inf)


def are_whole(value: Any) -> bool:
    """Whether all numbers of a leaf are integers."""
    return all(map(are_whole, value)) if isinstance(value, list) else isinstance(value, int)


def brief(value: Any) -> str:
    """Return a value as text of at most 160 letters."""
    text = repr(value)
    return text if len(text) <= 160 else f"{text[:156]} ..."


def ill_conditioned(name: str, leaves: Mapping[str, Any]) -> dict[str, float]:
    """Return path -> tolerance of numbers of vibrations that change by much more than their input.

    Infinite where another rounding of the input gives another order, or a number without a digit in common:
    what that changes, another machine may change, too.
    """
    if not name.startswith("vibration"):
        return {}
    again = dict(flat(PARTS[name][0](hard_signals(rounded=True))))
    changed = differences(leaves, again, 1e-11, {})
    return {path: 100 * change if change < 1e-4 else math.inf for path, _, change in changed}


def compared(name: str, leaves: Mapping[str, Any], most: int) -> str:
    """Return what differs from the record of a part, "same" if nothing does."""
    if not (RECORD / f"{name}.json.xz").exists():
        return f"there is no record; `record --only {name}` makes one"
    tolerance = next((t for key, t in TOLERANCE.items() if name.startswith(key)), DEFAULT_TOLERANCE)
    record = read(name)
    found = list(differences(record["leaves"], leaves, tolerance, record["loose"]))
    told = [f"{len(found)} differences" if found else "same"]
    told += [f"    {path}: {words}" for path, words, _ in found[:most]]
    return "\n".join([*told, *([f"    and {len(found) - most} more"] if len(found) > most else [])])


def outcome(name: str, what: str, most: int) -> str:
    """Compute a part, record or compare it, and say what came out."""
    function, needs = PARTS[name]
    if not all((Path(os.environ["TEXCLASS_DATA"]) / folder).is_dir() for folder in needs):
        return "skipped, the recordings are not here"
    try:
        leaves = dict(flat(function()))
    except Exception:
        if what == "record":
            raise
        return f"failed\n{traceback.format_exc(limit=-3)}"
    if what == "record":
        return f"recorded, {write(name, leaves, ill_conditioned(name, leaves))} bytes"
    return compared(name, leaves, most)


def main() -> int:
    """Record or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("record", "compare", "list"))
    parser.add_argument("--only", nargs="+", metavar="PART", help="parts, or what their names begin with")
    parser.add_argument("--most", type=int, default=20, help="differences that are printed for each part")
    asked = parser.parse_args()
    names = [name for name in PARTS if not asked.only or name.startswith(tuple(asked.only))]
    if not names:
        parser.error(f"no part begins with {asked.only}; the parts are {', '.join(PARTS)}")
    if asked.what == "list":
        print("\n".join(names))
        return 0
    own_data()
    os.environ["TEXCLASS_CACHE"] = str(SCRATCH / "cache")
    said = {}
    for name in names:
        started = time.process_time()
        said[name] = outcome(name, asked.what, asked.most)
        print(f"{name} ({time.process_time() - started:.0f} s): {said[name]}", flush=True)
    return int(any(not words.startswith(("same", "skipped", "recorded")) for words in said.values()))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="same_as_before_") as scratch:
        SCRATCH = Path(scratch)
        sys.exit(main())
