"""Datasets from folders of HaTT models: seeded random recordings within the range of the models."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from test_hatt_xml import document

from texclass.evaluation import run_benchmark
from texclass.haptics.exchange import write_hatt
from texclass.haptics.exchange.hatt_recordings import RANGE_FRACTIONS, random_walk
from texclass.haptics.textures.hatt import HattTexture
from texclass.loaders import CardError, open_dataset
from texclass.recording import RecordingError

CARD = """title = "mine"
format = "hatt-models"
folder = "models"
phases = "movement"
n_recordings = 3
duration_s = 2.0
"""


def texture(tone, name, fs=1000.0, variance=1.0):
    """Return a texture with a resonance at `tone` (rad per sample), ten times as loud at 200 mm/s."""
    speed, force = [20.0, 200.0], [1.0, 3.0]
    lsf = [[tone - 0.05, tone + 0.05]] * 2
    return HattTexture.from_models(speed, force, lsf, [0.01 * variance, variance], fs, name=name)


def card(tmp_path, text="", **textures):
    (tmp_path / "models").mkdir(exist_ok=True)
    for name, model in textures.items():
        write_hatt(model, tmp_path / "models" / f"Models_{name}.xml")
    path = tmp_path / "mine.toml"
    path.write_text(CARD + text)
    return path


@pytest.fixture
def two(tmp_path):
    return card(tmp_path, oak=texture(0.5, "oak"), slate=texture(1.5, "slate"))


def test_each_file_is_a_surface_with_the_number_of_recordings_of_the_card(two):
    dataset = open_dataset(two)
    assert [entry.recording_id for entry in dataset.entries] == [
        f"{m}_0{k}" for m in ("oak", "slate") for k in (1, 2, 3)
    ]
    recording = dataset[0]
    assert (recording.surface, recording.repetition, recording.fs, recording.unit) == (
        "oak",
        1,
        1000.0,
        "m/s^2",
    )
    assert recording.phases.movement == (0, 2000)
    assert recording.operator is recording.session is None


def test_recordings_are_reproducible_and_differ_from_each_other(two, tmp_path):
    first, second = open_dataset(two), open_dataset(two)
    assert_array_equal(first[4].acceleration, second[4].acceleration)
    assert first.input_hash == second.input_hash
    assert np.abs(np.corrcoef(first[0].speed, first[1].speed)[0, 1]) < 0.9
    card(tmp_path, ash=texture(1.0, "ash"))
    more = open_dataset(two)
    assert_array_equal(more[3].acceleration, first[0].acceleration)
    assert more.input_hash != first.input_hash
    other = open_dataset(card(tmp_path, "seed = 1\n"))
    assert other.input_hash != more.input_hash
    assert np.abs(other[3].acceleration - more[3].acceleration).max() > 0


def test_speed_and_force_cover_the_range_of_the_models(two):
    fractions = np.concatenate([[r.speed / 200, r.normal_force / 3] for r in open_dataset(two)], axis=1)
    assert RANGE_FRACTIONS[0] <= fractions.min() < 0.25
    assert 0.75 < fractions.max() <= RANGE_FRACTIONS[1]
    walks = [random_walk(20_000, 1000.0, np.random.default_rng(i)) for i in range(40)]
    assert np.mean(walks) == pytest.approx(0.5, abs=0.04)
    assert np.abs(np.diff(walks)).max() < 0.02  # smooth like the motion of a hand


def test_a_recording_has_the_resonance_of_its_model_and_is_louder_where_it_is_faster(two):
    recording = open_dataset(two)[3]
    spectrum = np.abs(np.fft.rfft(recording.acceleration))
    assert np.pi * np.argmax(spectrum) / (len(spectrum) - 1) == pytest.approx(1.5, abs=0.1)
    is_fast = recording.speed > np.median(recording.speed)
    rms = [np.sqrt(np.mean(recording.acceleration[mask] ** 2)) for mask in (is_fast, ~is_fast)]
    assert rms[0] > rms[1]


def test_the_benchmark_of_the_paper_runs_on_a_folder_of_models(two):
    result = run_benchmark(open_dataset(two), "strese2015", n_folds=3)
    accuracies = {row["name"]: row["accuracy"] for row in result.data["rows"]}
    assert accuracies["Modified MFCC, Constant Mel Filter Bank"]["lda"]["mean"] == 1.0
    assert "lda" not in accuracies["Hardness"]  # there are no taps
    assert result.data["rank_agreement"]["lda"] is not None


def test_the_published_layout_is_read(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "Slate.xml").write_text(document())
    recording = open_dataset(card(tmp_path))[0]
    assert recording.surface == "Slate"
    assert recording.acceleration.std() > 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fs_hz = 2000\n", r"Models_oak\.xml: SampleRate is 1000 Hz, but the card has fs_hz = 2000"),
        ("files = '(?P<surface>z.*)'\n", "models contains no models. Expected file names like"),
        ("files = '(?P<surface>Models)_.*'\n", "both define surface 'Models'. Expected one file per surface"),
    ],
)
def test_files_that_do_not_fit_the_card_are_named(two, tmp_path, text, message):
    with pytest.raises(RecordingError, match=message):
        open_dataset(card(tmp_path, text))[0]


def test_damaged_files_and_invalid_options_are_named(two, tmp_path):
    (tmp_path / "models" / "Models_oak.xml").write_text("<modelSet>")
    with pytest.raises(RecordingError, match=r"Models_oak\.xml is not well formed"):
        open_dataset(two)[0]
    with pytest.raises(RecordingError, match="cannot be resampled to 500 Hz"):
        open_dataset(two, resample=500)
    with pytest.raises(CardError, match=r"must define the group \(\?P<surface>\.\.\.\) and no other"):
        open_dataset(card(tmp_path, r"files = '(?P<surface>.)(?P<operator>.*)'"))
