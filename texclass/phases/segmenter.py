"""Segmentation of a recording into taps (hand motion, impact, decay), onset of sliding and movement."""

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
"""Largest RMS vibration of a sensor at rest over all axes, in m/s^2 (about 6 mg)."""
NO_TAPS = "no taps: no impulse is prominent enough"
NOTHING = "neither taps nor movement: nothing exceeds the noise"
NEVER_QUIET = "no quiet window, so the noise is unknown: the whole recording counts as movement"
SINGLE_TAP = "too short for a stroke, and at rest at one end: counts as one tap without hand motion"
STARTS_MOVING = "the recording starts during movement: no onset of sliding"


def find_phases(recording: Recording, settings: PhaseSettings | None = None) -> Phases:
    """Find taps, the onset of sliding and the movement of a recording.

    Padding (zeros or repeated values), fades and single-sample glitches are excluded first. Then:

    1. Remove gravity, tremor and hand motion, and divide the power of each bin by the noise at rest
       (`track`).
    2. Find impulses: levels that rise by at least 10 dB and decay (`find_impulses`).
    3. Find the movement: the remaining vibration above the noise (`split_taps_and_movement`).
    4. Classify the impulses. Impulses inside the movement belong to the texture. The other impulses are taps,
       unless they are much weaker than the strongest one (for example when the tool is lifted).

    Parameters
    ----------
    recording : Recording
        Recording with any number of axes and any unit, at a sampling rate of about 1 kHz or more. If its
        phases are declared, they are returned unchanged.
    settings : PhaseSettings, optional
        Thresholds and durations (default: the settings of the recording).

    Returns
    -------
    Phases
        Half-open ranges of samples. A tap starts where the hand starts to accelerate. It ends where its
        vibration has fallen to the noise or to 30 dB below its peak. The movement reaches from the onset of
        sliding to the point where the tool rests, and includes pauses at turning points. If the tool rests
        for less than 0.3 s, the movement reaches to the end of the recording. The attribute `notes` lists
        missing phases and assumptions, for example that there is no quiet window.

    Notes
    -----
    `strese2015` defines the phases (Figs. 4 and 7) but does not describe an algorithm. This algorithm is our
    own. Its computing time is linear in the length of the recording.

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
    vibration = track(recording, settings)
    impulses, opening = _impulses(vibration, settings)
    if settings.contents == "taps":
        taps = _taps(recording, vibration, select_taps(impulses, vibration.levels, settings), settings)
        return Phases(taps, notes=() if taps else (NO_TAPS,))
    begins = vibration.data[0] if _opens_in_movement(vibration, opening, settings) else None
    impulses, span = split_taps_and_movement(vibration.levels, impulses, settings, begins, opening)
    if span is not None and _may_be_strokes(impulses, vibration, span, settings):
        impulses = []
    taps = _taps(recording, vibration, impulses, settings)
    if span is None and (taps or _is_at_rest(recording, vibration)):
        return Phases(taps, notes=() if taps else (NOTHING,))
    if span is not None and (vibration.is_steady or taps):
        first, last = _movement(recording, vibration, span, impulses, settings)
        return Phases(taps, (first, last), first or None, () if first else (STARTS_MOVING,))
    return Phases((), (0, recording.n_samples), None, (NEVER_QUIET,))


def find_impact(power: Samples, noise: float) -> int | None:
    """Return the first sample above the noise and within 25 dB of the peak.

    The result is None if the peak does not clearly exceed the noise.

    Parameters
    ----------
    power : ndarray of shape (n,)
        Power of the vibration.
    noise : float
        Mean power at rest.

    Examples
    --------
    >>> find_impact(np.array([1.0, 1.2, 0.8, 500.0, 900.0]), noise=1.0)
    3
    """
    peak = float(power.max())
    threshold = max(20.0 * noise, 3e-3 * peak)  # no sample of noise reaches 20 times its mean
    return int(np.argmax(power >= threshold)) if peak >= 2.0 * threshold else None


def _short(recording: Recording) -> Phases:
    """Return the phases of a recording that is too short for a stroke: a single tap, or only movement."""
    tap = find_single_tap(recording)
    if tap is not None:
        return Phases((tap,), notes=(SINGLE_TAP,))
    if np.ptp(recording.acceleration, axis=0).max() == 0:
        return Phases(notes=(NOTHING,))
    return Phases((), (0, recording.n_samples), None, (NEVER_QUIET,))


def _impulses(vibration: Track, settings: PhaseSettings) -> tuple[list[Impulse], list[Impulse]]:
    """Return the complete impulses, and the impulses at the start of the data.

    An impulse that is cut off by the start of the data cannot be measured. If the recording is faded in or
    out, the abrupt change of gravity at the edge of the fade is not counted as an impact.
    """
    n_bins, (first, stop), (full_first, full_stop) = vibration.levels.n_bins, vibration.data, vibration.full
    opening = first + n_bins(settings.opening_s)
    kink = n_bins(settings.kink_s)
    earliest = full_first + (full_first - first) + kink if full_first > first else first
    latest = full_stop - kink if full_stop < stop else len(vibration.levels.broadband)
    impulses = find_impulses(vibration.levels, settings)
    complete = [
        i
        for i in impulses
        if i.start >= opening and (i.broadband_db >= settings.clear_db or earliest <= i.start < latest)
    ]
    return complete, [i for i in impulses if i.start < opening]


def _opens_in_movement(vibration: Track, opening: list[Impulse], settings: PhaseSettings) -> bool:
    """Return whether the data start with vibration that is not the decay of an impulse."""
    levels, first = vibration.levels, vibration.data[0]
    stop = first + levels.n_bins(2 * settings.opening_s)
    level = remove_impulses(levels.strokes[:stop], opening, 0.0)[first:]
    return len(level) > 0 and vibration.full[0] == first and float(level.mean()) > settings.active_ratio


def _may_be_strokes(
    impulses: list[Impulse], vibration: Track, span: tuple[int, int], settings: PhaseSettings
) -> bool:
    """Return whether the impulses are so few and weak that faint strokes may have caused them."""
    strongest = max((i.broadband_db for i in impulses), default=0.0)
    is_weak = len(impulses) < settings.min_impulses and strongest < settings.certain_db
    return is_weak and _is_faint(vibration, (0, span[1]), settings)


def _is_faint(vibration: Track, span: tuple[int, int], settings: PhaseSettings) -> bool:
    """Return whether the vibration barely exceeds the noise."""
    n_quiet = vibration.levels.n_bins(settings.quiet_s)
    level = moving_mean(vibration.levels.strokes, n_quiet)[slice(*span)]
    return float(level.max()) < settings.faint_ratio


def _movement(
    recording: Recording,
    vibration: Track,
    span: tuple[int, int],
    taps: list[Impulse],
    settings: PhaseSettings,
) -> tuple[int, int]:
    """Return the movement in samples. It reaches to the end of the data unless the tool rests there.

    If the strokes barely exceed the noise, even fainter strokes look like rest. Therefore a longer rest is
    then required at the end, and a short rest before the strokes counts as movement if there are no taps.
    """
    (first, last), n_bins, size = span, vibration.levels.n_bins, vibration.bin_samples
    is_faint = _is_faint(vibration, span, settings)
    if is_faint and not taps and first - vibration.data[0] < n_bins(settings.rest_s):
        first = vibration.data[0]
    rest_s = settings.pause_s if is_faint else settings.rest_s
    if vibration.data[1] - last < n_bins(rest_s) and not (taps and taps[-1].start >= last):
        last = vibration.data[1]
    return first * size, min(last * size, recording.n_samples)


def _taps(
    recording: Recording, vibration: Track, impulses: list[Impulse], settings: PhaseSettings
) -> tuple[Tap, ...]:
    size, taps = vibration.bin_samples, list[Tap]()
    previous_end = vibration.data[0] * size
    for impulse in impulses:
        impact = _impact(vibration, impulse, settings)
        end = max(impact + 1, min(impulse.end * size, recording.n_samples))
        earliest = min(impact, max(previous_end, impact - round(settings.hand_s * recording.fs)))
        start = earliest + find_hand_start(vibration.axes[earliest:impact], recording.fs)
        taps.append(Tap(start, impact, end, impulse.width * size, impulse.quality))
        previous_end = end
    return tuple(taps)


def _impact(vibration: Track, impulse: Impulse, settings: PhaseSettings) -> int:
    """Return the sample at which the vibration exceeds the noise."""
    margin = vibration.levels.n_bins(settings.margin_s)
    start = max(0, impulse.start - margin) * vibration.bin_size
    stop = (max(impulse.start + margin, impulse.peak) + margin) * vibration.bin_size
    row = find_impact(vibration.power[start:stop], vibration.noise)
    return impulse.start * vibration.bin_samples if row is None else (start + row) * vibration.step


def _is_at_rest(recording: Recording, vibration: Track) -> bool:
    """Return whether a signal of steady level is noise.

    An acceleration is noise if it is weak. In other units, a signal is noise if it is white.
    """
    if recording.unit == "m/s^2":
        return float(vibration.power.mean()) < AT_REST_M_S2**2
    return abs(vibration.correlation) <= 0.25
