"""Streams for models that need turn rate or friction besides the acceleration."""

import io

import numpy as np
import pytest
from toy_surfaces import pipeline
from turning_surfaces import FS, N, terrains, values

from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.loaders.dataset import Dataset
from texclass.recognition import Session, is_live, open_source, train
from texclass.recognition.live.online_recogniser import RecordingBuilder
from texclass.recording import RecordingError


@pytest.mark.parametrize("n_columns", [3, 5, 7])
def test_text_with_another_number_of_columns_raises_an_error_with_their_names(turning, n_columns):
    text = io.BytesIO("\n".join([" ".join(["1"] * n_columns)] * 50).encode())
    session = Session(turning)
    with pytest.raises(ValueError, match=rf"6 columns.* \(ax, ay, az, turn_x, .*\), got {n_columns}"):
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=turning)))
    with pytest.raises(ValueError, match=rf"must have 6 columns.* got {n_columns}"):
        open_source("-", fs=FS, unit="m/s^2", file=io.BytesIO(b""), raw_channels=n_columns, model=turning)


def friction_dataset():
    """Return the terrains with a friction that differs between them, and without turn rate."""
    level = {"gravel": 0.2, "grass": 1.0, "sand": 3.0}
    turning = terrains()

    def load(entry):
        recording = turning.load(entry)
        noise = np.random.default_rng(entry.repetition).standard_normal(N)
        return recording.with_(turn_rate=None, friction=level[entry.surface] * (1 + 0.05 * noise))

    return Dataset("friction", turning.entries, load, "friction")


@pytest.fixture(scope="module")
def friction_model():
    friction = load_feature_set("texclass").restricted_to(["friction", "prediction_gain"])
    rows = (RowDefinition(name="Friction", features=("friction", "prediction_gain")),)
    return train(
        friction_dataset(),
        pipeline(features=friction, rows=rows),
        row="Friction",
        classifier="lda",
        false_alarms=0.2,
    )


def test_friction_is_the_last_column_of_a_stream(friction_model):
    model = friction_model
    assert model.input_columns.names == ("ax", "ay", "az", "friction")
    for index in (0, 8, 16):
        recording = friction_dataset()[index]
        rows = np.column_stack([recording.acceleration, recording.friction])
        window = RecordingBuilder(model, 4, FS, "m/s^2").build_window(rows, 0)
        np.testing.assert_array_equal(window.friction, recording.friction)
        np.testing.assert_array_equal(window.acceleration, recording.acceleration)
        answer = model.answer(recording)
        assert answer.surface == recording.surface
        assert model.answer(window).probabilities == answer.probabilities
        text = io.BytesIO("\n".join(" ".join(map(repr, row)) for row in rows.tolist()).encode())
        session = Session(model)
        list(session.run(open_source("-", fs=FS, unit="m/s^2", file=text, model=model)))
        assert session.recogniser.verdict.surface == recording.surface


def test_a_stream_without_friction_raises_an_error_before_it_starts(friction_model, tmp_path):
    message = (
        r"no friction signal, but the model needs it \(friction\). Expected ax, ay, az, friction, .* --row"
    )
    np.savetxt(tmp_path / "r.csv", values("sand", 1)[:, :3], delimiter=",", header="ax,ay,az", comments="")
    with pytest.raises(RecordingError, match=message):
        open_source(str(tmp_path / "r.csv"), fs=FS, model=friction_model)
    with pytest.raises(ValueError, match=r"must have 4 columns.* \(ax, ay, az, friction\), got 3"):
        RecordingBuilder(friction_model, 3, FS, "m/s^2")


def test_only_standard_input_and_topics_are_live_sources():
    assert [is_live(name) for name in ("-", "ros2:/imu", "bag:a.mcap", "a.wav")] == [True, True, False, False]
