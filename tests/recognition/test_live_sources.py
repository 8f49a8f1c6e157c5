import io
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
    assert {(block.fs, block.unit, block.lost) for block in blocks} == {(FS, "g", 0)}


@pytest.mark.parametrize("size", [1, 7, 4096])
def test_float32_is_passed_on_however_it_arrives(size):
    class Pipe(io.BytesIO):
        def read1(self, n=-1):
            return self.read(min(n, size))

    data = SIGNAL.astype("<f4").tobytes()
    source = open_source("-", fs=FS, unit="g", raw_channels=3, file=Pipe(data))
    np.testing.assert_array_equal(_signal(source), SIGNAL.astype("<f4"))
    (last,) = [b for b in open_source("-", fs=FS, unit="g", raw_channels=3, file=Pipe(data[:-5])) if b.flags]
    assert last.flags == ("standard input: ends within a sample, 7 bytes left out",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"1,2,3\n1,2\n", "line 2 holds 2 numbers; the rule is 3"),
        (b"x,y,z\n", "line 1 is 'x,y,z'; the rule is finite numbers"),
        (b"1\nnan\n", "line 2 is 'nan'"),
        (b"\xff\xfe\n", "line 1 is"),
        (b"1 " * 40_000, "holds 32768 numbers; the rule is 1024"),
    ],
)
def test_a_bad_line_is_named(text, said):
    with pytest.raises(RecordingError, match=said):
        list(open_source("-", fs=FS, unit="g", file=io.BytesIO(text)))


def test_float32_that_is_not_finite_is_named():
    signalling = bytes.fromhex("0000817f")
    for last in (np.float32(np.inf).tobytes(), np.float32(np.nan).tobytes(), signalling):
        data = np.array([1, 2], "<f4").tobytes() + last
        with pytest.raises(RecordingError, match="sample 2 is"):
            list(open_source("-", fs=FS, unit="g", raw_channels=1, file=io.BytesIO(data)))


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300), st.booleans())
def test_any_input_is_samples_or_one_error(data, raw):
    try:
        signal = [
            b.samples
            for b in open_source("-", fs=FS, unit="g", raw_channels=2 if raw else None, file=io.BytesIO(data))
        ]
    except RecordingError as error:
        said = str(error)
    else:
        said = "standard input"
        assert all(np.isfinite(samples).all() for samples in signal)
    assert said.startswith("standard input")


def test_a_recording_is_played_in_blocks_with_its_flags_first():
    recording = Recording(SIGNAL, FS, "m/s^2", "r", flags=("clipped: 1 %",))
    blocks = list(open_source(recording, block_s=0.1))
    np.testing.assert_array_equal(np.concatenate([block.samples for block in blocks]), SIGNAL)
    assert [block.flags for block in blocks] == [("clipped: 1 %",), (), (), ()]


def test_a_paced_recording_takes_as_long_as_it_lasts():
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
    slower = list(open_source(f"bag:{bag}", rate=500.0))
    assert {block.fs for block in slower} == {500.0}
    assert slower[0].flags[-1] == "resampled (band-limited) from 1000 Hz to 500 Hz"


def test_what_is_missing_is_asked_for():
    with pytest.raises(RecordingError, match="standard input: fs is missing"):
        open_source("-", unit="g")
    with pytest.raises(RecordingError, match="standard input: unit is missing"):
        open_source("-", fs=FS)
    with pytest.raises(ValueError, match="block_s is 0; the rule is above 0"):
        open_source("-", fs=FS, unit="g", block_s=0)
