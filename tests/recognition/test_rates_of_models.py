"""Models of signals with different sampling rates: recordings with other rates are refused, streams too."""

import numpy as np
import pytest
from toy_surfaces import FS, SURFACES, N, pipeline, recording, surfaces

from texclass.evaluation import extract_table
from texclass.evaluation.axes import decide_axes
from texclass.evaluation.pipeline import RowDefinition
from texclass.features import load_feature_set
from texclass.haptics.textures.scan import Scan
from texclass.loaders.dataset import Dataset
from texclass.recognition import Session, adapt, load_model, open_source, train
from texclass.recognition.model_document import model_document
from texclass.recording import RecordingError
from texclass.robot.export.sample_graph import check_graphs

FEATURES = load_feature_set("texclass").restricted_to(["mfcc", "friction"])
SLOW_FS = 500


def rubbed(name, seed, fs=SLOW_FS, *, sound=False):
    """Return a recording with friction at `fs` and, if requested, a sound at 8 kHz."""
    rng = np.random.default_rng([*map(ord, name), seed])
    n = round(N * fs / FS)
    friction = 0.1 * (1 + [*SURFACES].index(name)) + 0.01 * rng.standard_normal(n)
    rates, more = {"friction": fs}, {}
    if sound:
        rates, more = rates | {"sound": 2 * FS}, {"sound": rng.standard_normal(2 * N)}
    return recording(name, seed, friction=friction, auxiliary_fs=rates, repetition=seed, **more)


class Loader:
    def __init__(self, sound=False, other=""):
        self.sound, self.other = sound, other

    def __call__(self, entry):
        fs = 250 if entry.recording_id == self.other else SLOW_FS
        return rubbed(entry.surface, entry.repetition, fs, sound=self.sound)


def dataset(**options):
    return Dataset("rubbed", surfaces(4).entries, Loader(**options), f"rubbed{options}")


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    """A saved and loaded model of friction at 500 Hz and acceleration at 4 kHz."""
    rows = (RowDefinition(name="Both", features=("mfcc", "friction")),)
    path = tmp_path_factory.mktemp("models") / "rubbing.skops"
    train(dataset(), pipeline(features=FEATURES, rows=rows), row="Both", classifier="lda").save(path)
    return load_model(path)


def test_a_model_stores_the_rates_and_classifies_recordings_with_them(rubbing):
    assert (rubbing.manifest.fs, rubbing.manifest.auxiliary_fs) == (FS, {"friction": SLOW_FS})
    assert rubbing.plan.signals == ("friction",)
    assert ", friction at 500 Hz" in str(model_document(rubbing))
    for name in SURFACES:
        answer = rubbing.answer(rubbed(name, 50))
        assert (answer.surface, answer.unknown) == (name, False)
        assert not [reason for reason in answer.reasons if "rate" in reason]


@pytest.mark.parametrize("fs", [250, FS])
def test_a_recording_with_another_rate_of_the_friction_is_not_classified(rubbing, fs):
    answer = rubbing.answer(rubbed("oak", 50, fs))
    assert answer.unknown
    problem = f"wrong rate of friction: {fs:g} Hz, trained at 500 Hz; record it at that rate"
    assert any(reason.startswith(problem) for reason in answer.reasons)
    with pytest.raises(ValueError, match=f"oak-50: {problem}"):
        adapt(rubbing, [rubbed("oak", 50, fs)])


def test_a_signal_that_the_model_does_not_need_may_have_any_rate(linear_model):
    plain = linear_model.answer(recording("oak", 50))
    assert linear_model.answer(rubbed("oak", 50)).probabilities == plain.probabilities


def test_streams_and_graphs_of_several_rates_are_refused(rubbing):
    message = "the model needs friction at 500 Hz besides the acceleration at 4000 Hz, but the signals of a"
    with pytest.raises(RecordingError, match=message):
        open_source(rubbed("oak", 50), model=rubbing)
    block = next(open_source(recording("oak", 50)))
    with pytest.raises(RecordingError, match=message):
        Session(rubbing).push(block)
    with pytest.raises(ValueError, match="the model needs friction, but the input of a graph has one rate"):
        check_graphs(rubbing)


def test_a_model_of_a_sound_is_trained_and_saved(tmp_path):
    features = FEATURES.restricted_to(["mfcc"])
    assert decide_axes(dataset(sound=True), "auto").channels == "all"
    rows = (RowDefinition(name="Spectrum", features=("mfcc",)),)
    definition = pipeline(features=features, rows=rows, channels="auto")
    model = train(dataset(sound=True), definition, row="Spectrum", classifier="lda")
    model.save(tmp_path / "sound.skops")
    model = load_model(tmp_path / "sound.skops")
    assert model.plan.channels == ("c1", "sound")
    assert model.manifest.auxiliary_fs == {"sound": 2 * FS}
    assert model.answer(rubbed("oak", 50, sound=True)).surface == "oak"
    with pytest.raises(RecordingError, match="the model needs sound at 8000 Hz"):
        model.input_columns  # noqa: B018


def test_a_recording_with_another_rate_is_left_out_of_a_table(tmp_path):
    mixed = dataset(other="felt-2")
    message = "felt-2: friction at 250 Hz, but 15 of 16 have friction at 500 Hz. Expected the same rates in"
    with pytest.raises(RecordingError, match=message):
        extract_table(mixed, FEATURES, tmp_path / "t.parquet")
    table = extract_table(mixed, FEATURES, tmp_path / "u.parquet", skip_bad=True)
    assert [one.recording_id for one in table.left_out] == ["felt-2"]
    no_friction = extract_table(mixed, FEATURES.restricted_to(["mfcc"]), tmp_path / "v.parquet")
    assert not no_friction.left_out


def test_a_scan_interpolates_speed_and_force():
    t = np.arange(N) / FS
    speed = 80 + 10 * np.sin(2 * np.pi * 4 * t)
    one_rate = recording("oak", 1, speed=speed, normal_force=1 + t)
    slow_speed = speed[::8].copy()
    slow_speed[100] = 1e4  # an outlier of one sample, which interpolation would spread
    rates = {"speed": FS / 8, "normal_force": FS / 20}
    several = recording("oak", 1, speed=slow_speed, normal_force=1 + t[::20], auxiliary_fs=rates)
    expected = Scan.from_recording(one_rate)
    with pytest.warns(UserWarning, match="excluded 1 sample"):
        scan = Scan.from_recording(several)
    np.testing.assert_allclose(scan.speed[:-8], expected.speed[:-8], atol=0.1)
    np.testing.assert_allclose(scan.force[:-20], expected.force[:-20], atol=1e-9)
