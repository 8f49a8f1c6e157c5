"""Files of recordings in every format, all holding the same known signal."""

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
import soundfile

FS = 10_000.0
N = 500


@pytest.fixture
def axes():
    """Known acceleration of shape (500, 3): integers, so that every format can hold it exactly."""
    return np.random.default_rng(0).integers(-2000, 2000, (N, 3)).astype(float)


@pytest.fixture
def write():
    """Return the function that writes a file of recordings."""
    return _write


def _write(path: Path, axes: np.ndarray) -> Path:
    """Write three axes in the format of the suffix (one file: text holds the first axis only)."""
    frame = pd.DataFrame(axes, columns=["ax", "ay", "az"][: axes.shape[1]])
    match path.suffix:
        case ".txt":
            np.savetxt(path, axes[:, 0], fmt="%16.7e")
        case ".csv":
            frame.to_csv(path, index=False)
        case ".tsv":
            frame.to_csv(path, index=False, sep="\t")
        case ".lvm":
            names = "".join(f"{name}\t" for name in frame)
            above = f"LabVIEW Measurement\t\nX_Columns\tNo\nDelta_X\t{1 / FS}\n"
            above += f"***End_of_Header***\nX_Value\t{names}Comment\n"
            text = frame.to_csv(index=False, header=False, sep="\t", lineterminator="\n")
            path.write_text(above + "".join(f"\t{line}\n" for line in text.splitlines()), encoding="utf-8")
        case ".parquet":
            pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
            frame.to_parquet(path)
        case ".wav" | ".flac":
            soundfile.write(path, axes.astype(np.int16), int(FS), subtype="PCM_16")
        case ".mat":
            scipy.io.savemat(path, {"acceleration": axes, "fs": FS, "who": "me"})
        case ".npy":
            np.save(path, axes)
        case ".npz":
            np.savez(path, acceleration=axes, fs=FS)
        case ".xlsx":
            pytest.importorskip("openpyxl", reason="the extra `formats` is not installed")
            frame.to_excel(path, index=False)
        case ".tdms":
            nptdms = pytest.importorskip("nptdms", reason="the extra `formats` is not installed")
            facts = {"wf_increment": 1 / FS}
            with nptdms.TdmsWriter(path) as file:
                file.write_segment(
                    [nptdms.ChannelObject("g", name, frame[name].to_numpy(), facts) for name in frame]
                )
        case ".h5" | ".hdf5":
            with h5py.File(path, "w") as file:
                file["acceleration"] = axes
                file.attrs["fs"] = FS
    return path
