"""Models, scores and conversions reject invalid input with a message that states what was expected."""

import numpy as np
import pytest

from texclass.vibration import (
    Autoregression,
    DecayingModes,
    LatticeInverse,
    LatticeSynthesis,
    MajorFrequencies,
    major_frequencies,
    scores,
)
from texclass.vibration import autoregressive as ar
from texclass.vibration import line_spectrum as ls
from texclass.vibration.decaying_modes import fit_matrix_pencil, fit_prony
from texclass.vibration.decaying_sinusoid import TapModel, fit_okamura, fit_tap_model
from texclass.vibration.interpolation import ModelBlend, interpolate
from texclass.vibration.order import select_order
from texclass.vibration.rising_peaks import segment_rising_peaks, vibration_band

NAN, INF = np.nan, np.inf
NOISE = np.random.default_rng(0).standard_normal(600)
A, B = (Autoregression(np.random.default_rng(i).uniform(-0.9, 0.9, 18), 1.0) for i in (1, 2))
THREE = Autoregression([0.5, -0.2, 0.1], 1.0)
ENDLESS = Autoregression(np.full(1000, 0.9), 1.0)
SLOW = MajorFrequencies([40.0], [1.0], [0.1])
ONES = np.ones(600)
INVALID_K = ([1.0], [0.5, -1.0], [NAN, 0.0], [INF], [], 0.5)
INVALID_LSF = ([0.0, 1.0], [1.0, np.pi], [1.0, 1.0], [2.0, 1.0], [NAN], [], 0.5)
INVALID_SIGNAL = ([], [1.0, NAN], [INF, 0], np.ones((2, 2, 2)), [1j, 2], 3.0)
INVALID_TAPS = (
    ([], []),
    ([ONES], [1.0, 2.0]),
    ([ONES], [0.0]),
    ([[0, NAN, 1, 0, 2]], [1.0]),
    ([0 * ONES], [1.0]),
)
SCORES = (
    scores.rms_spectral_error, scores.goodness_of_fit, scores.mean_absolute_difference,
    scores.log_spectral_distance, lambda a, b: scores.band_energy_distance(a, b, 1e4),
)  # fmt: skip

INVALID_CALLS = {
    "fit": [
        *(lambda x=x: ar.fit(x, 1) for x in INVALID_SIGNAL),
        lambda: ar.fit([1.0], 0),
        lambda: ar.fit(ONES, 1, method="magic"),
        lambda: ar.fit(ONES, 1, variance="magic"),
        lambda: ar.from_direct_form([1.0, -2.1, 1.2], 1.0),
        lambda: ar.from_direct_form([0.5, 0.1], 1.0),
        lambda: ar.from_autocorrelation([0.0, 1.0]),
        lambda: ar.from_autocorrelation([1.0, NAN]),
        lambda: ar.from_autocorrelation(np.ones((2, 0))),
    ],
    "Autoregression": [
        *(lambda k=k, g=g: Autoregression(k, g) for k, g in (([1.0], 1.0), ([NAN], 1.0), ([0.5], -1.0))),
        *(lambda k=k, g=g: Autoregression(k, g) for k, g in (([0.5], INF), ([0.5], [1.0, 2.0]), (0.5, 1.0))),
        lambda: THREE.truncate(4),
        lambda: THREE.cepstrum(0),
        lambda: THREE.log_spectrum_db([[0.1]]),
    ],
    "lattice": [
        lambda: LatticeSynthesis(Autoregression(np.zeros((2, 3)), np.ones(2))),
        lambda: LatticeSynthesis(ENDLESS),
        lambda: LatticeSynthesis(Autoregression([], 1.0)),
        lambda: LatticeSynthesis(THREE, dtype=np.int32),
        lambda: LatticeSynthesis(THREE, level=1e-160, dtype=np.float32),
        lambda: LatticeInverse(THREE, level=0.0),
        lambda: LatticeSynthesis(THREE).process([1.0, NAN]),
        lambda: LatticeSynthesis(THREE).process(np.ones((2, 2))),
        lambda: LatticeSynthesis(THREE).process_varying(np.ones(2), np.ones((2, 3)), np.ones(2)),
        lambda: LatticeSynthesis(THREE).process_varying(np.ones(2), np.zeros((2, 3)), np.array([1.0, -1.0])),
    ],
    "line spectrum": [
        *(lambda k=k: ls.from_reflection(k) for k in INVALID_K),
        *(lambda x=x: ls.to_reflection(x) for x in INVALID_LSF),
        *(lambda x=x: ls.conditioning(x) for x in INVALID_LSF),
        *(lambda x=x, g=g: ls.spread(x, g) for x, g in (([1, NAN], 0), ([], 0), ([1.0], 2), ([1.0], -0.1))),
    ],
    "interpolation": [
        *(lambda w=w: interpolate(A, B, w) for w in (-0.01, 1.01, NAN, [0.5, 2.0])),
        *(lambda w=w: ModelBlend([A, B]).at(w) for w in ([0.5, 0.6], [-0.5, 1.5], [NAN, 1.0], [1.0], 1.0)),
        lambda: ModelBlend([A, B]).at([0.2, 0.3, 0.5]),
        *(lambda m=m: ModelBlend(m) for m in ([], [A, THREE], [Autoregression([], 1.0)], A)),
        lambda: ModelBlend([Autoregression([[0.5]], [1.0])]),
        lambda: ModelBlend([ENDLESS], loudness="level"),
        lambda: ModelBlend([ENDLESS, Autoregression(np.zeros(1000), 1.0)], loudness="level"),
        lambda: ModelBlend([A], loudness="rms"),
    ],
    "order": [
        *(
            lambda options=options: select_order(NOISE, **{"max_order": 5, **options})
            for options in ({"criterion": "bic"}, {"method": "modified_covariance"}, {"max_error": -1.0})
        ),
        lambda: select_order(NOISE, 5, max_error=0.1, criterion="aicc"),
        lambda: select_order(NOISE, 0),
    ],
    "modes": [
        *(
            lambda m=m: DecayingModes(*m)
            for m in ((-1.0, 1, 1, 0), (1.0, 0, 1, 0), (1.0, 1, -1, 0), (1.0, 1, 1, NAN))
        ),
        *(lambda x=x: fit_matrix_pencil(x, 1e4) for x in ([1.0, 2.0, 3.0], np.ones((9, 2)), [1, NAN, 2, 3])),
        *(lambda order=order: fit_matrix_pencil(np.ones(9), 1e4, order=order) for order in (0, 5)),
        *(lambda x=x: fit_prony(x, 0.1) for x in ([1.0], [1, INF, 2])),
        *(lambda r=r: fit_prony(NOISE, r) for r in (0.0, NAN)),
        lambda: fit_prony(NOISE, 0.1, max_order=0),
    ],
    "taps": [
        *(lambda m=m: TapModel(*m) for m in ((NAN, 1, 1), (1, 0, 1), (1, 1, 0), (1, INF, 1))),
        *(lambda t=t, v=v: fit_okamura(t, v, 1e4) for t, v in INVALID_TAPS),
        *(lambda t=t, v=v: fit_tap_model(t, v, 1e4) for t, v in INVALID_TAPS),
        lambda: fit_okamura([[1.0]], [1.0], 1e4),
        lambda: fit_okamura([TapModel(-1500, 600, 592).synthesize(1.0, 200, 25e3)[::-1]], [1.0], 25e3),
    ],
    "major frequencies": [
        lambda: major_frequencies.fit_major_frequencies([1.0, 2.0], 1e4),
        lambda: major_frequencies.fit_major_frequencies([1.0, NAN, 2.0], 1e4),
        lambda: major_frequencies.fit_major_frequencies(NOISE, 1e4, n_frequencies=0),
        lambda: major_frequencies.fit_major_frequencies(NOISE, 0.0),
        lambda: major_frequencies.interpolate(SLOW, SLOW, 1.1),
        lambda: MajorFrequencies([1.0], [-1.0], [0.0]),
        lambda: MajorFrequencies([1.0, 2.0], [1.0], [0.0]),
    ],
    "scores": [
        *(
            lambda s=s, pair=pair: s(*pair)
            for s in SCORES
            for invalid in (np.full(600, NAN), np.ones((600, 2)), np.zeros(0))
            for pair in ((invalid, ONES), (ONES, invalid))
        ),
        *(lambda s=s: s(0 * ONES, ONES) for s in SCORES if s not in SCORES[1:3]),
        *(lambda s=s: s(ONES, np.ones(700)) for s in SCORES[1:3]),
        lambda: scores.band_energy_distance(9.81 * ONES, ONES, 1e4),
        lambda: scores.band_energy_distance(NOISE, NOISE, 50.0),
    ],
    "rising peaks": [
        *(lambda x=x: segment_rising_peaks(x, 0.0) for x in ([], [0.0, NAN])),
        *(lambda d=d: segment_rising_peaks([1.0, 2.0], d) for d in (-1.0, NAN)),
        lambda: segment_rising_peaks([1.0, 2.0], 0.0, threshold=-1.0),
        *(
            lambda p=p: vibration_band([0.0, 1.0, 2.0], p, smoothing_hz=0.0)
            for p in ([0.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0], [1.0, INF, 0.0])
        ),
        lambda: vibration_band([0.0, 1.0, 2.0], [1.0, 2.0, 0.0], smoothing_hz=-1.0),
    ],
}  # fmt: skip


@pytest.mark.parametrize("area", INVALID_CALLS)
def test_invalid_input_raises_a_value_error_with_the_expectation(area):
    for call in INVALID_CALLS[area]:
        with pytest.raises(ValueError, match=r"must|contains \d+ NaN"):
            call()
