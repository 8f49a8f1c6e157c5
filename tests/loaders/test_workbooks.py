"""Excel workbooks and LabVIEW files, with the extra `formats`."""

import resource
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
    assert (
        "sheet: 'Raw' is read, 1 other sheet ignored; to select another, pass --column, e.g. 'Other/x'"
        in recording.flags
    )
    with pytest.raises(RecordingError, match=r"a\.xlsx: no sheet has rows of numbers"):
        load_recording(workbook(tmp_path / "a.xlsx", About=about), fs=100, unit="g")


def test_a_column_selects_its_sheet_and_the_time_stamps_in_it(tmp_path):
    rows = [["Time", "x"], *timed_column(0.01)]
    path = workbook(tmp_path / "a.xlsx", Slow=rows, Fast=[["Time", "x"], *timed_column(0.001)])
    with pytest.raises(RecordingError, match=r"--column x \("):
        load_recording(path, unit="g")
    assert load_recording(path, unit="g", column="x").fs == pytest.approx(100)
    assert load_recording(path, unit="g", column="Fast/x").fs == pytest.approx(1000)
    with pytest.raises(RecordingError, match=r"a\.xlsx: 'x', 'Fast/x' are in several sheets"):
        load_recording(path, unit="g", column=("x", "Fast/x"))


def timed_column(step):
    return np.column_stack([step * np.arange(60), A[:, 0]]).tolist()


def test_lines_in_messages_and_options_are_rows_of_the_sheet(tmp_path):
    head = [["Title"], [], ["version", 1, 2], [], ["x", "y", "z"]]
    path = workbook(tmp_path / "a.xlsx", Data=[*head, *A.tolist()])
    recording = load_recording(path, fs=100, unit="m/s^2", skip_rows=4)
    np.testing.assert_array_equal(recording.acceleration, A)
    rows = [*head, *A.tolist()]
    rows[39][1] = "bad"
    with pytest.raises(RecordingError, match=r"line 40 is .*bad"):
        load_recording(workbook(path, Data=rows), fs=100, unit="g")


@pytest.mark.parametrize("error", ["#N/A", "#DIV/0!", "#VALUE!"])
def test_a_row_that_begins_with_an_error_of_excel_is_no_comment(tmp_path, error):
    rows = [["x", "y", "z"], *A.tolist()]
    rows[30][0] = error
    path = workbook(tmp_path / "a.xlsx", Data=rows)
    with pytest.raises(RecordingError, match=r"line 31 .*column 'x' is not a number.*--drop-incomplete"):
        load_recording(path, fs=100, unit="g")
    recording = load_recording(path, fs=100, unit="g", drop_incomplete=True)
    assert "incomplete: 1 line without a number in each column dropped" in recording.flags


@pytest.mark.parametrize("kind", [datetime.time, lambda date: date - datetime(2019, 8, 6)])
def test_times_of_day_and_durations_give_the_rate(tmp_path, kind):
    start = datetime(2019, 8, 6, 14, 15, 18)
    rows = [[kind(start + timedelta(seconds=t)), *a] for t, a in zip(T, A.tolist(), strict=True)]
    path = workbook(tmp_path / "a.xlsx", Data=[["Time", "x", "y", "z"], *rows])
    assert load_recording(path, unit="g").fs == pytest.approx(100)


def test_formulas_without_stored_values_are_named(tmp_path):
    path = workbook(tmp_path / "a.xlsx", Data=[["x"], *[[f"=1+{i}"] for i in range(50)]])
    with pytest.raises(RecordingError, match=r"no sheet has rows of numbers.*save the file in Excel"):
        load_recording(path, fs=100, unit="g")


def test_cells_without_a_number_are_an_error_or_left_out(tmp_path):
    rows = [["x", "y", "z"], *A.tolist()]
    rows[7][1], rows[9][2] = None, "=1/0"  # a formula without a stored value
    path = workbook(tmp_path / "a.xlsx", Data=rows)
    with pytest.raises(RecordingError, match=r"a\.xlsx \(sheet 'Data'\): line 8 .*--drop-incomplete"):
        load_recording(path, fs=100, unit="g")
    recording = load_recording(path, fs=100, unit="g", drop_incomplete=True)
    assert len(recording.acceleration) == 58
    assert "incomplete: 2 lines without a number in each column dropped" in recording.flags


def test_a_workbook_that_expands_without_end_is_refused(tmp_path):
    path = workbook(tmp_path / "a.xlsx", Data=A.tolist())
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet9.xml", bytes(1 << 27))
    with pytest.raises(
        RecordingError, match=r"a\.xlsx: expands to .* 64 MB, or 100 times the size of the file"
    ):
        load_recording(path, fs=100, unit="g", column="1")


def with_sheet(path, content, shared=b""):
    """Write a workbook whose only sheet, and texts, are given as XML."""
    rows = [["x"], [1.5], ["note"]]
    with zipfile.ZipFile(workbook(path.with_name("whole.xlsx"), Data=rows)) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    opening, _, _ = members["xl/worksheets/sheet1.xml"].partition(b"<sheetData>")
    members["xl/worksheets/sheet1.xml"] = content.replace(b"<sheetData>", opening + b"<sheetData>")
    if shared:
        kind = b"application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"
        part = b'<Override PartName="/xl/sharedStrings.xml" ContentType="%s"/></Types>' % kind
        members["[Content_Types].xml"] = members["[Content_Types].xml"].replace(b"</Types>", part)
        members["xl/sharedStrings.xml"] = shared
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


MAIN = b'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
ROW = b'<row r="%d"><c r="A%d"><v>1</v></c><c r="B%d" t="s"><v>0</v></c></row>'
SMALL_BUT_LARGE = {
    "blank cells": (b'<row><c r="XFD1"><v>1</v></c></row>' * 50_000, b"", "cells"),
    "a far row": (b'<row r="9999999999"><c><v>1</v></c></row>', b"", "rows"),
    "a repeated text": (
        b"".join(ROW % (i, i, i) for i in range(1, 5001)),
        b"<sst %s><si><t>%s</t></si></sst>" % (MAIN, b"a" * 1_000_000),
        "characters",
    ),
}


@pytest.mark.parametrize("kind", SMALL_BUT_LARGE)
def test_a_small_workbook_with_a_large_sheet_is_refused_before_it_takes_memory(tmp_path, kind):
    rows, shared, limit = SMALL_BUT_LARGE[kind]
    content = b"<sheetData>" + rows + b"</sheetData></worksheet>"
    path = with_sheet(tmp_path / "a.xlsx", content, shared)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RecordingError, match=rf"a\.xlsx \(sheet 'Data'\): has at least .*at most .*{limit}"):
        load_recording(path, fs=100, unit="g")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 256 * 1024


@pytest.mark.parametrize(
    "entity", [b'"%s"' % (b"1" * 10), b'SYSTEM "file:///etc/passwd"'], ids=["internal", "external"]
)
@pytest.mark.parametrize("comment", [b"", b"<!--" + b" " * 100_000 + b"-->"], ids=["first", "late"])
def test_entities_are_refused(tmp_path, entity, comment):
    head = b'<?xml version="1.0"?>' + comment + b"<!DOCTYPE x [<!ENTITY a " + entity + b">]>"
    rows = b'<row r="1"><c><v>&a;</v></c></row>' * 3
    path = with_sheet(tmp_path / "a.xlsx", head + b"<sheetData>" + rows + b"</sheetData></worksheet>")
    with pytest.raises(
        RecordingError, match=r"a\.xlsx \(xl/worksheets/sheet1\.xml\): declares a document type"
    ):
        load_recording(path, fs=100, unit="g")


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
    assert "time: fs is 100 Hz, from 'wf_increment' in the file" in recording.flags
    for options, message in (
        ({"fs": 200}, "fs is 100 Hz, but 200 Hz was given"),
        ({"unit": "V"}, "unit is 'g'"),
    ):
        with pytest.raises(RecordingError, match=message):
            load_recording(path, **options)


def test_a_group_of_tdms_has_its_own_time_channel(tmp_path):
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as file:
        for group, step in (("slow", 0.01), ("fast", 0.001)):
            columns = {"Time": step * np.arange(60), "x": A[:, 0].copy()}
            file.write_segment([nptdms.ChannelObject(group, *column) for column in columns.items()])
        file.write_segment([nptdms.GroupObject("Setup", {"tool": "steel"})])
    with pytest.raises(RecordingError, match=r"columns are 'slow/Time', 'slow/x'.*--column slow/x \("):
        load_recording(path, unit="g")
    assert load_recording(path, unit="g", column="slow/x").fs == pytest.approx(100)
    assert load_recording(path, unit="g", column="fast/x").fs == pytest.approx(1000)


def test_a_rate_that_contradicts_the_time_channel_of_tdms_is_refused(tmp_path):
    channels = {"Time": (T, {}), "x": (A[:, 0].copy(), {"wf_increment": 1.0})}
    path = tdms(tmp_path / "a.tdms", channels)
    with pytest.raises(
        RecordingError, match="--time-column none to use the sampling rate, or --time-column Time to"
    ):
        load_recording(path, unit="g")
    assert load_recording(path, unit="g", time_column="Time").fs == pytest.approx(100)
    assert load_recording(path, unit="g", time_column="none").fs == 1


def test_a_truncated_file_of_tdms_is_reported_and_channels_have_one_length(tmp_path):
    path = tmp_path / "a.tdms"
    facts = {"wf_increment": 0.01}
    with nptdms.TdmsWriter(path) as file:
        for _ in range(3):
            file.write_segment(
                [nptdms.ChannelObject("g", c, A[:, i].copy(), facts) for i, c in enumerate("xyz")]
            )
    path.write_bytes(path.read_bytes()[:-700])
    recording = load_recording(path, unit="g")
    assert 120 <= len(recording.acceleration) < 180
    assert "incomplete: the file ends within a segment" in recording.flags


@pytest.mark.parametrize("step", ["abc", -0.01, float("nan"), float("inf")])
def test_an_invalid_time_step_of_tdms_is_an_error(tmp_path, step):
    path = tdms(tmp_path / "a.tdms", {"x": (A[:, 0].copy(), {"wf_increment": step})})
    with pytest.raises(RecordingError, match=r"a\.tdms: wf_increment of 'x' is .*Expected a time step in s"):
        load_recording(path, unit="g")


def test_units_of_tdms_that_are_unknown_or_contradict_the_name_are_reported(tmp_path):
    facts = {"wf_increment": 0.01, "unit_string": "lbf"}
    path = tdms(tmp_path / "a.tdms", {"x": (A[:, 0].copy(), facts)})
    assert "unit: 'lbf' in the file is unknown" in load_recording(path, unit="g").flags
    for name, unit, message in (
        ("x (mg)", "g", "units g and mg"),
        ("x", "rad/s", "is not supported for an acceleration"),
    ):
        facts = {"wf_increment": 0.01, "unit_string": unit}
        tdms(path, {name: (A[:, 0].copy(), facts)})
        with pytest.raises(RecordingError, match=message):
            load_recording(path)


def test_channels_of_tdms_with_text_are_ignored_and_those_of_one_name_refused(tmp_path):
    channels = {"acc": (A[:, 0].copy(), {"wf_increment": 0.01}), "Comment": (["a", "b"], {})}
    recording = load_recording(tdms(tmp_path / "a.tdms", channels), unit="g")
    assert "ignored: 'Comment (text)'" in recording.flags
    path = tmp_path / "b.tdms"
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(
            [nptdms.ChannelObject("a/b", "c", A[:, 0].copy()), nptdms.ChannelObject("a", "b/c", T)]
        )
    with pytest.raises(RecordingError, match="two channels have the name 'a/b/c'"):
        load_recording(path, unit="g")


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
