"""Excel workbooks and LabVIEW files, with the extra `formats`."""

import sys
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pytest

from texclass.loaders import load_recording, open_dataset
from texclass.recording import RecordingError

openpyxl = pytest.importorskip("openpyxl", reason="the extra `formats` is not installed")
nptdms = pytest.importorskip("nptdms", reason="the extra `formats` is not installed")

A = np.round(np.random.default_rng(0).normal(size=(60, 3)), 4)
T = np.arange(60) / 100


def workbook(path, **sheets):
    """Write sheets, given as rows of cells."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(list(row))
    book.save(path)
    return path


def timed():
    return np.column_stack([T, A]).tolist()


def test_a_sheet_is_read_like_a_text_table(tmp_path):
    rows = [["time", "x", "y", "z"], ["s", "m/s^2", "m/s^2", "m/s^2"], *timed()]
    recording = load_recording(workbook(tmp_path / "a.xlsx", Data=rows))
    np.testing.assert_array_equal(recording.acceleration, A)
    assert (recording.fs, recording.unit, recording.channels) == (100, "m/s^2", ("x", "y", "z"))


def test_a_table_may_begin_anywhere_and_have_dates(tmp_path):
    start = datetime(2019, 8, 6, 14, 15, 18)
    rows = [[], [None, "made by", "me"], [], [None, "Date time", None, "x", "y", "z"]]
    rows += [[None, start + timedelta(seconds=t), None, *a] for t, a in zip(T, A.tolist(), strict=True)]
    recording = load_recording(workbook(tmp_path / "a.xlsx", Data=rows), unit="g")
    np.testing.assert_allclose(recording.acceleration, 9.80665 * A)
    assert recording.fs == pytest.approx(100)


def test_the_first_sheet_with_numbers_is_read_and_reported(tmp_path):
    about = [["Device", "Phone"], ["version", 1.2]]
    rows = [["x", "y", "z"], *A.tolist()]
    path = workbook(tmp_path / "a.xlsx", About=about, Raw=rows, Other=rows)
    recording = load_recording(path, fs=100, unit="g")
    assert len(recording.acceleration) == 60
    assert "sheet: 'Raw' is read, 1 other sheet with numbers not" in recording.flags
    with pytest.raises(RecordingError, match=r"a\.xlsx: no sheet has rows of numbers"):
        load_recording(workbook(tmp_path / "a.xlsx", About=about), fs=100, unit="g")


def test_cells_without_a_number_are_an_error_or_left_out(tmp_path):
    rows = [["x", "y", "z"], *A.tolist()]
    rows[7][1], rows[9][2] = None, "=1/0"  # a formula without a stored value
    path = workbook(tmp_path / "a.xlsx", Data=rows)
    with pytest.raises(RecordingError, match=r"a\.xlsx \(sheet 'Data'\): line 8 .*--drop-incomplete"):
        load_recording(path, fs=100, unit="g")
    recording = load_recording(path, fs=100, unit="g", drop_incomplete=True)
    assert len(recording.acceleration) == 58
    assert "incomplete: 2 lines without all numbers left out" in recording.flags


def test_a_workbook_that_expands_without_end_is_refused(tmp_path):
    path = workbook(tmp_path / "a.xlsx", Data=A.tolist())
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet9.xml", bytes(1 << 27))
    with pytest.raises(RecordingError, match=r"a\.xlsx: expands to .* 64 MB, or 100 times its size"):
        load_recording(path, fs=100, unit="g", column="1")


def test_a_changed_workbook_is_read_again(tmp_path):
    path = tmp_path / "a.xlsx"
    for rows in (A, 2 * A, A[:50]):
        workbook(path, Data=[["x", "y", "z"], *rows.tolist()])
        np.testing.assert_allclose(load_recording(path, fs=100, unit="m/s^2").acceleration, rows)


def tdms(path, channels, group="data"):
    """Write channels: name -> (samples, properties)."""
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject(group, name, *of) for name, of in channels.items()])
    return path


def test_channels_of_tdms_state_rate_and_unit(tmp_path):
    facts = {"wf_increment": 0.01, "unit_string": "g"}
    path = tdms(tmp_path / "a.tdms", {axis: (A[:, i].copy(), facts) for i, axis in enumerate("xyz")})
    recording = load_recording(path)
    np.testing.assert_allclose(recording.acceleration, 9.80665 * A)
    assert (recording.fs, recording.unit, recording.channels) == (100, "m/s^2", ("x", "y", "z"))
    assert "time: fs is 100 Hz, as 'wf_increment' in the file states" in recording.flags
    for stated, message in (
        ({"fs": 200}, "fs is 100 Hz, but 200 Hz was given"),
        ({"unit": "V"}, "unit is 'g'"),
    ):
        with pytest.raises(RecordingError, match=message):
            load_recording(path, **stated)


def test_a_time_channel_of_tdms_gives_the_rate(tmp_path):
    dates = np.datetime64("2019-08-06T00:00:00") + (1e6 * T).astype("m8[us]")
    path = tdms(tmp_path / "a.tdms", {"Time": (dates, {}), "x": (A[:, 0].copy(), {})})
    assert load_recording(path, unit="g").fs == pytest.approx(100)


def test_channels_of_tdms_with_different_rates_or_text_are_refused(tmp_path):
    channels = {"x": (A[:, 0].copy(), {"wf_increment": 0.01}), "y": (A[:, 1].copy(), {"wf_increment": 0.1})}
    path = tdms(tmp_path / "a.tdms", channels)
    with pytest.raises(RecordingError, match=r"rates 100, 10 Hz.*--column"):
        load_recording(path, column=("x", "y"), unit="g")
    assert load_recording(path, column="y", unit="g").fs == 10
    with pytest.raises(RecordingError, match="real numbers"):
        load_recording(tdms(tmp_path / "b.tdms", {"x": (["a", "b"], {})}), fs=1, unit="g")


def test_folders_of_workbooks_and_tdms_are_datasets(tmp_path):
    for surface, suffix in (("oak", "xlsx"), ("slate", "tdms")):
        (tmp_path / surface).mkdir()
        for k in (1, 2):
            path = tmp_path / surface / f"{k}.{suffix}"
            if suffix == "xlsx":
                workbook(path, Data=[["x"], *(A[:, :1] * k).tolist()])
            else:
                tdms(path, {"x": (A[:, 0] * k + 1, {})})
    dataset = open_dataset(tmp_path, fs=100, unit="g")
    assert [len(recording.acceleration) for recording in dataset] == [60] * 4


@pytest.mark.parametrize(("suffix", "library"), [("xlsx", "openpyxl"), ("tdms", "nptdms")])
def test_without_the_library_the_message_names_the_extra(tmp_path, monkeypatch, suffix, library):
    (tmp_path / f"a.{suffix}").write_bytes(b"something")
    for module in ("texclass.loaders.workbooks", "texclass.loaders.tdms"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(RecordingError, match=r"pip install 'texclass\[formats\]'"):
        load_recording(tmp_path / f"a.{suffix}")
