"""How the vibration changes during a movement: its course, its fluctuation, its persistence.

Band levels are compared with those of the same band at other times. A sensor that drifts multiplies a band
by the same factor at all times, which cancels: these columns keep what a spectrum loses from one day to the
next.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.bands import FLOOR, Periodogram, periodogram
from texclass.features.contract import UndefinedFeatureError, feature
from texclass.features.divided import divisible, named_pieces
from texclass.features.frames import window_of
from texclass.features.transforms import BLOCK, require, unit32
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples

N_PARTS = 6
"""Parts whose periodograms the course is taken from."""
FRAME = 64
"""Samples in a frame of `octave_frames`."""
N_OCTAVES = 5
"""Octaves that a frame resolves: bins 17-32, 9-16, 5-8, 3-4 and 2."""


@transform
def sixths(view: PhaseView) -> tuple[Periodogram, ...]:
    """Return the periodograms of six equal parts of the movement."""
    x, n = unit32(view), view.n_samples // N_PARTS
    return tuple(periodogram(x[i * n : (i + 1) * n], view.fs) for i in range(N_PARTS))


@transform
def octave_frames(view: PhaseView) -> Samples:
    """Return the power of Hann frames, one after the other, in octaves from fs/2 down, (n_frames, N_OCTAVES).

    In arbitrary units, floored far below the mean.
    """
    require(view, 8 * FRAME, f"8 frames of {FRAME} samples")
    window = window_of("hann", FRAME)
    frames = unit32(view)[: view.n_samples // FRAME * FRAME].reshape(-1, FRAME)
    power = np.concatenate([_octaves(frames[k : k + BLOCK] * window) for k in range(0, len(frames), BLOCK)])
    if not power.any():
        raise UndefinedFeatureError("silence: no frame holds any power")
    return np.asarray(np.maximum(power, FLOOR * power.mean()))


def _octaves(frames: NDArray[np.float32]) -> Samples:
    spectra = fft.rfft(frames)[:, 2:]
    power = spectra.real**2 + spectra.imag**2
    return np.add.reduceat(power, [0, 1, 3, 7, 15], axis=1, dtype=np.float64)[:, ::-1]


def _course_names(*, n_parts: int, octaves: tuple[int, int]) -> tuple[str, ...]:
    return tuple(f"term{j}.o{k}" for j in range(1, n_parts) for k in range(*octaves))


@feature(
    phase="movement",
    unit="log10(1)",
    reference="texclass; cosine transform over time of log band levels",
    outputs=named_pieces(_course_names),
    depends_on=("rate",),
)
@divisible
def band_course(view: PhaseView, *, n_parts: int = 3, octaves: tuple[int, int] = (0, 4)) -> Samples:
    """How the level of each octave runs from the first to the last part of a movement.

    With L_i the log10 power density of an octave in part i of n, term j is
    2/n sum_i L_i cos(pi j (i + 1/2)/n): term 1 is positive where the level falls, term 2 where it is higher
    at both ends than in the middle. A surface that warms, wears or stretches changes; so does a hand that
    gets faster, so a classifier should weigh these columns.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_parts : int
        Number of equal parts: 6, or 3 or 2 of several sixths each.
    octaves : tuple of int
        First octave, and the one after the last; octave k reaches from fs/2 / 2^k down to fs/2 / 2^(k+1).
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, a sixth in which nothing changes, or one that holds fewer than 1.5 periods of the lowest
        frequency.
    """
    low = 3 * 2 ** octaves[1]
    if n_parts not in (2, 3, 6):
        raise ValueError(f"n_parts is {n_parts!r}; the rule is 2, 3 or 6")
    require(view, N_PARTS * max(16, low), f"1.5 periods of octave {octaves[1] - 1} in each sixth")
    edges = view.fs / 2 * np.exp2(-np.arange(octaves[1], octaves[0] - 1, -1.0))
    density = np.array([sixth.density(edges)[::-1] for sixth in sixths(view)])
    L = np.log10(density.reshape(n_parts, N_PARTS // n_parts, -1).mean(axis=1))
    return np.asarray(fft.dct(L, axis=0)[1:].reshape(-1) / n_parts)


def _octave_names(**_: object) -> tuple[str, ...]:
    return tuple(f"o{k}" for k in range(N_OCTAVES))


@feature(
    phase="movement",
    unit="log10(1)",
    reference="texclass; deviation over frames of log band levels",
    outputs=named_pieces(_octave_names),
    depends_on=("rate",),
)
@divisible
def level_fluctuation(view: PhaseView) -> Samples:
    """How much the log10 power of each octave from fs/2 down deviates from frame to frame.

    Frames of 64 samples: noise of steady level fluctuates least, and the less the wider the octave; grains,
    threads and stick-slip more.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 512 samples.
    """
    return np.asarray(np.log10(octave_frames(view)).std(axis=0))


@feature(
    phase="movement",
    unit="1",
    reference="texclass; autocorrelation of log band levels",
    outputs=named_pieces(_octave_names),
    depends_on=("rate",),
)
@divisible
def level_persistence(view: PhaseView) -> Samples:
    """Correlation of the log10 power of each octave with that a frame, 64 samples, later.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 512 samples, or an octave whose level never changes.
    """
    L = np.log10(octave_frames(view))
    L -= L.mean(axis=0)
    variance = np.mean(L**2, axis=0)
    if not variance.min() > 1e-12:
        raise UndefinedFeatureError(
            f"the level of octave {variance.argmin()} is constant; the rule is one that changes"
        )
    return np.asarray(np.mean(L[1:] * L[:-1], axis=0) / variance)
