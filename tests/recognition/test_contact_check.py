"""Recordings without contact are unknown: silence, sensor noise and quantisation noise, for every model."""

from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import SURFACES, pipeline, recording, surfaces

from texclass.loaders import open_dataset
from texclass.phases import find_phases
from texclass.recognition import load_model, train
from texclass.recognition.contact_check import MIN_LEVEL, ContactLimits, measure_vibration
from texclass.recognition.model_document import model_document
from texclass.recording import Phases, Recording

SENSORS = ("biotac20", "taps5", "floors10", "borealtc", "dogsurf", "knocks30", "stylus6", "fabric_speeds")
NOISE_LEVELS = (0.001, 0.01, 0.1, 1.0, 10.0)


def _silent_signals(recording, rng):
    """Yield signals without contact, as changes of a recording with the same axes and length."""
    signals = {"acceleration": recording.acceleration, "turn_rate": recording.turn_rate}
    signals = {name: signal for name, signal in signals.items() if signal is not None}
    yield {name: np.zeros_like(signal) for name, signal in signals.items()}
    yield {name: signal * 0 + signal[:1] for name, signal in signals.items()}
    yield {name: np.linspace(signal[0], signal[-1], len(signal)) for name, signal in signals.items()}
    steps = {name: np.diff(np.unique(signal)) for name, signal in signals.items()}
    yield {
        name: rng.integers(-1, 2, signal.shape) * steps[name][steps[name] > 0].min()
        for name, signal in signals.items()
    }
    for factor in NOISE_LEVELS:
        yield {
            name: signal[0] + factor * signal.std(axis=0) * rng.standard_normal(signal.shape)
            for name, signal in signals.items()
        }


@pytest.fixture(scope="module", params=[1, 3])
def model(request):
    return train(surfaces(request.param), pipeline())


def test_noise_and_silence_are_unknown_for_models_from_one_and_from_several_recordings(model):
    example = recording("oak", 1)
    for changes in _silent_signals(example, np.random.default_rng(0)):
        answer = model.predict(example.with_(**changes))
        assert answer.unknown
        assert any(reason.startswith(("no contact: ", "no feature")) for reason in answer.reasons)
    answers = model.predict(recording(name, seed) for name in SURFACES for seed in range(50, 55))
    assert not any(reason.startswith("no contact") for answer in answers for reason in answer.reasons)


def test_a_saved_model_states_the_limits_of_a_contact(model, tmp_path):
    model.save(tmp_path / "model.skops")
    loaded = load_model(tmp_path / "model.skops")
    assert loaded.manifest.contact == model.manifest.contact
    (card,) = model_document(loaded).blocks
    level = model.manifest.contact["level"]
    assert card["No contact"].startswith(f"unknown, also: vibration levels below {MIN_LEVEL * level:.2g} ")
    quiet = recording("oak", 1)
    quiet = quiet.with_(acceleration=0.01 * quiet.acceleration)
    reasons = loaded.predict(quiet).reasons
    assert any(reason.startswith("no contact: the level of the vibration is ") for reason in reasons)


def test_an_adapted_model_accepts_quieter_contacts_and_no_noise(model):
    adapted = replace(model, manifest=model.manifest.model_copy(update={"adapted": {"map": "affine"}}))
    example = recording("oak", 1)
    quiet = example.with_(acceleration=0.01 * example.acceleration)
    assert adapted.contact_problem(quiet, quiet.phases) == ""
    noise = example.with_(acceleration=np.random.default_rng(0).standard_normal(2000))
    assert adapted.contact_problem(noise, noise.phases).startswith("no contact: the spectrum is flat")


def test_a_recording_without_tap_and_movement_has_no_contact():
    limits = ContactLimits(level=1.0, spread=5.0)
    noise = Recording(np.random.default_rng(0).standard_normal(4000), fs=1000.0)
    assert limits.problem(noise, Phases()) == "no contact: neither a tap nor a movement was found"
    assert limits.problem(noise, Phases(movement=(0, 4000))).startswith("no contact: the spectrum is flat")
    assert ContactLimits.from_recordings([noise.with_(phases=Phases())]) is None


def test_surfaces_whose_spectrum_is_flat_like_noise_are_not_mistaken_for_noise():
    rng = np.random.default_rng(0)
    flat = Recording(rng.standard_normal(4000), fs=1000.0, phases=Phases(movement=(0, 4000)))
    limits = ContactLimits.from_recordings([flat])
    assert limits.spread < measure_vibration(flat, flat.phases).noise_spread
    assert limits.problem(flat, flat.phases) == ""


def test_the_linear_trend_of_a_sensor_is_not_vibration():
    ramp = Recording(np.linspace(0, 50, 4000), fs=1000.0)
    assert measure_vibration(ramp, Phases(movement=(0, 4000))).level < 1e-9


def test_the_spread_of_white_noise_rarely_exceeds_its_limit():
    rng = np.random.default_rng(0)
    for n in (200, 500, 5000):
        vibrations = [
            measure_vibration(Recording(rng.standard_normal((n, 3)), fs=100.0), Phases(movement=(0, n)))
            for _ in range(300)
        ]
        assert np.mean([one.spread <= one.noise_spread for one in vibrations]) >= 0.99


@pytest.mark.parametrize("name", [*SENSORS, "simulated6"])
def test_real_and_simulated_sensors_are_silent_without_contact(name, request):
    if name in SENSORS:
        request.getfixturevalue("data_root")
    dataset = open_dataset(name)
    first = {entry.surface: entry for entry in reversed(dataset.entries)}
    limits = ContactLimits.from_recordings(dataset.load(entry) for entry in first.values())
    rng = np.random.default_rng(0)
    last = list({entry.surface: entry for entry in dataset.entries}.values())[:3]
    for entry in last:
        loaded = dataset.load(entry)
        assert limits.problem(loaded, find_phases(loaded)) == ""
        for changes in _silent_signals(loaded, rng):
            silent = loaded.with_(**changes)
            assert limits.problem(silent, find_phases(silent))


def test_the_quiet_start_of_simulated_recordings_has_no_contact():
    dataset = open_dataset("simulated6")
    entries = [entry for entry in dataset.entries if entry.repetition == 1]
    model = train(replace(dataset, entries=tuple(entries)), "texclass", row="Movement", classifier="kernel")
    for entry in entries:
        loaded = dataset.load(entry)
        phases = find_phases(loaded)
        first = min(phases.movement[0], *(tap.start for tap in phases.taps))
        quiet = Recording(
            loaded.acceleration[:first],
            fs=loaded.fs,
            unit=loaded.unit,
            phases=Phases(movement=(0, first)),
        )
        assert model.contact_problem(quiet, quiet.phases).startswith("no contact")
