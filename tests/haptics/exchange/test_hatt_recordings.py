"""A folder of HaTT models is a dataset: as random as its seed, within what the models know, and no more."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from test_hatt_xml import document

from texclass.evaluation import run_benchmark
from texclass.haptics.exchange import write_hatt
from texclass.haptics.exchange.hatt_recordings import SHARES, felt_share
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
    """Return a texture that hums at `tone` (rad per sample), ten times as loud at its fastest model."""
    speed, force = [20.0, 200.0], [1.0, 3.0]
    lsf = [[tone - 0.05, tone + 0.05]] * 2
    return HattTexture.from_models(speed, force, lsf, [0.01 * variance, variance], fs, name=name)


def card(tmp_path, text="", **textures):
    (tmp_path / "models").mkdir(exist_ok=True)
    for name, made in textures.items():
        write_hatt(made, tmp_path / "models" / f"Models_{name}.xml")
    path = tmp_path / "mine.toml"
    path.write_text(CARD + text)
    return path


@pytest.fixture
def two(tmp_path):
    return card(tmp_path, oak=texture(0.5, "oak"), slate=texture(1.5, "slate"))


def test_each_file_is_a_surface_of_so_many_recordings(two):
    dataset = open_dataset(two)
    assert [entry.recording_id for entry in dataset.entries] == [
        f"{m}_0{k}" for m in ("oak", "slate") for k in (1, 2, 3)
    ]
    made = dataset[0]
    assert (made.surface, made.repetition, made.fs, made.unit) == ("oak", 1, 1000.0, "m/s^2")
    assert made.phases.movement == (0, 2000)
    assert made.operator is made.session is None


def test_recordings_are_the_same_again_and_new_each(two, tmp_path):
    first, again = open_dataset(two), open_dataset(two)
    assert_array_equal(first[4].acceleration, again[4].acceleration)
    assert first.input_hash == again.input_hash
    assert np.abs(np.corrcoef(first[0].speed, first[1].speed)[0, 1]) < 0.9
    card(tmp_path, ash=texture(1.0, "ash"))
    more = open_dataset(two)
    assert_array_equal(more[3].acceleration, first[0].acceleration)
    assert more.input_hash != first.input_hash
    other = open_dataset(card(tmp_path, "seed = 1\n"))
    assert other.input_hash != more.input_hash
    assert np.abs(other[3].acceleration - more[3].acceleration).max() > 0


def test_speed_and_force_walk_all_over_what_the_models_know(two):
    found = np.concatenate([[r.speed / 200, r.normal_force / 3] for r in open_dataset(two)], axis=1)
    assert SHARES[0] <= found.min() < 0.25
    assert 0.75 < found.max() <= SHARES[1]
    walks = [felt_share(20_000, 1000.0, np.random.default_rng(i)) for i in range(40)]
    assert np.mean(walks) == pytest.approx(0.5, abs=0.04)
    assert np.abs(np.diff(walks)).max() < 0.02  # a hand, not a leap


def test_a_recording_hums_as_its_model_and_louder_where_it_is_faster(two):
    made = open_dataset(two)[3]
    spectrum = np.abs(np.fft.rfft(made.acceleration))
    assert np.pi * np.argmax(spectrum) / (len(spectrum) - 1) == pytest.approx(1.5, abs=0.1)
    fast = made.speed > np.median(made.speed)
    rms = [np.sqrt(np.mean(made.acceleration[part] ** 2)) for part in (fast, ~fast)]
    assert rms[0] > rms[1]


def test_the_table_of_the_paper_runs_on_it(two):
    result = run_benchmark(open_dataset(two), "strese2015", n_folds=3)
    found = {row["name"]: row["accuracy"] for row in result.data["rows"]}
    assert found["Modified MFCC, Constant Mel Filter Bank"]["lda"]["mean"] == 1.0
    assert "lda" not in found["Hardness"]  # nobody taps
    assert result.data["rank_agreement"]["lda"] is not None


def test_the_published_layout_is_read(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "Slate.xml").write_text(document())
    made = open_dataset(card(tmp_path))[0]
    assert made.surface == "Slate"
    assert made.acceleration.std() > 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fs_hz = 2000\n", r"Models_oak\.xml: SampleRate is 1000 Hz, the card says 2000. Expected one"),
        ("files = '(?P<surface>z.*)'\n", "models: holds no model. Expected files named as"),
        ("files = '(?P<surface>Models)_.*'\n", "are both of 'Models'. Expected one file each"),
    ],
)
def test_what_does_not_fit_the_card_is_named(two, tmp_path, text, message):
    with pytest.raises(RecordingError, match=message):
        open_dataset(card(tmp_path, text))[0]


def test_rubbish_is_named(two, tmp_path):
    (tmp_path / "models" / "Models_oak.xml").write_text("<modelSet>")
    with pytest.raises(RecordingError, match=r"Models_oak\.xml: is not well formed"):
        open_dataset(two)[0]
    with pytest.raises(RecordingError, match="resampling to 500 Hz was asked for"):
        open_dataset(two, resample=500)
    with pytest.raises(CardError, match=r"must define the group \(\?P<surface>\.\.\.\) and no other"):
        open_dataset(card(tmp_path, r"files = '(?P<surface>.)(?P<operator>.*)'"))
