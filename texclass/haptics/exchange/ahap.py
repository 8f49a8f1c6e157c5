"""Apple's haptic patterns (.ahap, Core Haptics): surfaces written as such, and patterns read and played.

A pattern holds transients (a tap), continuous events (up to 30 s), and parameter curves that bend the
intensity (0 to 1, multiplied) and sharpness (-1 to 1, added) of all that plays. Times of a curve's points
count from the curve's own time; players take at most 16 points a curve, so longer ones are written as
several, each beginning where the last ended. Intensity has no unit and sharpness no frequency: the level
survives relative to the loudest moment only, and the spectrum as one number that is barely felt.
"""

import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange.foreign import Part, read_foreign
from texclass.haptics.exchange.rendition import LONGEST_S, Rendition
from texclass.recording import Samples

LARGEST_FILE = 4 << 20
MOST_POINTS = 16
"""Of a curve."""
SHARP_HZ = (80.0, 230.0)
"""What sharpness 0 and 1 stand for: about where the actuator of a phone vibrates. Ours; Apple gives none."""
TRANSIENT_S = 0.02
FS = 8000.0
MOST_S = 6000.0
"""Of all events together, that are played."""
Control = Literal["HapticIntensityControl", "HapticSharpnessControl"]
Seconds = Annotated[float, Field(ge=0, le=1e6)]
Content = dict[str, Any]
"""A part of a file by its keys; `Pattern` checks the whole."""


class Parameter(Part):
    """A number of an event."""

    ParameterID: str
    ParameterValue: float


class HapticEvent(Part):
    """What is played from a time on: a tap, or a vibration for a while."""

    Time: Seconds
    EventType: Literal["HapticTransient", "HapticContinuous", "AudioContinuous", "AudioCustom"]
    EventDuration: Seconds | None = None
    EventParameters: tuple[Parameter, ...] = ()

    @model_validator(mode="after")
    def _lasts(self) -> "HapticEvent":
        if self.EventType == "HapticContinuous" and not self.EventDuration:
            raise ValueError("a continuous event has no EventDuration. Expected above 0 s")
        return self

    @property
    def seconds(self) -> float:
        """How long it is felt."""
        return TRANSIENT_S if self.EventType == "HapticTransient" else self.EventDuration or 0.0

    def parameter(self, name: str, default: float) -> float:
        """Return a parameter, 0 to 1, or its default."""
        found = {one.ParameterID: one.ParameterValue for one in self.EventParameters}
        return min(max(found.get(name, default), 0.0), 1.0)


class Point(Part):
    """Of a curve; its time, s, counts from that of the curve; players clamp its value."""

    Time: Seconds
    ParameterValue: Annotated[
        float, BeforeValidator(lambda x: min(max(x, -1.0), 1.0) if isinstance(x, int | float) else x)
    ]


class Curve(Part):
    """How a parameter moves, straight from point to point."""

    ParameterID: str
    Time: Seconds
    ParameterCurveControlPoints: tuple[Point, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _rises(self) -> "Curve":
        times = [point.Time for point in self.ParameterCurveControlPoints]
        if any(b < a for a, b in itertools.pairwise(times)):
            raise ValueError(f"the times of its points must rise, got {times[:4]}...")
        return self


class Item(Part):
    """An event or a curve (a dynamic parameter is left alone)."""

    Event: HapticEvent | None = None
    ParameterCurve: Curve | None = None


class Pattern(Part):
    """An .ahap file."""

    Version: float
    Metadata: dict[str, Any] = Field(default_factory=dict)
    Pattern: tuple[Item, ...] = Field(max_length=20_000)


def read_ahap(path: str | Path) -> Pattern:
    """Return the pattern of a file; as players do, clamp numbers and leave unknown keys alone.

    Raises
    ------
    ValueError
        If it is too long, no JSON, or breaks a rule; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    return read_foreign(Pattern, path, LARGEST_FILE)


def write_ahap(rendition: Rendition, path: str | Path) -> dict[str, str]:
    """Write a surface as .ahap, and return what is lost.

    Taps become transients; all else one continuous event, whose intensity follows the RMS and whose sharpness
    the centroid of the spectrum, piece by piece.

    Parameters
    ----------
    rendition : Rendition
        Of `texclass.haptics.exchange.play_texture` or `play_taps`.
    path : str or Path
        Ends in `.ahap`.

    Raises
    ------
    ValueError
        If the path has another ending.
    """
    path = check_suffix(path, ".ahap")
    items, full, lost = (_taps if rendition.taps.size else _stroke)(rendition)
    unit = rendition.unit
    told = {"Description": rendition.told, "Intensity1": f"{full:.6g} {unit}", "Project": "texclass"}
    content = {"Version": 1.0, "Metadata": told, "Pattern": items}
    pattern = Pattern.model_validate_json(json.dumps(content))
    write_atomic(path, pattern.model_dump_json(exclude_none=True, indent=1))
    return {
        **rendition.lost,
        **lost,
        "level": f"relative to {full:.4g} {unit}, which is intensity 1",
        "band": f"one sharpness, 0 to 1 for {SHARP_HZ[0]:g} to {SHARP_HZ[1]:g} Hz",
    }


def _taps(rendition: Rendition) -> tuple[list[Content], float, dict[str, str]]:
    """Return a transient a tap, the peak (in the unit) of intensity 1, and what else is lost."""
    full = float(rendition.taps[:, 1].max()) or 1.0
    items = [
        _event("HapticTransient", at, peak / full, _sharpness(frequency))
        for at, peak, frequency in rendition.taps.tolist()
    ]
    lost = "a player's own: of a tap, time, peak and frequency are kept, not its decay"
    return items, full, {"waveform": lost}


def _stroke(rendition: Rendition) -> tuple[list[Content], float, dict[str, str]]:
    """Return a continuous event and its curves, the RMS of intensity 1, and what else is lost."""
    x, fs = rendition.samples, rendition.fs
    seconds = x.size / fs
    step = max(0.02, seconds / (60 * (MOST_POINTS - 1)))  # a point every 20 ms, in at most 60 curves
    n = max(round(seconds / step), 1)
    pieces = [piece for piece in np.array_split(x, n) if piece.size]
    rms = np.array([np.sqrt(np.mean(np.square(piece))) for piece in pieces])
    full = float(rms.max()) or 1.0
    times = (np.arange(len(pieces)) + 0.5) * seconds / len(pieces)
    times[0], times[-1] = 0.0, seconds if len(pieces) > 1 else 0.0
    sharpness = _sharpness(centroid_hz(x, fs))
    middle = np.array([_sharpness(centroid_hz(piece, fs)) for piece in pieces]) - sharpness
    lasts = {"EventDuration": min(max(seconds, 1e-3), LONGEST_S)}
    items = [
        _event("HapticContinuous", 0.0, 1.0, sharpness, **lasts),
        *_curves("HapticIntensityControl", times, rms / full),
        *_curves("HapticSharpnessControl", times, middle),
    ]
    lost = {"waveform": f"its RMS and centroid every {1000 * seconds / len(pieces):.3g} ms are kept"}
    return items, full, lost


def _event(kind: str, at: float, intensity: float, sharpness: float, **more: float) -> Content:
    values = {"HapticIntensity": intensity, "HapticSharpness": sharpness}
    given = [{"ParameterID": name, "ParameterValue": round(value, 4)} for name, value in values.items()]
    return {"Event": {"Time": round(at, 6), "EventType": kind, "EventParameters": given, **more}}


def _curves(name: Control, times: Samples, values: Samples) -> list[Content]:
    """Return curves through points (n,), seconds and values, none of which has over `MOST_POINTS`."""
    found = []
    for first in range(0, max(times.size - 1, 1), MOST_POINTS - 1):
        cut = slice(first, first + MOST_POINTS)  # the last point of one is the first of the next
        at = float(times[first])
        points = [
            {"Time": round(t - at, 6), "ParameterValue": round(value, 4)}
            for t, value in zip(times[cut].tolist(), values[cut].tolist(), strict=True)
        ]
        curve = {"ParameterID": name, "Time": round(at, 6), "ParameterCurveControlPoints": points}
        found.append({"ParameterCurve": curve})
    return found


def centroid_hz(x: Samples, fs: float) -> float:
    """Return the centroid of the power spectrum of samples (n,), Hz; 0 of silence."""
    power = np.abs(np.fft.rfft(x)) ** 2
    power[1 : (x.size + 1) // 2] *= 2  # one-sided: what lies at 0 and at fs/2 is its own mirror image
    total = float(power.sum())
    return float(np.fft.rfftfreq(x.size, 1 / fs) @ power) / total if total > 0 else 0.0


def _sharpness(frequency_hz: float) -> float:
    low, high = SHARP_HZ
    return min(max((frequency_hz - low) / (high - low), 0.0), 1.0)


def play_ahap(pattern: Pattern, fs: float = FS) -> Samples:
    """Return what a pattern plays (n_samples,), in units of intensity 1, on a plain actuator.

    A continuous event is a sine of the frequency that its sharpness stands for (`SHARP_HZ`), a transient one
    that decays within 20 ms: ours, as what a phone really plays is not published.

    Raises
    ------
    ValueError
        If it lasts longer than ten minutes, or its events more than `MOST_S` in all.
    """
    found = [item.Event for item in pattern.Pattern if item.Event]
    events = [event for event in found if event.EventType.startswith("Haptic")]
    seconds = max((event.Time + event.seconds for event in events), default=0.0)
    if seconds > 20 * LONGEST_S:
        raise ValueError(f"it lasts {seconds:g} s. Expected at most {20 * LONGEST_S:g}")
    if (lasting := sum(event.seconds for event in events)) > MOST_S:
        raise ValueError(f"its events last {lasting:g} s in all. Expected at most {MOST_S:g}")
    out = np.zeros(max(round(seconds * fs), 1))
    t = np.arange(out.size) / fs
    curves = [item.ParameterCurve for item in pattern.Pattern if item.ParameterCurve]
    loudness = _course(curves, "HapticIntensityControl", 1.0, t)
    shift = _course(curves, "HapticSharpnessControl", 0.0, t)
    for event in events:
        end = min(math.ceil((event.Time + event.seconds) * fs), out.size)
        inside = slice(math.ceil(event.Time * fs), end)
        sharpness = np.clip(event.parameter("HapticSharpness", 0.5) + shift[inside], 0, 1)
        turns = np.cumsum(SHARP_HZ[0] + sharpness * (SHARP_HZ[1] - SHARP_HZ[0])) / fs
        played = event.parameter("HapticIntensity", 1.0) * loudness[inside] * np.sin(2 * np.pi * turns)
        if event.EventType == "HapticTransient":
            played *= np.exp(-5 * (t[inside] - event.Time) / TRANSIENT_S)
        out[inside] += played
    return out


def _course(curves: Sequence[Curve], name: Control, default: float, t: Samples) -> Samples:
    """Return a controlled parameter at times (n,): the last curve that has begun, its last value held."""
    found = np.full(t.size, default)
    for curve in sorted((one for one in curves if one.ParameterID == name), key=lambda one: one.Time):
        points = curve.ParameterCurveControlPoints
        times = [curve.Time + point.Time for point in points]
        later = t >= curve.Time
        found[later] = np.interp(t[later], times, [point.ParameterValue for point in points])
    return found
