"""The online recogniser: same answers for any block size and for recordings, and detection of events."""

import numpy as np
import pytest
from made_recordings import make
from numpy.testing import assert_array_equal
from scipy import signal as scipy_signal
from toy_surfaces import FS, SURFACES, signal

from texclass.recognition import ContactSettings, Event, OnlineRecogniser, OnlineSettings, WindowAnswer
from texclass.recognition.live.contact import ContactDetector, LevelMeter, Ring
from texclass.recording import Phases, Recording
from texclass.signals import butterworth

REST = 0.001
TAPS = (2000, 4400)
FIRST, SECOND = (7000, 14_000), (18_000, 25_000)
SETTINGS = OnlineSettings(window_s=0.5, hop_s=0.125)


def simulate_stream():
    """Return rest with two taps, cork, rest, slate, rest."""
    rng = np.random.default_rng(7)
    x = REST * rng.standard_normal(29_000)
    for impact in TAPS:
        t = np.arange(400) / FS
        x[impact : impact + 400] += np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t + 1)
    for (start, stop), surface in ((FIRST, "cork"), (SECOND, "slate")):
        x[start:stop] += signal(SURFACES[surface], 5, stop - start)
    return x


@pytest.fixture(scope="module")
def stream():
    return simulate_stream()


def recognise(model, x, n, settings=SETTINGS, **options):
    """Push a signal in blocks of n samples, and return all updates."""
    recogniser, updates = OnlineRecogniser(model, settings=settings, **options), []
    for k in range(0, len(x), n):
        updates += recogniser.push(x[k : k + n])
    return [*updates, *recogniser.finish()]


@pytest.fixture(scope="module")
def updates(linear_model, stream):
    return recognise(linear_model, stream, 64)


def windows(updates):
    return [update for update in updates if isinstance(update, WindowAnswer)]


def without_compute_time(update):
    if isinstance(update, Event):
        return update
    return update.start, update.stop, update.n_received, update.onset, update.answer, update.verdict


def test_updates_do_not_depend_on_the_block_size(linear_model, stream):
    sizes = (1, 7, 250, 4096, len(stream))
    first, *others = [[without_compute_time(u) for u in recognise(linear_model, stream, n)] for n in sizes]
    assert all(other == first for other in others)
    assert sum(not isinstance(update, Event) for update in first) > 10


@pytest.mark.parametrize("name", ["linear_model", "kernel_model"])
def test_a_window_has_the_same_answer_as_a_recording_of_its_samples(name, stream, request):
    model = request.getfixturevalue(name)
    for window in windows(recognise(model, stream, 100)):
        x = stream[window.start : window.stop]
        batch = model.answer(Recording(x, FS, "m/s^2", "batch", phases=Phases(movement=(0, len(x)))))
        assert batch.surface == window.answer.surface
        assert batch.unknown == window.answer.unknown
        assert dict(batch.probabilities) == pytest.approx(dict(window.answer.probabilities), abs=1e-12)


def test_contacts_taps_and_lift_offs_are_detected_with_a_short_delay(updates):
    events = [u for u in updates if isinstance(u, Event)]
    assert [e.kind for e in events if e.kind != "stroke"] == [
        "tap", "tap", "contact", "lift-off", "contact", "lift-off",
    ]  # fmt: skip
    by_kind = {kind: [e for e in events if e.kind == kind] for kind in ("tap", "contact", "lift-off")}
    settings = ContactSettings()
    for event, impact in zip(by_kind["tap"], TAPS, strict=True):
        assert abs(event.sample - impact) <= 0.002 * FS
        # The tap decays by 60 dB within 0.12 s.
        assert event.n_received - impact <= (0.12 + settings.gap_s + 0.01) * FS
    for event, (start, _) in zip(by_kind["contact"], (FIRST, SECOND), strict=True):
        assert abs(event.sample - start) <= 0.015 * FS
        assert event.n_received - event.sample <= (settings.share * settings.window_s + 0.02) * FS
    for event, (_, stop) in zip(by_kind["lift-off"], (FIRST, SECOND), strict=True):
        assert 0 <= event.sample - stop <= 0.07 * FS  # the high-pass rings down by 60 dB
        assert event.n_received - event.sample <= (settings.pause_s + 0.02) * FS


def test_windows_end_at_onset_plus_window_plus_hops_and_stay_inside_the_contact(updates):
    onsets = [u.sample for u in updates if isinstance(u, Event) and u.kind == "contact"]
    for window in windows(updates):
        assert window.onset in onsets
        assert (window.start - window.onset) % round(0.125 * FS) == 0
        assert window.stop - window.start == round(0.5 * FS)
        assert any(
            start - 64 <= window.start and window.stop <= stop + 520 for start, stop in (FIRST, SECOND)
        )


def test_a_lift_off_resets_the_evidence(updates):
    answers = windows(updates)
    last = {w.onset: w for w in answers}
    assert [w.verdict.surface for w in last.values()] == ["cork", "slate"]
    second = [w for w in answers if w.onset > FIRST[1]]
    assert second[0].verdict.n_windows == 1
    assert second[0].verdict.surface == "slate"


def test_memory_does_not_grow(linear_model, stream):
    recogniser = OnlineRecogniser(linear_model, settings=SETTINGS)
    recogniser.push(stream)
    n_bytes = recogniser.n_bytes
    for _ in range(3):
        recogniser.push(stream)
    assert recogniser.n_bytes == n_bytes
    assert len(recogniser._window_queue) < 8


def test_no_window_spans_a_break_and_the_contact_continues(linear_model, stream):
    recogniser, cut = OnlineRecogniser(linear_model, settings=SETTINGS), 10_000
    updates = [
        *recogniser.push(stream[:cut]),
        *recogniser.interrupt(100),
        *recogniser.push(stream[cut + 100 :]),
    ]
    kinds = [u.kind for u in updates if isinstance(u, Event)]
    assert kinds.count("break") == 1
    assert kinds.count("contact") == 2
    answers = windows(updates)
    assert not any(w.start < cut + 100 and w.stop > cut for w in answers)
    assert any(w.start >= cut + 100 and w.onset < cut for w in answers)


def test_a_break_longer_than_a_pause_is_a_lift_off(linear_model, stream):
    recogniser = OnlineRecogniser(linear_model, settings=SETTINGS)
    recogniser.push(stream[:10_000])
    kinds = [event.kind for event in recogniser.interrupt(round(0.6 * FS))]
    assert kinds == ["break", "lift-off"]
    assert recogniser.verdict is None


def test_a_stream_may_start_during_a_movement(linear_model):
    x = signal(SURFACES["oak"], 3, 6000)
    in_contact = OnlineSettings(window_s=0.25, starts_in_contact=True)
    for settings in (OnlineSettings(window_s=0.25), in_contact):
        answers = windows(recognise(linear_model, x, 100, settings))
        assert answers[0].start == 0
        assert answers[-1].verdict.surface == "oak"
    first = windows(recognise(linear_model, x, 100, in_contact))[0]
    assert first.n_received <= 1000 + 20  # one window, and at most one bin


def test_a_contact_at_the_start_of_a_stream_ends_when_the_level_drops(linear_model):
    x = np.concatenate(
        [signal(SURFACES["oak"], 3, 6000), 1e-4 * np.random.default_rng(0).standard_normal(6000)]
    )
    updates = recognise(linear_model, x, 100, OnlineSettings(window_s=0.25, starts_in_contact=True))
    lift_offs = [u for u in updates if isinstance(u, Event) and u.kind == "lift-off"]
    assert len(lift_offs) == 1
    assert abs(lift_offs[0].sample - 6000) < 0.05 * FS


def test_physical_units_are_converted(linear_model, stream):
    in_g, in_si = OnlineRecogniser(linear_model, unit="g"), OnlineRecogniser(linear_model)
    of_g, of_si = windows(in_g.push(stream / 9.80665)), windows(in_si.push(stream))
    assert [w.answer.surface for w in of_g] == [w.answer.surface for w in of_si]
    assert len(of_g) > 2
    assert (in_g.unit, in_g.level[0]) == ("m/s^2", pytest.approx(in_si.level[0]))


def test_windows_after_a_sure_verdict_can_be_skipped(linear_model, stream):
    settings = OnlineSettings(window_s=0.5, hop_s=0.125, stop_when_sure=True)
    answers = windows(recognise(linear_model, stream, 250, settings))
    assert all(w.verdict.sure for w in {w.onset: w for w in answers}.values())
    assert len(answers) < len(windows(recognise(linear_model, stream, 250)))


def test_a_contact_shorter_than_a_window_is_classified_at_its_end(linear_model, stream):
    settings = OnlineSettings(window_s=2.5, hop_s=0.5)
    answers = windows(recognise(linear_model, stream, 250, settings))
    assert [w.verdict.surface for w in answers] == ["cork", "slate"]
    stops = [stop for _, stop in (FIRST, SECOND)]
    assert all(abs(w.stop - stop) < 0.07 * FS for w, stop in zip(answers, stops, strict=True))


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((3, 2, 2)), "shape"),
        (np.array([1.0, np.nan]), "finite"),
        (np.zeros((5, 2)), "must have 1 columns.* got 2"),
    ],
)
def test_invalid_samples_raise_an_error(linear_model, samples, message):
    recogniser = OnlineRecogniser(linear_model)
    recogniser.push(np.zeros(10))
    with pytest.raises(ValueError, match=message):
        recogniser.push(samples)


def test_the_level_is_that_of_a_causal_filter_of_scipy():
    x = np.random.default_rng(3).standard_normal((2000, 3)) + np.array([0, 0, 9.81])
    meter, size = LevelMeter(1e4, 3, 1.0), 50
    powers = [power for k in range(0, 2000, 100) for _, power in meter.push(x[k : k + 100])]
    sos = butterworth("highpass", 60.0, 1e4)
    rest = scipy_signal.sosfilt_zi(sos)[:, :, None] * x[0]
    y = scipy_signal.sosfilt(sos, x, axis=0, zi=rest)[0]
    expected = (y**2).sum(axis=1).reshape(-1, size).mean(axis=1)
    np.testing.assert_allclose(powers, expected, rtol=1e-12)


def test_the_ring_returns_any_range_of_the_last_rows():
    rng = np.random.default_rng(0)
    ring, rows = Ring(50, 2), rng.standard_normal((1000, 2))
    n_pushed = 0
    while n_pushed < 900:
        n = int(rng.integers(0, 51))
        ring.push(rows[n_pushed : n_pushed + n])
        n_pushed += n
        start = int(rng.integers(ring.start, ring.stop + 1))
        assert_array_equal(ring.view(start, ring.stop), rows[start : ring.stop])
    ring.skip(10)
    assert ring.start == ring.stop == n_pushed + 10
    with pytest.raises(ValueError, match="start and stop must be within"):
        ring.view(n_pushed, n_pushed + 5)


def test_a_stream_starts_at_rest_if_no_bin_exceeds_ten_times_the_mean():
    for ratio, phase in ((9.5, "rest"), (10.5, "moving")):
        meter = LevelMeter(1000.0, 1, 1.0)
        meter.push(np.ones((20 * meter.bin_size, 1)))
        settings = ContactSettings(quiet_s=20 * meter.bin_size / 1000)
        detector = ContactDetector(meter, settings, None, "m/s^2")
        powers = np.full(20, 1e-6)
        powers[7] *= ratio * 19 / (20 - ratio)  # the mean of all times the ratio
        for k, power in enumerate(powers):
            detector.step((k + 1) * meter.bin_size, power)
        assert detector.phase == phase


def detect_events(recording):
    """Return the taps, contacts and lift-offs of a recording as a stream, without a model."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    meter = LevelMeter(recording.fs, axes.shape[1], 10.0)
    detector = ContactDetector(meter, ContactSettings(), None, recording.unit)
    bins = meter.push(axes[: len(axes) // meter.bin_size * meter.bin_size])
    return [event for stop, power in bins for event in detector.step(stop, power)]


@pytest.mark.parametrize("family", ["plain", "ringing taps only", "quick"])
def test_taps_and_strokes_of_a_recording_are_detected_in_a_stream(family):
    n_true = n_detected = n_correct = n_wrong_contacts = 0
    for seed in range(500, 506):
        recording = make(family, seed, fs=5000.0)
        events, phases = detect_events(recording), recording.phases
        impacts = [event.sample for event in events if event.kind == "tap"]
        onsets = [event.sample for event in events if event.kind == "contact"]
        n_wrong_contacts += len(onsets) != (phases.movement is not None)
        if phases.movement is not None:
            assert all(abs(onset - phases.onset) <= 0.06 * recording.fs for onset in onsets)
        n_true, n_detected = n_true + len(phases.taps), n_detected + len(impacts)
        distances = [min((abs(t.impact - i) for i in impacts), default=9e9) for t in phases.taps]
        n_correct += sum(distance < 60 for distance in distances)
    assert n_wrong_contacts <= 1  # a tap that rings for 0.3 s may count as a stroke before it has ended
    assert min(n_correct / n_true, n_correct / n_detected) >= 0.9


def test_a_glitch_in_a_stream_is_not_a_tap(linear_model, stream, updates):
    x = stream.copy()
    x[1000] += 5.0
    with_glitch = recognise(linear_model, x, 64)
    expected, taps = (
        [u.sample for u in items if isinstance(u, Event) and u.kind == "tap"]
        for items in (updates, with_glitch)
    )
    assert taps == expected


@pytest.mark.parametrize(("hop_s", "fraction"), [(0.125, 0.25), (None, 0.5), (1.0, 1.0)])
def test_overlapping_windows_are_weighted_by_their_fraction_of_new_signal(linear_model, hop_s, fraction):
    recogniser = OnlineRecogniser(linear_model, settings=OnlineSettings(window_s=0.5, hop_s=hop_s))
    assert recogniser.window == round(0.5 * FS)
    assert recogniser.evidence.constants["new_share"] == pytest.approx(fraction)


def test_evidence_fades_with_its_time_constant_in_seconds(linear_model):
    settings = OnlineSettings(window_s=0.5, hop_s=0.25, forget_s=2.0)
    constants = OnlineRecogniser(linear_model, settings=settings).evidence.constants
    assert constants["decay"] == pytest.approx(np.exp(-0.25 / 2.0))


def test_memory_is_allocated_with_the_first_sample(linear_model, stream):
    recogniser = OnlineRecogniser(linear_model, settings=SETTINGS)
    assert recogniser.n_bytes == 0
    recogniser.push(stream[:100])
    assert recogniser.n_bytes > 0
