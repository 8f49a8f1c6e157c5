"""One recording from a file of any format: values as written, errors for missing or invalid input."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import soundfile

from texclass.loaders import load_recording, open_dataset, readers
from texclass.loaders.plausibility import acceleration_flags, clipped_share
from texclass.recording import RecordingError

FS = 10_000.0
NOISE = np.random.default_rng(0).normal(size=20_000)


@pytest.mark.parametrize("suffix", readers.FORMATS)
def test_every_format_gives_the_written_values_and_missing_rates_or_units_are_errors(
    tmp_path, axes, write, suffix
):
    path = write(tmp_path / f"r{suffix}", axes)
    recording = load_recording(path, fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes[:, 0] if suffix == ".txt" else axes)
    assert (recording.fs, recording.recording_id) == (FS, "r")
    name = {".tdms": "wf_increment", **dict.fromkeys((".mat", ".npz", ".h5", ".hdf5"), "fs")}.get(suffix)
    flags = (f"time: fs is 10000 Hz, from {name!r} in the file",) if name else ()
    assert recording.flags == flags
    if readers.FORMATS[suffix].rate:
        assert load_recording(path, unit="counts").fs == FS
        with pytest.raises(RecordingError, match="fs is 10000 Hz, but 8000 Hz was given"):
            load_recording(path, fs=8000, unit="counts")
    else:
        with pytest.raises(RecordingError, match=f"r{suffix}: fs is missing.*Expected --fs"):
            load_recording(path, unit="counts")
    with pytest.raises(RecordingError, match=f"r{suffix}: unit is missing.*Expected --unit"):
        load_recording(path, fs=FS)
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match=r"is empty \(0 bytes\)"):
        load_recording(path, fs=FS, unit="g")


def test_the_guide_lists_every_format_as_it_is_registered():
    rows: dict[readers.Format, list[str]] = {}
    for suffix, kind in readers.formats().items():
        rows.setdefault(kind, []).append(f"`{suffix}`")
    page = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text(encoding="utf-8")
    for kind, suffixes in rows.items():
        options = [f"`--{name.replace('_', '-')}`" for name in kind.settings]
        extra = kind.extra and f"`{kind.extra}`"
        cells = (kind.name, ", ".join(suffixes), kind.rate, ", ".join(options), extra)
        row = "|".join(f" {cell} " if cell else " " for cell in cells)
        assert f"\n|{row}|\n" in page, row


@pytest.mark.parametrize(
    "template", ["wood_{}.txt", "wood_{}_train1.txt", "G1_X_wood_{}_test.txt", "wood_{}.wav"]
)
def test_one_file_per_axis_joins_into_one_recording(tmp_path, axes, write, template):
    for axis, column in zip("XYZ", axes.T, strict=True):
        write(tmp_path / template.format(axis), column[:, None])
    recording = load_recording(tmp_path / template.format("Y"), fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes)
    assert recording.channels == ("x", "y", "z")
    assert recording.recording_id == template.replace("_{}", "").rpartition(".")[0]


def test_a_single_axis_keeps_its_name(tmp_path, axes, write):
    recording = load_recording(write(tmp_path / "wood_Z.txt", axes), fs=FS, unit="g")
    assert (recording.channels, recording.recording_id) == (("z",), "wood_Z")


def test_axes_of_different_length_or_rate_are_refused(tmp_path, axes):
    for axis, n, fs in (("X", 500, 1000), ("Y", 499, 1000), ("Z", 500, 2000)):
        np.savez(tmp_path / f"r_{axis}.npz", acceleration=axes[:n, 0], fs=fs)
    with pytest.raises(RecordingError, match="'x': 500, 'y': 499"):
        load_recording(tmp_path / "r_X.npz", unit="g")
    (tmp_path / "r_Y.npz").unlink()
    with pytest.raises(RecordingError, match=r"rates \[1000.0, 2000.0\]"):
        load_recording(tmp_path / "r_X.npz", unit="g")


def test_columns_are_chosen_by_name_and_auxiliary_signals_too(tmp_path, axes, write):
    path = write(tmp_path / "r.csv", axes)
    auxiliary = {"friction": "ax", "speed": "ay"}
    recording = load_recording(path, fs=FS, unit="g", column="az", auxiliary=auxiliary)
    np.testing.assert_allclose(recording.acceleration, axes[:, 2] * 9.80665)
    np.testing.assert_array_equal(recording.friction, axes[:, 0])
    np.testing.assert_array_equal(recording.speed, axes[:, 1])
    with pytest.raises(RecordingError, match=r"unknown signals \['smell'\]"):
        load_recording(path, fs=FS, unit="g", auxiliary={"smell": "ax"})
    path.write_text("left,right\n1,2\n3,4\n")
    with pytest.raises(RecordingError, match=r"columns are 'left', 'right'.*--column"):
        load_recording(path, fs=FS, unit="g")
    assert load_recording(path, fs=FS, unit="counts", column="right").acceleration.tolist() == [2, 4]


def test_missing_files_and_unknown_formats_are_errors(tmp_path):
    (tmp_path / "r.docx").write_text("hello")
    formats = r"unknown suffix '.docx'. Expected one of .txt, .csv"
    for name, message in (("absent.wav", "cannot be opened"), (".", "is not a file"), ("r.docx", formats)):
        with pytest.raises(RecordingError, match=message):
            load_recording(tmp_path / name, fs=FS, unit="g")


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".parquet", ".csv"])
def test_values_that_are_not_finite_are_refused(tmp_path, axes, write, suffix):
    for bad in (np.nan, np.inf):
        axes[3, 1] = bad
        with pytest.raises(RecordingError, match=r"1 NaN or infinite values|number in every cell"):
            load_recording(write(tmp_path / f"r{suffix}", axes), fs=FS, unit="g")


def test_an_array_with_time_along_the_second_axis_is_turned(tmp_path, axes):
    np.savez(tmp_path / "r.npz", acceleration=axes.T)
    recording = load_recording(tmp_path / "r.npz", fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes)


@pytest.mark.parametrize(("suffix", "most"), [(".wav", 32), (".flac", 24)])
def test_counts_are_the_integer_codes_and_other_units_fractions_of_full_scale(tmp_path, suffix, most):
    for bits in (16, 24, 32)[: most // 8 - 1]:
        codes = np.random.default_rng(0).integers(-(2 ** (bits - 1)), 2 ** (bits - 1), 300)
        path = tmp_path / f"r{suffix}"
        soundfile.write(path, (codes << (32 - bits)).astype(np.int32), 2200, subtype=f"PCM_{bits}")
        np.testing.assert_array_equal(load_recording(path, unit="counts").acceleration, codes)
        fractions = load_recording(path, unit="arbitrary").acceleration
        np.testing.assert_allclose(fractions, codes / 2 ** (bits - 1), rtol=1e-15)


@pytest.mark.parametrize("subtype", ["FLOAT", "DOUBLE"])
def test_floating_point_audio_is_kept_as_stored(tmp_path, subtype):
    samples = np.random.default_rng(0).normal(size=300).astype(np.float32) * 50
    soundfile.write(tmp_path / "r.wav", samples, 2200, subtype=subtype)
    for unit in ("counts", "arbitrary"):
        np.testing.assert_array_equal(load_recording(tmp_path / "r.wav", unit=unit).acceleration, samples)


def test_a_truncated_wav_with_a_complete_header_and_a_text_file_are_errors(tmp_path):
    path = tmp_path / "r.wav"
    soundfile.write(path, NOISE[:1000] / 9, 2200)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordingError, match="contains 2043 of the 2044 bytes"):
        load_recording(path, unit="counts")
    path.write_text("not audio at all")
    with pytest.raises(RecordingError, match="not a readable audio file"):
        load_recording(path, unit="counts")


@pytest.mark.parametrize("limit", [0.5, 1.0, 1.5])
def test_the_clipped_share_counts_runs_at_full_scale(limit):
    smooth = np.convolve(NOISE, np.ones(8) / np.sqrt(8), "same")
    clipped = np.clip(smooth, -limit, limit)
    at_rail = np.abs(smooth) >= limit
    share = clipped_share(clipped)
    assert 0.7 * at_rail.mean() < share <= at_rail.mean()
    flags = (f"clipped: {100 * share:.1f} % of the samples at full scale",)
    assert acceleration_flags(clipped, ("x",), "r") == flags


@pytest.mark.parametrize("signal", [NOISE, np.sin(np.arange(5000) / 50), np.rint(20 * NOISE), np.sign(NOISE)])
def test_a_signal_within_its_range_is_not_flagged_as_clipped(signal):
    assert clipped_share(signal) < 1e-3
    assert clipped_share(np.rint(100 * np.sin(np.arange(50_000) / 2000))) == 0, "quantised, not clipped"


def test_one_clipped_axis_is_enough_for_the_flag_and_a_constant_axis_is_named():
    axes = np.column_stack([NOISE, NOISE, np.clip(np.cumsum(NOISE) % 50, 10, 40)])
    (flag,) = acceleration_flags(axes, ("x", "y", "z"), "r")
    assert flag.startswith("clipped")
    axes = np.column_stack([NOISE, np.full_like(NOISE, 7.0)])
    assert acceleration_flags(axes, ("x", "y"), "r") == ("constant: channel y",)


def test_a_recording_that_does_not_vary_or_is_one_sample_is_refused():
    for axes in (np.full(100, 3.0), np.ones((100, 3))):
        with pytest.raises(RecordingError, match=r"r\.wav: the acceleration is constant"):
            acceleration_flags(axes, ("x",), "r.wav")
    with pytest.raises(RecordingError, match=r"contains 1 sample\. Expected at least 2"):
        acceleration_flags(np.ones(1), ("x",), "r")


def load(path, content, **options):
    """Write a table and return its column a."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    options = {"fs": 1000, "unit": "counts", "column": None if path.suffix == ".txt" else "a"} | options
    return load_recording(path, **options).acceleration.tolist()


def test_one_value_per_line_in_all_notations(tmp_path):
    for content in ("1\n2\n3\n", "1\r\n2\r\n3", "  1.0\n 2e0\n+3.\n\n", "\ufeff1\n2\n3\n"):
        assert load(tmp_path / "r.txt", content) == [1, 2, 3]


def test_a_line_that_is_not_one_number_is_named(tmp_path):
    for content, line in (
        ("1\nabc\n3\n", "line 2 is 'abc'"),
        ("1\n2\n3 4\n", "line 3 is '3 4'"),
        ("1\n2,5\n3\n", "line 2 is '2,5'"),
        ("1\n2\n1_000\n", "line 3 is '1_000'"),
        ("1\n0x10\n", "line 2 is '0x10'"),
    ):
        with pytest.raises(RecordingError, match=f"r.txt: {line}. Expected one number per line"):
            load(tmp_path / "r.txt", content)


def test_text_that_is_not_finite_or_too_short_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"contains 2 NaN or infinite values, the first at \[1\]"):
        load(tmp_path / "r.txt", "1\nnan\ninf\n")
    for content in ("\n\n", "5\n"):
        with pytest.raises(RecordingError, match="at least"):
            load(tmp_path / "r.txt", content)


def test_the_delimiter_option_is_used_and_questioned_if_no_column_matches(tmp_path):
    assert load(tmp_path / "r.csv", "a;b,c\n1;2\n3;4\n", delimiter=";") == [1, 3]
    with pytest.raises(RecordingError, match=r"no column 'a'; the columns are 'a;b'.*is ',' the delimiter"):
        load(tmp_path / "r.csv", "a;b\n1;2\n3;4\n", delimiter=",")
    assert load(tmp_path / "r.csv", "note, a\nfirst,1\nsecond,2\n") == [1, 2], "others may hold text"


def test_a_bad_table_is_refused_with_its_line(tmp_path):
    for content, message in (
        ("a,b\n1,2\nx,4\n", "line 3 is 'x,4', column 'a' is not a number. Expected a number in every cell"),
        ("a,b\n1,2\n,4\n", "line 3 is ',4', column 'a' is not a number.*--drop-incomplete"),
        ("a,b\n1,2\n3\n", "line 3 is '3' with 1 cell, but the other lines have 2.*--drop-incomplete"),
        ("a,a\n1,2\n", "no column 'a'; the columns are 'a#1', 'a#2'"),
        ("a;b\n1.234,5;2\n", "line 2 is '1.234,5;2', column 'a' is not a number"),
        ("\n\n", "no column 'a'; the columns are none"),
        ("b,c\n1,2\n", "no column 'a'"),
        ("a,b\n", "acceleration is empty"),
        ("a,t\n", "acceleration is empty"),
        ("a,b\n1,2\nNA,4\n", "line 3 is 'NA,4'"),
        (b"\xff\xfe\x00", "not a text file.*Expected UTF-8, or UTF-16 with a byte order mark"),
        (b"a,b\n1\0\xff,2\n", "not a text file.*Expected UTF-8"),
    ):
        with pytest.raises(RecordingError, match=f"(?s)r.csv: .*{message}"):
            load(tmp_path / "r.csv", content)


def test_a_parquet_column_of_text_of_lists_or_with_a_gap_is_refused(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    gap = pd.array([1, None, 3], dtype="Int64")
    for column, message in (
        (["1", "2"], "a contains object values. Expected real numbers"),
        ([[1.0], [2.0, 3.0]], "a contains object values. Expected real numbers"),
        (gap, "a has 1 missing values"),
    ):
        pd.DataFrame({"a": column}).to_parquet(tmp_path / "r.parquet")
        with pytest.raises(RecordingError, match=message):
            load_recording(tmp_path / "r.parquet", fs=1000, unit="counts", column="a")


def table(path, columns, header=None, sep=","):
    """Write columns of numbers as text."""
    path.parent.mkdir(exist_ok=True)
    lines = [sep.join(f"{value:.9g}" for value in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([header, *lines] if header else lines))
    return path


TIMES = np.arange(500) / 250.0


def test_the_first_line_of_a_table_without_header_is_a_sample(tmp_path, axes):
    one = table(tmp_path / "one.csv", [axes[:, :1]])
    np.testing.assert_array_equal(load_recording(one, fs=FS, unit="counts").acceleration, axes[:, 0])
    for path, sep in ((tmp_path / "three.csv", ","), (tmp_path / "three.txt", "   ")):
        with pytest.raises(RecordingError, match=r"columns are 'c1', 'c2', 'c3'.*--column c1,c2,c3"):
            load_recording(table(path, [axes], sep=sep), fs=FS, unit="counts")
        for column in (("1", "2", "3"), ("c1", "c2", "c3")):
            recording = load_recording(path, fs=FS, unit="counts", column=column)
            np.testing.assert_array_equal(recording.acceleration, axes)
    with pytest.raises(RecordingError, match=r"no column '4'.*a column number from 1 to 3"):
        load_recording(path, fs=FS, unit="counts", column="4")


@pytest.mark.parametrize(("name", "sep"), [("r.csv", ";"), ("r.txt", ";"), ("r.tsv", "\t")])
def test_the_delimiter_is_detected_and_decimal_commas_are_read(tmp_path, axes, name, sep):
    path = table(tmp_path / name, [TIMES, axes / 100], "t,x,y,z".replace(",", sep), sep)
    assert load_recording(path, unit="counts").flags == ("rate: 250 Hz by the column 't'",)
    path.write_text(path.read_text().replace(".", ","))
    recording = load_recording(path, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes / 100)
    assert (recording.fs, recording.channels) == (250, ("x", "y", "z"))
    assert recording.flags[0] == "decimals: commas are read as decimal points"


def test_numbers_with_decimal_commas_need_the_delimiter_option(tmp_path):
    for name in ("r.csv", "r.txt"):
        with pytest.raises(
            RecordingError, match=r"'c1', 'c2'.*--delimiter ';' if 0,98 is one number; otherwise"
        ):
            load(tmp_path / name, "0,5\n0,25\n", column=None)
        assert load(tmp_path / name, "0,5\n0,25\n", column=None, delimiter=";") == [0.5, 0.25]


def test_columns_of_one_name_are_selected_by_number(tmp_path, axes):
    path = table(tmp_path / "r.csv", [axes], "x,x,z")
    for column in (("1", "2", "3"), ("x#1", "x#2", "z")):
        recording = load_recording(path, fs=FS, unit="counts", column=column)
        np.testing.assert_array_equal(recording.acceleration, axes)


@pytest.mark.parametrize("bracket", ["(m/s^2)", "[m/s2]", "[g]"])
def test_a_unit_in_column_names_is_used_and_must_not_be_contradicted(tmp_path, axes, bracket):
    unit, other = ("g", "mg") if "g" in bracket else ("m/s^2", "g")
    path = table(tmp_path / "oak" / "r.csv", [axes], ",".join(f"acc_{axis} {bracket}" for axis in "xyz"))
    recording = load_recording(path, fs=FS)
    recording_with_unit = load_recording(path, fs=FS, unit=unit)
    np.testing.assert_array_equal(recording.acceleration, recording_with_unit.acceleration)
    assert recording.flags[0] == f"unit {unit}, from the column names"
    assert f"unit {unit}, from the column names" not in recording_with_unit.flags
    with pytest.raises(RecordingError, match=rf"its unit is '{re.escape(unit)}', but '{other}' was given"):
        load_recording(path, fs=FS, unit=other)
    dataset = open_dataset(tmp_path, fs=FS)
    np.testing.assert_array_equal(dataset[0].acceleration, recording_with_unit.acceleration)
    assert any(
        note.startswith(f"unit {unit}, from the messages or column names of ") for note in dataset.notes
    )
    table(path, [axes], "acc_x [mg],acc_y [g],acc_z [g]")
    with pytest.raises(RecordingError, match=r"its columns have the units g and mg. Expected the same unit"):
        load_recording(path, fs=FS)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize(("between", "zone"), [("T", ""), (" ", ""), ("T", "Z"), (" ", "+02:00")])
@pytest.mark.parametrize("name", ["timestamp", "datetime", "time_ms"])
def test_dates_in_a_time_column_give_the_rate(tmp_path, axes, name, between, zone, suffix):
    stamps = np.datetime64("2024-01-01T23:59:59") + (1e6 * TIMES).astype("m8[us]")
    dates = [f"{str(stamp).replace('T', between)}{zone}" for stamp in stamps]
    lines = [f"{date},{x:g},{y:g},{z:g}" for date, (x, y, z) in zip(dates, axes, strict=True)]
    if suffix == "csv":
        (tmp_path / "r.csv").write_text("\n".join([f"{name},x,y,z", *lines]))
    else:
        pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
        frame = pd.DataFrame({name: stamps, **dict(zip("xyz", axes.T, strict=True))})
        frame.to_parquet(tmp_path / "r.parquet")
    recording = load_recording(tmp_path / f"r.{suffix}", unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes)
    assert recording.fs == 250
    with pytest.raises(
        RecordingError, match=r"fs is 250 Hz according to its column.*, but 250000 Hz was given"
    ):
        load_recording(tmp_path / f"r.{suffix}", unit="counts", fs=250_000)
    with pytest.raises(RecordingError, match=f"{name} contains datetime64.*Expected real numbers"):
        load_recording(tmp_path / f"r.{suffix}", fs=250, unit="counts", column=name)


@pytest.mark.parametrize(
    ("name", "unit_s"),
    [("time", 1.0), ("Time (sec)", 1.0), ("t (ms)", 1e-3), ("timestamp_us", 1e-6), ("epoch_ns", 1e-9)],
)
def test_a_time_column_gives_the_rate_or_contradicts_the_option(tmp_path, axes, name, unit_s):
    times = TIMES / unit_s
    path = table(tmp_path / "r.csv", [times, axes], f"{name},x,y,z")
    for options in ({}, {"fs": 250}, {"time_column": "1"}, {"fs": 250, "time_column": name}):
        recording = load_recording(path, unit="counts", **options)
        assert recording.fs == 250
        np.testing.assert_allclose(recording.acceleration, axes, atol=1e-6)
    with pytest.raises(
        RecordingError,
        match=rf"fs is 250 Hz according to its column '{re.escape(name)}'.*but 1000 Hz was given",
    ):
        load_recording(path, unit="counts", fs=1000)


def test_samples_are_interpolated_by_a_selected_time_column_and_losses_are_flagged(tmp_path):
    indices = np.delete(np.arange(500), [100, 101, 300])
    path = table(tmp_path / "r.csv", [TIMES[indices], np.sin(6 * TIMES[indices])], "time,a")
    recording = load_recording(path, unit="counts", time_column="time")
    np.testing.assert_allclose(recording.acceleration, np.sin(6 * TIMES), atol=1e-3)
    assert recording.flags[0] == "gaps: 3 messages missing in 2 gaps, interpolated"


def test_column_names_with_units_are_conventional_and_channels_have_no_units(tmp_path, axes):
    header = ",".join(f"ACCELEROMETER {axis} (m/s^2)" for axis in "XYZ")
    recording = load_recording(table(tmp_path / "r.csv", [axes], header), fs=FS, unit="m/s^2")
    np.testing.assert_array_equal(recording.acceleration, axes)
    assert recording.channels == ("ACCELEROMETER X", "ACCELEROMETER Y", "ACCELEROMETER Z")
    with pytest.raises(RecordingError, match="cannot identify the acceleration"):
        load_recording(table(tmp_path / "r.csv", [axes], "x (mm),y (mm),z (mm)"), fs=FS, unit="m/s^2")


def test_resampling_keeps_the_band_common_to_both_rates(tmp_path):
    t = np.arange(4000) / 4000
    low, high = np.sin(2 * np.pi * 50 * t), np.sin(2 * np.pi * 1800 * t)
    path = table(tmp_path / "r.csv", [low + high], "a")
    recording = load_recording(path, fs=4000, unit="counts", resample=1000)
    assert (recording.fs, recording.n_samples) == (1000, 1000)
    np.testing.assert_allclose(recording.acceleration[50:-50], low[::4][50:-50], atol=0.01)


@pytest.mark.parametrize(("resample", "native"), [(1000, 1000), (4000, 4000), (16_000, 4000)])
def test_a_resampled_recording_states_its_native_rate_and_missing_band(tmp_path, resample, native):
    path = table(tmp_path / "r.csv", [NOISE[:4000]], "a")
    recording = load_recording(path, fs=4000, unit="counts", resample=resample)
    assert (recording.fs, recording.native_fs) == (resample, native)
    flag = "narrow band: sampled at 4000 Hz, so no content above 2000 Hz"
    assert (flag in recording.flags) == (resample > native)


@pytest.mark.parametrize("fs", [1e-300, 9e-4, 1e12])
def test_a_rate_out_of_range_is_an_error_whether_from_file_or_option(tmp_path, fs):
    np.savez(tmp_path / "r.npz", acceleration=NOISE, fs=fs)
    for options in ({}, {"fs": fs}):
        with pytest.raises(RecordingError, match=r"Expected a rate from 0\.001 to 1e\+08 Hz"):
            load_recording(tmp_path / "r.npz", unit="counts", **options)


@pytest.mark.parametrize(
    ("text", "message"), [("1" * (1 << 21), "a line is too long"), ("a," * 20_000, "20001 columns")]
)
def test_texts_without_lines_or_with_too_many_columns_are_refused_at_once(tmp_path, text, message):
    for suffix in (".csv", ".txt"):
        (tmp_path / f"r{suffix}").write_text(text)
        with pytest.raises(RecordingError, match=message):
            load_recording(tmp_path / f"r{suffix}", fs=1000, unit="counts")
