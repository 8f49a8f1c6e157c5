"""Find taps (hand acceleration, impact, decay), the onset of sliding and movement in a recording."""

import numpy as np

from texclass.phase_settings import PhaseSettings
from texclass.phases.hand_motion import find_hand_start, find_single_tap
from texclass.phases.impulses import (
    Impulse,
    find_impulses,
    moving_mean,
    remove_impulses,
    select_taps,
    split_taps_and_movement,
)
from texclass.phases.vibration_track import Track, track
from texclass.recording import Phases, Recording, Samples, Tap

AT_REST_M_S2 = 0.06
"""Vibration of a resting sensor, RMS of all axes: about 6 mg."""
NO_TAPS = "no taps: nothing stands out of the noise sharply enough"
NOTHING = "neither taps nor movement: nothing stands out of the noise"
NEVER_QUIET = "no quiet stretch, so the noise is unknown: the whole recording is taken as movement"
LONE_TAP = "too short for a stroke, at rest before or after: taken as one tap; the hand's part is unknown"
STARTS_MOVING = "the recording starts in movement: no onset of sliding"


def find_phases(recording: Recording, settings: PhaseSettings | None = None) -> Phases:
    """Find taps, the onset of sliding and the movement of a recording.

    1. Filter out gravity, tremor and hand motion; divide by the noise at rest, bin by bin (`track`).
    2. An impulse rises by 10 dB or more above what was just before, and decays (`find_impulses`).
    3. The tool strokes where the level exceeds the noise otherwise (`split_taps_and_movement`).
    4. Impulses inside a movement belong to the texture; the others are taps, unless they are far weaker than
       the strongest (a tool that is lifted).

    Zero padding, held values, fades and single-sample glitches are excluded first.

    Parameters
    ----------
    recording : Recording
        Any number of axes, any unit, rates from about 1 kHz; declared phases are returned unchanged.
    settings : PhaseSettings, optional
        Thresholds and durations (default: those of the recording).

    Returns
    -------
    Phases
        Half-open ranges of samples. A tap starts where the hand starts to accelerate and ends when its
        vibration is in the noise or 30 dB below its peak; it has a width and a quality. The movement reaches
        from the onset of sliding to where the tool rests (to the end, if it rests for less than 0.3 s),
        pauses at turning points included. `notes` list what is missing or was assumed: no quiet stretch, a
        start in the middle of a movement, nothing at all.

    Notes
    -----
    `strese2015` names the phases (Figs. 4 and 7) and gives no algorithm; this one is ours. Its cost is
    linear in the length of the recording.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> x = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    >>> for start in (0.5, 0.9, 1.4):
    ...     x += 20 * (t >= start) * np.exp(-(t - start).clip(0) / 0.01) * np.sin(1885 * (t - start))
    >>> phases = find_phases(Recording(x, fs=10_000, unit="m/s^2"))
    >>> phases.kind, len(phases.taps)
    ('taps only', 3)
    """
    if recording.phases is not None:
        return recording.phases
    settings = settings or recording.phase_settings
    peak = max(abs(float(recording.acceleration.min())), abs(float(recording.acceleration.max())))
    if peak > 1e100:  # its square would overflow; levels are relative
        recording = recording.with_(acceleration=recording.acceleration / peak)
    if recording.duration_s < settings.window_s:
        return _short(recording)
    measured = track(recording, settings)
    impulses, opening = _impulses(measured, settings)
    if settings.contents == "taps":
        taps = _taps(recording, measured, select_taps(impulses, measured.levels, settings), settings)
        return Phases(taps, notes=() if taps else (NO_TAPS,))
    begins = measured.data[0] if _opens_in_movement(measured, opening, settings) else None
    impulses, span = split_taps_and_movement(measured.levels, impulses, settings, begins, opening)
    if span is not None and _are_of_strokes(impulses, measured, span, settings):
        impulses = []
    taps = _taps(recording, measured, impulses, settings)
    if span is None and (taps or _is_at_rest(recording, measured)):
        return Phases(taps, notes=() if taps else (NOTHING,))
    if span is not None and (measured.is_steady or taps):
        first, last = _movement(recording, measured, span, impulses, settings)
        return Phases(taps, (first, last), first or None, () if first else (STARTS_MOVING,))
    return Phases((), (0, recording.n_samples), None, (NEVER_QUIET,))


def find_impact(power: Samples, noise: float) -> int | None:
    """Return the first sample that exceeds the noise, within 25 dB of the peak; None without a clear one."""
    peak = float(power.max())
    least = max(20.0 * noise, 3e-3 * peak)  # a single sample of noise does not reach 20 times its mean
    return int(np.argmax(power >= least)) if peak >= 2.0 * least else None


def _short(recording: Recording) -> Phases:
    """Return the phases of a recording too short for a stroke: one tap, or a part of a movement."""
    tap = find_single_tap(recording)
    if tap is not None:
        return Phases((tap,), notes=(LONE_TAP,))
    if np.ptp(recording.acceleration, axis=0).max() == 0:
        return Phases(notes=(NOTHING,))
    return Phases((), (0, recording.n_samples), None, (NEVER_QUIET,))


def _impulses(measured: Track, settings: PhaseSettings) -> tuple[list[Impulse], list[Impulse]]:
    """Return the impulses that can be measured, and those with which the data start.

    An impulse cut off by the start of the data cannot be measured, and the kink with which a fade of gravity
    starts or ends is no impact.
    """
    n_bins, (first, stop), (up, down) = measured.levels.n_bins, measured.data, measured.full
    opening = first + n_bins(settings.opening_s)
    kink = n_bins(settings.kink_s)
    earliest = up + (up - first) + kink if up > first else first
    latest = down - kink if down < stop else len(measured.levels.broadband)
    impulses = find_impulses(measured.levels, settings)
    kept = [
        i
        for i in impulses
        if i.start >= opening and (i.broadband_db >= settings.clear_db or earliest <= i.start < latest)
    ]
    return kept, [i for i in impulses if i.start < opening]


def _opens_in_movement(measured: Track, opening: list[Impulse], settings: PhaseSettings) -> bool:
    """Return whether the data start with vibration that is not the decay of an impulse."""
    levels, first = measured.levels, measured.data[0]
    stop = first + levels.n_bins(2 * settings.opening_s)
    begin = remove_impulses(levels.strokes[:stop], opening, 0.0)[first:]
    return len(begin) > 0 and measured.full[0] == first and float(begin.mean()) > settings.active_ratio


def _are_of_strokes(
    impulses: list[Impulse], measured: Track, span: tuple[int, int], settings: PhaseSettings
) -> bool:
    """Return whether the impulses are so few and weak that they may be those of faint strokes."""
    strongest = max((i.broadband_db for i in impulses), default=0.0)
    are_weak = len(impulses) < settings.few and strongest < settings.sure_db
    return are_weak and _is_faint(measured, (0, span[1]), settings)


def _is_faint(measured: Track, span: tuple[int, int], settings: PhaseSettings) -> bool:
    """Return whether vibration hardly exceeds the noise."""
    n_quiet = measured.levels.n_bins(settings.quiet_s)
    level = moving_mean(measured.levels.strokes, n_quiet)[slice(*span)]
    return float(level.max()) < settings.faint_ratio


def _movement(
    recording: Recording, measured: Track, span: tuple[int, int], taps: list[Impulse], settings: PhaseSettings
) -> tuple[int, int]:
    """Return the movement in samples: to the end unless the tool rests there.

    Where strokes hardly exceed the noise, a rest after them (and a short one before, if there are no taps)
    may be fainter strokes.
    """
    (first, last), n_bins, size = span, measured.levels.n_bins, measured.bin_samples
    is_faint = _is_faint(measured, span, settings)
    if is_faint and not taps and first - measured.data[0] < n_bins(settings.rest_s):
        first = measured.data[0]
    rest_s = settings.pause_s if is_faint else settings.rest_s
    if measured.data[1] - last < n_bins(rest_s) and not (taps and taps[-1].start >= last):
        last = measured.data[1]
    return first * size, min(last * size, recording.n_samples)


def _taps(
    recording: Recording, measured: Track, impulses: list[Impulse], settings: PhaseSettings
) -> tuple[Tap, ...]:
    size, taps = measured.bin_samples, list[Tap]()
    free_from = measured.data[0] * size
    for impulse in impulses:
        impact = _impact(measured, impulse, settings)
        end = max(impact + 1, min(impulse.end * size, recording.n_samples))
        earliest = min(impact, max(free_from, impact - round(settings.hand_s * recording.fs)))
        start = earliest + find_hand_start(measured.axes[earliest:impact], recording.fs)
        taps.append(Tap(start, impact, end, impulse.width * size, impulse.quality))
        free_from = end
    return tuple(taps)


def _impact(measured: Track, impulse: Impulse, settings: PhaseSettings) -> int:
    """Return the sample at which the vibration exceeds the noise."""
    margin = measured.levels.n_bins(settings.margin_s)
    start = max(0, impulse.start - margin) * measured.bin_size
    stop = (max(impulse.start + margin, impulse.peak) + margin) * measured.bin_size
    row = find_impact(measured.power[start:stop], measured.noise)
    return impulse.start * measured.bin_samples if row is None else (start + row) * measured.step


def _is_at_rest(recording: Recording, measured: Track) -> bool:
    """Return whether a signal of steady level is noise: weak for an acceleration, white in other units."""
    if recording.unit == "m/s^2":
        return float(measured.power.mean()) < AT_REST_M_S2**2
    return abs(measured.correlation) <= 0.25
