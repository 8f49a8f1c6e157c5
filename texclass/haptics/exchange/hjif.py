"""MPEG haptics (ISO/IEC 23090-31) as .hjif: what such a file holds, read and played.

    haptics
      perceptions   what is felt: Vibrotactile, Vibrotactile Texture (over distance), Friction
        channels    an actuator: a gain, and the bands that add up to at most 1
          bands     Transient (taps), VectorialWave (oscillators), WaveletWave (any signal), Curve
            effects when they begin, and keyframes or a stream of wavelet coefficients

Positions count ticks: of time, or where `unit_exponent` counts metres, of distance, 1000 of them to what is
a second of time (for -3: a metre; frequencies then are cycles in a metre). Gains hold m/s^2, so that a player
that knows its actuator can show the true level.
"""

import base64
import binascii
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy import interpolate

from texclass.haptics.exchange import wavelet_stream
from texclass.haptics.exchange.foreign import Part, read_foreign
from texclass.haptics.exchange.rendition import TRANSIENT_S
from texclass.recording import Samples

LARGEST_FILE = 16 << 20
TICKS = 1000
FS = 8000.0
"""Hz, the reference software's."""
HIGHEST_HZ = 10_000.0
MOST_BANDS = {1: 7, 2: 63}
"""A channel's, by level; the schema allows more than the reference software does."""
MOST_CHANNELS = {1: 127, 2: 65535}
_INT = 2**31 - 1

Count = Field(ge=0, le=_INT)


@dataclass(frozen=True)
class PlayLimits:
    """What is played of a file at most: a small one can ask for any memory, and for hours.

    Attributes
    ----------
    longest_s : float
        Duration, s.
    channels_s, effects_s : float
        Durations of all channels, and of all effects, together, s.
    coded : int
        Samples of all wavelet blocks together: what decodes in a minute or two.
    effects : int
        Effects of a channel.
    depth : int
        Compositions or references within each other.
    """

    longest_s: float = 600.0
    channels_s: float = 12_000.0
    effects_s: float = 100_000.0
    coded: int = 4_000_000
    effects: int = 100_000
    depth: int = 8


LIMITS = PlayLimits()


class Stated(Part):
    """A part of which what is not known is left out: null is no value."""

    @model_validator(mode="after")
    def _without_null(self) -> Self:
        for name in self.model_fields_set:
            if getattr(self, name) is None:
                raise ValueError(f"{name} is null. Expected a value, or no key")
        return self


class Keyframe(Stated):
    """A point of an effect: ticks from its beginning, amplitude, frequency in whole Hz."""

    relative_position: int | None = Count
    amplitude_modulation: float | None = Field(default=None, ge=-1, le=1)
    frequency_modulation: int | None = Field(default=None, ge=0, le=HIGHEST_HZ)


class Effect(Stated):
    """What is felt from a position on: keyframes, a stream, other effects, or one of the library."""

    effect_type: Literal["Basis", "Composite", "Reference"]
    position: int = Count
    id: int | None = Field(default=None, ge=0, le=_INT)
    phase: float = Field(default=0.0, ge=0, le=6.28318)
    base_signal: Literal["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"] = "Sine"
    keyframes: tuple[Keyframe, ...] = ()
    composition: tuple["Effect", ...] = ()
    wavelet_stream: str | None = None

    @property
    def last(self) -> int:
        """Ticks from its beginning to its last keyframe."""
        return max((one.relative_position or 0 for one in self.keyframes), default=0)

    @model_validator(mode="after")
    def _whole(self) -> "Effect":
        if self.effect_type == "Reference" and self.id is None:
            raise ValueError("a reference has no id. Expected that of an effect of the library")
        if self.wavelet_stream is not None:
            _stream_of(self)
        return self


class Band(Stated):
    """Effects of one kind within limits of frequency (whole Hz); of wavelets the upper one is their rate."""

    band_type: Literal["WaveletWave", "VectorialWave", "Curve", "Transient"]
    lower_frequency_limit: int = Field(ge=0, le=HIGHEST_HZ)
    upper_frequency_limit: int = Field(ge=0, le=HIGHEST_HZ)
    curve_type: Literal["Linear", "Cubic", "Akima", "Bezier", "BSpline", "Unknown"] | None = None
    block_length: int | None = Field(default=None, ge=16, le=1 << 20)
    effects: tuple[Effect, ...]

    @property
    def ring_s(self) -> float:
        """How long an effect is felt beyond its last keyframe."""
        block_s = (self.block_length or 0) / TICKS if self.band_type == "WaveletWave" else 0.0
        return TRANSIENT_S if self.band_type == "Transient" else block_s

    @property
    def block_samples(self) -> int:
        """Samples that each effect of a wavelet band codes; 0 of other bands. ValueError where none can."""
        if self.band_type != "WaveletWave":
            return 0
        n = int(self.ring_s * self.upper_frequency_limit)
        if n < 16 or n & (n - 1) or n > 1 << 16:
            raise ValueError(f"a wavelet block has {n} samples. Expected a power of two, 16 to {1 << 16}")
        return n

    @model_validator(mode="after")
    def _fits(self) -> "Band":
        if self.upper_frequency_limit < self.lower_frequency_limit:
            raise ValueError("its upper frequency limit is below its lower one")
        if self.curve_type is not None and self.band_type != "Curve":
            raise ValueError(f"a {self.band_type} band has a curve type. Expected that of Curve bands only")
        points = [one.keyframes for one in self.effects if one.effect_type == "Basis"]
        bare = any(not of or any(one.amplitude_modulation is None for one in of) for of in points)
        if self.band_type == "Curve" and bare:
            raise ValueError("a curve has no keyframe, or one without amplitude. Expected one for each")
        if self.band_type == "WaveletWave":
            length = self.block_length
            if length is None or length & (length - 1):
                raise ValueError(f"block_length is {length}. Expected a power of two")
            if any(one.keyframes for one in self.effects):
                raise ValueError("an effect of a wavelet band has keyframes. Expected a stream")
            if any(one.effect_type == "Basis" and one.wavelet_stream is None for one in self.effects):
                raise ValueError("an effect of a wavelet band lacks its wavelet_stream. Expected one")
        return self


class Vector(Stated):
    """A direction, or a place among actuators."""

    X: int = Field(ge=-127, le=127)
    Y: int = Field(ge=-127, le=127)
    Z: int = Field(ge=-127, le=127)


class Channel(Stated):
    """What one actuator plays: the sum of its bands, at most 1 in size, times its gain."""

    id: int = Count
    description: str
    gain: float = Field(ge=0)
    mixing_coefficient: float = Field(ge=0)
    body_part_mask: int = Field(ge=0, le=2**32 - 1)
    reference_device_id: int | None = Field(default=None, ge=0, le=_INT)
    frequency_sampling: int | None = Field(default=None, ge=1, le=_INT)
    sample_count: int | None = Field(default=None, ge=0, le=_INT)
    direction: Vector | None = None
    bands: tuple[Band, ...]

    @property
    def stated_s(self) -> float:
        """How long it plays by its own account; 0 if it does not say."""
        return (self.sample_count or 0) / self.frequency_sampling if self.frequency_sampling else 0.0

    @model_validator(mode="after")
    def _unit(self) -> "Channel":
        at = self.direction
        if at is not None and not 0.98 <= math.hypot(at.X, at.Y, at.Z) / 127 <= 1.02:
            raise ValueError("its direction is no unit vector. Expected a length of 127")
        return self


class Device(Stated):
    """An actuator that a file was made for."""

    id: int = Field(ge=1, le=_INT)
    name: str


class Perception(Stated):
    """One kind of feeling."""

    id: int = Count
    perception_modality: Literal[
        "Pressure", "Acceleration", "Velocity", "Position", "Temperature", "Vibrotactile", "Water", "Wind",
        "Force", "Electrotactile", "Vibrotactile Texture", "Stiffness", "Friction", "Humidity",
        "User-defined Temporal", "User-defined Spatial", "Other",
    ]  # fmt: skip
    description: str
    avatar_id: int = Count
    effect_library: tuple[Effect, ...]
    reference_devices: tuple[Device, ...] = ()
    channels: tuple[Channel, ...] = Field(min_length=1)
    unit_exponent: int = Field(default=-3, ge=-128, le=127)
    perception_unit_exponent: int = Field(default=0, ge=-30, le=30)

    @property
    def library(self) -> dict[int | None, Effect]:
        """What references refer to, by id."""
        return {one.id: one for one in self.effect_library}

    @model_validator(mode="after")
    def _consistent(self) -> "Perception":
        for what, parts in (("channel", self.channels), ("reference device", self.reference_devices)):
            _different(what, [part.id for part in parts])
        _different("library effect", [one.id for one in self.effect_library])
        devices = {device.id for device in self.reference_devices}
        for channel in self.channels:
            if channel.reference_device_id is not None and channel.reference_device_id not in devices:
                raise ValueError(
                    f"reference device {channel.reference_device_id} is none of {devices or 'none'}"
                )
            for band in channel.bands:
                for effect in band.effects:
                    _check_references(effect, self.library)
        return self


class Avatar(Stated):
    """A body, or a part of one."""

    id: int = Field(ge=1, le=_INT)
    lod: int = Count
    type: Literal["Vibration", "Pressure", "Temperature", "Custom"]


class Sync(Stated):
    """A moment of the timeline."""

    timestamp: int = Count


class Haptics(Stated):
    """A .hjif file."""

    version: str = Field(pattern="^20(2[3-9]|[3-9][0-9])(-[1-9])?$")
    profile: Literal["Main", "Simple Parametric"]
    level: Literal[1, 2]
    date: str = Field(pattern="[0-9]{4}")
    description: str
    timescale: int = Field(ge=1, le=48_000)
    avatars: tuple[Avatar, ...]
    perceptions: tuple[Perception, ...] = Field(min_length=1)
    syncs: tuple[Sync, ...]

    @model_validator(mode="after")
    def _conforms(self) -> "Haptics":
        _different("avatar", [avatar.id for avatar in self.avatars])
        _different("perception", [one.id for one in self.perceptions])
        simple = self.profile == "Simple Parametric"
        if simple and self.timescale != TICKS:
            raise ValueError(f"timescale is {self.timescale}. Expected {TICKS} for Simple Parametric")
        known = {0, *(avatar.id for avatar in self.avatars)}
        for perception in self.perceptions:
            if perception.avatar_id not in known:
                raise ValueError(f"avatar {perception.avatar_id} of a perception is not defined")
            n_bands = max(len(channel.bands) for channel in perception.channels)
            if len(perception.channels) > MOST_CHANNELS[self.level] or n_bands > MOST_BANDS[self.level]:
                raise ValueError(
                    f"a perception has {len(perception.channels)} channels of {n_bands} bands. Expected "
                    f"{MOST_CHANNELS[self.level]} of {MOST_BANDS[self.level]} at most for level {self.level}"
                )
            kinds = {band.band_type for channel in perception.channels for band in channel.bands}
            if simple and "WaveletWave" in kinds:
                raise ValueError("it has wavelet bands. Expected none for Simple Parametric")
        return self


def read_hjif(path: str | Path) -> Haptics:
    """Return what a .hjif file holds, as strictly checked as the reference software does.

    Raises
    ------
    ValueError
        If it is too long, no JSON or too deep, or breaks a rule; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    return read_foreign(Haptics, path, LARGEST_FILE)


# Playing ----------------------------------------------------------------------------------------------------


def play_hjif(haptics: Haptics, fs: float = FS) -> Samples:
    """Return what a file plays, as the reference software plays it.

    What runs over distance is played at 1000 ticks a second, like time.

    Parameters
    ----------
    haptics : Haptics
    fs : float
        Hz. Wavelet bands hold each of their samples until the next.

    Returns
    -------
    ndarray of shape (n_samples, n_channels)
        Channels of all perceptions, in the order of the file: in m/s^2 for vibrations.

    Raises
    ------
    ValueError
        If it is longer, or has more effects, channels or samples than `LIMITS` allows.
    """
    felt, seconds, lasting, coded = [], 0.0, 0.0, 0
    for perception in haptics.perceptions:
        for channel in perception.channels:
            effects = basis_effects(channel, perception)
            ends = [(at + one.last) / haptics.timescale + band.ring_s for at, one, band in effects]
            seconds = max([seconds, *([channel.stated_s] if channel.stated_s else ends)])
            lasting += sum(ends) - sum(at for at, *_ in effects) / haptics.timescale
            coded += sum(band.block_samples for *_, band in effects)
            felt.append((10.0**perception.perception_unit_exponent * channel.gain, effects))
    if seconds > LIMITS.longest_s:
        raise ValueError(f"it plays for {seconds:g} s. Expected at most {LIMITS.longest_s:g}")
    if len(felt) * seconds > LIMITS.channels_s or lasting > LIMITS.effects_s:
        raise ValueError(
            f"it plays {len(felt)} channels of {seconds:g} s, effects of {lasting:g} s in all. Expected "
            f"at most {LIMITS.channels_s:g} s of channels and {LIMITS.effects_s:g} s of effects"
        )
    if coded > LIMITS.coded:
        raise ValueError(f"its wavelet blocks hold {coded} samples. Expected at most {LIMITS.coded}")
    played = np.zeros((max(round(seconds * fs), 1), len(felt)))
    for column, (gain, effects) in zip(played.T, felt, strict=True):
        for at, effect, band in effects:
            _play_effect(column, at / haptics.timescale, effect, band, fs, haptics.timescale)
        column[:] = gain * np.clip(column, -1, 1)
    return played


def basis_effects(channel: Channel, perception: Perception) -> list[tuple[int, Effect, Band]]:
    """Return ticks, basis effect and band of all that a channel of a perception plays.

    Raises
    ------
    ValueError
        If there are more than `LIMITS` allows, or compositions and references without end.
    """
    library = perception.library
    every = ((at, effect, band) for band in channel.bands for at, effect in _within(band.effects, library))
    # a few effects may refer to each other so often that they are never all seen
    first = [*islice(every, 2 * LIMITS.effects + 1)]
    found = [one for one in first if one[1].effect_type == "Basis"]
    if len(found) > LIMITS.effects or len(first) > 2 * LIMITS.effects:
        raise ValueError(f"a channel has more than {LIMITS.effects} effects, the limit")
    return found


def _within(
    effects: Iterable[Effect], library: Mapping[int | None, Effect], at: int = 0, depth: int = 0
) -> Iterator[tuple[int, Effect]]:
    """Yield ticks and effect of each effect, then of those that it is composed of, or refers to."""
    if depth > LIMITS.depth:
        raise ValueError(f"effects are nested more than {LIMITS.depth} deep, the limit")
    for effect in effects:
        begin = at + effect.position
        yield begin, effect
        if effect.effect_type == "Reference":
            meant = _referred(effect, library).model_copy(update={"position": 0})
            yield from _within([meant], library, begin, depth + 1)
        elif effect.effect_type == "Composite":
            yield from _within(effect.composition, library, begin, depth + 1)


def _play_effect(out: Samples, at: float, effect: Effect, band: Band, fs: float, timescale: int) -> None:
    """Add an effect that begins at a time (s) to samples (n,)."""
    lasting = effect.last / timescale + band.ring_s
    first = max(math.ceil(at * fs - 1e-9), 0)
    t = np.arange(first, min(first + math.ceil(lasting * fs) + 2, out.size)) / fs - at
    if band.band_type == "WaveletWave":
        x = wavelet_stream.inverse(wavelet_stream.decode(_stream_of(effect), band.block_samples))
        index = np.floor(t * band.upper_frequency_limit + 1e-6).astype(np.int64)
        t = t[index < x.size]
        out[first : first + t.size] += x[index[: t.size]]
        return
    t = t[t <= lasting + 1e-12]
    part = out[first : first + t.size]
    if band.band_type == "Transient":
        for frame in effect.keyframes:
            since = t - (frame.relative_position or 0) / timescale
            inside = (since >= 0) & (since <= TRANSIENT_S)
            part[inside] += (frame.amplitude_modulation or 0.0) * np.sin(
                4 * np.pi * since[inside] / TRANSIENT_S
            )
    elif band.band_type == "Curve":
        part += _curve(effect, band, t, timescale)
    elif t.size:
        part += _oscillation(effect, t, timescale)


def _points(effect: Effect, key: str, timescale: int) -> tuple[Samples, Samples]:
    """Return rising times (s) and values of the keyframes that have one."""
    found = {
        (frame.relative_position or 0) / timescale: getattr(frame, key)
        for frame in effect.keyframes
        if getattr(frame, key) is not None
    }
    times = np.array(sorted(found))
    return times, np.array([found[time] for time in times.tolist()], dtype=np.float64)


def _curve(effect: Effect, band: Band, t: Samples, timescale: int) -> Samples:
    """Return a curve at times (n,): straight between keyframes, or smooth through them."""
    times, values = _points(effect, "amplitude_modulation", timescale)
    if not times.size:
        return np.zeros(t.size)
    if band.curve_type == "Linear" or times.size == 1:
        return np.interp(t, times, values)
    smooth = interpolate.pchip_interpolate(times, values, np.clip(t, times[0], times[-1]))
    return np.asarray(smooth)


def _oscillation(effect: Effect, t: Samples, timescale: int) -> Samples:
    """Return an oscillator at times (n,): amplitude and frequency go straight from keyframe to keyframe."""
    times, amplitude = _points(effect, "amplitude_modulation", timescale)
    envelope = np.interp(t, times, amplitude) if times.size else 1.0
    times, frequency = _points(effect, "frequency_modulation", timescale)
    if not times.size:
        times, frequency = np.zeros(1), np.zeros(1)
    # turns at the keyframes, the frequency held before the first; within a piece it is a parabola
    turns = np.concatenate([[0.0], np.cumsum(np.diff(times) * (frequency[1:] + frequency[:-1]) / 2)])
    turns += times[0] * frequency[0]
    now = np.interp(t, times, frequency)
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 1)
    phase = turns[i] + (t - times[i]) * (frequency[i] + now) / 2 + effect.phase / (2 * np.pi)
    return np.asarray(envelope * _WAVES[effect.base_signal](phase))


_WAVES: dict[str, Callable[[Samples], Samples]] = {
    "Sine": lambda turns: np.sin(2 * np.pi * turns),
    "Square": lambda turns: np.where(turns % 1 < 0.5, 1.0, -1.0),
    "Triangle": lambda turns: 1 - 4 * np.abs(np.round(turns - 0.25) - (turns - 0.25)),
    "SawToothUp": lambda turns: 2 * (turns - np.floor(turns + 0.5)),
    "SawToothDown": lambda turns: 2 * (np.floor(turns + 0.5) - turns),
}


def _stream_of(effect: Effect) -> bytes:
    text = (effect.wavelet_stream or "").rstrip("=")
    try:
        return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"wavelet_stream is no base64 ({error}). Expected base64") from None


def _different(what: str, ids: Sequence[int | None]) -> None:
    if len(set(ids)) != len(ids):
        raise ValueError(f"two {what}s have the same id. Expected unique ids")


def _referred(effect: Effect, library: Mapping[int | None, Effect]) -> Effect:
    if effect.id not in library:
        raise ValueError(
            f"effect {effect.id} is referred to. Expected one of the library, {sorted(map(str, library))}"
        )
    return library[effect.id]


def _check_references(effect: Effect, library: Mapping[int | None, Effect], depth: int = 0) -> None:
    if depth > LIMITS.depth:
        raise ValueError(f"effects are nested more than {LIMITS.depth} deep, the limit")
    if effect.effect_type == "Reference":
        _referred(effect, library)
    for inner in effect.composition:
        _check_references(inner, library, depth + 1)
