"""A session: blocks in, what is wrong with the stream said and survived."""

import numpy as np
import pytest
from toy_surfaces import FS, SURFACES, signal

from texclass.recognition import Block, Event, Notice, OnlineSettings, Session, WindowAnswer, listen
from texclass.recognition.live.session import finite_stretches
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


def test_samples_that_are_not_finite_are_left_out(linear_model, oak):
    bad = oak.copy()
    bad[2500:2510] = np.nan
    session, found = run(linear_model, blocks(bad))
    assert session.n_lost == 10
    assert "not finite: 10 samples" in of(Notice, found)[0].what
    assert of(WindowAnswer, found)[-1].verdict.surface == "oak"


def test_finite_stretches_cover_every_row_once():
    rows = np.array([np.nan, 1, 2, np.inf, np.nan, 3, np.nan])[:, None]
    told = [(lost, kept[:, 0].tolist()) for lost, kept in finite_stretches(rows)]
    assert told == [(1, [1, 2]), (2, [3]), (1, [])]


@pytest.mark.parametrize(
    ("fs", "unit", "what"), [(2000.0, "m/s^2", "wrong rate: 2000 Hz"), (FS, "counts", "wrong unit: counts")]
)
def test_a_wrong_rate_or_unit_is_said_once_and_answers_are_unknown(linear_model, oak, fs, unit, what):
    _, found = run(linear_model, blocks(oak, fs=fs, unit=unit))
    assert [n.what.startswith(what) for n in of(Notice, found)] == [True]
    assert of(WindowAnswer, found)
    assert all(w.answer.unknown for w in of(WindowAnswer, found))


def test_a_rate_that_changes_begins_the_stream_anew(linear_model, oak):
    _, found = run(linear_model, [*blocks(oak), *blocks(oak[:3000], fs=2 * FS)])
    assert any("begun anew" in n.what for n in of(Notice, found))
    assert sum(e.kind == "contact" for e in of(Event, found)) == 2


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
