"""Evidence over windows: a majority, and a sum of log posteriors that equals Bayes' rule."""

import numpy as np
import pytest

from texclass.recognition import Answer, Evidence

MATERIALS = ("cork", "felt", "oak")


def answer(p, *, unknown=False):
    best, second = np.argsort(-np.asarray(p))[:2]
    named = dict(zip(MATERIALS, p, strict=True))
    return Answer("w", MATERIALS[best], p[best], MATERIALS[second], unknown, 0.5, (), named)


def together(rows, kind="sequential", **settings):
    evidence = Evidence(MATERIALS, kind, **settings)
    return [evidence.add(answer(list(p)), 0.1 * k) for k, p in enumerate(rows, 1)]


def test_sequential_evidence_of_independent_windows_is_bayes_rule():
    rows = np.random.default_rng(0).dirichlet(np.ones(3), 6)
    posterior = np.prod(rows, axis=0) / np.prod(rows, axis=0).sum()
    verdict = together(rows, discount=1.0)[-1]
    assert list(verdict.probabilities.values()) == pytest.approx(posterior.tolist(), rel=1e-9)


def test_the_first_window_alone_keeps_its_calibrated_probability():
    verdict = together([[0.2, 0.7, 0.1]], discount=0.3)[0]
    assert dict(verdict.probabilities) == pytest.approx({"cork": 0.2, "felt": 0.7, "oak": 0.1})


def test_windows_that_overlap_count_by_what_they_add():
    rows = [[0.5, 0.3, 0.2]] * 5
    halves = together(rows, discount=1.0, window_s=1.0, hop_s=0.5)[-1]
    log = 3 * np.log(rows[0])  # 1 + 4 halves
    assert list(halves.probabilities.values()) == pytest.approx((np.exp(log) / np.exp(log).sum()).tolist())


def test_a_majority_counts_votes_and_breaks_ties_by_probability():
    rows = [[0.9, 0.05, 0.05], [0.1, 0.5, 0.4], [0.1, 0.5, 0.4], [0.9, 0.05, 0.05]]
    told = together(rows, "majority")
    assert [v.surface for v in told] == ["cork", "cork", "felt", "cork"]
    assert told[2].probability == pytest.approx(3 / 6, abs=1e-5)


def test_evidence_becomes_sure_and_stays_so_until_reset():
    evidence = Evidence(MATERIALS, confidence=0.9, discount=1.0)
    sure = [evidence.add(answer(p), 1.0).sure for p in ([0.7, 0.2, 0.1], [0.8, 0.1, 0.1], [0.05, 0.9, 0.05])]
    assert sure == [False, True, True]
    evidence.reset()
    assert evidence.verdict is None
    assert not evidence.add(answer([0.5, 0.3, 0.2]), 1.0).sure


def test_forgetting_lets_a_new_surface_win():
    rows = [[0.98, 0.01, 0.01]] * 30 + [[0.01, 0.98, 0.01]] * 10
    kept, fading = (together(rows, forget_s=f)[-1].surface for f in (float("inf"), 3.0))
    assert (kept, fading) == ("cork", "felt")


def test_half_of_the_windows_unknown_makes_the_contact_unknown():
    evidence = Evidence(MATERIALS)
    told = [evidence.add(answer([0.8, 0.1, 0.1], unknown=u), 1.0).unknown for u in (True, False, False)]
    assert told == [True, True, False]


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"kind": "mean"}, "majority"), ({"confidence": 1.0}, "confidence"), ({"discount": 0.0}, "discount")],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Evidence(MATERIALS, **settings)
