import io
import time

import numpy as np
import pytest

from texclass.recognition import open_source
from texclass.recording import Recording, RecordingError

FS = 1000.0
SIGNAL = np.random.default_rng(0).normal(size=(330, 3))


def _signal(source):
    return np.concatenate([block.samples for block in source])


def _text(signal, comma=","):
    return io.BytesIO(
        "\n".join(comma.join(f"{value!r}" for value in row.tolist()) for row in signal).encode()
    )


@pytest.mark.parametrize("comma", [",", " ", ", ", "\t"])
def test_lines_of_numbers_are_samples(comma):
    source = open_source("-", fs=FS, unit="g", file=_text(SIGNAL, comma))
    blocks = list(source)
    np.testing.assert_array_equal(np.concatenate([block.samples for block in blocks]), SIGNAL)
    assert [len(block.samples) for block in blocks] == [25] * 13 + [5]
    np.testing.assert_allclose([block.t_s for block in blocks], np.arange(14) * 0.025)
    assert {(block.fs, block.unit, block.n_lost) for block in blocks} == {(FS, "g", 0)}


@pytest.mark.parametrize("mark", [None, ";"])
def test_between_semicolons_a_comma_is_a_decimal_point(mark):
    text = _text(SIGNAL, ";").getvalue().replace(b".", b",")
    source = open_source("-", fs=FS, unit="g", delimiter=mark, file=io.BytesIO(text))
    np.testing.assert_array_equal(_signal(source), SIGNAL)


@pytest.mark.parametrize("raw", [False, True])
def test_columns_of_standard_input_are_chosen_by_number(raw):
    def open_columns(*columns):
        file = io.BytesIO(SIGNAL.astype("<f4").tobytes()) if raw else _text(SIGNAL)
        return open_source("-", fs=FS, unit="g", column=columns, raw_channels=3 if raw else None, file=file)

    np.testing.assert_allclose(_signal(open_columns("3", "1")), SIGNAL[:, [2, 0]], rtol=1e-6)
    for name in ("4", "ax"):
        message = f"column '{name}' does not exist. Expected a number from 1 to 3"
        with pytest.raises(RecordingError, match=message):
            list(open_columns("1", name))


@pytest.mark.parametrize(
    "options", [{"time_column": "1"}, {"delimiter": ";", "raw_channels": 3}, {"delimiter": ""}]
)
def test_options_of_files_raise_an_error_for_standard_input(options):
    with pytest.raises(ValueError, match=r"standard input.*(Use --fs instead|Expected one character)"):
        open_source("-", fs=FS, unit="g", file=_text(SIGNAL), **options)


@pytest.mark.parametrize("size", [1, 7, 4096])
def test_float32_does_not_depend_on_the_size_of_its_reads(size):
    class Pipe(io.BytesIO):
        def read1(self, n=-1):
            return self.read(min(n, size))

    data = SIGNAL.astype("<f4").tobytes()
    source = open_source("-", fs=FS, unit="g", raw_channels=3, file=Pipe(data))
    np.testing.assert_array_equal(_signal(source), SIGNAL.astype("<f4"))
    (last,) = [b for b in open_source("-", fs=FS, unit="g", raw_channels=3, file=Pipe(data[:-5])) if b.flags]
    assert last.flags == ("standard input: ends within a sample, 7 bytes left out",)


@pytest.mark.parametrize(
    ("text", "expected", "message"),
    [
        (
            "1,2,3\n1,2\n4,5,6\n7,8,9\n",
            [[1, 2, 3], None, [4, 5, 6], [7, 8, 9]],
            "line 2 is '1,2'. Expected 3",
        ),
        ("x,y\n1,2\n3,4\n", [[1, 2], [3, 4]], "line 1 is 'x,y'. Expected 2 numbers"),
        ("5\n1,2\n3,4\n", [[1, 2], [3, 4]], "line 1 is '5'"),
        ("1\n2\nsensor error\n3\n", [[1], [2], None, [3]], "line 3 is 'sensor error'"),
        ("1\nnan\n2\ninf\n", [[1], [np.nan], [2], [np.inf]], None),
        ("1 2\n3 4\n5 6\n\xff\n", [[1, 2], [3, 4], [5, 6], None], "line 4 is"),
    ],
)
def test_a_garbled_line_is_a_lost_sample_with_a_flag(text, expected, message):
    blocks = list(open_source("-", fs=FS, unit="g", file=io.BytesIO(text.encode("latin-1"))))
    width = len(expected[0])
    rows = [[np.nan] * width if row is None else row for row in expected]
    np.testing.assert_array_equal(_signal(blocks), rows)
    flags = [flag for block in blocks for flag in block.flags]
    assert len(flags) == (message is not None)
    assert all(message in flag for flag in flags)


@pytest.mark.parametrize("text", [b"x,y,z\n", b"\xff\xfe\n" * 200, b"1 " * 40_000])
def test_text_without_samples_raises_an_error_with_its_first_line(text):
    with pytest.raises(RecordingError, match=r"standard input: line 1, .* 1 to 1024 numbers"):
        list(open_source("-", fs=FS, unit="g", file=io.BytesIO(text)))


def test_float32_values_that_are_not_finite_cause_no_warning():
    data = np.array([1, np.inf, 2], "<f4").tobytes() + bytes.fromhex("0000817f")
    np.testing.assert_array_equal(
        _signal(open_source("-", fs=FS, unit="g", raw_channels=1, file=io.BytesIO(data)))[:, 0],
        [1, np.inf, 2, np.nan],
    )


def test_a_recording_is_played_in_blocks_with_its_flags_first():
    recording = Recording(SIGNAL, FS, "m/s^2", "r", flags=("clipped: 1 %",))
    blocks = list(open_source(recording, block_s=0.1))
    np.testing.assert_array_equal(np.concatenate([block.samples for block in blocks]), SIGNAL)
    assert [block.flags for block in blocks] == [("clipped: 1 %",), (), (), ()]


def test_a_paced_recording_is_played_in_real_time():
    start = time.monotonic()
    list(open_source(Recording(SIGNAL[:, 0], FS, "g", "r"), paced=True))
    assert 0.32 < time.monotonic() - start < 3


def test_files_bags_and_rates_are_opened_by_name(tmp_path):
    pytest.importorskip("rosbags", reason="the extra `robot` is not installed")
    from bag_writer import IMU, Topic, regular, write_bag

    np.savetxt(tmp_path / "r.txt", SIGNAL[:, 0])
    np.testing.assert_allclose(
        _signal(open_source(str(tmp_path / "r.txt"), fs=FS, unit="counts"))[:, 0], SIGNAL[:, 0]
    )
    values = np.tile(SIGNAL, 2)
    bag = write_bag(tmp_path, "mcap", {"/imu": Topic(IMU, values, regular(len(values), FS))})
    np.testing.assert_array_equal(_signal(open_source(f"bag:{bag}?topic=/imu")), SIGNAL)
    blocks = list(open_source(f"bag:{bag}", rate=500.0))
    assert {block.fs for block in blocks} == {500.0}
    assert blocks[0].flags[-1] == "resampled (band-limited) from 1000 Hz to 500 Hz"


def test_missing_and_invalid_options_raise_an_error():
    with pytest.raises(RecordingError, match="standard input: the sampling rate is missing"):
        open_source("-", unit="g")
    with pytest.raises(RecordingError, match="standard input: unit is missing"):
        open_source("-", fs=FS)
    with pytest.raises(ValueError, match=r"only be used with standard input \(-\), got 3 for r\.wav"):
        open_source("r.wav", raw_channels=3)
    with pytest.raises(ValueError, match=r"block_s must be positive, got 0 s"):
        open_source("-", fs=FS, unit="g", block_s=0)
