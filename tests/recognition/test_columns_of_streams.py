"""A model that was trained on more than accelerations hears the rest on a stream, or says what is missing."""

import io

import numpy as np
import pytest
from toy_surfaces import pipeline
from turning_surfaces import FS, N, terrains, values

from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.loaders.dataset import Dataset
from texclass.recognition import Session, is_live, open_source, train
from texclass.recognition.live.online_recogniser import Stretches
from texclass.recording import RecordingError


@pytest.mark.parametrize("n_columns", [3, 5, 7])
def test_text_of_other_columns_is_refused_by_name(turning, n_columns):
    text = io.BytesIO("\n".join([" ".join(["1"] * n_columns)] * 50).encode())
    session = Session(turning)
    with pytest.raises(ValueError, match=f"has {n_columns} columns. Expected 6, ax, ay, az, turn_x, turn_y"):
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=turning)))
    with pytest.raises(ValueError, match=f"has {n_columns} columns. Expected 6"):
        open_source("-", fs=FS, unit="m/s^2", file=io.BytesIO(b""), raw_channels=n_columns, model=turning)


# Friction: a last column.


def rubbed():
    """Return the terrains with a friction that alone tells them apart; they do not turn."""
    level = {"gravel": 0.2, "grass": 1.0, "sand": 3.0}
    turning = terrains()

    def load(entry):
        whole = turning.load(entry)
        noise = np.random.default_rng(entry.repetition).standard_normal(N)
        return whole.with_(turn_rate=None, friction=level[entry.surface] * (1 + 0.05 * noise))

    return Dataset("rubbed", turning.entries, load, "rubbed")


@pytest.fixture(scope="module")
def rubbing_model():
    friction = load_feature_set("texclass").restricted_to(["friction", "prediction_gain"])
    rows = (RowDefinition(name="Friction", features=("friction", "prediction_gain")),)
    return train(
        rubbed(), pipeline(features=friction, rows=rows), row="Friction", classifier="lda", false_alarms=0.2
    )


def test_friction_is_the_last_column_of_a_stream(rubbing_model):
    model = rubbing_model
    assert model.needs.names == ("ax", "ay", "az", "friction")
    for index in (0, 8, 16):
        recording = rubbed()[index]
        both = np.column_stack([recording.acceleration, recording.friction])
        shape = Stretches(model, 4, FS, "m/s^2")
        window = shape.window(both, 0)
        np.testing.assert_array_equal(window.friction, recording.friction)
        np.testing.assert_array_equal(window.acceleration, recording.acceleration)
        asked = model.answer(recording)
        assert asked.surface == recording.surface
        assert model.answer(window).probabilities == asked.probabilities
        text = io.BytesIO("\n".join(" ".join(map(repr, row)) for row in both.tolist()).encode())
        session = Session(model)
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=model)))
        assert session.live.verdict.surface == recording.surface


def test_a_stream_without_friction_is_refused_before_it_begins(rubbing_model, tmp_path):
    told = "no friction, needed by friction. Expected ax, ay, az, friction, .* --row of acceleration only"
    np.savetxt(tmp_path / "r.csv", values("sand", 1)[:, :3], delimiter=",", header="ax,ay,az", comments="")
    with pytest.raises(RecordingError, match=told):
        open_source(str(tmp_path / "r.csv"), fs=FS, model=rubbing_model)
    with pytest.raises(ValueError, match=r"has 3 columns. Expected 4, ax, ay, az, friction"):
        Stretches(rubbing_model, 3, FS, "m/s^2")


def test_what_is_live_is_not_conditioned_yet():
    assert [is_live(name) for name in ("-", "ros2:/imu", "bag:a.mcap", "a.wav")] == [True, True, False, False]
