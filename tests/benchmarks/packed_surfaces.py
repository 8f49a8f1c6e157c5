"""Surfaces in few bytes: what 8 to 256 bytes keep of real recordings (`lmt_excerpts`, `fabric_speeds`).

Rate against distortion in-sample, and of the second half of each excerpt packed from the first alone.
`python tests/benchmarks/packed_surfaces.py` (2 minutes) writes reports/studies/packed_surfaces.
"""

import os
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import resample_poly, welch
from study import command_line, own_data, table, write

from texclass.loaders import load_recording
from texclass.provenance import versions
from texclass.textures import pack
from texclass.vibration.scores import band_energy_distance

FS = 8000
BYTES = (8, 16, 32, 64, 128, 256)
N_SEEDS = 3


def excerpts(set_):
    """Return the recordings of a set, at 8 kHz, one axis, the mean removed."""
    for path in sorted((Path(os.environ["TEXCLASS_DATA"]) / set_).rglob("*.wav")):
        recording = load_recording(path, unit="arbitrary")
        x = recording.acceleration.reshape(recording.n_samples, -1)[:, 0]
        x = resample_poly(x - x.mean(), FS, round(recording.fs)) if recording.fs != FS else x - x.mean()
        yield str(path.relative_to(path.parents[1])), x[: 4 * FS]


def rendered(texture, n, seed):
    """Return what a stroke of 80 mm/s and 1 N renders."""
    return texture.renderer(seed=seed).process(np.tile([80.0, 0.0], (n, 1)), np.ones(n))


def judged(texture, x):
    """Return GFC from 20 to 1000 Hz, distance of nine bands and level error, mean over seeds."""
    found = []
    for seed in range(N_SEEDS):
        y = rendered(texture, x.size + 800, seed)[800:]
        f, S = welch(np.stack([x, y]), FS, nperseg=512)
        a, b = np.sqrt(S[:, (f >= 20) & (f <= 1000)])
        gfc = float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
        found.append((gfc, band_energy_distance(x, y, FS), abs(20 * np.log10(y.std() / x.std()))))
    return dict(zip(("gfc", "bands", "level_db"), np.mean(found, axis=0).tolist(), strict=True))


def main() -> None:
    asked = command_line(__doc__).parse_args()
    own_data()
    rows = []
    for set_ in ("lmt_excerpts", "fabric_speeds"):
        for name, x in excerpts(set_):
            half = x.size // 2
            for n_bytes in BYTES:
                base = {"set": set_, "name": name, "asked": n_bytes}
                packed = pack(x, n_bytes, fs=FS, unit="arbitrary")
                rows.append(base | {"judged": "all", "bytes": len(packed.to_bytes())} | judged(packed, x))
                first = pack(x[:half], n_bytes, fs=FS, unit="arbitrary")
                rows.append(base | {"judged": "second half", "bytes": len(first.to_bytes())})
                rows[-1] |= judged(first, x[half:])
            print(name, rows[-5], flush=True)
    frame = pd.DataFrame(rows)
    cells = frame.groupby(["set", "judged", "asked"], sort=False)
    shown = cells["gfc"].agg(n="size", least="min", median="median", good=lambda g: int((g >= 0.95).sum()))
    medians = cells[["level_db", "bands"]].median().rename(columns={"level_db": "db"})
    shown = shown.join(medians).reset_index()
    result = {"rows": rows, "versions": versions("numpy", "scipy")}
    blocks = [
        f"Recordings at {FS} Hz, 1 s of each of `lmt_excerpts`, up to 4 s of `fabric_speeds`, packed as "
        "a vibration alone (one spectrum, one level). GFC: cosine of the amplitude spectra from 20 to 1000 "
        "Hz (Welch, 512 points) of the recording and of what is rendered, mean over "
        f"{N_SEEDS} seeds of noise. Second half: packed from the first half alone. Bands: distance of the "
        "energies of nine bands, dB. All were looked at; nothing was changed after that.",
        table(
            shown.to_dict("records"),
            "set | judged on | bytes | n | GFC >= 0.95 | median GFC | least | level, dB | bands",
            "{set} | {judged} | {asked} | {n} | {good} | {median:.3f} | {least:.3f} | {db:.1f} | {bands:.1f}",
            "Level and bands are medians.",
            n_words=2,
        ),
    ]
    write(asked.out, "packed_surfaces", result, "Surfaces in few bytes", blocks)


if __name__ == "__main__":
    main()
