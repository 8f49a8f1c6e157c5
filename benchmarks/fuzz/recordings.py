"""Fuzzing targets: files of recordings (text, tables, audio, MATLAB, arrays), and standard input."""

import io
import random
import struct
import tempfile
import wave
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io
import soundfile

from fuzz.contract import Target
from fuzz.mutate import Mutator, archives, either, of_bytes, of_text
from texclass.loaders import load_recording
from texclass.loaders.cards import FileReading, LabelTable
from texclass.loaders.filesets import _read_rows
from texclass.loaders.labels import Labels, is_label_table
from texclass.recognition import open_source
from texclass.recognition.live.session import SampleRepair
from texclass.recording import Recording

FS = 1000.0
N = 12


def axes() -> np.ndarray:
    """Known samples of shape (12, 3)."""
    return np.random.default_rng(0).integers(-2000, 2000, (N, 3)).astype(float)


def written(name: str, write: Callable[[Path], Any]) -> bytes:
    """Return the bytes that a function writes into a file of a name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def valid(recording: Recording) -> Recording:
    """Check the invariants of a recording."""
    a = recording.acceleration
    assert len(a) >= 2
    assert np.isfinite(a).all()
    assert np.isfinite(recording.fs)
    assert recording.fs > 0
    assert len(recording.channels) == (1 if a.ndim == 1 else a.shape[1])
    return recording


def _parquets() -> list[bytes]:
    frame = pd.DataFrame(axes()[:4], columns=["x", "y", "z"])
    kinds = [{"compression": None}, {"compression": "snappy", "use_dictionary": False}]
    seed_files = [written("a.parquet", lambda path, k=k: frame.to_parquet(path, **k)) for k in kinds]
    odd = pd.DataFrame({"acceleration": [[1.0], [2.0, 3.0]]})
    return [*seed_files, written("a.parquet", odd.to_parquet)]


def _wavs() -> list[bytes]:
    codes = axes()[:, :1].astype(np.int16)
    seed_files = [written("a.wav", lambda p, k=k: soundfile.write(p, codes, 1000, subtype=k))
             for k in ("PCM_16", "PCM_24", "FLOAT", "IMA_ADPCM", "ULAW")]  # fmt: skip
    others = [
        written("a.wav", lambda p, k=k: soundfile.write(p, codes, 1000, format=k))
        for k in ("W64", "AIFF", "RF64")
    ]
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setparams((3, 1, 8000, 0, "NONE", ""))
        file.writeframes(bytes(range(48)))
    return [*seed_files, *others, buffer.getvalue()]


def _mat5s() -> list[bytes]:
    stored = {"acceleration": axes()[:4], "fs": FS, "who": "me", "more": {"a": np.arange(2)}}
    return [
        written("a.mat", lambda p: scipy.io.savemat(p, stored)),
        written("a.mat", lambda p: scipy.io.savemat(p, stored, do_compression=True)),
        written("a.mat", lambda p: scipy.io.savemat(p, {"x": axes()[:4, 0]}, format="4")),
    ]


def _hdf5(path: Path, *, matlab: bool = False, **how: Any) -> None:
    with h5py.File(
        path, "w", libver=how.pop("libver", "earliest"), userblock_size=512 if matlab else 0
    ) as file:
        data = file.create_dataset("acceleration", data=axes()[:6].astype(np.float32), **how)
        if matlab:
            data.attrs["MATLAB_class"] = np.bytes_("double")
            file["fs"] = FS
        else:
            file.attrs["fs"] = FS


def _hdf5s() -> list[bytes]:
    return [
        written("a.h5", _hdf5),
        written("a.h5", lambda p: _hdf5(p, libver="latest")),
        written("a.h5", lambda p: _hdf5(p, chunks=(3, 3), compression="gzip", shuffle=True, fletcher32=True)),
    ]


_TYPES = ("<f8", ">f8", "<f2", "<f16", "<c16", "|O", "<i8", "|b1", "<U5", "<M8[ns]", "|V8")
_SHAPES = ((4, 3), (), (0,), (10**6, 10**6), (2**62, 8), (-1,), (12, 1, 1), (3, 2, 2), (10**9,))


def _npy_change(rng: random.Random, members: dict[str, bytes]) -> dict[str, bytes]:
    name = rng.choice(sorted(members))
    data = members[name]
    match rng.randrange(4):
        case 0:
            head = {"descr": rng.choice(_TYPES),
                    "fortran_order": rng.random() < 0.5,
                    "shape": rng.choice(_SHAPES)}  # fmt: skip
            text = repr(head).ljust(117).encode() + b"\n"
            members[name] = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data[128:]
        case 1:
            members[rng.choice(("fs.npy", "x.npy", "", "a/b.npy", "acceleration.NPY", "../x.npy"))] = data
        case _:
            members[name] = of_bytes(rng, data)
    return members


def _rows(path: Path) -> object:
    labels, values = _read_rows(path, "label")
    assert len(labels) == len(values)
    assert values.dtype == np.float64
    return values


_LABELS = LabelTable(file="labels.csv", recording="id", surface="what", repetition="run")
_READING = FileReading(fs_hz=FS, unit="g", files=(".*",), labels=_LABELS)


def _labels(path: Path) -> object:
    assert _READING.labels is not None
    seed_files = Labels.read(path, _READING.labels).rows
    assert all(isinstance(value, str) for row in seed_files.values() for value in (*row, *row.values()))
    assert all(isinstance(key, str) for key in seed_files)
    return is_label_table(path), seed_files


def _lines(data: bytes) -> object:
    blocks = list(open_source("-", file=io.BytesIO(data), fs=FS, unit="g", block_s=0.002))
    # A garbled line is a lost sample, NaN: what goes on from there is finite, whatever stood in the lines.
    assert all(block.samples.ndim == 2 and block.samples.dtype == np.float64 for block in blocks)
    assert len({block.samples.shape[1] for block in blocks}) <= 1
    trained: Any = SimpleNamespace(manifest=SimpleNamespace(peak_acceleration=1.0, unit="g"))
    if blocks:
        repair = SampleRepair(trained, blocks[0].samples.shape[1], FS, 1.0)
        segments = [segment for block in blocks for segment in repair.repair(block.samples)[0]]
        assert all(np.isfinite(rows).all() for _, rows in segments)
    return blocks


def _raw(data: bytes) -> object:
    facts = {"fs": FS, "unit": "g", "block_s": 0.004}
    return [list(open_source("-", file=io.BytesIO(data), raw_channels=n, **facts)) for n in (1, 3)]


def _csv(**how: Any) -> bytes:
    return pd.DataFrame(axes(), columns=["x", "y", "z"]).to_csv(index=False, **how).encode()


def _lvms() -> list[bytes]:
    head = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\nDelta_X\t0.001\t\n"
    rows = "".join(f"\t{x:g}\n" for x in axes()[:, 0])
    return [f"{head}***End_of_Header***\t\nX_Value\tAcc\tComment\n{rows}".encode()]


def _npys() -> list[bytes]:
    arrays = (axes()[:4], np.asfortranarray(axes()[:4].astype("<f4")), axes()[:, 0].astype(">i2"))
    return [written("a.npy", lambda path, array=array: np.save(path, array)) for array in arrays]


def _npy(rng: random.Random, data: bytes) -> bytes:
    return _npy_change(rng, {"acceleration.npy": data}).get("acceleration.npy", data)


def _workbooks() -> list[bytes]:
    frame = pd.DataFrame(axes()[:5], columns=["x", "y", "z"])
    dates = pd.date_range("2019-08-06", periods=5, freq="10ms")
    with_dates = frame.assign(time=dates, note=["", "=1/0", "a", None, "b"])

    def write(path: Path) -> None:
        with pd.ExcelWriter(path) as book:
            with_dates.to_excel(book, sheet_name="Raw data", startrow=2, startcol=1, index=False)
            frame.to_excel(book, sheet_name="More")

    return [written("a.xlsx", frame.to_excel), written("a.xlsx", write)]


def _xml(rng: random.Random, members: dict[str, bytes]) -> dict[str, bytes]:
    name = rng.choice(sorted(members))
    members[name] = rng.choice((of_text, of_bytes))(rng, members[name])
    return members


def _tdms() -> list[bytes]:
    from nptdms import ChannelObject, RootObject, TdmsWriter

    facts = {"wf_increment": 0.001, "unit_string": "g"}
    one = [ChannelObject("data", axis, axes()[:, i], facts) for i, axis in enumerate("xyz")]
    times = ChannelObject("log", "time", np.arange(N) * np.timedelta64(1, "ms") + np.datetime64("2019-08-06"))
    two = [
        times,
        ChannelObject("log", "x", axes()[:, 0].astype("i2")),
        ChannelObject("other", "a", axes()[:3, 0]),
    ]

    def write(path: Path, objects: list[ChannelObject]) -> None:
        with TdmsWriter(path) as file:
            file.write_segment([RootObject({"name": "a"}), *objects])
            file.write_segment(objects)

    return [written("a.tdms", partial(write, objects=objects)) for objects in (one, two)]


SEEDS: dict[str, tuple[Callable[[], list[bytes]], Mutator]] = {
    ".txt": (
        lambda: [b"".join(f"{x:.3g}\n".encode() for x in axes()[:, 0]), b"1\n\n-2.5e3\r\n 7\n"],
        of_text,
    ),
    ".csv": (
        lambda: [_csv(), b'\xef\xbb\xbf"ax","ay","az",t\n1,2,3,0\n4,5,6,1\n', b"a\n1\n2\n"],
        of_text,
    ),
    ".tsv": (lambda: [_csv(sep="\t")], of_text),
    ".lvm": (_lvms, of_text),
    ".parquet": (_parquets, of_bytes),
    ".wav": (_wavs, of_bytes),
    ".flac": (
        lambda: [written("a.flac", lambda p: soundfile.write(p, axes().astype(np.int16), 1000))],
        of_bytes,
    ),
    ".mat": (lambda: [*_mat5s(), written("a.mat", partial(_hdf5, matlab=True))], of_bytes),
    ".npy": (_npys, either(_npy, of_bytes)),
    ".npz": (
        lambda: [
            written("a.npz", lambda p: np.savez(p, acceleration=axes()[:4], fs=FS)),
            written("a.npz", lambda p: np.savez_compressed(p, x=axes()[:, 0].astype(np.float32))),
        ],
        archives(_npy_change, deflate=True),
    ),
    ".h5": (_hdf5s, of_bytes),
    ".hdf5": (_hdf5s, of_bytes),
    ".xlsx": (_workbooks, either(archives(_xml, deflate=True), of_bytes)),
    ".tdms": (_tdms, of_bytes),
}
"""Suffix -> valid files, and how they are changed; a test fails for a suffix of `FORMATS` without any."""
OF_BAGS = {".bag": "rosbag1", ".mcap": "rosbag2 mcap", ".db3": "rosbag2 sqlite3"}
"""Suffixes of bags -> the readers in `fuzz.bags`."""


def _read(path: Path) -> Recording:
    """Load a file; of those that state a rate or unit, without what would contradict it."""
    facts: dict[str, Any] = {"unit": "m/s^2"}
    if path.suffix not in {".wav", ".flac", ".h5", ".hdf5", ".lvm", ".tdms"}:
        facts["fs"] = FS
    if path.suffix == ".tdms":
        facts = {"column": ("x",), "fs": FS, "unit": "g"}
    return valid(load_recording(path, **facts))


TARGETS = (
    *(
        Target(suffix[1:], seeds, _read, mutate, f"fuzzed{suffix}")
        for suffix, (seeds, mutate) in SEEDS.items()
    ),
    Target(
        "table of rows",
        lambda: [b"label,0,1,2\noak,1,2,3\nfelt,4,5,6.5\noak,7,8,9\n"],
        _rows,
        of_text,
        "rows.csv",
    ),
    Target(
        "table of labels",
        lambda: [
            b"id,what,run\nr1,oak,1\nr2,felt,2\n",
            b'\xef\xbb\xbfid,what,run,note\n"a,b",oak,1,"x\ny"\n',
        ],
        _labels,
        of_text,
        "labels.csv",
    ),
    Target(
        "lines of standard input",
        lambda: [b"1 2 3\n4 5 6\n7,8,9\n\n1e3 2 -3\n", b"0.5\n1.5\n-2\n"],
        _lines,
        either(of_text, of_bytes),
    ),
    Target(
        "float32 of standard input",
        lambda: [np.arange(12, dtype="<f4").tobytes(), np.linspace(-1, 1, 7, dtype="<f4").tobytes()],
        _raw,
        of_bytes,
    ),
)
