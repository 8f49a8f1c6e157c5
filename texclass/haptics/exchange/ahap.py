"""Write surfaces as haptic patterns for Apple Core Haptics (.ahap), and read and play such patterns.

A pattern contains transient events (taps), continuous events (up to 30 s), and parameter curves. Curves
change the intensity (0 to 1, multiplied) and the sharpness (-1 to 1, added) of all events. The times of curve
points are relative to the start of the curve. Players accept at most 16 points per curve, so longer curves
are split; each part begins where the previous part ends. Intensity has no unit, and sharpness is not a
frequency. A pattern therefore preserves only the level relative to a full scale and a rough measure of the
spectrum.

Files written with one full scale keep the level differences between surfaces. The sharpness is a fixed
function of the spectral centroid that covers all frequencies that can be felt, so it keeps the order of
surfaces and the ratios of their frequencies.
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
from texclass.haptics.exchange.external_files import ExternalModel, read_external
from texclass.haptics.exchange.rendition import LONGEST_S, Rendition
from texclass.recording import Samples
from texclass.validation import check_positive

MAX_FILE_BYTES = 4 << 20
MAX_POINTS = 16
"""Largest number of points per curve."""
FELT_HZ = (20.0, 1000.0)
"""Centroids in Hz for sharpness 0 and 1, logarithmic in between: the range of vibration that humans feel. A
narrower range, for example that of the actuator, would give most surfaces the sharpness 1."""
PLAYED_HZ = (65.0, 300.0)
"""Frequencies in Hz that are played for sharpness 0 and 1, linear in between, as in the AHAP encoder of the
MPEG reference software. Apple publishes no values."""
TRANSIENT_S = 0.02
"""Duration of a rendered transient in s. Apple publishes no value."""
FS = 8000.0
"""Default sampling rate of rendered patterns in Hz."""
MAX_EVENTS_S = 6000.0
"""Largest total duration of rendered events in s."""
Control = Literal["HapticIntensityControl", "HapticSharpnessControl"]
Seconds = Annotated[float, Field(ge=0, le=1e6)]
Content = dict[str, Any]
"""Part of a file as a dictionary; `Pattern` validates the whole file."""


class Parameter(ExternalModel):
    """One parameter of an event: its identifier and value."""

    ParameterID: str
    ParameterValue: float


class HapticEvent(ExternalModel):
    """A tap, a continuous vibration or a sound that starts at a given time."""

    Time: Seconds
    EventType: Literal["HapticTransient", "HapticContinuous", "AudioContinuous", "AudioCustom"]
    EventDuration: Seconds | None = None
    EventParameters: tuple[Parameter, ...] = ()

    @model_validator(mode="after")
    def _check_duration(self) -> "HapticEvent":
        if self.EventType == "HapticContinuous" and not self.EventDuration:
            raise ValueError("a continuous event must have a positive EventDuration")
        return self

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return TRANSIENT_S if self.EventType == "HapticTransient" else self.EventDuration or 0.0

    def parameter(self, name: str, default: float) -> float:
        """Return the value of a parameter (or its default), clamped to the range 0 to 1."""
        values = {parameter.ParameterID: parameter.ParameterValue for parameter in self.EventParameters}
        return min(max(values.get(name, default), 0.0), 1.0)


class Point(ExternalModel):
    """A point of a curve: time in s from the start of the curve, and a value that is clamped to [-1, 1]."""

    Time: Seconds
    ParameterValue: Annotated[
        float, BeforeValidator(lambda x: min(max(x, -1.0), 1.0) if isinstance(x, int | float) else x)
    ]


class Curve(ExternalModel):
    """Time course of a parameter, piecewise linear between points."""

    ParameterID: str
    Time: Seconds
    ParameterCurveControlPoints: tuple[Point, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _check_times(self) -> "Curve":
        times = [point.Time for point in self.ParameterCurveControlPoints]
        if any(b < a for a, b in itertools.pairwise(times)):
            raise ValueError(f"the times of curve points must increase, got {times[:4]}...")
        return self


class Item(ExternalModel):
    """An item of a pattern: an event or a curve. Dynamic parameters are ignored."""

    Event: HapticEvent | None = None
    ParameterCurve: Curve | None = None


class Pattern(ExternalModel):
    """The contents of an .ahap file."""

    Version: float
    Metadata: dict[str, Any] = Field(default_factory=dict)
    Pattern: tuple[Item, ...] = Field(max_length=20_000)


def read_ahap(path: str | Path) -> Pattern:
    """Read a pattern from an .ahap file. As in players, values are clamped and unknown keys are ignored.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the file is too large or is not JSON, or a value is invalid.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import json, pathlib, tempfile
    >>> event = {"Time": 0.0, "EventType": "HapticTransient", "EventParameters": []}
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "click.ahap"
    >>> _ = path.write_text(json.dumps({"Version": 1.0, "Pattern": [{"Event": event}]}))
    >>> len(read_ahap(path).Pattern)
    1
    """
    return read_external(Pattern, path, MAX_FILE_BYTES)


def write_ahap(rendition: Rendition, path: str | Path, *, full_scale: float | None = None) -> dict[str, str]:
    """Write a surface to an .ahap file, and return a description of the lost information by topic.

    Taps are written as transients. Other vibrations are written as one continuous event: its intensity
    follows the RMS, and its sharpness follows the spectral centroid between 20 and 1000 Hz.

    Parameters
    ----------
    rendition : Rendition
        Result of `texclass.haptics.exchange.play_texture` or `play_taps`.
    path : str or Path
        File to write; must end in `.ahap`.
    full_scale : float, optional
        RMS (for taps: peak) of intensity 1, in the unit of the rendition; stronger vibration is limited
        (default: the strongest moment of the rendition). Use one value for all surfaces of a set, so that
        their levels can be compared.

    Raises
    ------
    ValueError
        If the path does not end in `.ahap`, or `full_scale` is not positive.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.exchange import Rendition
    >>> x = np.sin(2 * np.pi * 155 * np.arange(1000) / 1000)
    >>> rendition = Rendition("tone", "m/s^2", 1000.0, x, speed=80.0, force=1.0)
    >>> losses = write_ahap(rendition, pathlib.Path(tempfile.mkdtemp()) / "tone.ahap")
    >>> losses["band"]
    'one sharpness, 0.52 for 155 Hz (0 to 1 for 20 to 1000 Hz), played at about 188 Hz'
    """
    path = check_suffix(path, ".ahap")
    if full_scale is not None:
        check_positive(full_scale=full_scale)
    centroid = centroid_hz(rendition.samples, rendition.fs)
    largest = _levels(rendition).max()
    full = full_scale or float(largest) or 1.0
    convert = _convert_taps if rendition.taps.size else _convert_stroke
    items, losses = convert(rendition, full)
    unit, sharpness = rendition.unit, _sharpness(centroid)
    metadata = {"Description": rendition.caption, "Intensity1": f"{full:.6g} {unit}", "Project": "texclass"}
    content = {"Version": 1.0, "Metadata": metadata, "Pattern": items}
    pattern = Pattern.model_validate_json(json.dumps(content))
    write_atomic(path, pattern.model_dump_json(exclude_none=True, indent=1))
    return {
        **rendition.losses,
        **losses,
        "level": _describe_level(float(largest), full, unit, is_own=full_scale is None),
        "band": f"one sharpness, {sharpness:.2f} for {centroid:.0f} Hz (0 to 1 for {FELT_HZ[0]:g} to "
        f"{FELT_HZ[1]:g} Hz), played at about {_played_hz(sharpness):.0f} Hz",
    }


def _levels(rendition: Rendition) -> Samples:
    """Return the peak of each tap, or the RMS of each frame of a vibration."""
    if rendition.taps.size:
        return rendition.taps[:, 1]
    return np.array([np.sqrt(np.mean(np.square(frame))) for frame in _frames(rendition)])


def _describe_level(largest: float, full: float, unit: str, *, is_own: bool) -> str:
    """Describe the full scale, and by how much a vibration exceeds it."""
    text = f"relative to {full:.4g} {unit}, which is intensity 1"
    if is_own:
        return f"{text} (the strongest moment of this file; set one full scale for files that are compared)"
    if largest <= full:
        return f"{text}; the strongest moment has intensity {largest / full:.3g}"
    return f"{text}; the strongest moment is {20 * np.log10(largest / full):.1f} dB stronger and is limited"


def _convert_taps(rendition: Rendition, full: float) -> tuple[list[Content], dict[str, str]]:
    """Return one transient per tap, and the losses; `full` is the peak of intensity 1."""
    items = [
        _event("HapticTransient", time, min(peak / full, 1.0), _sharpness(frequency))
        for time, peak, frequency in rendition.taps.tolist()
    ]
    loss = "chosen by the player: time, peak and frequency of each tap are kept, not its decay"
    return items, {"waveform": loss}


def _frames(rendition: Rendition) -> list[Samples]:
    """Divide a vibration into frames of 20 ms, or of more in long files, so that 60 curves are enough."""
    seconds = rendition.samples.size / rendition.fs
    n = max(round(seconds / max(0.02, seconds / (60 * (MAX_POINTS - 1)))), 1)
    return [frame for frame in np.array_split(rendition.samples, n) if frame.size]


def _convert_stroke(rendition: Rendition, full: float) -> tuple[list[Content], dict[str, str]]:
    """Return a continuous event with its curves, and the losses; `full` is the RMS of intensity 1."""
    x, fs = rendition.samples, rendition.fs
    seconds, frames, rms = x.size / fs, _frames(rendition), _levels(rendition)
    times = (np.arange(len(frames)) + 0.5) * seconds / len(frames)
    times[0], times[-1] = 0.0, seconds if len(frames) > 1 else 0.0
    sharpness = _sharpness(centroid_hz(x, fs))
    shift = np.array([_sharpness(centroid_hz(frame, fs)) for frame in frames]) - sharpness
    duration = {"EventDuration": min(max(seconds, 1e-3), LONGEST_S)}
    items = [
        _event("HapticContinuous", 0.0, 1.0, sharpness, **duration),
        *_curves("HapticIntensityControl", times, np.minimum(rms / full, 1.0)),
        *_curves("HapticSharpnessControl", times, shift),
    ]
    losses = {"waveform": f"only its RMS and centroid every {1000 * seconds / len(frames):.3g} ms are kept"}
    return items, losses


def _event(kind: str, time: float, intensity: float, sharpness: float, **more: float) -> Content:
    values = {"HapticIntensity": intensity, "HapticSharpness": sharpness}
    parameters = [{"ParameterID": name, "ParameterValue": round(value, 4)} for name, value in values.items()]
    return {"Event": {"Time": round(time, 6), "EventType": kind, "EventParameters": parameters, **more}}


def _curves(name: Control, times: Samples, values: Samples) -> list[Content]:
    """Return curves of at most `MAX_POINTS` points each, through the values (n,) at times in s (n,)."""
    curves = []
    for first in range(0, max(times.size - 1, 1), MAX_POINTS - 1):
        part = slice(
            first, first + MAX_POINTS
        )  # the last point of a curve is the first point of the next curve
        start = float(times[first])
        points = [
            {"Time": round(t - start, 6), "ParameterValue": round(value, 4)}
            for t, value in zip(times[part].tolist(), values[part].tolist(), strict=True)
        ]
        curve = {"ParameterID": name, "Time": round(start, 6), "ParameterCurveControlPoints": points}
        curves.append({"ParameterCurve": curve})
    return curves


def centroid_hz(x: Samples, fs: float) -> float:
    """Return the centroid of the power spectrum of samples (n,) within `FELT_HZ` in Hz; 0 for silence."""
    power, hz = np.abs(np.fft.rfft(x)) ** 2, np.fft.rfftfreq(x.size, 1 / fs)
    power[1 : (x.size + 1) // 2] *= 2  # one-sided spectrum: the bins at 0 and at fs/2 occur once
    power[(hz < FELT_HZ[0]) | (hz > FELT_HZ[1])] = 0.0
    total = float(power.sum())
    return float(hz @ power) / total if total > 0 else 0.0


def _sharpness(frequency_hz: float) -> float:
    low, high = FELT_HZ
    return float(np.log(np.clip(frequency_hz, low, high) / low) / np.log(high / low))


def _played_hz(sharpness: float) -> float:
    low, high = PLAYED_HZ
    return low + sharpness * (high - low)


def play_ahap(pattern: Pattern, fs: float = FS) -> Samples:
    """Render a pattern for a simple actuator, as samples (n_samples,) relative to intensity 1.

    A continuous event is a sine wave whose frequency follows the sharpness (`PLAYED_HZ`). A transient is a
    sine wave that decays within 20 ms. Both are assumptions, because the output of real phones is not
    published.

    Parameters
    ----------
    pattern : Pattern
        Pattern to render.
    fs : float
        Sampling rate in Hz (default 8000).

    Raises
    ------
    ValueError
        If the pattern lasts longer than ten minutes, or its events last longer than `MAX_EVENTS_S` in total.

    Examples
    --------
    >>> event = {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 0.1}
    >>> pattern = Pattern.model_validate_json(json.dumps({"Version": 1.0, "Pattern": [{"Event": event}]}))
    >>> play_ahap(pattern).size
    800
    """
    events = [item.Event for item in pattern.Pattern if item.Event]
    events = [event for event in events if event.EventType.startswith("Haptic")]
    seconds = max((event.Time + event.seconds for event in events), default=0.0)
    if seconds > 20 * LONGEST_S:
        raise ValueError(
            f"the duration of the pattern must be at most {20 * LONGEST_S:g} s, got {seconds:g} s"
        )
    if (total := sum(event.seconds for event in events)) > MAX_EVENTS_S:
        raise ValueError(
            f"the total duration of the events must be at most {MAX_EVENTS_S:g} s, got {total:g} s"
        )
    out = np.zeros(max(round(seconds * fs), 1))
    t = np.arange(out.size) / fs
    curves = [item.ParameterCurve for item in pattern.Pattern if item.ParameterCurve]
    gain = _sample_curves(curves, "HapticIntensityControl", 1.0, t)
    shift = _sample_curves(curves, "HapticSharpnessControl", 0.0, t)
    for event in events:
        end = min(math.ceil((event.Time + event.seconds) * fs), out.size)
        part = slice(math.ceil(event.Time * fs), end)
        sharpness = np.clip(event.parameter("HapticSharpness", 0.5) + shift[part], 0, 1)
        cycles = np.cumsum(PLAYED_HZ[0] + sharpness * (PLAYED_HZ[1] - PLAYED_HZ[0])) / fs
        wave = event.parameter("HapticIntensity", 1.0) * gain[part] * np.sin(2 * np.pi * cycles)
        if event.EventType == "HapticTransient":
            wave *= np.exp(-5 * (t[part] - event.Time) / TRANSIENT_S)
        out[part] += wave
    return out


def _sample_curves(curves: Sequence[Curve], name: Control, default: float, t: Samples) -> Samples:
    """Return a parameter at times (n,): the value of the latest curve, which holds its last value."""
    values = np.full(t.size, default)
    selected = (curve for curve in curves if curve.ParameterID == name)
    for curve in sorted(selected, key=lambda curve: curve.Time):
        points = curve.ParameterCurveControlPoints
        times = [curve.Time + point.Time for point in points]
        has_started = t >= curve.Time
        values[has_started] = np.interp(t[has_started], times, [point.ParameterValue for point in points])
    return values
