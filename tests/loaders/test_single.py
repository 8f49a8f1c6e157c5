import numpy as np
import pytest

from texclass.loaders import load_recording
from texclass.loaders.files import READERS
from texclass.recording import RecordingError

FS = 10_000.0
SUFFIXES = [suffix for suffix, reader in READERS.items() if reader != "bags"]
STATES_FS = (".wav", ".flac", ".mat", ".npz", ".h5", ".hdf5")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_gives_back_what_was_written(tmp_path, axes, write, suffix):
    path = write(tmp_path / f"r{suffix}", axes)
    recording = load_recording(path, fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes[:, 0] if suffix == ".txt" else axes)
    assert recording.fs == FS
    assert recording.recording_id == "r"
    assert recording.flags == ()


@pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s not in STATES_FS])
def test_a_missing_sampling_rate_is_asked_for(tmp_path, axes, write, suffix):
    with pytest.raises(RecordingError, match=f"r{suffix}: fs is missing.*give --fs"):
        load_recording(write(tmp_path / f"r{suffix}", axes), unit="counts")


@pytest.mark.parametrize("suffix", STATES_FS)
def test_a_stated_sampling_rate_is_used_and_may_not_be_contradicted(tmp_path, axes, write, suffix):
    path = write(tmp_path / f"r{suffix}", axes)
    assert load_recording(path, unit="counts").fs == FS
    with pytest.raises(RecordingError, match="fs is 10000 Hz there, 8000 Hz was given"):
        load_recording(path, fs=8000, unit="counts")


def test_a_missing_unit_is_asked_for(tmp_path, axes, write):
    with pytest.raises(RecordingError, match=r"unit is missing.*give --unit"):
        load_recording(write(tmp_path / "r.wav", axes))


@pytest.mark.parametrize("fs", [0, -5, float("nan")])
def test_an_impossible_sampling_rate_is_refused(tmp_path, axes, write, fs):
    with pytest.raises(RecordingError, match="sampling rate in Hz above 0"):
        load_recording(write(tmp_path / "r.csv", axes), fs=fs, unit="g")


@pytest.mark.parametrize(
    "template", ["wood_{}.txt", "wood_{}_train1.txt", "G1_X_wood_{}_test.txt", "wood_{}.wav"]
)
def test_one_file_per_axis_joins_into_one_recording(tmp_path, axes, write, template):
    for axis, column in zip("XYZ", axes.T, strict=True):
        if template.endswith(".wav"):
            write(tmp_path / template.format(axis), column[:, None])
        else:
            np.savetxt(tmp_path / template.format(axis), column)
    recording = load_recording(tmp_path / template.format("Y"), fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes)
    assert recording.channels == ("x", "y", "z")
    assert recording.recording_id == template.replace("_{}", "").rpartition(".")[0]


def test_a_single_axis_keeps_its_name(tmp_path, axes, write):
    recording = load_recording(write(tmp_path / "wood_Z.txt", axes), fs=FS, unit="g")
    assert recording.channels == ("z",)
    assert recording.recording_id == "wood_Z"


def test_axes_of_different_length_are_refused(tmp_path, axes):
    np.savetxt(tmp_path / "r_X.txt", axes[:, 0])
    np.savetxt(tmp_path / "r_Y.txt", axes[:-1, 0])
    with pytest.raises(RecordingError, match="'x': 500, 'y': 499"):
        load_recording(tmp_path / "r_X.txt", fs=FS, unit="g")


def test_axes_of_different_rate_are_refused(tmp_path, axes):
    for axis, fs in (("X", 1000), ("Y", 2000)):
        np.savez(tmp_path / f"r_{axis}.npz", acceleration=axes[:, 0], fs=fs)
    with pytest.raises(RecordingError, match=r"rates \[1000.0, 2000.0\]"):
        load_recording(tmp_path / "r_X.npz", unit="g")


def test_columns_are_chosen_by_name_and_auxiliary_signals_too(tmp_path, axes, write):
    path = write(tmp_path / "r.csv", axes)
    recording = load_recording(
        path, fs=FS, unit="g", column="az", auxiliary={"friction": "ax", "speed": "ay"}
    )
    np.testing.assert_allclose(recording.acceleration, axes[:, 2] * 9.80665)
    np.testing.assert_array_equal(recording.friction, axes[:, 0])
    np.testing.assert_array_equal(recording.speed, axes[:, 1])


def test_an_unknown_signal_is_refused(tmp_path, axes, write):
    with pytest.raises(RecordingError, match=r"\['smell'\] are unknown"):
        load_recording(write(tmp_path / "r.csv", axes), fs=FS, unit="g", auxiliary={"smell": "ax"})


def test_columns_without_a_conventional_name_are_asked_for(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("left,right\n1,2\n3,4\n")
    with pytest.raises(RecordingError, match=r"columns are 'left', 'right'.*--column"):
        load_recording(path, fs=FS, unit="g")
    assert load_recording(path, fs=FS, unit="counts", column="right").acceleration.tolist() == [2, 4]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_empty_file_is_refused(tmp_path, suffix):
    path = tmp_path / f"r{suffix}"
    path.touch()
    with pytest.raises(RecordingError, match=r"is empty \(0 bytes\)"):
        load_recording(path, fs=FS, unit="g")


@pytest.mark.parametrize("name", ["absent.wav", "."])
def test_a_path_that_is_no_file_is_refused(tmp_path, name):
    with pytest.raises(RecordingError, match=r"cannot be opened|is not a file"):
        load_recording(tmp_path / name, fs=FS, unit="g")


def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path):
    (tmp_path / "r.docx").write_text("hello")
    with pytest.raises(RecordingError, match=r"suffix is '.docx'; the rule is one of .txt, .csv"):
        load_recording(tmp_path / "r.docx", fs=FS, unit="g")


@pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s not in (".txt", ".csv", ".tsv")])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_a_truncated_binary_file_is_refused(tmp_path, axes, write, suffix, share):
    path = write(tmp_path / f"r{suffix}", axes)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordingError, match=f"r{suffix}"):
        load_recording(path, unit="counts", fs=FS)


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".parquet", ".wav", ".flac", ".mat", ".npz"])
def test_rubbish_is_a_recording_or_a_recording_error_never_anything_else(tmp_path, axes, write, suffix):
    original = write(tmp_path / f"r{suffix}", axes).read_bytes()
    rng = np.random.default_rng(1)
    path = tmp_path / f"rubbish{suffix}"
    for _ in range(60):
        damaged = bytearray(original)
        for place in rng.integers(0, min(len(damaged), 400), 4):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            assert load_recording(path, unit="counts", fs=FS).n_samples >= 2
        except RecordingError as error:
            assert f"rubbish{suffix}" in str(error)  # noqa: PT017


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".parquet", ".csv"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(tmp_path, axes, write, suffix, bad):
    axes[3, 1] = bad
    with pytest.raises(RecordingError, match=r"1 values|number in every cell|lacks 1 values"):
        load_recording(write(tmp_path / f"r{suffix}", axes), fs=FS, unit="g")


def test_an_array_with_time_along_the_second_axis_is_turned(tmp_path, axes):
    np.savez(tmp_path / "r.npz", acceleration=axes.T)
    recording = load_recording(tmp_path / "r.npz", fs=FS, unit="counts")
    np.testing.assert_array_equal(recording.acceleration, axes)
