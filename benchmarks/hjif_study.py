"""Playback of .hjif files from texclass in the MPEG reference software, and handling of damaged files.

`python benchmarks/hjif_study.py --reference PATH` (some minutes) writes reports/studies/hjif. PATH is
the reference's Synthesizer; it is built by hand, apart from this project.
"""

import copy
import json
import math
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import soundfile
from study import command_line, table, write

from texclass.haptics.exchange import play_hjif, play_taps, play_texture, read_hjif, to_hatt, write_hjif
from texclass.haptics.exchange.hjif import FS, Haptics
from texclass.haptics.exchange.rendition import Rendition, level_db
from texclass.haptics.exchange.wav import resample
from texclass.haptics.scene import PlannedScene, SceneSurface, plan_scene
from texclass.haptics.textures import GridModel
from texclass.haptics.textures.guruswamy2011 import Amplitude, LevelLaw, SpatialTexture
from texclass.haptics.textures.hatt import HattTexture
from texclass.haptics.textures.oeztuerk2018 import FrequencyTexture, LpcTexture
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.haptics.textures.resonant_surfaces import SURFACES
from texclass.recording import Samples
from texclass.vibration import Autoregression, MajorFrequencies, TapModel, line_spectrum
from texclass.vibration.scores import goodness_of_fit

SEED = 31031
N_EACH, N_SCENES, N_SPOILED, SECONDS = 20, 100, 60, 1.0
SPOILED = "simulated HaTT texture", "major frequencies", "taps"
"""Of which the first file is spoiled."""
KINDS = ("LPC texture", "major frequencies", "features along a line", "taps")
ENDLESS = "no answer within 30 s"
MOST_SURFACES = 4
"""Of a drawn scene; each is written as a file, as `texclass convert --surface` does."""


def stand_ins() -> Iterator[HattTexture]:
    """Yield the nine resonant surfaces as HaTT textures, models at 5 speeds x 4 forces at 1000 Hz."""
    v, f = (axis.ravel() for axis in np.meshgrid(np.linspace(40, 200, 5), np.linspace(0.5, 3, 4)))
    for one in SURFACES:
        k, level = one.models(np.column_stack([v, np.zeros_like(v)]), f, 1000.0)
        gain = level * np.sqrt(np.prod(1 - k**2, axis=-1))
        lsf = line_spectrum.spread(line_spectrum.from_reflection(k))
        texture = HattTexture.from_models(v, f, lsf, gain**2, 1000.0, name=one.name, mu=0.3)
        yield to_hatt(texture)


def shipped() -> Iterator[tuple[str, Rendition]]:
    """Yield each surface of the shipped scenes, as planned."""
    for name in ("example", "twenty"):
        scene = plan_scene(name).scene
        for surface in scene.model_indices:
            one = SceneSurface(scene, surface)
            yield f"shipped scene {name}", play_texture(one, unit=scene.unit, seconds=SECONDS)


def drawn(kind: str, rng: np.random.Generator) -> Rendition:
    """Return a surface of a kind with random models, rates, levels and sizes."""
    fs = float(rng.choice([500.0, 1000.0, 1344.0, 2000.0, 4000.0, 10_000.0]))
    speeds = np.sort(rng.uniform(10, 400, 3)) + np.arange(3)
    loud = 10 ** rng.uniform(-3, 2)
    match kind:
        case "LPC texture":
            k = rng.uniform(-0.95, 0.95, (3, int(rng.integers(1, 40)))) / np.arange(1, 2)
            models = Autoregression(k, np.prod(np.sqrt(1 - k**2), axis=1) * loud * rng.uniform(0.5, 2, 3))
            return play_texture(LpcTexture(speeds, models, 3 * loud, fs, "drawn"), seconds=SECONDS)
        case "major frequencies":
            n = int(rng.integers(1, 90))
            f = np.sort(rng.uniform(5, fs / 2 - 1, (3, n)), axis=1)
            amplitude = loud * rng.exponential(size=(3, n))
            lines = [
                MajorFrequencies(a, b, rng.uniform(0, 6.28, n)) for a, b in zip(f, amplitude, strict=True)
            ]
            return play_texture(
                FrequencyTexture(speeds, tuple(lines), n * loud, fs, "drawn"), seconds=SECONDS
            )
        case "features along a line":
            n, length = int(rng.integers(1, 30)), float(rng.uniform(2, 200))
            modes = rng.uniform(5, 0.4 * fs, n), rng.uniform(20, 400, n), loud * rng.uniform(0.1, 1, n)
            law = Amplitude(LevelLaw(1.0, 0.1, 0.1), float(rng.uniform(10, 300)), 1.0)
            x, turn = np.sort(rng.uniform(0, length, n)), rng.uniform(-3, 3, n)
            line = np.array([1.0, 0.0])
            return play_texture(
                SpatialTexture("drawn", fs, length, x, np.arange(n), *modes, turn, law, loud, line)
            )
        case "taps":
            n = int(rng.integers(1, 20))
            found = [
                TapModel(loud * rng.normal(), rng.uniform(20, 900), rng.uniform(20, 2000)) for _ in range(n)
            ]
            return play_taps(TapLibrary(tuple(f"m{i}" for i in range(n)), tuple(found)))
    raise ValueError(f"kind is {kind!r}. Expected one of {', '.join(KINDS)}")


def drawn_scene(number: int, rng: np.random.Generator) -> Iterator[tuple[str, Rendition]]:
    """Yield the surfaces of a scene: random lattices, lines or both at 3 speeds x 2 forces."""
    fs = float(rng.choice([500.0, 1000.0, 1344.0, 2000.0, 4000.0]))
    models: list[GridModel] = []
    for _ in range(int(rng.integers(2, MOST_SURFACES + 1))):
        order, n_lines = ((int(rng.integers(1, 12)), 0), (0, 5), (4, 3))[int(rng.integers(3))]
        k, a = rng.uniform(-0.9, 0.9, (3, 2, order)), rng.uniform(0.1, 1.0, (3, 2, n_lines))
        share = rng.uniform(0.1, 0.9) if order else 1.0  # of the power, in the lines
        a *= np.sqrt(2 * share / np.maximum((a**2).sum(axis=2, keepdims=True), 0.01))
        axes = np.sort(rng.uniform(10, 400, 3)) + np.arange(3), np.array([0.5, 2.0])
        power = 10 ** rng.uniform(-6, 4) * rng.uniform(0.2, 2, (3, 2))
        lines = rng.uniform(5, 0.4 * fs, n_lines), np.zeros(n_lines)
        models.append(
            GridModel(axes, np.concatenate([k, a], axis=2), power, 6 * np.sqrt(power.max()), *lines)
        )
    assigned = {f"surface {i}": i for i in range(len(models))}
    scene = PlannedScene(f"scene {number}", fs, "m/s^2", (0.0, fs / 2), 1e3, 2, assigned, tuple(models))
    for name in assigned:
        yield "surface of a drawn scene", play_texture(SceneSurface(scene, name), seconds=SECONDS)


def asked(reference: Path, path: Path, fs: int = int(FS)) -> tuple[str, Samples]:
    """Return the messages of the reference software and the channels (n, n_channels) of its playback."""
    out = path.with_suffix(".wav")
    out.unlink(missing_ok=True)
    words = [str(reference), "-f", str(path), "-o", str(out), "-fs", str(fs)]
    try:
        found = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False)
    except subprocess.TimeoutExpired:
        return ENDLESS, np.zeros((0, 1))
    crashed = f" (signal {-found.returncode})" if found.returncode < 0 else ""
    played = soundfile.read(out, always_2d=True)[0] if out.exists() else np.zeros((0, 1))
    return found.stderr.strip() + crashed, played


def normalised(path: Path) -> Haptics:
    """Rewrite a file with gains of 1, because the reference plays 16 bits; return its contents."""
    content = json.loads(path.read_text(encoding="utf-8"))
    for perception in content["perceptions"]:
        for channel in perception["channels"]:
            channel["gain"] = 1.0
    path.write_text(json.dumps(content), encoding="utf-8")
    return read_hjif(path)


def compared(kind: str, sent: Rendition, reference: Path, folder: Path) -> dict[str, Any]:
    """Return whether the reference accepts a file, and its playback compared with ours and the original."""
    path = folder / "a.hjif"
    losses = write_hjif(sent, path)
    size = path.stat().st_size
    gain = read_hjif(path).perceptions[0].channels[0].gain
    haptics = normalised(path)
    complaint, theirs = asked(reference, path)
    ours = play_hjif(haptics, FS)
    n = min(len(ours), len(theirs))
    a, b = ours[:n, 0], theirs[:n, 0]
    row = {
        "kind": kind,
        "accepted": not complaint and n > 0,
        "complaint": complaint,
        "bytes": size,
        "lost": losses,
    }
    if n == 0:
        return row
    row |= {
        "level_db": level_db(b) - level_db(a),
        "beside_ours": float(np.median(np.abs(a - b))),
        "off": float(np.mean(np.abs(a - b) > 1e-3)),
    }
    if not (sent.taps.size or sent.pitch_mm):
        band = haptics.perceptions[0].channels[0].bands[0]
        rate = float(band.upper_frequency_limit) if band.band_type == "WaveletWave" else FS
        meant = resample(sent.samples, sent.fs, rate)
        step = round(FS / rate)  # a wavelet's samples are held: every one once
        got = gain * b[step // 2 :: step]
        m = min(got.size, meant.size)
        row |= {
            "meant_db": level_db(got[:m]) - level_db(sent.samples),
            "gfc": goodness_of_fit(meant[:m], got[:m]) if m >= 500 else math.nan,
        }
    return row


def places(content: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the way to each value in a tree of JSON."""
    if way:
        yield way
    if isinstance(content, dict):
        for key, value in content.items():
            yield from places(value, (*way, key))
    elif isinstance(content, list):
        for i, value in enumerate(content[:2]):
            yield from places(value, (*way, i))


def spoiled(content: dict[str, Any], rng: np.random.Generator) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield files without end in which a value is missing or of another kind or range."""
    ways = list(places(content))
    while True:
        way = ways[int(rng.integers(len(ways)))]
        new = copy.deepcopy(content)
        inner = new
        for step in way[:-1]:
            inner = inner[step]
        fault = str(rng.choice(["missing", "text", "negative", "empty", "null"]))
        if fault == "missing":
            if isinstance(inner, list):
                continue
            del inner[way[-1]]
        else:
            inner[way[-1]] = {"text": "x", "negative": -3, "empty": {}, "null": None}[fault]
        yield f"{'.'.join(map(str, way))} {fault}", new


def refusals(
    sent: Rendition, reference: Path, folder: Path, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Return the results of reader and reference for `N_SPOILED` damaged files that the reference rejects."""
    write_hjif(sent, folder / "b.hjif")
    whole = json.loads((folder / "b.hjif").read_text(encoding="utf-8"))
    path, rows = folder / "c.hjif", dict[str, dict[str, Any]]()
    for n_tried, (name, content) in enumerate(spoiled(whole, rng)):
        if sum(row["reference"] for row in rows.values()) >= N_SPOILED or n_tried > 20 * N_SPOILED:
            break
        path.write_text(json.dumps(content), encoding="utf-8")
        try:
            read_hjif(path)
            ours = ""
        except ValueError as error:
            ours = str(error).removeprefix(f"{path}: ")
        complaint, _ = asked(reference, path)
        row = {"of": sent.name, "spoiled": name, "reference": bool(complaint), "ours": bool(ours)}
        rows[name] = row | {"ends": complaint != ENDLESS, "message": ours}
    return list(rows.values())


def main() -> None:
    """Run the study and write the report."""
    options = command_line(__doc__, reference="")
    reference, rng = Path(options.reference), np.random.default_rng(SEED)
    if not reference.is_file():
        raise SystemExit(f"--reference is {options.reference!r}. Expected the path of the Synthesizer")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hatt = (("simulated HaTT texture", play_texture(one, seconds=SECONDS)) for one in stand_ins())
        surfaces = [*hatt, *shipped(), *((kind, drawn(kind, rng)) for kind in KINDS * N_EACH)]
        for number in range(N_SCENES):
            surfaces += drawn_scene(number, rng)
        rows = pd.DataFrame([compared(kind, sent, reference, folder) for kind, sent in surfaces])
        bases = [next(one for kind, one in surfaces if kind == named) for named in SPOILED]
        refused = [row for one in bases for row in refusals(one, reference, folder, rng)]
    found = rows.groupby("kind", sort=False).agg(
        files=("accepted", "size"), accepted=("accepted", "sum"), bytes=("bytes", "median"),
        beside=("beside_ours", "max"), off=("off", "max"), level=("level_db", lambda x: x.abs().max()),
        meant=("meant_db", lambda x: x.abs().max()), gfc=("gfc", "min"),
    ).reset_index()  # fmt: skip
    for name, form in (("meant", "{:.2f}"), ("gfc", "{:.4f}")):
        found[name] = ["-" if math.isnan(one) else form.format(one) for one in found[name]]
    summary_table = table(
        found,
        "written = {kind} | files = {files} | accepted = {accepted} | bytes = {bytes:.0f} | "
        "difference = {beside:.1e} | samples off = {off:.2%} | level dB = {level:.3f} | "
        "to meant dB = {meant} | GFC = {gfc}",
        "Files that the reference accepts, and the worst of each kind: its 16 bits beside our player (median "
        "difference; full scale 1), and beside what was meant (level, the spectra's goodness of fit). A "
        "sample is off (over 0.001 of full scale) where the reference takes a held sample a step earlier. "
        "What is meant is lost above 4 kHz (textures of 10 kHz), in lines beyond 63, and in "
        "fractions of a hertz.",
    )
    judged = [row for row in refused if row["reference"] and row["ends"]]
    endless = sum(not row["ends"] for row in refused)
    both = sum(row["ours"] for row in judged)
    only = sum(row["ours"] for row in refused if not row["reference"])
    sentences = (
        f"Of {len(judged)} spoiled files that the reference refuses (a value missing, of another kind or "
        f"range, in files of wavelets and friction, of lines, of taps) our reader refuses {both}; it refused "
        f"{only} of {len(refused) - len(judged) - endless} others, which the reference took without a word; "
        f"with {endless} the reference came to no end."
    )
    lists = {
        "seed": SEED, "surfaces": rows.to_dict("records"), "spoiled": refused,
        "by_kind": found.to_dict("records"),
    }  # fmt: skip
    result = json.loads(json.dumps(lists, default=float).replace("NaN", "null"))
    write(
        options.out,
        "hjif",
        result,
        "MPEG haptics compared with the reference software",
        [summary_table, sentences],
    )


if __name__ == "__main__":
    main()
