"""Freehand recordings from a few lines of physics, made otherwise than `texclass.simulate` makes them.

The simulator moves a tool over a profile, step by step. Here a tap is a pulse of force and a few modes that
ring, a stroke is filtered noise (or ridges) that follows a speed, and everything that goes wrong between tool
and file is done to the sum: hum, drift, rails, zeros, held values, fades, spikes. The truth is known.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from texclass.recording import Phases, Recording, Tap

RATES_HZ = (1000.0, 2200.0, 5000.0, 10_000.0, 20_000.0, 50_000.0)
MATCH_S = 0.010
"""An impact that is found lies this near to the true one."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is done, and what happens to it on the way into the file.

    Attributes
    ----------
    n_taps, gap_s
        How many taps, how far apart (range).
    peak
        Range of their peaks in m/s^2.
    contact_s
        Range of the duration of the pulse of force.
    decay_s
        Range of the time constant of the ringing.
    pull
        Chance that the hand's acceleration towards the surface is felt before a tap.
    wait_s
        Range of the time from the last tap to the first stroke.
    strokes_s
        Range of the duration of all strokes; None for none.
    loudness
        Range of the strokes' vibration (rms, m/s^2).
    pause_s
        Range of the rest between two strokes; None for turning points without one.
    late_s
        Range of the rest after the last stroke.
    noise
        Range of the sensor's own noise (rms of an axis, m/s^2).
    quiet_s
        Range of the rest before the first tap.
    rebound_s
        Range of the time from a hit to a second one of 0.85 to 1.1 times its strength; None for single hits.
    reverberation_s
        Range of the time in which the echo of a room decays by 60 dB; None for none.
    """

    n_taps: tuple[int, int] = (2, 6)
    gap_s: tuple[float, float] = (0.35, 0.7)
    peak: tuple[float, float] = (5.0, 60.0)
    contact_s: tuple[float, float] = (0.0006, 0.005)
    decay_s: tuple[float, float] = (0.003, 0.02)
    pull: float = 0.8
    wait_s: tuple[float, float] = (0.6, 1.0)
    strokes_s: tuple[float, float] | None = (2.5, 4.0)
    loudness: tuple[float, float] = (0.4, 4.0)
    pause_s: tuple[float, float] | None = None
    late_s: tuple[float, float] = (0.0, 0.0)
    noise: tuple[float, float] = (0.01, 0.04)
    quiet_s: tuple[float, float] = (0.3, 0.8)
    rebound_s: tuple[float, float] | None = None
    reverberation_s: tuple[float, float] | None = None


FAMILIES = {
    "plain": Plan(),
    "soft": Plan(peak=(0.6, 4.0), contact_s=(0.004, 0.012), decay_s=(0.004, 0.01), pull=0.4),
    "uneven": Plan(peak=(1.2, 60.0), pull=0.0, noise=(0.005, 0.015)),
    "hum": Plan(),
    "drift": Plan(),
    "clipped": Plan(peak=(15.0, 60.0)),
    "padded": Plan(),
    "faded": Plan(),
    "glitches": Plan(),
    "quick": Plan(wait_s=(0.08, 0.6)),
    "overlapping": Plan(gap_s=(0.11, 0.2), decay_s=(0.015, 0.04), peak=(10.0, 60.0)),
    "pauses": Plan(pause_s=(0.1, 0.5)),
    "late quiet": Plan(late_s=(0.05, 1.0)),
    "strokes only": Plan(n_taps=(0, 0)),
    "ringing taps only": Plan(strokes_s=None, decay_s=(0.04, 0.12), peak=(15.0, 60.0), gap_s=(0.3, 0.8)),
    "double hits": Plan(rebound_s=(0.04, 0.075), decay_s=(0.01, 0.025), peak=(10.0, 60.0)),
    "double hits only": Plan(
        rebound_s=(0.04, 0.075), decay_s=(0.01, 0.025), peak=(10.0, 60.0), n_taps=(1, 3), strokes_s=None
    ),
    "reverberation": Plan(reverberation_s=(0.1, 1.0), strokes_s=None, peak=(10.0, 60.0), gap_s=(0.5, 0.9)),
    "quiet start": Plan(quiet_s=(0.2, 0.5)),
    "automatic gain": Plan(peak=(10.0, 60.0)),
    "taps in a tail": Plan(
        strokes_s=None, n_taps=(2, 2), decay_s=(0.04, 0.07), gap_s=(0.14, 0.25), peak=(30.0, 60.0)
    ),
    "short strokes": Plan(strokes_s=(1.0, 1.6)),
}


def make(family: str, seed: int, fs: float | None = None) -> Recording:
    """Return recording `seed` of a family, true phases included; at one of `RATES_HZ` by chance."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
    plan, fs = FAMILIES[family], fs or float(rng.choice(RATES_HZ))
    quiet_s = rng.uniform(*plan.quiet_s)
    n_taps = int(rng.integers(plan.n_taps[0], plan.n_taps[1] + 1))
    impacts = quiet_s + np.cumsum(rng.uniform(*plan.gap_s, n_taps)) - plan.gap_s[0]
    last = impacts[-1] if n_taps else quiet_s
    begin = last + rng.uniform(*plan.wait_s)
    strokes = _plan_strokes(begin, plan, rng) if plan.strokes_s else []
    end = strokes[-1][1] if strokes else begin
    t = np.arange(round((end + rng.uniform(*plan.late_s)) * fs)) / fs
    n_axes = int(rng.choice([1, 3]))
    axes = np.zeros((len(t), n_axes))
    normal = _direction(n_axes, rng)
    taps = []
    for impact in impacts:
        vibration, taken_s = _tap(t - impact, plan, fs, rng)
        if plan.rebound_s:
            later = round(rng.uniform(*plan.rebound_s) * fs)
            vibration[later:] += rng.uniform(0.85, 1.1) * _without_pull(vibration, t - impact)[:-later]
        if plan.reverberation_s:
            vibration = vibration + _echo(vibration, t, plan, fs, rng)
        axes += np.outer(vibration, normal + 0.2 * rng.standard_normal(n_axes))
        first = int(np.ceil(impact * fs))
        taps.append(Tap(max(0, first - round(0.1 * fs)), first, min(len(t), first + round(taken_s * fs) + 1)))
    movement = None
    if strokes:
        axes += np.outer(_strokes(t, strokes, plan, fs, rng), _direction(n_axes, rng))
        movement = (round(begin * fs), min(len(t), round(end * fs)))
    tremor = 0.05 * np.sin(2 * np.pi * rng.uniform(7, 11) * t + rng.uniform(0, 6))
    axes += np.outer(tremor, normal) + rng.uniform(*plan.noise) * rng.standard_normal(axes.shape)
    if rng.random() < 0.5:
        axes += 9.81 * _direction(n_axes, rng)
    phases = Phases(tuple(taps), movement, movement and movement[0])
    axes, phases = _spoil(family, axes, phases, fs, rng)
    whole = axes if n_axes == 3 else axes[:, 0]
    return Recording(whole, fs, "m/s^2", f"{family} {seed}", phases=phases, source="made")


def _direction(n_axes, rng):
    vector = rng.standard_normal(n_axes)
    return vector / np.linalg.norm(vector)


def _tap(after, plan, fs, rng):
    """Return pulse and ringing from 0 s of `after` on, the pull of the hand before, and how long it lasts."""
    x = np.zeros(len(after))
    contact_s, decay_s = rng.uniform(*plan.contact_s), rng.uniform(*plan.decay_s)
    later = after[on := after >= 0]
    x[on] = np.where(later < contact_s, np.sin(np.pi * later / contact_s), 0.0)
    highest = min(0.35 * fs, 0.8 / contact_s)
    for _ in range(int(rng.integers(1, 4))):
        mode_hz = np.exp(rng.uniform(np.log(90.0), np.log(max(highest, 120.0))))
        x[on] += rng.uniform(0.2, 0.8) * np.exp(-later / decay_s) * np.sin(2 * np.pi * mode_hz * later)
    peak = np.exp(rng.uniform(*np.log(plan.peak)))
    x *= peak / np.abs(x).max()
    if rng.random() < plan.pull:
        pull_s = rng.uniform(0.06, 0.12)
        before = np.clip(-after / pull_s, 0.0, 1.0)
        x -= rng.uniform(0.3, 2.0) * np.sin(np.pi * before) ** 2
    return x, contact_s + 3.5 * decay_s


def _without_pull(vibration, after):
    return np.where(after >= 0, vibration, 0.0)


def _echo(vibration, t, plan, fs, rng):
    """Return the echo of a room: noise that decays by 60 dB, at most as loud as what it follows."""
    decay = 10 ** (-3 * t / rng.uniform(*plan.reverberation_s)) * rng.standard_normal(len(t))
    echo = signal.oaconvolve(vibration, decay)[: len(t)]
    return rng.uniform(0.1, 0.5) * echo * np.abs(vibration).max() / np.abs(echo).max()


def _plan_strokes(begin, plan, rng):
    """Return when strokes to and fro begin and end; none is shorter than 0.35 s."""
    strokes, at, end = [], begin, begin + rng.uniform(*plan.strokes_s)
    while not strokes or at < end - 0.35:
        last = min(at + rng.uniform(0.35, 1.0), max(end, at + 0.35))
        strokes.append((at, last if end - last > 0.35 else max(end, last)))
        at = strokes[-1][1] + (rng.uniform(*plan.pause_s) if plan.pause_s else 0.0)
    return strokes


def _strokes(t, strokes, plan, fs, rng):
    """Return vibration that follows the speed of strokes."""
    speed = np.zeros(len(t))
    for first, last in strokes:
        speed += rng.uniform(0.6, 1.0) * np.sin(np.pi * np.clip((t - first) / (last - first), 0.0, 1.0))
    low_hz = rng.uniform(60.0, 200.0)
    high_hz = min(rng.uniform(2.0, 6.0) * low_hz, 0.45 * fs)
    band = signal.butter(1, (low_hz, high_hz), "bandpass", fs=fs, output="sos")
    rough = signal.sosfilt(band, rng.standard_normal(len(t)))
    rough /= rough.std()
    if rng.random() < 0.4:  # ridges, a few mm apart: a sharp train whose rate is the speed over the spacing
        phase = np.cumsum(speed) / fs * rng.uniform(40.0, 120.0)
        pulses = np.diff(np.floor(phase), prepend=0.0) * speed
        ridges = signal.sosfilt(band, pulses)
        rough = rough + rng.uniform(1.0, 2.0) * ridges / max(ridges.std(), 1e-12)
    x = rough * np.maximum(speed, 0.0) ** rng.uniform(0.5, 0.9)
    x *= np.exp(rng.uniform(*np.log(plan.loudness))) / x[speed > 0].std()
    return x


def _spoil(family, axes, phases, fs, rng):
    """Do to the axes what the family is named after."""
    n, t = len(axes), np.arange(len(axes)) / fs
    match family:
        case "hum":
            for k, share in ((1, 1.0), (2, 0.4), (3, 0.5)):
                wave = np.sin(2 * np.pi * 50.0 * k * t + rng.uniform(0, 6))
                axes = axes + rng.uniform(0.03, 0.15) * share * np.outer(wave, _direction(axes.shape[1], rng))
        case "drift":
            walk = np.cumsum(rng.standard_normal(axes.shape), axis=0) / np.sqrt(fs)
            axes = axes + rng.uniform(0.2, 1.0) * walk + np.outer(t, rng.uniform(-0.5, 0.5, axes.shape[1]))
        case "clipped":
            rails = rng.uniform(4.0, 12.0)
            level = np.median(axes, axis=0)
            axes = np.clip(axes, level - rails, level + rails)
        case "padded":
            before, after = (round(rng.uniform(*span) * fs) for span in ((0.05, 0.4), (0.0, 0.4)))
            held = rng.random() < 0.5
            axes = np.pad(axes, ((before, after), (0, 0)), mode="edge" if held else "constant")
            phases = _moved(phases, before)
        case "faded":
            up = round(rng.uniform(0.05, min(0.3, phases.taps[0].start / fs)) * fs)
            down = round(rng.uniform(0.05, 0.15) * fs)
            ramp = np.ones(n)
            ramp[:up] = np.linspace(0.0, 1.0, up)
            ramp[-down:] = np.linspace(1.0, 0.0, down)
            if rng.random() < 0.5:
                ramp = np.sin(0.5 * np.pi * ramp) ** 2
            axes = axes * ramp[:, None]
        case "automatic gain":  # of a phone: 15 dB less for a tap of 60 m/s^2, and back within a second
            level = np.sqrt(np.square(axes - np.median(axes, axis=0)).sum(axis=1))
            falling = signal.lfilter([1 / (0.01 * fs)], [1, 1 / (0.01 * fs) - 1], level)
            rising = np.exp(-1 / fs)
            for i in range(1, n):
                falling[i] = max(falling[i], rising * falling[i - 1])
            axes = (axes - np.median(axes, axis=0)) / np.sqrt(1.0 + falling / 2)[:, None]
        case "glitches":
            axes = axes.copy()
            for at in rng.integers(5, n - 5, int(rng.integers(1, 5))):
                axes[at, int(rng.integers(axes.shape[1]))] += rng.choice([-60.0, 60.0])
    return axes, phases


def _moved(phases, n):
    taps = tuple(Tap(tap.start + n, tap.impact + n, tap.end + n) for tap in phases.taps)
    if phases.movement is None:
        return replace(phases, taps=taps)
    first, last = (edge + n for edge in phases.movement)
    return Phases(taps, (first, last), first)


def matched(true: Phases, found: Phases, fs: float) -> int:
    """Count true impacts that one found impact, used once, meets within `MATCH_S`."""
    free = [tap.impact for tap in found.taps]
    n_matched = 0
    for tap in true.taps:
        near = [impact for impact in free if abs(impact - tap.impact) <= MATCH_S * fs]
        if near:
            free.remove(min(near, key=lambda impact: abs(impact - tap.impact)))
            n_matched += 1
    return n_matched


def overlap(true: Phases, found: Phases) -> float:
    """Intersection over union of the movements; 1 if neither has one, 0 if one of them."""
    if true.movement is None or found.movement is None:
        return float(true.movement == found.movement)
    (a, b), (c, d) = true.movement, found.movement
    return max(0, min(b, d) - max(a, c)) / (max(b, d) - min(a, c))
