"""Text tables as loggers and programs write them: read correctly, or refused with an option that works."""

import inspect
import re
import shlex

import numpy as np
import pytest

from texclass.cli.parameters import reader_settings
from texclass.loaders import load_recording
from texclass.recording import RecordingError

N = 60
A = np.round(np.random.default_rng(0).normal(size=(N, 3)), 3)
T = np.arange(N) / 100
XYZ = ("x", "y", "z")


def text(rows=A, mark=",", *, above="", number="{:.3f}", after="", decimal="."):
    """Return a table of numbers below some lines."""
    cells = [[number.format(cell).replace(".", decimal) for cell in row] for row in rows]
    return above + "".join(f"{mark.join(row)}{after}\n" for row in cells)


def indexed(rows=A):
    return np.column_stack([np.arange(len(rows)), rows])


def timed(rows=A):
    return np.column_stack([T, rows])


def rows_of(content):
    """Return the lines of a table as lists of cells."""
    return [line.split(",") for line in content.splitlines()]


def of_index(above, rows=A):
    return above + "".join(f"{k},{line}\n" for k, line in enumerate(text(rows).splitlines()))


BOOT = (
    "ets Jun  8 2016 00:22:57\n\nrst:0x1 (POWERON_RESET),boot:0x13\nload:0x3fff0030,len:1344\nMPU6050 ready\n"
)
LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{decimal}\nX_Columns\t{x}\n"
    "Date\t2019/08/06\nTime\t14:15:18.5\n***End_of_Header***\t\n\t\nChannels\t3\t\t\nSamples\t60\t60\t60\n"
    "Date\t2019/08/06\t2019/08/06\t2019/08/06\nY_Unit_Label\tm/s^2\tm/s^2\tm/s^2\nX_Dimension\tTime\tTime\tTime\n"
    "X0\t0.0\t0.0\t0.0\nDelta_X\t{step}\t{step}\t{step}\n***End_of_Header***\t\t\t\n"
    "X_Value\tAcc X\tAcc Y\tAcc Z\tComment\n"
)
PICO = "Time,Channel A,Channel B\n(ms),(V),(V)\n\n"
TABLES = {
    # name: (suffix, content, options, acceleration)
    "pandas without names, with index": (".csv", of_index(",0,1,2\n"), {"column": ("0", "1", "2")}, A),
    "pandas without names": (".csv", text(above="0,1,2\n"), {"column": ("0", "1", "2")}, A),
    "numbers of columns named by numbers": (
        ".csv",
        text(above="0,1,2\n"),
        {"column": ("1", "2", "3")},
        A,
    ),
    "pandas series": (".csv", of_index(",0\n", A[:, :1]), {}, A[:, 0]),
    "pandas with index": (".csv", of_index(",x,y,z\n"), {}, A),
    "pandas with index, read and written again": (".csv", of_index("Unnamed: 0,x,y,z\n"), {}, A),
    "R without a name of the index": (".csv", of_index("x,y,z\n"), {}, A),
    "trailing comma in header and rows": (".csv", text(above="x,y,z,\n", after=","), {}, A),
    "trailing comma in header": (".csv", text(above="x,y,z,\n"), {}, A),
    "trailing comma in rows": (".csv", text(above="x,y,z\n", after=","), {}, A),
    "trailing commas without header": (".csv", text(after=",,"), {"column": ("1", "2", "3")}, A),
    "trailing semicolon": (".csv", text(above="x;y;z;\n", mark=";", after=";"), {}, A),
    "commented header": (".txt", text(above="# ax ay az\n", mark=" "), {}, A),
    "commented header in CSV": (".csv", text(above="# ax,ay,az\n"), {}, A),
    "blanks in CSV": (".csv", text(mark=" "), {"column": ("1", "2", "3")}, A),
    "numpy comments": (".txt", text(above="# sensor: a, b, c\n# rate; 5\n#x y z\n", mark=" "), {}, A),
    "separator line of Excel": (".csv", text(above="sep=;\nx;y;z\n", mark=";"), {}, A),
    "units below the names": (
        ".csv",
        text(timed(), above="t,ax,ay,az\ns,m/s^2,m/s^2,m/s^2\n"),
        {"unit": None, "fs": None},
        A,
    ),
    "units below the names, time in ms": (
        ".csv",
        text(np.column_stack([10 * np.arange(N), A]), above="time;ax;ay;az\n[ms];[g];[g];[g]\n", mark=";"),
        {"unit": "g", "fs": None},
        A * 9.80665,
    ),
    "comments anywhere": (
        ".csv",
        "# a\n" + text(A[:9], above="x,y,z\n") + "# pause, 1, 2\n% note\n" + text(A[9:]) + "// end\n",
        {},
        A,
    ),
    "comments in one column": (".txt", "% a\n" + text(A[:9, :1]) + "# b\n" + text(A[9:, :1]), {}, A[:, 0]),
    "boot lines": (".txt", text(above=BOOT), {"column": ("1", "2", "3")}, A),
    "boot lines above names": (".csv", text(above=BOOT + "x,y,z\n"), {}, A),
    "a header of facts": (
        ".csv",
        text(above="Device,X16\nRate,1000\nStart,2019-08-06 14:15:18\n\nx,y,z\n"),
        {},
        A,
    ),
    "name of a single column": (".txt", text(A[:, :1], above="acceleration\n"), {}, A[:, 0]),
    "LabVIEW": (
        ".lvm",
        text(timed(), "\t", above=LVM.format(x="One", step=0.01, decimal=".")),
        {"unit": None, "fs": None},
        A,
    ),
    "LabVIEW with comments": (
        ".lvm",
        text(timed(), "\t", above=LVM.format(x="One", step=0.01, decimal="."), after="\t"),
        {"unit": None, "fs": None},
        A,
    ),
    "LabVIEW without times": (
        ".lvm",
        LVM.format(x="No", step="0,010000", decimal=",")
        + "".join(f"\t{line}\n" for line in text(mark="\t", decimal=",").splitlines()),
        {"unit": None, "fs": None},
        A,
    ),
    "LabVIEW without times, one channel": (
        ".lvm",
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\nChannels\t1\t\n"
        "Y_Unit_Label\tm/s^2\t\nX_Dimension\tTime\t\nDelta_X\t0.010000\t\n***End_of_Header***\t\t\n"
        "X_Value\tAcc\tComment\n" + "".join(f"\t{x:.3f}\n" for x in A[:, 0]),
        {"unit": None, "fs": None},
        A[:, 0],
    ),
    "LabVIEW as text": (
        ".txt",
        text(timed(), "\t", above=LVM.format(x="One", step=0.01, decimal=".")),
        {"unit": None, "fs": None},
        A,
    ),
    "PicoScope": (
        ".csv",
        text(np.column_stack([10 * np.arange(N), A[:, :2]]), above=PICO),
        {"unit": "V", "fs": None, "column": ("Channel A", "Channel B")},
        A[:, :2],
    ),
    "European": (
        ".csv",
        text(timed(), ";", above="Zeit (s);x;y;z\n", decimal=","),
        {"time_column": "1", "fs": None},
        A,
    ),
    "Empatica": (
        ".csv",
        text(above="1495437325.00, 1495437325.00, 1495437325.00\n100.00, 100.00, 100.00\n"),
        {"column": ("1", "2", "3"), "fs": None},
        A,
    ),
    "Delsys, times in seconds named X": (
        ".csv",
        text(
            np.column_stack([timed()[:, 0], A[:, 0], timed()[:, 0], A[:, 1]]),
            above='"X[s]","ACC.X 1 [g]","X[s]","ACC.Y 1 [g]"\n',
        ),
        {"unit": None, "fs": None, "column": ("ACC.X 1 [g]", "ACC.Y 1 [g]")},
        9.80665 * A[:, :2],
    ),
    "Shimmer": (
        ".csv",
        text(
            timed(), "\t", above='"sep=\t"\nS_Time\tAcc_X\tAcc_Y\tAcc_Z\t\ns\tm/(s^2)\tm/(s^2)\tm/(s^2)\t\n'
        ),
        {"unit": None, "fs": None},
        A,
    ),
    "an oscilloscope of Keysight": (
        ".csv",
        text(timed()[:, :3], above="x-axis,1,2\nsecond,Volt,Volt\n"),
        {"unit": "V", "fs": None, "column": ("1 [V]", "2 [V]")},
        A[:, :2],
    ),
    "dates without a name": (
        ".csv",
        "".join(f"2019-01-01 00:00:{i / 100:06.3f},{x},{y},{z}\n" for i, (x, y, z) in enumerate(A)),
        {"fs": None, "column": ("2", "3", "4")},
        A,
    ),
    "German time": (".csv", text(timed(), ";", above="zeit;x;y;z\n", decimal=","), {"fs": None}, A),
    "microseconds of a controller": (
        ".csv",
        text(np.column_stack([10_000 * np.arange(N), A]), above="micros,x,y,z\n"),
        {"fs": None},
        A,
    ),
    "two clocks, one with a unit": (
        ".txt",
        "Phone timestamp;sensor timestamp [ns];X [g];Y [g];Z [g]\n"
        + "".join(
            f"2021-11-01T12:00:{i // 10 / 10:06.3f};{10_000_000 * i};{x};{y};{z}\n"
            for i, (x, y, z) in enumerate(A)
        ),
        {"unit": None, "fs": None},
        9.80665 * A,
    ),
    "European in quotes": (
        ".csv",
        "".join(f'"{x:.3f}","{y:.3f}"\n'.replace(".", ",") for x, y, _ in A),
        {"column": ("1", "2")},
        A[:, :2],
    ),
    "empty cells in other columns": (".csv", text(above="x,y,z,note\n", after=","), {}, A),
    "an empty first line of cells": (".csv", "x,y,z\n,,\n" + text(), {}, A),
    "windows lines": (".csv", text(above="x,y,z\n").replace("\n", "\r\n"), {}, A),
    "blank lines": (".csv", "\n\n" + text(above="x,y,z\n\n").replace("\n", "\n\n", 5), {}, A),
    "a name in two lines": (".csv", text(above='"x\n(1)",y,z\n'), {"column": ("1", "2", "3")}, A),
    "a code page of Windows": (
        ".csv",
        text(above="x (m/s²),y (m/s²),z (m/s²)\n").encode("cp1252"),
        {"unit": None},
        A,
    ),
}


def load(path, **options):
    return load_recording(path, **{"fs": 100, "unit": "m/s^2"} | options)


def write(folder, suffix, content):
    path = folder / f"r{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("kind", TABLES)
def test_tables_as_programs_write_them_are_read(tmp_path, kind):
    suffix, content, options, expected = TABLES[kind]
    recording = load(write(tmp_path, suffix, content), **options)
    np.testing.assert_allclose(recording.acceleration, expected)
    assert recording.fs == 100


@pytest.mark.parametrize(
    "above",
    [
        "Sample Rate: 1 kHz. Values on linear scale. 1 channel\n",
        "Data1\nSampling frequency (Hz): 1000\n\nAI 1\n",
        '# {"sensor": ["ACC"], "sampling rate": 1000}\n# EndOfHeader\n',
        "// Update Rate: 1000.0Hz\nAcc_X\n",
        "# Config: data_rate = 1000.0 Hz, filter = 488 Hz\na_x\n",
        "# data rate 115200 baud\n;SampleRate, 1000,Hz\nx\n",
        "Device,1.2\nMeasurement Frequency,1000 Hz\nx\n",
    ],
)
def test_the_lines_above_the_rows_state_the_rate(tmp_path, above):
    path = write(tmp_path, ".csv", above + text(A[:, :1]))
    recording = load(path, fs=None)
    assert recording.fs == 1000
    assert any(flag.startswith("rate: 1000 Hz, from the lines above the rows") for flag in recording.flags)
    with pytest.raises(RecordingError, match="fs is 1000 Hz, but 100 Hz was given"):
        load(path, fs=100)
    below = write(tmp_path, ".csv", "Sampling rate: 999 Hz\ntime (s),x\n" + text(timed()[:, :2]))
    assert load(below, fs=None).fs == 100  # time stamps are closer to the truth


def test_what_is_no_acceleration_is_not_suggested(tmp_path):
    for above, rows, suggested in (
        ("t (s),Gyroscope x (rad/s),y (rad/s),z (rad/s)\n", timed(), "--column NAMES"),
        ("t (s),position x (m),position y (m),position z (m)\n", timed(), "--column NAMES"),
        ("", np.tile(A, 4), "--column NAMES"),
        (
            "t,Sub Frame,Fx,Fy,Fz\ns,,N,N,N\n",
            np.insert(timed(), 1, np.arange(N) % 10, axis=1),
            "--column 'Fx [N],Fy [N],Fz [N]'",
        ),
    ):
        with pytest.raises(RecordingError) as refused:
            load(write(tmp_path, ".csv", above + text(rows)), fs=100)
        assert suggested in str(refused.value)


@pytest.mark.parametrize("codec", ["utf-16-le", "utf-16-be", "utf-8"])
@pytest.mark.parametrize(
    "kind", ["European", "commented header", "comments anywhere", "boot lines", "pandas with index"]
)
def test_the_byte_order_mark_defines_the_encoding(tmp_path, codec, kind):
    suffix, content, options, expected = TABLES[kind]
    recording = load(write(tmp_path, suffix, f"\ufeff{content}".encode(codec)), **options)
    np.testing.assert_allclose(recording.acceleration, expected)


def options_in(message):
    """Return the first reading option that a message suggests, as a command line parses it."""
    match = re.search(r"--(column|skip-rows|comment|delimiter|drop-incomplete) ?", message)
    assert match, message
    if match[1] == "drop-incomplete":
        return {"drop_incomplete": True}
    words = shlex.shlex(message[match.end() :], posix=True, punctuation_chars=False)
    words.whitespace_split = True
    value = words.get_token()
    if match[1] in ("column", "delimiter"):
        unset = dict.fromkeys(inspect.signature(reader_settings).parameters)
        return {match[1]: reader_settings(**unset | {match[1]: value})[match[1]]}
    return {match[1].replace("-", "_"): int(value) if value.isdecimal() else value}


FIRST = A[:5]
SUGGESTED = {
    # name: (suffix, content, acceleration read with the suggested option)
    "text beside numbers": (
        ".csv",
        "id,left,right\n" + "".join(f"r{k},{x},{y}\n" for k, (x, y, _) in enumerate(A)),
        A[:, :2],
    ),
    "a ramp without a time's name": (".csv", text(timed(), above="Zeit,u,v,w\n"), A),
    "axes among other columns": (
        ".csv",
        text(np.column_stack([A[:, :1], A]), above="level,gFx,gFy,gFz\n"),
        A,
    ),
    "names with blanks": (".csv", text(above="my x,my y,my z\n"), A),
    "names with commas and quotes": (".csv", text(above='"a, b",it\'s,$c\n'), A),
    "names like options": (".csv", text(above="-a,-b,-c\n"), A),
    "names with units": (".csv", text(above="left (m/s^2),up (m/s^2),front (m/s^2)\n"), A),
    "names of pandas": (".csv", of_index(",0,1,2\n"), A),
    "a commented header": (".csv", text(above="# u,v,w\n"), A),
    "a constant column": (".csv", text(np.column_stack([np.ones(N), A]), above="q,u,v,w\n"), A),
    "no names": (".csv", text(mark=";"), A),
    "a decimal comma": (".csv", "".join(f"{x:.3f}\n".replace(".", ",") for x in A[:, 0]), A[:, 0]),
    "empty cells": (".csv", text(FIRST, above="x,y,z\n") + "1,,2\n" + text(A[5:]), A),
    "a cut last line": (".csv", text(above="x,y,z\n") + "0.1,0.", A),
    "a garbled line": (".csv", text(FIRST, above="x,y,z\n") + "0.1\0\x02,-,--\n" + text(A[5:]), A),
    "the header again": (".csv", text(FIRST, above="x,y,z\n") + text(A[5:], above="x,y,z\n"), A),
    "a number among the boot lines": (".txt", text(A[:, :1], above="115200\nready\n"), A[:, 0]),
    "other comments": (".csv", text(FIRST, above="x,y,z\n") + "!pause\n" + text(A[5:]), A),
}


@pytest.mark.parametrize("kind", SUGGESTED)
def test_a_suggested_option_works_as_typed(tmp_path, kind):
    suffix, content, expected = SUGGESTED[kind]
    path = write(tmp_path, suffix, content)
    with pytest.raises(RecordingError) as refusal:
        load(path)
    option = options_in(str(refusal.value))
    recording = load(path, **option)
    np.testing.assert_allclose(recording.acceleration, expected)


@pytest.mark.parametrize(
    ("above", "column"),
    [
        ("Time,Channel A,Channel B\n(ms),(mV),(mV)\n\n", ("Channel A", "Channel B")),
        ("t,x (rad/s),y (rad/s)\n", ("2", "3")),
        ("t,x [mm/s^2],y [mm/s^2]\n", ("2", "3")),
        ("t,x (µT),y (µT)\n", ("2", "3")),
    ],
)
def test_a_unit_of_another_quantity_is_an_error_with_or_without_options(tmp_path, above, column):
    path = write(tmp_path, ".csv", text(timed()[:, :3], above=above))
    with pytest.raises(RecordingError, match=r"not supported for an acceleration.*convert the values"):
        load(path, fs=None, column=column, unit="V", time_unit="s")


def test_columns_are_suggested_although_a_line_is_incomplete(tmp_path):
    path = write(tmp_path, ".txt", text(above="ready\n") + "0.1,0.\n")
    with pytest.raises(RecordingError, match="--column c1,c2,c3"):
        load(path)
    with pytest.raises(RecordingError, match="--drop-incomplete"):
        load(path, column=("c1", "c2", "c3"))
    read = load(path, column=("c1", "c2", "c3"), drop_incomplete=True)
    np.testing.assert_array_equal(read.acceleration, A)


def test_a_garbled_line_that_is_not_utf_8_can_be_left_out(tmp_path):
    rows = text(A, above="x,y,z\n").encode()
    path = write(tmp_path, ".csv", rows[:-1] + b"\n0.1,\xff\xfe\n")
    read = load(path, drop_incomplete=True)
    np.testing.assert_array_equal(read.acceleration, A)
    assert "incomplete: 1 line without a number in each column dropped" in read.flags


def test_each_option_of_a_message_works(tmp_path):
    path = write(tmp_path, ".csv", "ready\n" + text(FIRST) + "!pause, 1\n" + text(A[5:]))
    with pytest.raises(RecordingError, match=r"line 7 is '!pause, 1'.*--drop-incomplete.*--comment '!'"):
        load(path, column=("1", "2", "3"))
    for option, expected in (
        ({"drop_incomplete": True}, A),
        ({"comment": "!"}, A),
        ({"skip_rows": 7}, A[5:]),
    ):
        np.testing.assert_array_equal(load(path, column=("1", "2", "3"), **option).acceleration, expected)


def test_what_was_assumed_is_reported(tmp_path):
    for kind, flag in (
        ("pandas without names", "names: the line '0,1,2' is read as column names, not as a row"),
        ("units below the names", "units: s, m/s^2, from the lines above the rows"),
        ("comments anywhere", "comments: 3 comment lines between the rows skipped"),
        (
            "boot lines",
            "header: 4 lines above the rows ignored, starting with 'ets Jun  8 2016 00:22:57'",
        ),
        ("European", "decimals: commas are read as decimal points"),
        ("a code page of Windows", "encoding: the text is not UTF-8, read as Windows-1252"),
    ):
        suffix, content, options, _ = TABLES[kind]
        assert flag in load(write(tmp_path, suffix, content), **options).flags
    counts = write(tmp_path, ".csv", text(100 * A[:, :2], above="0,1\n", number="{:.0f}"))
    recording = load(counts, column=("1", "2"))
    assert "names: the first line '0,1' is read as a row; --skip-rows 1 skips it" in recording.flags
    assert len(load(counts, column=("1", "2"), skip_rows=1).acceleration) == N
    path = write(tmp_path, ".csv", "x,y,z\n" + text(FIRST) + "1,2\n1,,2\n" + text(A[5:]))
    assert load(path, drop_incomplete=True).flags == (
        "incomplete: 2 lines without a number in each column dropped",
    )


@pytest.mark.parametrize("names", ["mag_x,signal,long", "x (g),y,z"])
def test_a_unit_row_holds_for_names_that_contain_its_letters(tmp_path, names):
    path = write(tmp_path, ".csv", text(above=f"{names}\ng,g,g\n"))
    recording = load_recording(path, fs=100, column=("1", "2", "3"))
    np.testing.assert_allclose(recording.acceleration, 9.80665 * A, rtol=1e-6)


def test_a_unit_row_that_contradicts_the_names_is_refused(tmp_path):
    path = write(tmp_path, ".csv", text(above="x (mg),y (mg),z (mg)\ng,g,g\n"))
    with pytest.raises(RecordingError, match="its columns have the units g and mg"):
        load_recording(path, fs=100)


@pytest.mark.parametrize(
    ("header", "column", "chosen", "how"),
    [
        ("0,1,2", "1,2,3", ("0", "1", "2"), "numbers from 1"),
        ("0,1,2", "1,2", ("1", "2"), "names"),
        ("0,1,2", "0,1,2", ("0", "1", "2"), None),
        ("ax,2,3", "2,3", ("2", "3"), None),
        ("ax,ay,az", "1,2,3", ("ax", "ay", "az"), None),
        ("ax,1,az", "ax,1", ("ax", "1"), "names"),
    ],
)
def test_numbers_that_are_names_of_other_columns_are_reported(tmp_path, header, column, chosen, how):
    samples = np.random.default_rng(0).normal(size=(500, 3)).round(4)
    path = tmp_path / "x.csv"
    np.savetxt(path, samples, delimiter=",", header=header, comments="")
    recording = load(path, column=column.split(","))
    places = [header.split(",").index(name) for name in chosen]
    np.testing.assert_allclose(recording.acceleration, samples[:, places])
    reported = [flag for flag in recording.flags if flag.startswith("columns: ")]
    assert [f"are read as {how}" in flag for flag in reported] == [True] * (how is not None)


def test_what_was_assumed_of_a_file_per_axis_is_reported_once(tmp_path):
    for k, axis in enumerate("xyz"):
        rows = np.random.default_rng(k).normal(size=500).astype(str)
        (tmp_path / f"r_{axis}.txt").write_text("\n".join([*rows[:9], "# paused", *rows[9:]]))
    flags = load(tmp_path / "r_x.txt").flags
    assert [flag for flag in flags if "comment" in flag] == [
        "comments: 1 comment line between the rows skipped"
    ]
