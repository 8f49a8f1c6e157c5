"""Sessions: recognition in a stream with faults, and notices about them."""

from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import FS, SURFACES, signal

from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recognition import Block, Event, Notice, OnlineSettings, Session, WindowAnswer, listen
from texclass.recognition.live.session import SampleRepair
from texclass.recognition.sources.blocks import resampled
from texclass.recording import Recording, RecordingError

MOVING = OnlineSettings(window_s=0.25, starts_in_contact=True)


def to_blocks(x, n=100, fs=FS, unit="m/s^2", **fields):
    return [Block(k / fs, x[k : k + n, None], fs, unit, **fields) for k in range(0, len(x), n)]


def run(model, blocks, settings=MOVING):
    session = Session(model, settings=settings)
    return session, list(session.run(blocks))


def select(kind, updates):
    return [update for update in updates if isinstance(update, kind)]


@pytest.fixture(scope="module")
def oak():
    return signal(SURFACES["oak"], 3, 6000)


def test_lost_samples_and_flags_cause_notices(linear_model, oak):
    blocks = to_blocks(oak)
    blocks[20] = Block(0.5, blocks[20].samples, FS, "m/s^2", 40, ("lost: 40 samples", "clock jumps: 1"))
    session, updates = run(linear_model, blocks)
    assert [n.message for n in select(Notice, updates)] == ["lost: 40 samples", "clock jumps: 1"]
    assert session.n_lost == 40
    assert session.recogniser.n_samples == len(oak) + 40
    assert [e.kind for e in select(Event, updates)] == ["contact", "break"]
    assert select(WindowAnswer, updates)[-1].verdict.surface == "oak"


def test_samples_that_are_not_finite_are_interpolated_or_count_as_lost(linear_model, oak):
    x = oak.copy()
    x[2500:2510] = np.nan
    session, updates = run(linear_model, to_blocks(x))
    assert session.n_lost == 10
    assert "not finite: 10 samples" in select(Notice, updates)[0].message
    assert [e.kind for e in select(Event, updates)] == ["contact"]
    assert select(WindowAnswer, updates)[-1].verdict.surface == "oak"
    x[2500:2520] = np.nan
    assert [e.kind for e in select(Event, run(linear_model, to_blocks(x))[1])] == ["contact", "break"]


@pytest.mark.parametrize("glitch", [1e9, 3.4e38, -1e5, np.inf])
@pytest.mark.parametrize("settings", [MOVING, OnlineSettings(window_s=0.25)], ids=["moving", "from rest"])
def test_a_glitch_causes_a_notice_and_affects_answers_for_less_than_a_second(
    linear_model, oak, glitch, settings
):
    x = np.concatenate([0.001 * np.random.default_rng(0).standard_normal(2000), oak])
    index = 4000
    expected = select(WindowAnswer, run(linear_model, to_blocks(x), settings)[1])
    x[index] = glitch
    session, updates = run(linear_model, to_blocks(x), settings)
    (notice,) = select(Notice, updates)
    assert notice.message.startswith("not finite: 1" if abs(glitch) > 1e15 else "glitch: 1 samples")
    assert session.n_lost == 1
    answers = select(WindowAnswer, updates)
    assert [w.stop for w in answers] == [w.stop for w in expected]
    next_second = [w for w in answers if index < w.stop <= index + FS]
    assert len(next_second) >= 4
    assert {w.answer.surface for w in next_second} == {"oak"}
    pairs = [(w.answer, e.answer) for w, e in zip(answers, expected, strict=True) if w.start > index]
    assert all(answer.probabilities == without.probabilities for answer, without in pairs)


def test_a_glitch_does_not_stop_a_resampled_stream(linear_model, oak):
    x = np.repeat(oak, 2)
    x[4000] = 3.4e38
    source = resampled((block for block in to_blocks(x, fs=2 * FS)), FS)
    _, updates = run(linear_model, source)
    assert any(n.message.startswith(("glitch", "not finite")) for n in select(Notice, updates))
    answers = select(WindowAnswer, updates)
    assert next(w.stop for w in answers if w.stop > 2000) <= 2000 + 0.3 * FS
    assert (answers[-1].answer.surface, answers[-1].stop > 5400) == ("oak", True)


def test_a_loose_wire_causes_few_notices_and_the_stream_continues_after_it(linear_model, oak):
    x = np.tile(oak, 4)
    loose = slice(2000, 18_000)
    x[loose] = np.random.default_rng(1).choice([-1e9, 1e9, np.nan], 16_000)
    session, updates = run(linear_model, to_blocks(x))
    assert 2 <= len(select(Notice, updates)) <= 6
    assert "similar" in select(Notice, updates)[-1].message
    assert session.n_lost >= 15_000
    last = select(WindowAnswer, updates)[-1]
    assert last.answer.surface == "oak"
    assert last.stop >= len(x) - 1000


def test_a_new_resting_level_is_accepted_after_a_tenth_of_a_second(linear_model, oak):
    x = np.concatenate([oak, oak + 1e6])
    session, updates = run(linear_model, to_blocks(x))
    assert session.n_lost == round(0.1 * FS) - 1
    assert [e.kind for e in select(Event, updates)] == ["contact", "break"]
    assert select(WindowAnswer, updates)[-1].stop >= len(x) - 1000


@pytest.mark.parametrize("size", [1, 7, 400])
def test_repaired_samples_do_not_depend_on_the_block_size(linear_model, size):
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((400, 2))
    for start, n in (
        (0, 2),
        (50, 1),
        (60, TIMESTAMPS.max_gap),
        (100, TIMESTAMPS.max_gap + 1),
        (200, 90),
        (300, 3),
    ):
        rows[start : start + n] = rng.choice([np.nan, 1e9 if start else np.inf], (n, 2))
    rows[150] = [3.0, 1e9]  # only the first column is acceleration

    def repair(size):
        samples, segments, n_lost = SampleRepair(linear_model, 1, FS, 1.0), [], []
        for k in range(0, len(rows), size):
            for n, segment in samples.repair(rows[k : k + size])[0]:
                n_lost += [n] * (n > 0)
                segments.append(segment)
        return n_lost, np.concatenate(segments)

    n_lost, repaired = repair(size)
    assert n_lost == [2, TIMESTAMPS.max_gap + 1, 90]
    np.testing.assert_array_equal(repaired, repair(400)[1])
    np.testing.assert_allclose(repaired[48], (rows[49] + rows[51]) / 2)
    assert len(repaired) + sum(n_lost) == 400
    expected = 2 * max(100 * linear_model.manifest.peak_acceleration, 1000)
    assert SampleRepair(linear_model, 1, FS, 0.5).max_step == expected


def test_lost_samples_in_a_block_without_samples_interrupt_the_stream(linear_model, oak):
    blocks = to_blocks(oak)
    blocks.insert(30, Block(0.75, oak[:0, None], FS, "m/s^2", 400))
    session, updates = run(linear_model, blocks)
    assert session.n_lost == 400
    assert session.recogniser.n_samples == len(oak) + 400
    assert "break" in [e.kind for e in select(Event, updates)]


def test_notices_of_one_kind_are_limited_to_one_in_five_seconds(linear_model, oak):
    blocks = [Block(k / 10, oak[:2, None], FS, "m/s^2", 0, (f"gaps: {k}", "odd")) for k in range(120)]
    _, updates = run(linear_model, blocks)
    omitted = "(49 similar since the last notice)"
    assert [n.message for n in select(Notice, updates)] == [
        "gaps: 0", "odd", f"gaps: 50 {omitted}", f"odd {omitted}", f"gaps: 100 {omitted}", f"odd {omitted}",
        "gaps: 119 (19 similar)", "odd (19 similar)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("fs", "unit", "what"), [(2000.0, "m/s^2", "wrong rate: 2000 Hz"), (FS, "counts", "wrong unit: counts")]
)
def test_a_wrong_rate_or_unit_causes_one_notice_and_unknown_answers(linear_model, oak, fs, unit, what):
    _, updates = run(linear_model, to_blocks(oak, fs=fs, unit=unit))
    assert [n.message.startswith(what) for n in select(Notice, updates)] == [True]
    assert select(WindowAnswer, updates)
    assert all(w.answer.unknown for w in select(WindowAnswer, updates))


def test_a_resampled_stream_of_a_sensor_with_a_low_rate_raises_an_error(linear_model, oak):
    slow = to_blocks(oak[::8], fs=FS / 8)
    with pytest.raises(RecordingError, match=r"narrow band: sampled at 500 Hz.*Train with --resample 500"):
        run(linear_model, resampled((block for block in slow), FS))
    adapted = replace(
        linear_model, manifest=linear_model.manifest.model_copy(update={"adapted": {"map": "shift"}})
    )
    assert not adapted.bandwidth_problems(FS / 8)


def test_a_change_of_the_rate_restarts_the_recognition(linear_model, oak):
    _, updates = run(linear_model, [*to_blocks(oak), *to_blocks(oak[:3000], fs=2 * FS)])
    assert any(n.message.startswith("restart") for n in select(Notice, updates))
    assert sum(e.kind == "contact" for e in select(Event, updates)) == 2


def test_wheels_are_always_in_contact_and_the_verdict_follows_the_ground(linear_model, oak):
    quiet = 1e-4 * np.random.default_rng(3).standard_normal(4000)
    x = np.concatenate([oak, quiet, signal(SURFACES["slate"], 5, 6000)])
    settings = OnlineSettings(window_s=0.25, always_in_contact=True)
    _, updates = run(linear_model, to_blocks(x), settings)
    assert [e.kind for e in select(Event, updates)] == ["contact"]
    answers = select(WindowAnswer, updates)
    assert [w.start for w in answers] == list(range(0, len(x) - 1000 + 1, 500))
    assert answers[-1].verdict.surface == "slate"
    # A hand-held tool would have been lifted.
    hand_events = select(Event, run(linear_model, to_blocks(x))[1])
    assert [e.kind for e in hand_events][:2] == ["contact", "lift-off"]


def test_a_model_of_long_recordings_classifies_windows_of_five_seconds_with_a_notice(linear_model, oak):
    manifest = linear_model.manifest.model_copy(update={"shortest_s": 52.0})
    model = replace(linear_model, manifest=manifest)
    session, updates = run(model, to_blocks(np.tile(oak, 4)), OnlineSettings(starts_in_contact=True))
    assert session.recogniser.window == 5 * FS
    (notice,) = select(Notice, updates)
    assert notice.message.startswith("window: 5 s, but the training recordings have 52 s")
    assert select(WindowAnswer, updates)
    session, updates = run(model, to_blocks(oak), OnlineSettings(starts_in_contact=True, window_s=1.0))
    assert (session.recogniser.window, select(Notice, updates)) == (FS, [])


def test_a_block_without_samples_causes_a_notice_only(linear_model, oak):
    silent = Block(0.0, np.empty((0, 1)), 0.0, "m/s^2", 0, ("silence: no message for 1.0 s",))
    _, updates = run(linear_model, [silent, *to_blocks(oak), silent])
    assert len(select(Notice, updates)) == 2
    assert len(select(WindowAnswer, updates)) == len(
        select(WindowAnswer, run(linear_model, to_blocks(oak))[1])
    )


def test_listen_runs_a_session_on_a_recording_or_on_blocks(linear_model, oak, tmp_path):
    linear_model.save(tmp_path / "m.skops")
    expected = [w.answer.probabilities for w in select(WindowAnswer, run(linear_model, to_blocks(oak))[1])]
    for source in (Recording(oak, FS, "m/s^2", "oak"), iter(to_blocks(oak))):
        updates = select(WindowAnswer, listen(tmp_path / "m.skops", source, settings=MOVING))
        assert [w.answer.probabilities for w in updates] == expected
    with pytest.raises(RecordingError, match="sampling rate is missing"):
        listen(linear_model, "-")


FROM_REST = OnlineSettings(window_s=0.25)
QUIET = 0.005 * np.random.default_rng(0).normal(size=round(20 * FS))
AFTER_5_S = np.arange(len(QUIET)) > 5 * FS
HUM = 0.05 * np.sin(2 * np.pi * 100 * np.arange(len(QUIET)) / FS)


@pytest.mark.parametrize(
    "steady",
    [QUIET * np.where(AFTER_5_S, 1.4, 1), QUIET * np.where(AFTER_5_S, 3, 1), QUIET + HUM * AFTER_5_S],
)
def test_a_constant_level_becomes_the_noise_floor_with_a_notice(linear_model, oak, steady):
    stroke = steady.copy()
    stroke[round(12 * FS) : round(13.5 * FS)] += oak[: round(1.5 * FS)]
    for x, stroke_events in ((steady, []), (stroke, ["contact", "lift-off"])):
        _, updates = run(linear_model, to_blocks(x), FROM_REST)
        kinds = [e.kind for e in select(Event, updates) if e.kind != "stroke"]
        assert kinds == ["contact", "lift-off", *stroke_events]
        assert [n.message for n in select(Notice, updates)] == [
            "noise: constant level for 4 s, used as the new noise floor"
        ]
        assert all(w.stop < 9.5 * FS or 12 * FS < w.stop < 14 * FS for w in select(WindowAnswer, updates))


@pytest.mark.parametrize(("padding", "padding_s"), [(9.81, 0.1), (9.81, 0.2), (9.81, 3.0)])
def test_zeros_and_held_values_do_not_set_the_noise_floor(linear_model, oak, padding, padding_s):
    x = QUIET[: round(8 * FS)] + 9.81
    x[: round(padding_s * FS)] = padding
    x[round(4 * FS) : round(4.5 * FS)] = x[round(4 * FS)]
    x[round(5 * FS) : round(6 * FS)] += oak[: round(FS)]
    _, updates = run(linear_model, to_blocks(x), FROM_REST)
    contacts = [e.sample / FS for e in select(Event, updates) if e.kind == "contact"]
    assert contacts == [pytest.approx(5.0, abs=0.05)]
