"""A session: blocks in, what is wrong with the stream said and survived."""

from dataclasses import replace

import numpy as np
import pytest
from toy_surfaces import FS, SURFACES, signal

from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recognition import Block, Event, Notice, OnlineSettings, Session, WindowAnswer, listen
from texclass.recognition.live.session import Defects
from texclass.recognition.sources.blocks import resampled
from texclass.recording import Recording, RecordingError

MOVING = OnlineSettings(window_s=0.25, assume_contact=True)


def blocks(x, n=100, fs=FS, unit="m/s^2", **facts):
    return [Block(k / fs, x[k : k + n, None], fs, unit, **facts) for k in range(0, len(x), n)]


def run(model, given, settings=MOVING):
    session = Session(model, settings=settings)
    return session, list(session.run(given))


def of(kind, found):
    return [update for update in found if isinstance(update, kind)]


@pytest.fixture(scope="module")
def oak():
    return signal(SURFACES["oak"], 3, 6000)


def test_lost_samples_and_flags_are_said_and_survived(linear_model, oak):
    given = blocks(oak)
    given[20] = Block(0.5, given[20].samples, FS, "m/s^2", 40, ("lost: 40 samples", "clock jumps: 1"))
    session, found = run(linear_model, given)
    assert [n.what for n in of(Notice, found)] == ["lost: 40 samples", "clock jumps: 1"]
    assert session.n_lost == 40
    assert session.live.n_samples == len(oak) + 40
    assert [e.kind for e in of(Event, found)] == ["contact", "break"]
    assert of(WindowAnswer, found)[-1].verdict.surface == "oak"


def test_samples_that_are_not_finite_are_bridged_or_lost(linear_model, oak):
    bad = oak.copy()
    bad[2500:2510] = np.nan
    session, found = run(linear_model, blocks(bad))
    assert session.n_lost == 10
    assert "not finite: 10 samples" in of(Notice, found)[0].what
    assert [e.kind for e in of(Event, found)] == ["contact"]
    assert of(WindowAnswer, found)[-1].verdict.surface == "oak"
    bad[2500:2520] = np.nan
    assert [e.kind for e in of(Event, run(linear_model, blocks(bad))[1])] == ["contact", "break"]


@pytest.mark.parametrize("glitch", [1e9, 3.4e38, -1e5, np.inf])
@pytest.mark.parametrize("settings", [MOVING, OnlineSettings(window_s=0.25)], ids=["moving", "from rest"])
def test_one_wild_sample_is_told_and_the_answer_is_back_within_a_second(linear_model, oak, glitch, settings):
    x = np.concatenate([0.001 * np.random.default_rng(0).standard_normal(2000), oak])
    at = 4000
    expected = of(WindowAnswer, run(linear_model, blocks(x), settings)[1])
    x[at] = glitch
    session, found = run(linear_model, blocks(x), settings)
    (notice,) = of(Notice, found)
    assert notice.what.startswith("not finite: 1" if abs(glitch) > 1e15 else "glitch: 1 samples")
    assert session.n_lost == 1
    told = of(WindowAnswer, found)
    assert [w.stop for w in told] == [w.stop for w in expected]
    after = [w for w in told if at < w.stop <= at + FS]
    assert len(after) >= 4
    assert {w.answer.surface for w in after} == {"oak"}
    again = [(w.answer, e.answer) for w, e in zip(told, expected, strict=True) if w.start > at]
    assert all(now.probabilities == before.probabilities for now, before in again)


def test_a_wild_sample_is_survived_where_the_stream_is_resampled(linear_model, oak):
    x = np.repeat(oak, 2)
    x[4000] = 3.4e38
    source = resampled((block for block in blocks(x, fs=2 * FS)), FS)
    _, found = run(linear_model, source)
    assert any(n.what.startswith(("glitch", "not finite")) for n in of(Notice, found))
    told = of(WindowAnswer, found)
    assert next(w.stop for w in told if w.stop > 2000) <= 2000 + 0.3 * FS
    assert (told[-1].answer.surface, told[-1].stop > 5400) == ("oak", True)


def test_a_wire_that_stays_loose_is_told_a_few_times_and_the_stream_goes_on(linear_model, oak):
    x = np.tile(oak, 4)
    loose = slice(2000, 18_000)
    x[loose] = np.random.default_rng(1).choice([-1e9, 1e9, np.nan], 16_000)
    session, found = run(linear_model, blocks(x))
    assert 2 <= len(of(Notice, found)) <= 6
    assert "like it" in of(Notice, found)[-1].what
    assert session.n_lost >= 15_000
    last = of(WindowAnswer, found)[-1]
    assert last.answer.surface == "oak"
    assert last.stop >= len(x) - 1000


def test_a_new_level_is_no_glitch_for_long(linear_model, oak):
    x = np.concatenate([oak, oak + 1e6])
    session, found = run(linear_model, blocks(x))
    assert session.n_lost == round(0.1 * FS) - 1
    assert [e.kind for e in of(Event, found)] == ["contact", "break"]
    assert of(WindowAnswer, found)[-1].stop >= len(x) - 1000


@pytest.mark.parametrize("size", [1, 7, 400])
def test_mended_samples_do_not_depend_on_blocks(linear_model, size):
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
    rows[150] = [3.0, 1e9]  # of which only the first is acceleration

    def mended(size):
        defects, parts, lost = Defects(linear_model, 1, FS, 1.0), [], []
        for k in range(0, len(rows), size):
            for n, part in defects.mended(rows[k : k + size])[0]:
                lost += [n] * (n > 0)
                parts.append(part)
        return lost, np.concatenate(parts)

    lost, whole = mended(size)
    assert lost == [2, TIMESTAMPS.max_gap + 1, 90]
    np.testing.assert_array_equal(whole, mended(400)[1])
    np.testing.assert_allclose(whole[48], (rows[49] + rows[51]) / 2)
    assert len(whole) + sum(lost) == 400
    assert Defects(linear_model, 1, FS, 0.5).far == 2 * max(
        100 * linear_model.manifest.peak_acceleration, 1000
    )


def test_a_loss_that_is_reported_without_samples_interrupts_the_stream(linear_model, oak):
    given = blocks(oak)
    given.insert(30, Block(0.75, oak[:0, None], FS, "m/s^2", 400))
    session, found = run(linear_model, given)
    assert session.n_lost == 400
    assert session.live.n_samples == len(oak) + 400
    assert "break" in [e.kind for e in of(Event, found)]


def test_notices_of_one_kind_are_said_once_in_five_seconds_and_counted(linear_model, oak):
    given = [Block(k / 10, oak[:2, None], FS, "m/s^2", 0, (f"gaps: {k}", "odd")) for k in range(120)]
    _, found = run(linear_model, given)
    assert [n.what for n in of(Notice, found)] == [
        "gaps: 0", "odd", "gaps: 50 (49 like it in between)", "odd (49 like it in between)",
        "gaps: 100 (49 like it in between)", "odd (49 like it in between)",
        "gaps: 119 (19 like it)", "odd (19 like it)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("fs", "unit", "what"), [(2000.0, "m/s^2", "wrong rate: 2000 Hz"), (FS, "counts", "wrong unit: counts")]
)
def test_a_wrong_rate_or_unit_is_said_once_and_answers_are_unknown(linear_model, oak, fs, unit, what):
    _, found = run(linear_model, blocks(oak, fs=fs, unit=unit))
    assert [n.what.startswith(what) for n in of(Notice, found)] == [True]
    assert of(WindowAnswer, found)
    assert all(w.answer.unknown for w in of(WindowAnswer, found))


def test_a_stream_from_a_sensor_of_too_low_a_rate_is_refused_although_resampled(linear_model, oak):
    slow = blocks(oak[::8], fs=FS / 8)
    with pytest.raises(RecordingError, match=r"narrow band: sampled at 500 Hz.*Train with --resample 500"):
        run(linear_model, resampled((block for block in slow), FS))
    adapted = replace(
        linear_model, manifest=linear_model.manifest.model_copy(update={"adapted": {"map": "shift"}})
    )
    assert not adapted.bandwidth_problems(FS / 8)


def test_a_rate_that_changes_begins_the_stream_anew(linear_model, oak):
    _, found = run(linear_model, [*blocks(oak), *blocks(oak[:3000], fs=2 * FS)])
    assert any("begun anew" in n.what for n in of(Notice, found))
    assert sum(e.kind == "contact" for e in of(Event, found)) == 2


def test_wheels_are_always_in_contact_and_go_on_to_the_next_ground(linear_model, oak):
    quiet = 1e-4 * np.random.default_rng(3).standard_normal(4000)
    x = np.concatenate([oak, quiet, signal(SURFACES["slate"], 5, 6000)])
    settings = OnlineSettings(window_s=0.25, always_in_contact=True)
    _, found = run(linear_model, blocks(x), settings)
    assert [e.kind for e in of(Event, found)] == ["contact"]
    told = of(WindowAnswer, found)
    assert [w.start for w in told] == list(range(0, len(x) - 1000 + 1, 500))
    assert told[-1].verdict.surface == "slate"
    hand = of(Event, run(linear_model, blocks(x))[1])  # a hand-held tool, on the other hand, was lifted
    assert [e.kind for e in hand][:2] == ["contact", "lift-off"]


def test_a_model_of_runs_of_minutes_answers_windows_of_seconds_and_says_so(linear_model, oak):
    runs = replace(linear_model, manifest=linear_model.manifest.model_copy(update={"shortest_s": 52.0}))
    session, found = run(runs, blocks(np.tile(oak, 4)), OnlineSettings(assume_contact=True))
    assert session.live.window == 5 * FS
    assert [n.what.startswith("window: 5 s, trained on runs of 52 s") for n in of(Notice, found)] == [True]
    assert of(WindowAnswer, found)
    asked = run(runs, blocks(oak), OnlineSettings(assume_contact=True, window_s=1.0))
    assert (asked[0].live.window, of(Notice, asked[1])) == (FS, [])


def test_a_block_that_only_reports_changes_nothing(linear_model, oak):
    silent = Block(0.0, np.empty((0, 1)), 0.0, "m/s^2", 0, ("silent: nothing for 1.0 s",))
    _, found = run(linear_model, [silent, *blocks(oak), silent])
    assert len(of(Notice, found)) == 2
    assert len(of(WindowAnswer, found)) == len(of(WindowAnswer, run(linear_model, blocks(oak))[1]))


def test_listening_to_a_recording_or_to_blocks_is_a_session(linear_model, oak, tmp_path):
    linear_model.save(tmp_path / "m.skops")
    expected = [w.answer.probabilities for w in of(WindowAnswer, run(linear_model, blocks(oak))[1])]
    for source in (Recording(oak, FS, "m/s^2", "oak"), iter(blocks(oak))):
        found = of(WindowAnswer, listen(tmp_path / "m.skops", source, settings=MOVING))
        assert [w.answer.probabilities for w in found] == expected
    with pytest.raises(RecordingError, match="fs is missing"):
        listen(linear_model, "-")


LISTENING = OnlineSettings(window_s=0.25)
QUIET = 0.005 * np.random.default_rng(0).normal(size=round(20 * FS))
LATER = np.arange(len(QUIET)) > 5 * FS
HUM = 0.05 * np.sin(2 * np.pi * 100 * np.arange(len(QUIET)) / FS)


@pytest.mark.parametrize(
    "steady", [QUIET * np.where(LATER, 1.4, 1), QUIET * np.where(LATER, 3, 1), QUIET + HUM * LATER]
)
def test_a_level_that_stays_the_same_becomes_the_noise_floor_with_a_notice(linear_model, oak, steady):
    stroke = steady.copy()
    stroke[round(12 * FS) : round(13.5 * FS)] += oak[: round(1.5 * FS)]
    for x, later in ((steady, []), (stroke, ["contact", "lift-off"])):
        _, found = run(linear_model, blocks(x), LISTENING)
        kinds = [e.kind for e in of(Event, found) if e.kind != "stroke"]
        assert kinds == ["contact", "lift-off", *later]
        assert [n.what for n in of(Notice, found)] == [
            "noise: the level is steady for 4 s: taken as the new noise floor"
        ]
        assert all(w.stop < 9.5 * FS or 12 * FS < w.stop < 14 * FS for w in of(WindowAnswer, found))


@pytest.mark.parametrize(("padding", "until"), [(9.81, 0.1), (9.81, 0.2), (9.81, 3.0)])
def test_zeros_and_held_values_are_no_noise_floor(linear_model, oak, padding, until):
    x = QUIET[: round(8 * FS)] + 9.81
    x[: round(until * FS)] = padding
    x[round(4 * FS) : round(4.5 * FS)] = x[round(4 * FS)]
    x[round(5 * FS) : round(6 * FS)] += oak[: round(FS)]
    _, found = run(linear_model, blocks(x), LISTENING)
    contacts = [e.sample / FS for e in of(Event, found) if e.kind == "contact"]
    assert contacts == [pytest.approx(5.0, abs=0.05)]
