"""Compare the network of `abdulali2016` with one AR model per texture on all real recordings with conditions.

The network predicts spectrum and level from speed and force. One AR model of all training recordings has a
constant spectrum and level.
"""

import csv

import numpy as np
import shared
from abdulali2016_study import Score, compare, render_along, score_nulls
from scipy import signal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition, model_scan
from texclass.haptics.textures.abdulali2016.model_points import limit_vibration
from texclass.loaders.cards import read_card
from texclass.loaders.places import find_folder
from texclass.vibration import LatticeSynthesis, fit

ORDER = 20
SCORES = tuple(name for name in Score._fields if name != "deviation")


def joined(parts, name):
    """Return one scan of several parts (vibration, speed in mm/s, force in N, sampling rate in Hz)."""
    vibrations, speeds, forces, fs = zip(*parts, strict=True)
    speed, force = (
        np.concatenate([np.broadcast_to(v, x.shape) for v, x in zip(values, vibrations, strict=True)])
        for values in (speeds, forces)
    )
    return Scan.along_line(np.concatenate(vibrations), speed, force, fs[0], name)


def stylus_pairs(recordings):
    """Yield training and validation scans of `stylus6`: the halves of each recording."""
    for recording in recordings.values():
        scan = condition(Scan.from_recording(recording))
        yield scan.crop(0, len(scan) // 2), [scan.crop(len(scan) // 2, len(scan))]


def fabric_pairs(recordings):
    """Yield scans of `fabric_speeds`: three speeds for training, and v2 or v3 for validation."""
    parts = {}
    for name, recording in recordings.items():
        surface, _, step = name.rpartition("_v")
        fs = recording.fs / 4  # vibrations end at 1 kHz
        x = limit_vibration(signal.resample_poly(recording.acceleration.ravel(), 1, 4), fs)
        parts.setdefault(surface, {})[int(step)] = (x, shared.FABRIC_MM_S[int(step) - 1], 1.0, fs)
    for surface, by_step in parts.items():
        for held_out in (2, 3):
            training = [part for step, part in sorted(by_step.items()) if step != held_out]
            yield joined(training, f"{surface}, v{held_out}"), [joined([by_step[held_out]], surface)]


def finger_pairs(recordings):
    """Yield scans of `biotac20`: repetitions 1 to 20, and every fourth of 21 to 40 for validation."""
    table = find_folder(read_card("biotac20")) / "recordings.csv"
    parts = {}
    for row in csv.DictReader(table.read_text(encoding="utf-8").splitlines()):
        recording = recordings[row["recording"]]
        x = limit_vibration(recording.acceleration.ravel(), recording.fs)
        speed, force = 1000 * float(row["speed_median_m_s"]), float(row["force_z_median_n"])
        parts.setdefault(row["material_name"], []).append((x, speed, force, recording.fs))
    for surface, repetitions in parts.items():
        yield joined(repetitions[:20], surface), [joined([part], surface) for part in repetitions[20::4]]


SETS = {"stylus6": stylus_pairs, "fabric_speeds": fabric_pairs, "biotac20": finger_pairs}


def compare_models(training, validations):
    """Return the scores of network and single model, and how the level of segments depends on the conditions.

    `spread_db` is the standard deviation of the level of the training segments, and `explained` the share of
    its variance that a power law of speed and force explains (adjusted R^2; NaN for fewer than 5 segments).
    """
    modelled = model_scan(training, isotropic=True, order=ORDER)
    texture, segments = modelled.network(), modelled.segments
    single, rng = fit(training.acceleration, ORDER), np.random.default_rng(0)
    scores = {"network": [], "one model": []}
    for scan in validations:
        lattice = LatticeSynthesis(single).settle(rng)
        rendered = {
            "network": render_along(texture, scan),
            "one model": lattice.process(rng.standard_normal(len(scan))),
        }
        for name, y in rendered.items():
            scores[name].append(compare(scan.acceleration, y, scan.fs))
    level_db = 20 * np.log10([np.sqrt(np.mean(x**2)) for x in segments.cut(training.acceleration)])
    conditions = np.log([segments.means(training.speed), segments.means(training.force)])
    varying = conditions[conditions.std(axis=1) > 1e-6]
    return {
        "surface": training.name,
        "segments": len(segments),
        "spread_db": float(level_db.std()),
        "explained": explained_share(level_db, varying),
    } | {
        f"{name}, {key}": float(np.mean([getattr(score, key) for score in values]))
        for name, values in scores.items()
        for key in SCORES
    }


def explained_share(y, x):
    """Return the adjusted R^2 of the linear regression of y on the rows of x."""
    n, p = y.size, len(x)
    if n < 5 or p == 0:
        return np.nan
    X = np.vstack([np.ones(n), x]).T
    residual = y - X @ np.linalg.lstsq(X, y)[0]
    return 1 - (residual.var() / y.var()) * (n - 1) / (n - p - 1)


def study_real_sets():
    """Return one row per texture of each set that is available, and the input hashes."""
    rows, hashes = [], {}
    for card, pairs in SETS.items():
        recordings, digest = shared.recordings(card)
        if recordings:
            hashes[card] = digest
            scans = list(pairs(recordings))
            compared = [{"set": card} | compare_models(*pair) for pair in scans]
            rows += [row | nulls for row, nulls in zip(compared, null_columns(scans), strict=True)]
    return rows, hashes


def null_columns(scans):
    """Return for each pair of scans the GFC and the perceptual distance of each candidate without a model.

    Scans with the same held-out speed (the end of the name) are compared with each other.
    """
    columns = {}
    names = [training.name for training, _ in scans]
    for held_out in dict.fromkeys(name.partition(", v")[2] for name in names):
        alike = [pair for pair in scans if pair[0].name.partition(", v")[2] == held_out]
        vibrations = {
            training.name: (
                training.acceleration,
                np.concatenate([scan.acceleration for scan in validations]),
            )
            for training, validations in alike
        }
        columns |= score_nulls(vibrations, alike[0][0].fs)
    return [
        {f"{way}, {key}": getattr(score, key) for way, score in columns[name].items() for key in SCORES}
        for name in names
    ]
