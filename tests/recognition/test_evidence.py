"""Evidence of the windows of a contact: majority vote and sequential log posterior."""

import numpy as np
import pytest

from texclass.recognition import Answer, Evidence, expected_calibration_error, fit_calibration
from texclass.recognition.probabilities import fit_correlation

SURFACES = ("cork", "felt", "oak")


def answer(p, *, unknown=False):
    best, second = np.argsort(-np.asarray(p))[:2]
    probabilities = dict(zip(SURFACES, p, strict=True))
    return Answer("w", SURFACES[best], p[best], SURFACES[second], unknown, 0.5, (), probabilities)


def verdicts_of(rows, kind="sequential", **settings):
    evidence = Evidence(SURFACES, kind, **settings)
    return [evidence.add(answer(list(p)), 0.1 * k) for k, p in enumerate(rows, 1)]


DRAWN = np.random.default_rng(0).dirichlet(np.ones(3), 6)
ONE = np.array([0.5, 0.3, 0.2])


@pytest.mark.parametrize(
    ("rows", "settings", "posterior", "rel"),
    [
        (DRAWN, {"correlation": 0.0}, np.prod(DRAWN, axis=0), 1e-9),  # Bayes' rule
        (DRAWN[:1], {"correlation": 0.3}, DRAWN[0], 1e-9),  # one window is not changed
        # With an overlap of one half, five windows are worth 1 + 4/2.
        ([ONE] * 5, {"correlation": 0.0, "window_s": 1.0, "hop_s": 0.5}, ONE**3, 1e-6),
        ([ONE] * 400, {"correlation": 0.5}, ONE**2, 1e-2),  # worth at most two
        ([ONE] * 400, {}, ONE, 1e-6),  # the default correlation is 1
    ],
)
def test_windows_add_up_to_their_effective_number(rows, settings, posterior, rel):
    p = list(verdicts_of(rows, **settings)[-1].probabilities.values())
    assert p == pytest.approx((posterior / posterior.sum()).tolist(), rel=rel)


def test_the_lapse_is_distributed_over_all_surfaces():
    certain = verdicts_of([[1.0, 0.0, 0.0]] * 50, correlation=0.0, lapse=0.03)[-1]
    assert certain.probability == pytest.approx(0.98)


def test_the_probabilities_of_contacts_are_calibrated():
    """The windows of a contact share a deviation; the correlation is fitted on other contacts."""
    n_contacts, n_windows, K = 300, 15, len(SURFACES)
    rng = np.random.default_rng(5)

    def contacts():
        labels = rng.integers(0, K, n_contacts)
        shared = rng.normal(0, 1.2, (n_contacts, 1, K))
        s = 1.5 * np.eye(K)[labels][:, None] + shared + rng.normal(0, 1.0, (n_contacts, n_windows, K))
        return s.reshape(-1, K), np.repeat(labels, n_windows), np.repeat(np.arange(n_contacts), n_windows)

    scores, labels, numbers = contacts()
    calibration = fit_calibration(scores, labels)
    correlation = fit_correlation(calibration(scores), labels, numbers)
    assert 0.3 < correlation < 0.9
    scores, labels, numbers = contacts()

    def error_and_accuracy(correlation):
        last = []
        for p in calibration(scores).reshape(n_contacts, n_windows, K):
            lapse = 1 / (n_contacts + 2)
            evidence = Evidence(SURFACES, window_s=1.0, hop_s=1.0, correlation=correlation, lapse=lapse)
            last.append([evidence.add(answer(one.tolist()), 1.0) for one in p][-1])
        hits = [v.surface == SURFACES[k] for v, k in zip(last, labels[::n_windows], strict=True)]
        return expected_calibration_error([v.probability for v in last], hits, 10), np.mean(hits)

    error, accuracy = error_and_accuracy(correlation)
    assert error < 0.06
    assert 0.5 < accuracy < 0.9
    assert error_and_accuracy(0.0)[0] > 0.15  # as if windows were independent


def test_the_correlation_of_independent_windows_is_about_zero():
    rng = np.random.default_rng(6)
    labels, numbers = np.repeat(rng.integers(0, 3, 300), 6), np.repeat(np.arange(300), 6)
    scores = 1.0 * np.eye(3)[labels] + rng.normal(0, 1.0, (1800, 3))
    assert fit_correlation(fit_calibration(scores, labels)(scores), labels, numbers) < 0.1
    order = rng.permutation(1800)  # the order of recordings does not matter
    order = order[np.argsort(rng.permutation(300)[numbers[order]], kind="stable")]
    p = fit_calibration(scores, labels)(scores)
    one, other = (fit_correlation(p[i], labels[i], numbers[i]) for i in (np.arange(1800), order))
    assert one == pytest.approx(other, abs=0.05)
    with pytest.raises(ValueError, match="no contact has two windows"):
        fit_correlation(p, labels, np.arange(1800))


def test_a_majority_counts_votes_and_breaks_ties_by_probability():
    rows = [[0.9, 0.05, 0.05], [0.1, 0.5, 0.4], [0.1, 0.5, 0.4], [0.9, 0.05, 0.05]]
    verdicts = verdicts_of(rows, "majority")
    assert [v.surface for v in verdicts] == ["cork", "cork", "felt", "cork"]
    assert verdicts[2].probability == pytest.approx(3 / 6, abs=1e-5)


def test_a_verdict_is_sure_while_its_probability_reaches_the_confidence():
    evidence = Evidence(SURFACES, confidence=0.9, correlation=0.0)
    sure = [evidence.add(answer(p), 1.0).sure for p in ([0.7, 0.2, 0.1], [0.8, 0.1, 0.1], [0.05, 0.9, 0.05])]
    assert sure == [False, True, False]
    evidence.reset()
    assert evidence.verdict is None
    assert not evidence.add(answer([0.5, 0.3, 0.2]), 1.0).sure


@pytest.mark.parametrize("kind", ["sequential", "majority"])
def test_windows_that_contradict_the_evidence_restart_it(kind):
    cork, felt, oak = [0.97, 0.02, 0.01], [0.02, 0.97, 0.01], [0.02, 0.01, 0.97]
    verdicts = verdicts_of(
        [cork] * 9 + [felt] * 2 + [cork] + [felt, felt, oak] + [felt] * 4, kind, correlation=0.1
    )
    restarts = [i for i, verdict in enumerate(verdicts) if verdict.previous_surface]
    assert restarts == [17]
    assert (verdicts[17].surface, verdicts[17].previous_surface, verdicts[17].n_windows) == (
        "felt",
        "cork",
        3,
    )
    assert {verdict.surface for verdict in verdicts[:17]} == {"cork"}
    assert verdicts[18].n_windows == 4
    # Overlapping windows count less, and windows of unknown surfaces do not contradict.
    rows = [cork] * 12 + [felt] * 9
    overlapping = verdicts_of(rows, kind, correlation=0.1, hop_s=0.25)
    assert [i for i, verdict in enumerate(overlapping) if verdict.previous_surface] == [12 + 8]
    evidence = Evidence(SURFACES, kind)
    for p in rows:
        evidence.add(answer(p, unknown=p is felt), 1.0)
    assert (evidence.verdict.surface, evidence.verdict.previous_surface) == ("cork", "")


def test_decay_follows_a_new_surface():
    rows = [[0.98, 0.01, 0.01]] * 30 + [[0.29, 0.42, 0.29]] * 10
    without_decay, with_decay = (verdicts_of(rows, forget_s=f)[-1].surface for f in (float("inf"), 3.0))
    assert (without_decay, with_decay) == ("cork", "felt")


@pytest.mark.parametrize("kind", ["sequential", "majority"])
def test_decay_also_applies_to_unknown_windows_and_to_certainty(kind):
    evidence = Evidence(SURFACES, kind, forget_s=3.0, confidence=0.5, correlation=0.2)
    for _ in range(200):
        evidence.add(answer([0.98, 0.01, 0.01], unknown=True), 1.0)
    assert evidence.verdict.probability > 0.5
    assert (evidence.verdict.unknown, evidence.verdict.sure) == (True, False)
    verdicts = [evidence.add(answer([0.3, 0.4, 0.3]), 1.0) for _ in range(12)]
    last = verdicts[-1]
    assert (last.surface, last.unknown) == ("felt", False)
    assert kind == "majority" or not last.sure


def test_half_of_the_windows_unknown_makes_the_contact_unknown():
    evidence = Evidence(SURFACES)
    verdicts = [evidence.add(answer([0.8, 0.1, 0.1], unknown=u), 1.0).unknown for u in (True, False, False)]
    assert verdicts == [True, True, False]


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
