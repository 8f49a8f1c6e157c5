"""Evidence over windows: a majority, and a sum of log posteriors that equals Bayes' rule."""

import numpy as np
import pytest

from texclass.recognition import Answer, Evidence, expected_calibration_error, fit_calibration
from texclass.recognition.probabilities import fit_correlation

SURFACES = ("cork", "felt", "oak")


def answer(p, *, unknown=False):
    best, second = np.argsort(-np.asarray(p))[:2]
    named = dict(zip(SURFACES, p, strict=True))
    return Answer("w", SURFACES[best], p[best], SURFACES[second], unknown, 0.5, (), named)


def together(rows, kind="sequential", **settings):
    evidence = Evidence(SURFACES, kind, **settings)
    return [evidence.add(answer(list(p)), 0.1 * k) for k, p in enumerate(rows, 1)]


DRAWN = np.random.default_rng(0).dirichlet(np.ones(3), 6)
ONE = np.array([0.5, 0.3, 0.2])


@pytest.mark.parametrize(
    ("rows", "settings", "posterior", "rel"),
    [
        (DRAWN, {"correlation": 0.0}, np.prod(DRAWN, axis=0), 1e-9),  # Bayes' rule
        (DRAWN[:1], {"correlation": 0.3}, DRAWN[0], 1e-9),  # one window keeps what it says
        # Halves are felt twice: 1 + 4 of them.
        ([ONE] * 5, {"correlation": 0.0, "window_s": 1.0, "hop_s": 0.5}, ONE**3, 1e-6),
        ([ONE] * 400, {"correlation": 0.5}, ONE**2, 1e-2),  # worth two at most
        ([ONE] * 400, {}, ONE, 1e-6),  # nothing is known of how they agree
    ],
)
def test_windows_add_up_to_as_many_as_are_independent(rows, settings, posterior, rel):
    found = list(together(rows, **settings)[-1].probabilities.values())
    assert found == pytest.approx((posterior / posterior.sum()).tolist(), rel=rel)


def test_what_training_does_not_rule_out_is_left_to_all_surfaces():
    certain = together([[1.0, 0.0, 0.0]] * 50, correlation=0.0, lapse=0.03)[-1]
    assert certain.probability == pytest.approx(0.98)


def test_what_a_contact_says_in_the_end_is_as_often_right_as_it_says():
    """Contacts whose windows share a deviation of their own: fitted on some, asked of others."""
    n_contacts, n_windows, K = 300, 15, len(SURFACES)
    rng = np.random.default_rng(5)

    def contacts():
        labels = rng.integers(0, K, n_contacts)
        own = rng.normal(0, 1.2, (n_contacts, 1, K))
        s = 1.5 * np.eye(K)[labels][:, None] + own + rng.normal(0, 1.0, (n_contacts, n_windows, K))
        return s.reshape(-1, K), np.repeat(labels, n_windows), np.repeat(np.arange(n_contacts), n_windows)

    scores, labels, numbers = contacts()
    calibration = fit_calibration(scores, labels)
    found = fit_correlation(calibration(scores), labels, numbers)
    assert 0.3 < found < 0.9
    scores, labels, numbers = contacts()

    def said(correlation):
        last = []
        for p in calibration(scores).reshape(n_contacts, n_windows, K):
            lapse = 1 / (n_contacts + 2)
            evidence = Evidence(SURFACES, window_s=1.0, hop_s=1.0, correlation=correlation, lapse=lapse)
            last.append([evidence.add(answer(one.tolist()), 1.0) for one in p][-1])
        right = [v.surface == SURFACES[k] for v, k in zip(last, labels[::n_windows], strict=True)]
        return expected_calibration_error([v.probability for v in last], right, 10), np.mean(right)

    error, share = said(found)
    assert error < 0.06
    assert 0.5 < share < 0.9
    assert said(0.0)[0] > 0.15  # as if they were independent


def test_the_correlation_of_windows_that_share_nothing_is_none():
    rng = np.random.default_rng(6)
    labels, numbers = np.repeat(rng.integers(0, 3, 300), 6), np.repeat(np.arange(300), 6)
    scores = 1.0 * np.eye(3)[labels] + rng.normal(0, 1.0, (1800, 3))
    assert fit_correlation(fit_calibration(scores, labels)(scores), labels, numbers) < 0.1
    order = rng.permutation(1800)  # in which recordings are told does not matter
    order = order[np.argsort(rng.permutation(300)[numbers[order]], kind="stable")]
    p = fit_calibration(scores, labels)(scores)
    one, other = (fit_correlation(p[i], labels[i], numbers[i]) for i in (np.arange(1800), order))
    assert one == pytest.approx(other, abs=0.05)
    with pytest.raises(ValueError, match="several windows"):
        fit_correlation(p, labels, np.arange(1800))


def test_a_majority_counts_votes_and_breaks_ties_by_probability():
    rows = [[0.9, 0.05, 0.05], [0.1, 0.5, 0.4], [0.1, 0.5, 0.4], [0.9, 0.05, 0.05]]
    told = together(rows, "majority")
    assert [v.surface for v in told] == ["cork", "cork", "felt", "cork"]
    assert told[2].probability == pytest.approx(3 / 6, abs=1e-5)


def test_a_verdict_is_sure_as_long_as_its_probability_says_so():
    evidence = Evidence(SURFACES, confidence=0.9, correlation=0.0)
    sure = [evidence.add(answer(p), 1.0).sure for p in ([0.7, 0.2, 0.1], [0.8, 0.1, 0.1], [0.05, 0.9, 0.05])]
    assert sure == [False, True, False]
    evidence.reset()
    assert evidence.verdict is None
    assert not evidence.add(answer([0.5, 0.3, 0.2]), 1.0).sure


@pytest.mark.parametrize("kind", ["sequential", "majority"])
def test_windows_that_contradict_the_evidence_restart_it(kind):
    cork, felt, oak = [0.97, 0.02, 0.01], [0.02, 0.97, 0.01], [0.02, 0.01, 0.97]
    told = together([cork] * 9 + [felt] * 2 + [cork] + [felt, felt, oak] + [felt] * 4, kind, correlation=0.1)
    changed = [i for i, verdict in enumerate(told) if verdict.changed_from]
    assert changed == [17]
    assert (told[17].surface, told[17].changed_from, told[17].n_windows) == ("felt", "cork", 3)
    assert {verdict.surface for verdict in told[:17]} == {"cork"}
    assert told[18].n_windows == 4
    # Overlapping windows share what they felt, and windows of unknown surfaces contradict nothing.
    rows = [cork] * 12 + [felt] * 9
    overlapping = together(rows, kind, correlation=0.1, hop_s=0.25)
    assert [i for i, verdict in enumerate(overlapping) if verdict.changed_from] == [12 + 8]
    evidence = Evidence(SURFACES, kind)
    for p in rows:
        evidence.add(answer(p, unknown=p is felt), 1.0)
    assert (evidence.verdict.surface, evidence.verdict.changed_from) == ("cork", "")


def test_forgetting_lets_a_new_surface_win():
    rows = [[0.98, 0.01, 0.01]] * 30 + [[0.29, 0.42, 0.29]] * 10
    kept, fading = (together(rows, forget_s=f)[-1].surface for f in (float("inf"), 3.0))
    assert (kept, fading) == ("cork", "felt")


@pytest.mark.parametrize("kind", ["sequential", "majority"])
def test_where_evidence_fades_all_of_a_verdict_is_of_what_was_felt_lately(kind):
    evidence = Evidence(SURFACES, kind, forget_s=3.0, confidence=0.5, correlation=0.2)
    for _ in range(200):
        evidence.add(answer([0.98, 0.01, 0.01], unknown=True), 1.0)
    assert evidence.verdict.probability > 0.5
    assert (evidence.verdict.unknown, evidence.verdict.sure) == (True, False)
    told = [evidence.add(answer([0.3, 0.4, 0.3]), 1.0) for _ in range(12)]
    last = told[-1]
    assert (last.surface, last.unknown) == ("felt", False)
    assert kind == "majority" or not last.sure


def test_half_of_the_windows_unknown_makes_the_contact_unknown():
    evidence = Evidence(SURFACES)
    told = [evidence.add(answer([0.8, 0.1, 0.1], unknown=u), 1.0).unknown for u in (True, False, False)]
    assert told == [True, True, False]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "mean"}, "majority"),
        ({"confidence": 1.0}, "confidence"),
        ({"correlation": 1.5}, "correlation"),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Evidence(SURFACES, **settings)
