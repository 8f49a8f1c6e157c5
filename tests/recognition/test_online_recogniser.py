"""What the online recogniser claims: one answer for any blocking, the batch answer, events as they happen."""

import numpy as np
import pytest
from made_recordings import make
from numpy.testing import assert_array_equal
from scipy import signal as scipy_signal
from toy_surfaces import FS, SURFACES, signal

from texclass.recognition import ContactRules, Event, OnlineRecogniser, OnlineSettings, WindowAnswer
from texclass.recognition.live.contact import Contact, Level, Ring
from texclass.recording import Phases, Recording
from texclass.signals import butterworth

REST = 0.001
TAPS = (2000, 4400)
FIRST, SECOND = (7000, 14_000), (18_000, 25_000)
SETTINGS = OnlineSettings(window_s=0.5, hop_s=0.125)


def felt():
    """Rest with two taps, cork, rest, slate, rest."""
    rng = np.random.default_rng(7)
    x = REST * rng.standard_normal(29_000)
    for at in TAPS:
        t = np.arange(400) / FS
        x[at : at + 400] += np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t + 1)
    for (start, stop), surface in ((FIRST, "cork"), (SECOND, "slate")):
        x[start:stop] += signal(SURFACES[surface], 5, stop - start)
    return x


@pytest.fixture(scope="module")
def stream():
    return felt()


def listen(model, x, n, settings=SETTINGS, **facts):
    live, found = OnlineRecogniser(model, settings=settings, **facts), []
    for k in range(0, len(x), n):
        found += live.push(x[k : k + n])
    return [*found, *live.finish()]


@pytest.fixture(scope="module")
def heard(linear_model, stream):
    """What was said of the stream."""
    return listen(linear_model, stream, 64)


def windows(found):
    return [update for update in found if isinstance(update, WindowAnswer)]


def exactly(update):
    if isinstance(update, Event):
        return update
    verdict = update.verdict
    return update.start, update.stop, update.known, update.onset, update.answer, verdict


def test_every_blocking_gives_the_same_updates_bit_by_bit(linear_model, stream):
    told = [[exactly(u) for u in listen(linear_model, stream, n)] for n in (1, 7, 250, 4096, len(stream))]
    assert all(one == told[0] for one in told[1:])
    assert sum(not isinstance(u, Event) for u in told[0]) > 10


@pytest.mark.parametrize("name", ["linear_model", "kernel_model"])
def test_each_window_has_the_answer_of_the_model_for_these_samples(name, stream, request):
    model = request.getfixturevalue(name)
    for window in windows(listen(model, stream, 100)):
        piece = stream[window.start : window.stop]
        batch = model.answer(Recording(piece, FS, "m/s^2", "batch", phases=Phases(movement=(0, len(piece)))))
        assert batch.surface == window.answer.surface
        assert batch.unknown == window.answer.unknown
        assert dict(batch.probabilities) == pytest.approx(dict(window.answer.probabilities), abs=1e-12)


def test_contacts_taps_and_lift_offs_are_found_as_they_happen(heard):
    events = [u for u in heard if isinstance(u, Event)]
    assert [e.kind for e in events if e.kind != "stroke"] == [
        "tap", "tap", "contact", "lift-off", "contact", "lift-off",
    ]  # fmt: skip
    by_kind = {kind: [e for e in events if e.kind == kind] for kind in ("tap", "contact", "lift-off")}
    rules = ContactRules()
    for event, at in zip(by_kind["tap"], TAPS, strict=True):
        assert abs(event.sample - at) <= 0.002 * FS
        assert event.known - at <= (0.12 + rules.gap_s + 0.01) * FS  # its 60 dB die away in 0.12 s
    for event, (start, _) in zip(by_kind["contact"], (FIRST, SECOND), strict=True):
        assert abs(event.sample - start) <= 0.015 * FS
        assert event.known - event.sample <= (rules.share * rules.window_s + 0.02) * FS
    for event, (_, stop) in zip(by_kind["lift-off"], (FIRST, SECOND), strict=True):
        assert 0 <= event.sample - stop <= 0.07 * FS  # the high-pass rings down by 60 dB
        assert event.known - event.sample <= (rules.pause_s + 0.02) * FS


def test_windows_end_at_onset_plus_window_plus_hops_and_stay_inside_the_contact(heard):
    onsets = [u.sample for u in heard if isinstance(u, Event) and u.kind == "contact"]
    for window in windows(heard):
        assert window.onset in onsets
        assert (window.start - window.onset) % round(0.125 * FS) == 0
        assert window.stop - window.start == round(0.5 * FS)
        assert any(
            start - 64 <= window.start and window.stop <= stop + 520 for start, stop in (FIRST, SECOND)
        )


def test_a_lift_off_forgets_the_surface_before(heard):
    found = windows(heard)
    last = {w.onset: w for w in found}
    assert [w.verdict.surface for w in last.values()] == ["cork", "slate"]
    second = [w for w in found if w.onset > FIRST[1]]
    assert second[0].verdict.n_windows == 1
    assert second[0].verdict.surface == "slate"


def test_memory_does_not_grow(linear_model, stream):
    live = OnlineRecogniser(linear_model, settings=SETTINGS)
    live.push(stream)
    before = live.n_bytes
    for _ in range(3):
        live.push(stream)
    assert live.n_bytes == before
    assert len(live._due) < 8


def test_no_window_reaches_over_a_break_and_the_contact_goes_on(linear_model, stream):
    live, cut = OnlineRecogniser(linear_model, settings=SETTINGS), 10_000
    found = [*live.push(stream[:cut]), *live.interrupt(100), *live.push(stream[cut + 100 :])]
    kinds = [u.kind for u in found if isinstance(u, Event)]
    assert kinds.count("break") == 1
    assert kinds.count("contact") == 2
    told = windows(found)
    assert not any(w.start < cut + 100 and w.stop > cut for w in told)
    assert any(w.start >= cut + 100 and w.onset < cut for w in told)


def test_a_break_longer_than_a_pause_is_a_lift_off(linear_model, stream):
    live = OnlineRecogniser(linear_model, settings=SETTINGS)
    live.push(stream[:10_000])
    kinds = [event.kind for event in live.interrupt(round(0.6 * FS))]
    assert kinds == ["break", "lift-off"]
    assert live.verdict is None


def test_a_stream_that_begins_in_movement_is_taken_as_one(linear_model):
    x = signal(SURFACES["oak"], 3, 6000)
    assumed = OnlineSettings(window_s=0.25, assume_contact=True)
    for settings in (OnlineSettings(window_s=0.25), assumed):
        found = windows(listen(linear_model, x, 100, settings))
        assert found[0].start == 0
        assert found[-1].verdict.surface == "oak"
    first = windows(listen(linear_model, x, 100, assumed))[0]
    assert first.known <= 1000 + 20  # a window, and at most a bin


def test_a_contact_that_began_the_stream_ends_where_the_signal_drops(linear_model):
    x = np.concatenate(
        [signal(SURFACES["oak"], 3, 6000), 1e-4 * np.random.default_rng(0).standard_normal(6000)]
    )
    found = listen(linear_model, x, 100, OnlineSettings(window_s=0.25, assume_contact=True))
    lifted = [u for u in found if isinstance(u, Event) and u.kind == "lift-off"]
    assert len(lifted) == 1
    assert abs(lifted[0].sample - 6000) < 0.05 * FS


def test_physical_units_are_converted(linear_model, stream):
    in_g, in_si = OnlineRecogniser(linear_model, unit="g"), OnlineRecogniser(linear_model)
    told = [windows(live.push(x)) for live, x in ((in_g, stream / 9.80665), (in_si, stream))]
    assert [w.answer.surface for w in told[0]] == [w.answer.surface for w in told[1]]
    assert len(told[0]) > 2
    assert (in_g.unit, in_g.level[0]) == ("m/s^2", pytest.approx(in_si.level[0]))


def test_stopping_when_sure_computes_no_more(linear_model, stream):
    stopping = OnlineSettings(window_s=0.5, hop_s=0.125, stop_when_sure=True)
    found = windows(listen(linear_model, stream, 250, stopping))
    assert all(w.verdict.sure for w in {w.onset: w for w in found}.values())
    assert len(found) < len(windows(listen(linear_model, stream, 250)))


def test_a_contact_shorter_than_a_window_is_answered_when_it_is_over(linear_model, stream):
    long = OnlineSettings(window_s=2.5, hop_s=0.5)
    found = windows(listen(linear_model, stream, 250, long))
    assert [w.verdict.surface for w in found] == ["cork", "slate"]
    assert all(abs(w.stop - stop) < 0.07 * FS for w, (_, stop) in zip(found, (FIRST, SECOND), strict=True))


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((3, 2, 2)), "shape"),
        (np.array([1.0, np.nan]), "finite"),
        (np.zeros((5, 2)), "columns. Expected 1"),
    ],
)
def test_bad_samples_are_refused(linear_model, samples, message):
    live = OnlineRecogniser(linear_model)
    live.push(np.zeros(10))
    with pytest.raises(ValueError, match=message):
        live.push(samples)


def test_the_level_is_that_of_a_causal_filter():
    x = np.random.default_rng(3).standard_normal((2000, 3)) + np.array([0, 0, 9.81])
    level, size = Level(1e4, 3, 1.0), 50
    powers = [power for k in range(0, 2000, 100) for _, power in level.push(x[k : k + 100])]
    sos = butterworth("highpass", 60.0, 1e4)
    rest = scipy_signal.sosfilt_zi(sos)[:, :, None] * x[0]
    y = scipy_signal.sosfilt(sos, x, axis=0, zi=rest)[0]
    expected = (y**2).sum(axis=1).reshape(-1, size).mean(axis=1)
    np.testing.assert_allclose(powers, expected, rtol=1e-12)


def test_the_ring_gives_any_stretch_of_the_last_rows():
    rng = np.random.default_rng(0)
    ring, rows = Ring(50, 2), rng.standard_normal((1000, 2))
    done = 0
    while done < 900:
        n = int(rng.integers(0, 51))
        ring.push(rows[done : done + n])
        done += n
        start = int(rng.integers(ring.start, ring.stop + 1))
        assert_array_equal(ring.view(start, ring.stop), rows[start : ring.stop])
    ring.skip(10)
    assert ring.start == ring.stop == done + 10
    with pytest.raises(ValueError, match="Expected from"):
        ring.view(done, done + 5)


def test_what_stays_within_ten_times_its_mean_at_the_start_is_rest():
    for ratio, phase in ((9.5, "rest"), (10.5, "moving")):
        level = Level(1000.0, 1, 1.0)
        level.push(np.ones((20 * level.bin_size, 1)))
        contact = Contact(level, ContactRules(quiet_s=20 * level.bin_size / 1000), None, "m/s^2")
        powers = np.full(20, 1e-6)
        powers[7] *= ratio * 19 / (20 - ratio)  # the mean of all times the ratio
        for k, power in enumerate(powers):
            contact.step((k + 1) * level.bin_size, power)
        assert contact.phase == phase


def events_of(recording):
    """What a stream of these samples says of taps, contacts and lift-offs, without a model."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    level = Level(recording.fs, axes.shape[1], 10.0)
    contact = Contact(level, ContactRules(), None, recording.unit)
    bins = level.push(axes[: len(axes) // level.bin_size * level.bin_size])
    return [event for stop, power in bins for event in contact.step(stop, power)]


@pytest.mark.parametrize("family", ["plain", "ringing taps only", "quick"])
def test_a_stream_finds_the_taps_and_the_strokes_of_a_recording(family):
    true = found = right = wrong = 0
    for seed in range(500, 506):
        recording = make(family, seed, fs=5000.0)
        events, phases = events_of(recording), recording.phases
        impacts = [event.sample for event in events if event.kind == "tap"]
        begun = [event.sample for event in events if event.kind == "contact"]
        wrong += len(begun) != (phases.movement is not None)
        if phases.movement is not None:
            assert all(abs(at - phases.onset) <= 0.06 * recording.fs for at in begun)
        true, found = true + len(phases.taps), found + len(impacts)
        right += sum(min((abs(t.impact - at) for at in impacts), default=9e9) < 60 for t in phases.taps)
    assert wrong <= 1  # what rings on for 0.3 s is hard to tell from a stroke before it is over
    assert min(right / true, right / found) >= 0.9


def test_a_wild_sample_in_a_stream_is_no_tap(linear_model, stream, heard):
    wild = stream.copy()
    wild[1000] += 5.0
    clean, spoiled = (
        [u.sample for u in found if isinstance(u, Event) and u.kind == "tap"]
        for found in (heard, listen(linear_model, wild, 64))
    )
    assert spoiled == clean


@pytest.mark.parametrize(("hop_s", "share"), [(0.125, 0.25), (None, 0.5), (1.0, 1.0)])
def test_overlapping_windows_count_by_the_share_of_new_signal(linear_model, hop_s, share):
    live = OnlineRecogniser(linear_model, settings=OnlineSettings(window_s=0.5, hop_s=hop_s))
    assert live.window == round(0.5 * FS)
    assert live.evidence.constants["new_share"] == pytest.approx(share)


def test_evidence_is_forgotten_with_its_time_constant_in_seconds(linear_model):
    settings = OnlineSettings(window_s=0.5, hop_s=0.25, forget_s=2.0)
    constants = OnlineRecogniser(linear_model, settings=settings).evidence.constants
    assert constants["decay"] == pytest.approx(np.exp(-0.25 / 2.0))


def test_a_recogniser_that_has_seen_no_sample_holds_none(linear_model, stream):
    live = OnlineRecogniser(linear_model, settings=SETTINGS)
    assert live.n_bytes == 0
    live.push(stream[:100])
    assert live.n_bytes > 0
