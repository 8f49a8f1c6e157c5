"""Nulls and ceiling of scores of synthesized vibrations on each data set, and what each set can prove.

`python benchmarks/score_nulls.py` (4 minutes) writes reports/studies/score_nulls, in the page of vibrations.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from hjif_study import stand_ins
from scipy.signal import butter, resample_poly, sosfiltfilt, welch
from study import command_line, table, write

from texclass.loaders import open_dataset
from texclass.recording import Samples
from texclass.signals import combine, remove_hand_motion
from texclass.simulate import operator_catalogue, record_rising_speed, surface_catalogue
from texclass.vibration.null_scores import NULLS, Score, distance_to_null, null_scores, same_or_different
from texclass.vibration.perceptual_distance import band_powers, perceptual_distance
from texclass.vibration.scores import band_energy_distance, goodness_of_fit, log_spectral_distance

SEED = 0
LOWEST_HZ, HIGHEST_HZ = 20.0, 1000.0
FS_HZ = 8000.0
"""Sampling rate of the recordings that have 10 kHz."""
STRONGEST_DB = 30.0
"""Assumed sensation level in dB of the strongest band: no set states how strong its vibrations are felt."""
LEVEL = "level (dB)"
GOOD_GFC = 0.95
"""GFC that reports of packed surfaces count as good."""
SPEED_MM_S, SETTLE_S, DURATION_S = 80.0, 0.6, 4.0
"""Simulated strokes: speed, discarded beginning and duration."""
SETS = {
    "stylus6": "hand-held stylus on 6 textures, halves of 5 s",
    "lmt_excerpts": "10 tool recordings of 9 surfaces, halves of 0.5 s, and one of 4.8 s",
    "fabric_speeds": "finger on 4 fabrics at 4 speeds, halves of 0.4 to 2 s",
    "biotac20": "robot finger on 20 materials, one recording each, halves of 4 s",
    "simulated surfaces": "20 simulated surfaces at 80 mm/s, halves of 2 s",
    "simulated HaTT models": "9 resonant surfaces at 80 mm/s and 1 N, halves of 2 s",
}


def gfc_in_band(fs: float) -> Score:
    """Return the GFC of the amplitudes from 20 to 1000 Hz, by Welch's method with segments of 64 ms."""

    def score(recorded: Samples, candidate: Samples) -> float:
        f, power = welch(np.stack([recorded, candidate]), fs, nperseg=round(0.064 * fs))
        a, b = np.sqrt(power[:, (f >= LOWEST_HZ) & (f <= HIGHEST_HZ)])
        return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))

    return score


def level_error(fs: float) -> Score:
    """Return the difference of the levels from 20 to 1000 Hz in dB."""

    def score(recorded: Samples, candidate: Samples) -> float:
        powers = (band_powers(x, fs).sum() for x in (recorded, candidate))
        return float(abs(np.diff(10 * np.log10(list(powers)))[0]))

    return score


def all_scores(fs: float) -> dict[str, tuple[Score, bool]]:
    """Return the scores by name: function, and whether higher is better."""
    return {
        "GFC (20 to 1000 Hz)": (gfc_in_band(fs), True),
        "GFC (as printed)": (goodness_of_fit, True),
        "nine bands (dB)": (lambda x, y: band_energy_distance(x, y, fs), False),
        "log spectral distance (dB)": (log_spectral_distance, False),
        "perceptual distance (dB)": (
            lambda x, y: perceptual_distance(x, y, fs, strongest_db=STRONGEST_DB),
            False,
        ),
        LEVEL: (level_error(fs), False),
    }


def real_recordings(card: str) -> tuple[dict[str, Samples], dict[str, str], float]:
    """Return the vibrations of a set without hand motion, their surfaces, and the sampling rate."""
    recordings, surfaces, rates = {}, {}, set()
    for recording in open_dataset(card):
        if card == "biotac20" and recording.surface in surfaces.values():
            continue
        x = recording.acceleration.reshape(recording.n_samples, -1)[:, 0]
        fs = recording.fs
        if fs > FS_HZ:
            x, fs = resample_poly(x - x.mean(), 4, 5), FS_HZ
        recordings[recording.recording_id] = sosfiltfilt(
            butter(4, LOWEST_HZ, "high", fs=fs, output="sos"), x - x.mean()
        )
        surfaces[recording.recording_id] = recording.surface
        rates.add(fs)
    (rate,) = rates
    return recordings, surfaces, rate


def simulated_recordings(name: str) -> tuple[dict[str, Samples], dict[str, str], float]:
    """Return simulated vibrations at constant speed, their surfaces, and the sampling rate."""
    if name == "simulated HaTT models":
        textures = {texture.name: texture for texture in stand_ins()}
        fs = next(iter(textures.values())).fs
        path = np.tile([SPEED_MM_S, 0.0], (round(DURATION_S * fs), 1))
        recordings = {
            name: texture.renderer(seed=i).process(path, np.ones(len(path)))
            for i, (name, texture) in enumerate(textures.items())
        }
    else:
        fs, operator = FS_HZ, operator_catalogue(1, SEED)[0]
        recordings = {}
        for i, surface in enumerate(surface_catalogue(20, SEED)):
            recording = record_rising_speed(
                surface, operator, duration_s=DURATION_S + SETTLE_S, fs=fs, seed=(SEED, i),
                speed_mm_s=(SPEED_MM_S, SPEED_MM_S),
            )  # fmt: skip
            x = combine(recording.acceleration[round(SETTLE_S * fs) :])
            recordings[surface.name] = remove_hand_motion(x, fs)
    return recordings, {key: key for key in recordings}, fs


def study_set(name: str) -> Iterator[dict[str, Any]]:
    """Yield a row for each score: medians of nulls and ceiling, distance of the ceiling, and AUROC."""
    load: Callable[[str], Any] = simulated_recordings if name.startswith("simulated") else real_recordings
    recordings, surfaces, fs = load(name)
    for title, (score, higher_is_better) in all_scores(fs).items():
        options = {
            "higher_is_better": higher_is_better,
            "surfaces": surfaces,
            "equal_level": title != LEVEL,
        }
        nulls = null_scores(score, recordings, fs, **options)
        ceiling = distance_to_null(nulls["other half"], nulls, higher_is_better=higher_is_better)
        pairs = same_or_different(score, recordings, fs, **options)
        yield {
            "set": name,
            "score": title,
            "higher_is_better": higher_is_better,
            "medians": nulls.median().round(4).to_dict(),
            "ceiling": ceiling,
            "pairs": pairs,
            "proves": bool(ceiling["low"] > 0) and title != LEVEL,
        }


def share_of_good_pairs(name: str) -> float:
    """Return the share of pairs of whole recordings of different surfaces with a good GFC."""
    recordings, surfaces, fs = real_recordings(name)
    score = gfc_in_band(fs)
    names = list(recordings)
    n = min(x.size for x in recordings.values())
    pairs = [(a, b) for i, a in enumerate(names) for b in names[:i] if surfaces[a] != surfaces[b]]
    return float(np.mean([score(recordings[a][:n], recordings[b][:n]) >= GOOD_GFC for a, b in pairs]))


def shown(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the cells of the table."""
    for row in rows:
        digits = 3 if row["higher_is_better"] else 2
        ceiling, pairs = row["ceiling"], row["pairs"]
        cells = {key: f"{row['medians'][key]:.{digits}f}" for key in ("other half", *NULLS)}
        yield cells | {
            "set": row["set"],
            "score": row["score"],
            "distance": f"{ceiling['mean']:+.{digits}f} [{ceiling['low']:+.{digits}f}, "
            f"{ceiling['high']:+.{digits}f}]",
            "better": f"{ceiling['n_better']} of {ceiling['n']}",
            "auroc": f"{pairs['auroc']:.2f} [{pairs['low']:.2f}, {pairs['high']:.2f}]",
            "proves": "yes" if row["proves"] else "no",
        }


def statement(name: str, rows: list[dict[str, Any]]) -> str:
    """Return what a set can prove."""
    able = [row["score"] for row in rows if row["proves"]]
    if not able:
        verdict = "proves nothing about spectra: no score distinguishes the other half from the best null"
    else:
        verdict = f"can prove something with {', '.join(able)}"
    return f"`{name}` ({SETS[name]}) {verdict}."


def ranking(rows: list[dict[str, Any]]) -> str:
    """Return on which sets the perceptual distance separates surfaces better than the GFC."""
    auroc = {(row["set"], row["score"]): row["pairs"]["auroc"] for row in rows}
    names = list(dict.fromkeys(row["set"] for row in rows))
    better = [
        name for name in names if auroc[name, "perceptual distance (dB)"] > auroc[name, "GFC (20 to 1000 Hz)"]
    ]
    return (
        f"The perceptual distance has a higher AUROC than the GFC (20 to 1000 Hz) on {len(better)} of "
        f"{len(names)} sets ({', '.join(better) or 'none'}). It is no better classifier in general. Its "
        "scale is the difference: it is in dB, and differences below 1.6 to 4.0 dB are not perceived."
    )


def main() -> None:
    args = command_line(__doc__, sets=tuple(SETS))
    rows = [row for name in args.sets for row in study_set(name)]
    share = share_of_good_pairs("lmt_excerpts")
    by_set = pd.DataFrame({"set": [row["set"] for row in rows], "row": rows}).groupby("set", sort=False)[
        "row"
    ]
    blocks = [
        "A score of a synthesized vibration means nothing by itself. Here each score is computed on the "
        "second half of each recording, for its first half (the ceiling), and for three nulls that contain "
        "nothing of the surface: white noise of equal level, the best of the other surfaces, and noise with "
        "the mean spectrum of the others (`texclass.vibration.null_scores`). A set proves something with a "
        "score if the ceiling is better than the best null: the 95 % interval over recordings of the "
        "distance lies above 0. The AUROC tells how well the score distinguishes halves of one recording "
        "from halves of different surfaces (0.5: chance).",
        table(
            shown(rows),
            "set = {set} | score = {score} | other half = {other half} | white noise = {white noise} | "
            "next surface = {next surface} | mean of others = {mean of others} | "
            "other half to best null = {distance} | better = {better} | AUROC = {auroc} | proves = {proves}",
            "Medians over recordings; mean distance to the best null with its 95 % interval (positive: "
            "better). Nulls have the level of the first half, except for the level error, for which other "
            "surfaces keep theirs, and for which white noise is the ceiling itself. Perceptual distance: "
            f"strongest band {STRONGEST_DB:g} dB above the threshold.",
            n_words=2,
        ),
        *(statement(name, list(group)) for name, group in by_set),
        f"Of the pairs of recordings of different surfaces of `lmt_excerpts`, {share:.0%} have a GFC of at "
        f"least {GOOD_GFC:g} (first second, 20 to 1000 Hz).",
        ranking(rows),
    ]
    result = {"rows": rows, "share_of_good_pairs": share, "seed": SEED}
    write(args.out, "score_nulls", result, "Scores of vibrations and their nulls", blocks)


if __name__ == "__main__":
    main()
