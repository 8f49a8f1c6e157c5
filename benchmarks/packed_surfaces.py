"""Packed surfaces of 8 to 128 bytes: similarity to the original, compared with MPEG's codec.

Rate against distortion in-sample, held out in time (`lmt_excerpts`, `fabric_speeds`), in speed (`stylus6`,
`fabric_speeds`) and in force (`stylus6`); and of simulated stand-ins for published models. Each next to nulls
and ceiling. `python benchmarks/packed_surfaces.py` (10 minutes) writes reports/studies/packed_surfaces. With
`--reference BIN` it runs MPEG's codec on `lmt_excerpts`, too: BIN is the folder of the reference's programs
Encoder and Synthesizer, which are built by hand, apart from this project. Otherwise the rows of the codec are
those of the report that is replaced.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import soundfile
from hjif_study import stand_ins
from scipy.signal import butter, resample_poly, sosfiltfilt, welch
from scipy.stats import spearmanr
from study import ROOT, command_line, table, write

from texclass.features.extractor import FeatureExtractor
from texclass.haptics.scales import scale_values
from texclass.haptics.textures import PackedTexture, Scan, Texture, pack
from texclass.haptics.textures.grid_texture import LIGHT_N, REST_MM_S
from texclass.haptics.textures.packing import FRAME_S, LOWEST_HZ, sampled_axes
from texclass.loaders import load_recording, open_dataset
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue
from texclass.vibration.null_scores import NULLS, distance_to_null, null_scores
from texclass.vibration.perceptual_distance import perceptual_distance
from texclass.vibration.scores import band_energy_distance, goodness_of_fit

sys.path.insert(0, str(ROOT / "examples" / "papers"))
from shared import FABRIC_MM_S

FS = 8000
BYTES = (8, 16, 32, 64, 128)
KILOBITS = (1, 2, 4, 8, 16)
N_SEEDS, SEED = 3, 1704
FASTEST, HARDEST = 1000.0, 20.0
"""mm/s and N; `stylus6` holds a few readings of up to 40 m/s and 500 kN."""
STRONGEST_DB = 30.0
"""Assumed sensation level in dB of the strongest band, for the perceptual distance."""
CANDIDATES = ("other half", *NULLS)
SCORES = {"gfc": True, "paper": True, "bands": False, "level_db": False, "perceptual": False}
"""Scores, and whether higher is better."""


CODEC = (
    "MPEG's codec (its reference software, a WAV of 8 kHz to packets and back) takes them for 1 s; it does "
    "not go below 800 to 950 bytes: at 1 kb/s it writes the file of 2 kb/s. An earlier run of it on such "
    "excerpts, of which the estimator was not written down, gave 0.84-0.89 at 2 kb/s (910-941 bytes), "
    "0.98-0.996 at 4, 0.999 at 8: the GFC from 20 to 1000 Hz agrees with it at 4 and 8 kb/s, and covers it "
    "at 2 (one excerpt, of brick, is at 0.77). That of single bins of a transform of 1 s, 0.94-0.96 at 4 "
    "kb/s, would not."
)

EARLIER = " Rows of MPEG's codec are those of an earlier run, without the perceptual distance."


def excerpts(set_: str) -> Iterator[tuple[str, Samples]]:
    """Yield the recordings of a set, at 8 kHz, one axis, the mean removed, at most 4 s."""
    for path in sorted((Path(os.environ["TEXCLASS_DATA"]) / set_).rglob("*.wav")):
        recording = load_recording(path, unit="arbitrary")
        x = recording.acceleration.reshape(recording.n_samples, -1)[:, 0]
        x = resample_poly(x - x.mean(), FS, round(recording.fs)) if recording.fs != FS else x - x.mean()
        yield path.stem, x[: 4 * FS]


def rendered(texture: Texture, speed: Any, force: Any, n: int, seed: int) -> Samples:
    """Return n samples along speeds and forces (a number, or n of them), after a tenth of a second."""
    before = round(0.1 * texture.fs)
    v, f = (np.pad(np.broadcast_to(one, n), (before, 0), mode="edge") for one in (speed, force))
    path = np.column_stack([v, np.zeros_like(v)])
    return texture.renderer(seed=seed).process(path, f)[before:]


def scores(x: Samples, y: Samples, fs: float) -> dict[str, float]:
    """Return how close y is to x, pieces of signals (n_pieces, n) both, the first of them the recorded ones.

    Two readings of the GFC: amplitudes from 20 to 1000 Hz, Welch's of 64 ms; and as the paper prints it.
    """
    f, S = welch(np.stack([x, y]), fs, nperseg=round(0.064 * fs))
    a, b = np.sqrt(S.mean(axis=1)[:, (f >= LOWEST_HZ) & (f <= 1000)])
    one, other = x.ravel(), y.ravel()
    return {
        "gfc": float(a @ b / np.linalg.norm(a) / np.linalg.norm(b)),
        "paper": goodness_of_fit(one, other),
        "bands": band_energy_distance(one, other, fs),
        "level_db": float(abs(20 * np.log10(other.std() / one.std()))),
        "perceptual": perceptual_distance(one, other, fs, strongest_db=STRONGEST_DB, equal_level=True),
    }


def of_nulls(
    recordings: dict[str, Samples], fs: float, base: dict[str, Any], n_piece: int | None = None
) -> Iterator[dict[str, Any]]:
    """Yield rows of the nulls and the ceiling of a set, and the best null of each score.

    `n_piece` is the length of the pieces for `scores`; by default a recording is one piece.
    """

    def score(x: Samples, y: Samples, key: str) -> float:
        n = n_piece or x.size
        x, y = (one[: one.size // n * n].reshape(-1, n) for one in (x, y))
        return scores(x, y, fs)[key]

    surfaces = {name: name.partition("_")[0] for name in recordings}
    tables = {
        key: null_scores(
            partial(score, key=key), recordings, fs, surfaces=surfaces, higher_is_better=higher_is_better,
            equal_level=key != "level_db",
        )
        for key, higher_is_better in SCORES.items()
    }  # fmt: skip
    for name, known in product(recordings, (*CANDIDATES, "best null")):
        values = {key: round(float(table.loc[name, known]), 4) for key, table in tables.items()}
        yield base | {"name": name, "known": known, "asked": 0, "bytes": 0} | values


def mean_scores(found: list[dict[str, float]]) -> dict[str, float]:
    """Return the means, to 4 digits."""
    return {name: round(float(np.mean([one[name] for one in found])), 4) for name in found[0]}


def of_excerpts() -> Iterator[dict[str, Any]]:
    """Yield rows of recordings alone: one spectrum, one level; in-sample, and from the first half."""
    for set_ in ("lmt_excerpts", "fabric_speeds"):
        base = {"set": set_, "judged": "second half", "part": 0}
        yield from of_nulls(dict(excerpts(set_)), FS, base)
        for (name, x), n_bytes in product(excerpts(set_), BYTES):
            half = x.size // 2
            for judged, known, target in (("all of it", x, x), ("second half", x[:half], x[half:])):
                texture = pack(known, n_bytes, fs=FS, unit="arbitrary")
                plays = [rendered(texture, 80.0, 1.0, target.size, seed) for seed in range(N_SEEDS)]
                found = mean_scores([scores(target[np.newaxis], y[np.newaxis], FS) for y in plays])
                base = {
                    "set": set_,
                    "name": name,
                    "judged": judged,
                    "part": 0,
                    "known": judged.replace("second", "first"),
                }
                yield base | {"asked": n_bytes, "bytes": len(texture.to_bytes())} | found


def strokes() -> Iterator[tuple[str, str, Scan, list[tuple[str, Samples]]]]:
    """Yield set, name and scan, and what can be left out: which, and whether each piece of 0.125 s is in it.

    Of `stylus6` a third of the pieces by speed or by force, of `fabric_speeds` one of four speeds. The hand's
    own motion (below 20 Hz) is taken out of the first.
    """
    above = butter(4, LOWEST_HZ, "high", fs=1000.0, output="sos")
    for recording in open_dataset("stylus6"):
        x = sosfiltfilt(above, recording.acceleration.reshape(-1))
        scan = Scan.along_line(x, recording.speed, recording.normal_force, recording.fs)
        speed, force = (np.median(cut(one, scan.fs), axis=1) for one in (scan.speed, scan.force))
        calm = [
            cut(one, scan.fs).max(axis=1) < most
            for one, most in ((scan.speed, FASTEST), (scan.force, HARDEST))
        ]
        reference_file = calm[0] & calm[1] & (speed >= REST_MM_S) & (force >= LIGHT_N)
        parts = []
        for axis, of in (("speed", speed), ("force", force)):
            third = np.digitize(of, np.quantile(of[reference_file], [1 / 3, 2 / 3]))
            parts += [
                (f"{axis}, {where}", reference_file & (third == i))
                for i, where in ((1, "middle"), (0, "end"), (2, "end"))
            ]
        yield "stylus6", recording.surface, scan, [("", reference_file), *parts]
    fabrics: dict[str, dict[str, Samples]] = {}
    for name, x in excerpts("fabric_speeds"):
        if (session := name.rpartition("_")[2]) != "ref":
            fabrics.setdefault(name.partition("_")[0], {})[session] = x
    for name, by_speed in fabrics.items():
        whole = {session: cut(x, FS) for session, x in by_speed.items()}
        speed = np.concatenate(
            [np.full(x.shape[0], FABRIC_MM_S[int(session[1:]) - 1]) for session, x in whole.items()]
        )
        x = np.concatenate([*whole.values()]).ravel()
        scan = Scan.along_line(x, np.repeat(speed, x.size // speed.size), 1.0, FS)
        ends = speed[0], speed[-1]
        parts = [(f"speed, {'end' if v in ends else 'middle'}", speed == v) for v in np.unique(speed)]
        yield "fabric_speeds", name, scan, [("", speed > 0), *parts]


def cut(x: Samples, fs: float) -> Samples:
    """Return the frames (n_frames, n) of 0.125 s that are packed."""
    n = round(FRAME_S * fs)
    return x[: x.size // n * n].reshape(-1, n)


def chosen(scan: Scan, part: Samples) -> Scan:
    """Return the concatenated frames of a scan; packing uses each frame separately."""
    x, v, f = (cut(one, scan.fs)[part].ravel() for one in (scan.acceleration, scan.speed, scan.force))
    return Scan.along_line(x, v, f, scan.fs)


def of_strokes() -> Iterator[dict[str, Any]]:
    """Yield scores of parts of a stroke, packed from the other parts and from all parts, and of nulls."""
    vibrations: dict[tuple[str, str, int], dict[str, Samples]] = {}
    for set_, name, scan, (_, *parts) in strokes():
        for i, (judged, part) in enumerate(parts):
            same = vibrations.setdefault((set_, judged, i), {})
            same[name] = cut(scan.acceleration, scan.fs)[part].ravel()
    for (set_, judged, i), recordings in vibrations.items():
        fs = 1000.0 if set_ == "stylus6" else FS
        base = {"set": set_, "judged": judged, "part": i}
        yield from of_nulls(recordings, fs, base, round(FRAME_S * fs))
    for set_, name, scan, ((_, reference_file), *parts) in strokes():
        x = cut(scan.acceleration, scan.fs)
        for n_bytes in BYTES[1:]:  # 8 hold no law of the level
            whole = pack(chosen(scan, reference_file), n_bytes, unit="arbitrary")
            for i, (judged, part) in enumerate(parts):
                others = pack(chosen(scan, reference_file & ~part), n_bytes, unit="arbitrary")
                alone = float(abs(20 * np.log10(x[reference_file & ~part].std() / x[part].std())))
                for known, texture in (("all", whole), ("the others", others)):
                    found = []
                    for seed in range(N_SEEDS):
                        y = rendered(texture, scan.speed, scan.force, len(scan), seed)
                        found.append(scores(x[part], cut(y, scan.fs)[part], scan.fs))
                    base = {"set": set_, "name": name, "judged": judged, "part": i, "known": known}
                    yield (
                        base
                        | {"asked": n_bytes, "bytes": len(texture.to_bytes()), "alone_db": alone}
                        | mean_scores(found)
                    )


def of_stand_ins() -> Iterator[dict[str, Any]]:
    """Yield scores of nine simulated HaTT models between the recorded speeds and forces."""
    set_, judged = "simulated HaTT models", "speed and force, between"
    textures = list(stand_ins())
    speed, force = (float(np.sqrt(axis[0] * axis[-1])) for axis in sampled_axes(textures[0]))
    recordings = {one.name: rendered(one, speed, force, 4000, seed) for seed, one in enumerate(textures)}
    yield from of_nulls(recordings, 1000.0, {"set": set_, "judged": judged, "part": 0})
    for texture in textures:
        between = [np.sqrt(axis[1:] * axis[:-1]) for axis in sampled_axes(texture)]
        packed = [(n, pack(texture, n)) for n in BYTES[1:]]
        for n_bytes, other in [(0, texture), *packed]:
            found = []
            for seed, (v, f) in enumerate(product(*between)):
                x, y = (
                    rendered(one, v, f, 2000, seed + more)[np.newaxis]
                    for one, more in ((texture, 100), (other, 0))
                )
                found.append(scores(x, y, texture.fs))
            n = len(other.to_bytes()) if isinstance(other, PackedTexture) else 0
            base = {"set": set_, "name": texture.name, "judged": judged, "part": 0}
            yield (
                base
                | {"known": "itself" if not n else "all", "asked": n_bytes, "bytes": n}
                | mean_scores(found)
            )


def of_taps() -> Iterator[dict[str, Any]]:
    """Yield rows of simulated surfaces, how hard they are as recorded and as packed."""
    operators = operator_catalogue(4, seed=SEED)
    for i, surface in enumerate(surface_catalogue(24, seed=SEED)):
        recording = record_freehand(surface, operators[i % 4], duration_s=6.0, seed=i)
        n = round(np.median([tap.end - tap.impact for tap in recording.phases.taps]))
        for n_bytes in BYTES[2:]:  # 16 hold speed and force and no tap
            tap = pack(recording, n_bytes).tap
            x = np.concatenate([np.zeros(500), tap.synthesize(n, recording.fs)])
            knock = Recording(x, recording.fs, "m/s^2", "knock", phases=Phases((Tap(0, 500, x.size),)))
            tables = (
                FeatureExtractor("scales").fit([one]).extract([one]).table for one in (recording, knock)
            )
            original_hardness, packed_hardness = (
                float(scale_values(found)["hard"].iloc[0]) for found in tables
            )
            yield {
                "name": surface.name,
                "asked": n_bytes,
                "modes": tap.n_modes,
                "felt": original_hardness,
                "packed": packed_hardness,
            }


def of_codec(programs: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of MPEG's codec on the excerpts, from bytes of its packets back to a WAV."""
    with tempfile.TemporaryDirectory() as folder:
        reference_file, coded, played = (Path(folder) / one for one in ("a.wav", "a.hmpg", "b.wav"))
        for (name, x), rate in product(excerpts("lmt_excerpts"), KILOBITS):
            soundfile.write(reference_file, x, FS, subtype="PCM_16")
            for program, *words in (
                ("Encoder", "-f", reference_file, "-o", coded, "-kb", rate, "-b"),
                ("Synthesizer", "-f", coded, "-o", played, "-fs", FS, "-b"),
            ):
                subprocess.run([programs / program, *map(str, words)], capture_output=True, check=False)
            y = soundfile.read(played, always_2d=True)[0][: x.size, 0]
            base = {"set": "lmt_excerpts", "name": name, "judged": "all of it", "part": 0}
            base |= {"known": f"MPEG, {rate} kb/s"}
            size = {"asked": rate, "bytes": coded.stat().st_size}
            yield base | size | mean_scores([scores(x[np.newaxis, : y.size], y[np.newaxis], FS)])
            coded.unlink(), played.unlink()


def previous_codec_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the rows of MPEG's codec of an earlier report, without scores that it does not contain."""
    path = folder / "packed_surfaces.json"
    if path.is_file():
        for row in json.loads(path.read_text(encoding="utf-8"))["rows"]:
            if row["known"].startswith("MPEG"):
                yield {"part": 0, **dict.fromkeys(SCORES, np.nan), **row}


def with_margins(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows without "best null", with the distances of GFC and perceptual distance to it."""
    keys = ["set", "part", "name"]
    best = frame[frame["known"] == "best null"].set_index(keys)
    rest = frame[frame["known"] != "best null"].copy()
    index = pd.MultiIndex.from_frame(rest[keys])
    for key in ("gfc", "perceptual"):
        sign = 1 if SCORES[key] else -1
        rest[f"{key}_margin"] = sign * (rest[key].to_numpy() - best[key].reindex(index).to_numpy())
    return rest


def margin(values: pd.Series, digits: int) -> str:
    """Return the mean distance to the best null with its 95 % interval over recordings."""
    if values.isna().any():
        return "-"
    estimate = distance_to_null(values, pd.DataFrame({"best null": 0 * values}), higher_is_better=True)
    mean, low, high = (f"{estimate[key]:+.{digits}f}" for key in ("mean", "low", "high"))
    return f"{mean} [{low}, {high}]"


def summed(frame: pd.DataFrame, rate: str) -> list[dict[str, Any]]:
    """Return a row for each rate of each kind: how many are good, medians and the least."""
    cells = frame.groupby(["set", "judged", "known", "asked"], sort=False)
    shown = cells["gfc"].agg(n="size", least="min", median="median", good=lambda g: int((g >= 0.95).sum()))
    medians = cells[["paper", "level_db", "bands", "alone_db", "perceptual"]].median()
    for key, digits in (("gfc", 3), ("perceptual", 1)):
        by_name = frame.groupby([*cells.keys, "name"], sort=False)[f"{key}_margin"].mean()
        medians[f"{key}_margin"] = by_name.groupby(cells.keys, sort=False).agg(partial(margin, digits=digits))
    shown = shown.join(medians).join(cells["bytes"].median().rename("size")).reset_index()
    kinds = shown.groupby(["set", "judged", "known"], sort=False).ngroup()
    shown["alone"] = ["-" if np.isnan(x) else f"{x:.1f}" for x in shown["alone_db"]]
    shown["felt_db"] = ["-" if np.isnan(x) else f"{x:.1f}" for x in shown["perceptual"]]
    shown = shown.iloc[np.argsort(kinds, kind="stable")]
    rows = shown.to_dict("records")
    for row in rows:
        row["rate"] = rate.format(**row) if row["asked"] else row["known"]
        row["size"] = f"{row['size']:.0f}" if row["asked"] else "-"
        row["most"] = row["asked"] or "-"
    return rows


def hardness(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each number of bytes."""
    return [
        {
            "bytes": n_bytes,
            "modes": int(one["modes"].max()),
            "rho": spearmanr(one["felt"], one["packed"]).statistic,
            "median": (one["felt"] - one["packed"]).abs().median(),
            "worst": (one["felt"] - one["packed"]).abs().max(),
        }
        for n_bytes, one in frame.groupby("asked")
    ]


def proofs(frame: pd.DataFrame) -> Iterator[str]:
    """Yield for each set how many of its rows of 64 bytes, held out, are better than the best null."""
    held_out = frame[(frame["asked"] == 64) & frame["known"].isin(["first half", "the others", "all"])]
    held_out = held_out[(held_out["known"] != "all") | held_out["set"].str.startswith("simulated")]
    for set_, rows in held_out.groupby("set", sort=False):
        parts = []
        for key, name in (("gfc", "GFC"), ("perceptual", "perceptual distance")):
            by_name = rows.groupby("name")[f"{key}_margin"].mean()
            distance = distance_to_null(
                by_name, pd.DataFrame({"best null": 0 * by_name}), higher_is_better=True
            )
            result = "better than" if distance["low"] > 0 else "not better than"
            result = "worse than" if distance["high"] < 0 else result
            parts.append(f"{result} the best null by its {name}")
        yield f"`{set_}`, 64 bytes held out: {', '.join(parts)}."


def main() -> None:
    args = command_line(__doc__, reference="")
    programs = Path(args.reference)
    if args.reference and not all((programs / name).is_file() for name in ("Encoder", "Synthesizer")):
        raise SystemExit(f"--reference is {args.reference!r}. Expected a folder of Encoder and Synthesizer")
    rows = [
        row
        for kind in (
            list(of_codec(programs) if args.reference else previous_codec_rows(args.out)),
            of_excerpts(),
            of_strokes(),
            of_stand_ins(),
        )
        for row in kind
    ]
    taps = pd.DataFrame(of_taps())
    frame = with_margins(pd.DataFrame(rows).reindex(columns=[*rows[-1], "alone_db"]))
    codec = frame["known"].str.startswith("MPEG")
    note = CODEC + EARLIER * (not args.reference) if codec.any() else "MPEG's codec was not run."
    scored = (
        "n = {n} | GFC >= 0.95 = {good} | median GFC = {median:.3f} | least = {least:.3f} | "
        "GFC as printed = {paper:.3f} | level, dB = {level_db:.1f} | bands, dB = {bands:.1f} | "
        "perceptual, dB = {felt_db} | GFC to best null = {gfc_margin} | "
        "perceptual to best null, dB = {perceptual_margin}"
    )
    alone = frame["judged"].isin(["all of it", "second half"])
    blocks = [
        "A surface is packed into at most so many bytes (`tx.haptics.textures.pack`), rendered, and "
        "compared. GFC: cosine of the amplitude spectra from 20 to 1000 Hz (half the rate, if less), by "
        "Welch in pieces of 64 ms; beside it the criterion as `abdulali2016` prints it (windows of 500 "
        "samples, Hamming 50, all frequencies). Bands: RMS difference of the energies of nine bands. "
        "Perceptual: `perceptual_distance` at equal level, strongest band 30 dB above the threshold. Means "
        f"over {N_SEEDS} seeds of noise, then medians over recordings (least: the worst of them).",
        "A score alone proves nothing: rows without bytes are nulls (white noise, the next surface, the mean "
        "spectrum of the others, all at the level of the first half except for the level error) and the "
        "ceiling (the other half), on the same recordings under the same conditions. Distances to the best "
        "null are means with their 95 % interval over recordings; positive is better, and an interval that "
        "includes 0 proves nothing. [Scores and their nulls]"
        "(vibrations.md#scores-of-vibrations-and-their-nulls) states what each set can prove.",
        *(proofs(frame)),
        "All rows were inspected. After that one thing was changed: the level is held below the slowest and "
        "lightest recorded conditions, where it faded before (3.8 and 3.5 dB off at the ends of `stylus6`).",
        table(
            summed(frame[codec], "{known}") + summed(frame[alone & ~codec], "{asked} bytes"),
            "set = {set} | judged on = {judged} | sent as = {rate} | bytes = {size} | " + scored,
            "Recordings alone (one spectrum, one level), at 8 kHz: 1 s of each of `lmt_excerpts`, up to 4 "
            "s of `fabric_speeds`; the second half is predicted from the first alone. The bytes are for "
            f"any length. {note}",
            n_words=3,
        ),
        table(
            summed(frame[~alone & ~codec], "{asked} bytes"),
            f"set = {{set}} | judged on = {{judged}} | packed from = {{known}} | most bytes = {{most}} | "
            f"{scored} | one level, dB = {{alone}}",
            "Textures over speed and force, each part along the hand's own path. `stylus6` (1 kHz, above "
            "20 Hz): thirds of the pieces of 0.125 s by speed and by force, one left out at a time, the "
            "middle one lying between what is known, the end ones outside it; readings over 1000 mm/s or "
            "20 N are left out. `fabric_speeds`: 20, 30, 50 and 60 mm/s (according to the program of the "
            "experiment), one left out at a time. One "
            "level: the error of a level that does not follow the speed or the force. Simulated HaTT "
            "models: stand-ins for the published ones (nine resonant surfaces), judged at 8 speeds and "
            "forces between those they were felt at when packed; itself, 0 bytes: the model beside itself "
            "with other noise, the most that any texture could get.",
            n_words=3,
        ),
        table(
            hardness(taps),
            "bytes = {bytes} | modes = {modes} | rank correlation = {rho:.3f} | "
            "median difference = {median:.2f} | worst = {worst:.2f}",
            "Hardness, 0 soft to 10 hard (`texclass describe`), of 24 simulated surfaces as recorded "
            "(median of their taps), and of the tap in the packed texture: the tap of median hardness as "
            "decaying sinusoids.",
        ),
    ]
    result = {
        "rows": rows,
        "taps": taps.to_dict("records"),
        "seed": SEED,
    }
    write(args.out, "packed_surfaces", result, "Packed surfaces of a few bytes", blocks)


if __name__ == "__main__":
    main()
