"""Define the contents of MPEG haptics files (ISO/IEC 23090-31, .hjif), read them and play them.

    haptics
      perceptions   a modality: Vibrotactile, Vibrotactile Texture (over distance), Friction
        channels    an actuator: a gain, and bands whose sum is at most 1
          bands     Transient (taps), VectorialWave (oscillators), WaveletWave (any signal), Curve
            effects a start position, and keyframes or a stream of wavelet coefficients

Positions are in ticks of time. In perceptions over distance, they are in ticks of 10^`unit_exponent` metres,
and 1000 ticks are played like one second of time (for an exponent of -3: one metre, with frequencies in
cycles per metre). Gains are in m/s^2, so that a player with a calibrated actuator can reproduce the true
level.
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
from texclass.haptics.exchange.external_files import ExternalModel, read_external
from texclass.haptics.exchange.rendition import TRANSIENT_S
from texclass.recording import Samples

MAX_FILE_BYTES = 16 << 20
TICKS = 1000
"""Ticks per second in the files that texclass writes."""
FS = 8000.0
"""Default sampling rate of played files in Hz, as in the reference software."""
MAX_HZ = 10_000.0
"""Largest frequency of a band in Hz."""
MAX_BANDS = {1: 7, 2: 63}
"""Largest number of bands per channel, by level; the schema allows more than the reference software."""
MAX_CHANNELS = {1: 127, 2: 65535}
"""Largest number of channels per perception, by level."""
_INT = 2**31 - 1

Count = Field(ge=0, le=_INT)


@dataclass(frozen=True)
class PlayLimits:
    """Limits for playing a file. Without them, a small file could cause hours of output and use all memory.

    Attributes
    ----------
    max_seconds : float
        Largest duration in s.
    max_channels_s, max_effects_s : float
        Largest total duration of all channels in s, and largest total duration of all effects in s.
    max_coded_samples : int
        Largest total number of samples of all wavelet blocks; decoding them takes one to two minutes.
    max_effects : int
        Largest number of effects per channel.
    max_depth : int
        Largest depth of nested compositions or references.
    """

    max_seconds: float = 600.0
    max_channels_s: float = 12_000.0
    max_effects_s: float = 100_000.0
    max_coded_samples: int = 4_000_000
    max_effects: int = 100_000
    max_depth: int = 8


LIMITS = PlayLimits()


class HjifPart(ExternalModel):
    """Base class of the parts of a .hjif file. Optional keys may be omitted, but must not be null."""

    @model_validator(mode="after")
    def _refuse_null(self) -> Self:
        for name in self.model_fields_set:
            if getattr(self, name) is None:
                raise ValueError(f"{name} must not be null. Define a value, or remove the key")
        return self


class Keyframe(HjifPart):
    """A point of an effect: position in ticks from the start of the effect, amplitude, and integer Hz."""

    relative_position: int | None = Count
    amplitude_modulation: float | None = Field(default=None, ge=-1, le=1)
    frequency_modulation: int | None = Field(default=None, ge=0, le=MAX_HZ)


class Effect(HjifPart):
    """An effect with a start position: keyframes, a stream, other effects, or a reference to the library."""

    effect_type: Literal["Basis", "Composite", "Reference"]
    position: int = Count
    id: int | None = Field(default=None, ge=0, le=_INT)
    phase: float = Field(default=0.0, ge=0, le=6.28318)
    base_signal: Literal["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"] = "Sine"
    keyframes: tuple[Keyframe, ...] = ()
    composition: tuple["Effect", ...] = ()
    wavelet_stream: str | None = None

    @property
    def last_tick(self) -> int:
        """Number of ticks from the start of the effect to its last keyframe."""
        return max((frame.relative_position or 0 for frame in self.keyframes), default=0)

    @model_validator(mode="after")
    def _check(self) -> "Effect":
        if self.effect_type == "Reference" and self.id is None:
            raise ValueError("a reference must contain the id of a library effect, got no id")
        if self.wavelet_stream is not None:
            _decode_stream(self)
        return self


class Band(HjifPart):
    """Effects of one kind, with frequency limits in integer Hz; the upper limit of wavelets is the rate."""

    band_type: Literal["WaveletWave", "VectorialWave", "Curve", "Transient"]
    lower_frequency_limit: int = Field(ge=0, le=MAX_HZ)
    upper_frequency_limit: int = Field(ge=0, le=MAX_HZ)
    curve_type: Literal["Linear", "Cubic", "Akima", "Bezier", "BSpline", "Unknown"] | None = None
    block_length: int | None = Field(default=None, ge=16, le=1 << 20)
    effects: tuple[Effect, ...]

    @property
    def tail_s(self) -> float:
        """Duration in s of an effect after its last keyframe."""
        block_s = (self.block_length or 0) / TICKS if self.band_type == "WaveletWave" else 0.0
        return TRANSIENT_S if self.band_type == "Transient" else block_s

    @property
    def block_samples(self) -> int:
        """Number of samples per effect of a wavelet band, 0 for other bands; ValueError if it is invalid."""
        if self.band_type != "WaveletWave":
            return 0
        n = int(self.tail_s * self.upper_frequency_limit)
        if n < 16 or n & (n - 1) or n > 1 << 16:
            raise ValueError(
                f"the samples of a wavelet block must be a power of two from 16 to {1 << 16}, got {n}"
            )
        return n

    @model_validator(mode="after")
    def _check(self) -> "Band":
        if self.upper_frequency_limit < self.lower_frequency_limit:
            raise ValueError(
                f"upper_frequency_limit must be at least lower_frequency_limit "
                f"({self.lower_frequency_limit} Hz), got {self.upper_frequency_limit} Hz"
            )
        if self.curve_type is not None and self.band_type != "Curve":
            raise ValueError(
                f"a {self.band_type} band must not have a curve_type, which is for Curve bands only"
            )
        if self.band_type == "Curve" and any(map(_lacks_amplitude, self.effects)):
            raise ValueError("each curve effect must have keyframes with amplitude_modulation")
        if self.band_type == "WaveletWave":
            length = self.block_length
            if length is None or length & (length - 1):
                raise ValueError(f"block_length must be a power of two, got {length}")
            if any(effect.keyframes for effect in self.effects):
                raise ValueError("an effect of a wavelet band must have a wavelet_stream, got keyframes")
            basis = (effect for effect in self.effects if effect.effect_type == "Basis")
            if any(effect.wavelet_stream is None for effect in basis):
                raise ValueError("an effect of a wavelet band must have a wavelet_stream, got none")
        return self


def _lacks_amplitude(effect: Effect) -> bool:
    frames = effect.keyframes
    is_empty = not frames or any(frame.amplitude_modulation is None for frame in frames)
    return effect.effect_type == "Basis" and is_empty


class Vector(HjifPart):
    """A direction, or a position in the array of actuators."""

    X: int = Field(ge=-127, le=127)
    Y: int = Field(ge=-127, le=127)
    Z: int = Field(ge=-127, le=127)


class Channel(HjifPart):
    """Output of one actuator: the sum of its bands, with a magnitude of at most 1, times the gain."""

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
    def declared_s(self) -> float:
        """Duration of the channel in s as declared in the file; 0 if none is declared."""
        return (self.sample_count or 0) / self.frequency_sampling if self.frequency_sampling else 0.0

    @model_validator(mode="after")
    def _check(self) -> "Channel":
        vector = self.direction
        if vector is not None and not 0.98 <= math.hypot(vector.X, vector.Y, vector.Z) / 127 <= 1.02:
            raise ValueError("direction must be a unit vector, scaled to length 127")
        return self


class Device(HjifPart):
    """An actuator for which the effects were designed."""

    id: int = Field(ge=1, le=_INT)
    name: str


class Perception(HjifPart):
    """Effects of one modality."""

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
        """Effects that references can use, by id."""
        return {effect.id: effect for effect in self.effect_library}

    @model_validator(mode="after")
    def _check(self) -> "Perception":
        for kind, parts in (("channel", self.channels), ("reference device", self.reference_devices)):
            _check_unique(kind, [part.id for part in parts])
        _check_unique("library effect", [effect.id for effect in self.effect_library])
        devices = {device.id for device in self.reference_devices}
        for channel in self.channels:
            if channel.reference_device_id is not None and channel.reference_device_id not in devices:
                raise ValueError(
                    f"reference device {channel.reference_device_id} is not defined. "
                    f"Expected one of {sorted(devices)}"
                )
            for band in channel.bands:
                for effect in band.effects:
                    _check_references(effect, self.library)
        return self


class Avatar(HjifPart):
    """A body, or part of a body, to which the effects are applied."""

    id: int = Field(ge=1, le=_INT)
    lod: int = Count
    type: Literal["Vibration", "Pressure", "Temperature", "Custom"]


class Sync(HjifPart):
    """A synchronization point on the timeline."""

    timestamp: int = Count


class Haptics(HjifPart):
    """The contents of a .hjif file."""

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
    def _check(self) -> "Haptics":
        _check_unique("avatar", [avatar.id for avatar in self.avatars])
        _check_unique("perception", [perception.id for perception in self.perceptions])
        is_simple = self.profile == "Simple Parametric"
        if is_simple and self.timescale != TICKS:
            raise ValueError(
                f"timescale must be {TICKS} for the profile Simple Parametric, got {self.timescale}"
            )
        avatar_ids = {0, *(avatar.id for avatar in self.avatars)}
        for perception in self.perceptions:
            if perception.avatar_id not in avatar_ids:
                raise ValueError(
                    f"avatar {perception.avatar_id} of a perception is not defined. "
                    f"Expected one of {sorted(avatar_ids)}"
                )
            n_channels = len(perception.channels)
            n_bands = max(len(channel.bands) for channel in perception.channels)
            if n_channels > MAX_CHANNELS[self.level] or n_bands > MAX_BANDS[self.level]:
                raise ValueError(
                    f"a perception of level {self.level} must have at most "
                    f"{MAX_CHANNELS[self.level]} channels with {MAX_BANDS[self.level]} bands each, "
                    f"got {n_channels} channels of {n_bands} bands"
                )
            band_types = {band.band_type for channel in perception.channels for band in channel.bands}
            if is_simple and "WaveletWave" in band_types:
                raise ValueError(
                    "wavelet bands require the profile Main. Change the profile, or remove the wavelet bands"
                )
        return self


def read_hjif(path: str | Path) -> Haptics:
    """Read a .hjif file and validate it as strictly as the reference software.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the file is too large, not JSON or nested too deeply, or a value is invalid.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.exchange import Rendition, write_hjif
    >>> x = np.sin(2 * np.pi * 155 * np.arange(100) / 1000)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "tone.hjif"
    >>> losses = write_hjif(Rendition("tone", "m/s^2", 1000.0, x, speed=80.0, force=1.0), path)
    >>> read_hjif(path).description
    'tone'
    """
    return read_external(Haptics, path, MAX_FILE_BYTES)


# Playing ----------------------------------------------------------------------------------------------------


def play_hjif(haptics: Haptics, fs: float = FS) -> Samples:
    """Render the channels of a file in the same way as the reference software.

    Effects over distance are played at 1000 ticks per second, like effects over time.

    Parameters
    ----------
    haptics : Haptics
        Contents of a file, as returned by `read_hjif`.
    fs : float
        Sampling rate in Hz (default 8000). Each sample of a wavelet band is held until the next sample.

    Returns
    -------
    ndarray of shape (n_samples, n_channels)
        Channels of all perceptions, in file order; vibrations are in m/s^2.

    Raises
    ------
    ValueError
        If a duration, the number of effects or wavelet samples, or the nesting depth exceeds `LIMITS`.

    Examples
    --------
    >>> from texclass.haptics.exchange import Rendition
    >>> from texclass.haptics.exchange.hjif_rendition import build_hjif
    >>> x = np.sin(2 * np.pi * 155 * np.arange(100) / 1000)
    >>> haptics, _ = build_hjif(Rendition("tone", "m/s^2", 1000.0, x, speed=80.0, force=1.0))
    >>> play_hjif(haptics).shape
    (800, 1)
    """
    channels, seconds, total_effects_s, n_coded = [], 0.0, 0.0, 0
    for perception in haptics.perceptions:
        for channel in perception.channels:
            effects = basis_effects(channel, perception)
            ends = [
                (start + effect.last_tick) / haptics.timescale + band.tail_s
                for start, effect, band in effects
            ]
            seconds = max([seconds, *([channel.declared_s] if channel.declared_s else ends)])
            total_effects_s += sum(ends) - sum(start for start, *_ in effects) / haptics.timescale
            n_coded += sum(band.block_samples for *_, band in effects)
            channels.append((10.0**perception.perception_unit_exponent * channel.gain, effects))
    if seconds > LIMITS.max_seconds:
        raise ValueError(
            f"the duration of the file must be at most {LIMITS.max_seconds:g} s, got {seconds:g} s"
        )
    if len(channels) * seconds > LIMITS.max_channels_s or total_effects_s > LIMITS.max_effects_s:
        raise ValueError(
            f"the total duration must be at most {LIMITS.max_channels_s:g} s for channels and "
            f"{LIMITS.max_effects_s:g} s for effects, got {len(channels)} channels of {seconds:g} s each "
            f"and {total_effects_s:g} s of effects"
        )
    if n_coded > LIMITS.max_coded_samples:
        raise ValueError(
            f"the wavelet blocks must have at most {LIMITS.max_coded_samples} samples in total, got {n_coded}"
        )
    output = np.zeros((max(round(seconds * fs), 1), len(channels)))
    for column, (gain, effects) in zip(output.T, channels, strict=True):
        for start, effect, band in effects:
            _play_effect(column, start / haptics.timescale, effect, band, fs, haptics.timescale)
        column[:] = gain * np.clip(column, -1, 1)
    return output


def basis_effects(channel: Channel, perception: Perception) -> list[tuple[int, Effect, Band]]:
    """Return the start (in ticks), the basis effect and its band for all effects that a channel plays.

    Raises
    ------
    ValueError
        If the number of effects or their nesting depth exceeds `LIMITS`.
    """
    library = perception.library
    expanded = (
        (start, effect, band) for band in channel.bands for start, effect in _expand(band.effects, library)
    )
    # the expansion of a few effects that refer to each other can be endless
    first = [*islice(expanded, 2 * LIMITS.max_effects + 1)]
    basis = [item for item in first if item[1].effect_type == "Basis"]
    if len(basis) > LIMITS.max_effects or len(first) > 2 * LIMITS.max_effects:
        raise ValueError(
            f"a channel must have at most {LIMITS.max_effects} effects (with references expanded), got more"
        )
    return basis


def _expand(
    effects: Iterable[Effect], library: Mapping[int | None, Effect], start: int = 0, depth: int = 0
) -> Iterator[tuple[int, Effect]]:
    """Yield the start (in ticks) and each effect, followed by the effects it contains or refers to."""
    if depth > LIMITS.max_depth:
        raise ValueError(f"effects must be nested at most {LIMITS.max_depth} deep, got more")
    for effect in effects:
        position = start + effect.position
        yield position, effect
        if effect.effect_type == "Reference":
            target = _resolve(effect, library).model_copy(update={"position": 0})
            yield from _expand([target], library, position, depth + 1)
        elif effect.effect_type == "Composite":
            yield from _expand(effect.composition, library, position, depth + 1)


def _play_effect(out: Samples, start: float, effect: Effect, band: Band, fs: float, timescale: int) -> None:
    """Add an effect that starts at time `start` (s) to the samples `out` (n,)."""
    duration = effect.last_tick / timescale + band.tail_s
    first = max(math.ceil(start * fs - 1e-9), 0)
    t = np.arange(first, min(first + math.ceil(duration * fs) + 2, out.size)) / fs - start
    if band.band_type == "WaveletWave":
        x = wavelet_stream.inverse(wavelet_stream.decode(_decode_stream(effect), band.block_samples))
        index = np.floor(t * band.upper_frequency_limit + 1e-6).astype(np.int64)
        t = t[index < x.size]
        out[first : first + t.size] += x[index[: t.size]]
        return
    t = t[t <= duration + 1e-12]
    segment = out[first : first + t.size]
    if band.band_type == "Transient":
        for frame in effect.keyframes:
            elapsed = t - (frame.relative_position or 0) / timescale
            is_inside = (elapsed >= 0) & (elapsed <= TRANSIENT_S)
            segment[is_inside] += (frame.amplitude_modulation or 0.0) * np.sin(
                4 * np.pi * elapsed[is_inside] / TRANSIENT_S
            )
    elif band.band_type == "Curve":
        segment += _curve(effect, band, t, timescale)
    elif t.size:
        segment += _oscillation(effect, t, timescale)


def _points(effect: Effect, key: str, timescale: int) -> tuple[Samples, Samples]:
    """Return times (s, increasing) and values of the keyframes in which the parameter `key` is defined."""
    by_time = {
        (frame.relative_position or 0) / timescale: getattr(frame, key)
        for frame in effect.keyframes
        if getattr(frame, key) is not None
    }
    times = np.array(sorted(by_time))
    return times, np.array([by_time[time] for time in times.tolist()], dtype=np.float64)


def _curve(effect: Effect, band: Band, t: Samples, timescale: int) -> Samples:
    """Return a curve at times (n,): linear between keyframes, or smooth through them."""
    times, values = _points(effect, "amplitude_modulation", timescale)
    if not times.size:
        return np.zeros(t.size)
    if band.curve_type == "Linear" or times.size == 1:
        return np.interp(t, times, values)
    smooth = interpolate.pchip_interpolate(times, values, np.clip(t, times[0], times[-1]))
    return np.asarray(smooth)


def _oscillation(effect: Effect, t: Samples, timescale: int) -> Samples:
    """Return an oscillator at times (n,); amplitude and frequency are linear between keyframes."""
    times, amplitude = _points(effect, "amplitude_modulation", timescale)
    envelope = np.interp(t, times, amplitude) if times.size else 1.0
    times, frequency = _points(effect, "frequency_modulation", timescale)
    if not times.size:
        times, frequency = np.zeros(1), np.zeros(1)
    # cycles at the keyframes; the phase is parabolic between them, and the first frequency is held before
    cycles = np.concatenate([[0.0], np.cumsum(np.diff(times) * (frequency[1:] + frequency[:-1]) / 2)])
    cycles += times[0] * frequency[0]
    frequency_at_t = np.interp(t, times, frequency)
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 1)
    phase = cycles[i] + (t - times[i]) * (frequency[i] + frequency_at_t) / 2 + effect.phase / (2 * np.pi)
    return np.asarray(envelope * _WAVES[effect.base_signal](phase))


_WAVES: dict[str, Callable[[Samples], Samples]] = {
    "Sine": lambda cycles: np.sin(2 * np.pi * cycles),
    "Square": lambda cycles: np.where(cycles % 1 < 0.5, 1.0, -1.0),
    "Triangle": lambda cycles: 1 - 4 * np.abs(np.round(cycles - 0.25) - (cycles - 0.25)),
    "SawToothUp": lambda cycles: 2 * (cycles - np.floor(cycles + 0.5)),
    "SawToothDown": lambda cycles: 2 * (np.floor(cycles + 0.5) - cycles),
}


def _decode_stream(effect: Effect) -> bytes:
    text = (effect.wavelet_stream or "").rstrip("=")
    try:
        return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"wavelet_stream must be base64 ({error})") from None


def _check_unique(kind: str, ids: Sequence[int | None]) -> None:
    if len(set(ids)) != len(ids):
        raise ValueError(f"two {kind}s have the same id. Expected unique ids")


def _resolve(effect: Effect, library: Mapping[int | None, Effect]) -> Effect:
    if effect.id not in library:
        raise ValueError(
            f"reference to unknown effect {effect.id}. "
            f"Expected an id of the library, {sorted(map(str, library))}"
        )
    return library[effect.id]


def _check_references(effect: Effect, library: Mapping[int | None, Effect], depth: int = 0) -> None:
    if depth > LIMITS.max_depth:
        raise ValueError(f"effects must be nested at most {LIMITS.max_depth} deep, got more")
    if effect.effect_type == "Reference":
        _resolve(effect, library)
    for inner in effect.composition:
        _check_references(inner, library, depth + 1)
