"""Convert surfaces to MPEG haptics (.hjif) and back.

All files have 1000 ticks per second, because the public reference software interprets some durations as
milliseconds regardless of the timescale of the file.
"""

import base64
import json
import math
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange import wavelet_stream
from texclass.haptics.exchange.hjif import (
    FS,
    MAX_BANDS,
    MAX_HZ,
    TICKS,
    Effect,
    Haptics,
    Perception,
    basis_effects,
    play_hjif,
)
from texclass.haptics.exchange.rendition import Rendition, describe_level_change
from texclass.haptics.textures.contract import NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S
from texclass.recording import UNITS, Samples
from texclass.validation import check_positive

RATE = 8000
"""Number of samples per 1000 ticks in wavelet bands. Players run at 8000 samples per second and hold each
sample until the next. A lower rate would be played as steps, with spectral images above half of that rate."""
BLOCK = 512
"""Number of samples per wavelet block (64 ticks); players require a power of two."""
HEADROOM = 1.01
"""Ratio of the gain to the largest sample. Rounding can slightly exceed 1, at which 16-bit players may wrap
around."""
_DESCRIPTION = re.compile(r"(.*) at ([\d.]+(?:e[+-]\d\d)?) mm/s(?:, ([\d.]+(?:e[+-]\d\d)?) N)?, (\S+)")
"""Description of a vibration: `Rendition.caption` followed by the unit."""

Content = dict[str, Any]
"""Part of a file as a dictionary; `Haptics` validates the whole file."""


def write_hjif(
    rendition: Rendition, path: str | Path, *, planes: int = wavelet_stream.PLANES
) -> dict[str, str]:
    """Write a surface to a .hjif file, and return a description of the lost information by topic.

    Taps are written as transients, vibrations of a few spectral lines as vectorial waves, spatial textures as
    a vibrotactile texture over distance, and other vibrations as wavelet bands. The friction coefficient is
    written as a second perception.

    Parameters
    ----------
    rendition : Rendition
        Result of `texclass.haptics.exchange.play_texture` or `play_taps`.
    path : str or Path
        File to write; must end in `.hjif`.
    planes : int
        Number of bits of the largest wavelet coefficient, 1 to 15 (default 10).

    Returns
    -------
    dict of str to str
        Losses by topic, for example speed, force, level and band.

    Raises
    ------
    ValueError
        If the path does not end in `.hjif`, or `planes` is not between 1 and 15.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> x = np.sin(2 * np.pi * 155 * np.arange(100) / 1000)
    >>> rendition = Rendition("tone", "m/s^2", 1000.0, x, speed=80.0, force=1.0)
    >>> write_hjif(rendition, pathlib.Path(tempfile.mkdtemp()) / "tone.hjif")["band"]
    '0 to 500 Hz of 0 to 500 Hz'
    """
    path = check_suffix(path, ".hjif")
    if not 1 <= planes <= wavelet_stream.MAX_PLANES:
        raise ValueError(f"planes must be between 1 and {wavelet_stream.MAX_PLANES}, got {planes}")
    haptics, losses = build_hjif(rendition, planes)
    write_atomic(path, haptics.model_dump_json(exclude_none=True))
    return losses


def build_hjif(rendition: Rendition, planes: int = wavelet_stream.PLANES) -> tuple[Haptics, dict[str, str]]:
    """Return the contents of a .hjif file and the losses; see `write_hjif`."""
    is_spatial, losses = bool(rendition.pitch_mm), dict(rendition.losses)
    exponent, rate = -3, rendition.fs
    if is_spatial:  # rate in samples per 1000 ticks, each of 10^exponent m
        rate = 1000 / rendition.pitch_mm
        while rate > RATE and exponent > -6:
            exponent, rate = exponent - 1, rate / 10
    if rendition.taps.size:
        channel = _transients(rendition.taps)
        losses["waveform"] = (
            "chosen by the player: time, peak and frequency of each tap are kept, not its decay"
        )
    elif rendition.lines.size:
        channel = _oscillators(rendition)
        losses["lines"] = f"{len(channel['bands'])} of {len(rendition.lines)}, frequencies in whole Hz"
    else:
        channel = _wavelets(rendition.samples, rate, planes)
        top, own, unit = float(RATE), rendition.fs, "Hz"
        if is_spatial:
            top, own, unit = top / 10.0 ** (3 + exponent + 3), 1 / rendition.pitch_mm, "/mm"
        losses["band"] = f"0 to {min(top, own) / 2:g} {unit} of 0 to {own / 2:g} {unit}"
    if is_spatial:
        losses["speed"] = (
            f"the decay of each feature is that at {rendition.speed:.4g} mm/s, fixed to distance"
        )
    if rendition.unit != "m/s^2":
        losses["unit"] = f"{rendition.unit}: its level in m/s^2 is unknown"
    modality = "Vibrotactile Texture" if is_spatial else "Vibrotactile"
    vibration = _perception(0, modality, rendition.caption, channel)
    vibration |= {"description": f"{rendition.caption}, {rendition.unit}", "unit_exponent": exponent}
    mu = rendition.friction
    friction = [_perception(1, "Friction", "coefficient of kinetic friction", _constant(mu))] if mu else []
    content = {
        "version": "2023",
        "profile": "Main",
        "level": 1 if len(channel["bands"]) <= MAX_BANDS[1] else 2,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "description": rendition.name or "surface",
        "timescale": TICKS,
        "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [vibration, *friction],
        "syncs": [],
    }
    haptics = Haptics.model_validate_json(json.dumps(content))
    losses["level"] = "the peak of each tap is kept"
    if not rendition.taps.size:
        losses["level"] = describe_level_change(play_hjif(haptics)[:, 0], rendition.samples)
    return haptics, losses


def _transients(taps: Samples) -> Content:
    """Return a channel of transients for taps (n, 3): time (s), peak and frequency (Hz)."""
    gain = HEADROOM * float(taps[:, 1].max())
    effects = [
        _effect(round(TICKS * time), keyframes=[_keyframe(0, peak / gain, frequency)])
        for time, peak, frequency in taps.tolist()
    ]
    return {"gain": gain, "bands": [_band("Transient", _limits(taps[:, 2]), effects)]}


def _oscillators(rendition: Rendition) -> Content:
    """Return a channel with one band for each of the strongest lines."""
    strongest = np.argsort(-rendition.lines[:, 1], kind="stable")[: MAX_BANDS[2]]
    lines = rendition.lines[np.sort(strongest)]
    gain = HEADROOM * float(lines[:, 1].sum())  # so that their sum never exceeds 1
    end = max(round(TICKS * rendition.samples.size / rendition.fs), 1)
    bands = []
    for frequency, amplitude, phase in lines.tolist():
        # the format uses sine waves; a cosine leads a sine by a quarter of a cycle
        shift = min((phase + math.pi / 2) % (2 * math.pi), 6.28318)
        frames = [_keyframe(tick, amplitude / gain, frequency) for tick in (0, end)]
        effect = _effect(0, phase=shift, base_signal="Sine", keyframes=frames)
        bands.append(_band("VectorialWave", _limits(np.array([frequency])), [effect]))
    return {"gain": gain, "bands": bands}


def _wavelets(x: Samples, rate: float, planes: int) -> Content:
    """Return a wavelet channel for samples (n,) at a rate of `rate` samples per 1000 ticks."""
    own = max(min(round(rate), RATE), 1)
    count = max(round(x.size * own / rate), 1)
    x = signal.resample(x, max(round(x.size * RATE / rate), 1))  # band-limited to rate / 2
    blocks = np.pad(x, (0, -x.size % BLOCK)).reshape(-1, BLOCK)
    coefficients = np.array([wavelet_stream.transform(block) for block in blocks])
    largest = float(np.abs(coefficients).max()) / wavelet_stream.MAX_COEFFICIENT
    gain = HEADROOM * max(float(np.abs(x).max()), largest) or 1.0
    length = BLOCK * TICKS // RATE
    streams = [base64.b64encode(wavelet_stream.encode(row / gain, planes)).decode() for row in coefficients]
    # players decode a trailing = as data bits
    effects = [_effect(i * length, wavelet_stream=stream.rstrip("=")) for i, stream in enumerate(streams)]
    band = _band("WaveletWave", (0, RATE), effects) | {"block_length": length}
    return {"gain": gain, "bands": [band], "frequency_sampling": own, "sample_count": count}


def _constant(value: float) -> Content:
    """Return a channel with a constant positive value."""
    gain = max(value, 1.0)
    frames = [{"relative_position": tick, "amplitude_modulation": value / gain} for tick in (0, TICKS)]
    band = _band("Curve", (0, 0), [_effect(0, keyframes=frames)]) | {"curve_type": "Linear"}
    return {"gain": gain, "bands": [band]}


def _keyframe(tick: int, amplitude: float, frequency: float) -> Content:
    hz = min(round(frequency), int(MAX_HZ))
    return {"relative_position": tick, "amplitude_modulation": amplitude, "frequency_modulation": hz}


def _effect(tick: int, **more: Any) -> Content:
    return {"effect_type": "Basis", "position": tick, **more}


def _limits(frequency_hz: Samples) -> tuple[int, int]:
    """Return the integer frequency limits in Hz that enclose frequencies (n,)."""
    return max(int(frequency_hz.min()) - 1, 0), min(int(frequency_hz.max()) + 2, int(MAX_HZ))


def _band(kind: str, limits: tuple[int, int], effects: list[Content]) -> Content:
    low, high = limits
    return {
        "band_type": kind, "lower_frequency_limit": low, "upper_frequency_limit": high, "effects": effects
    }  # fmt: skip


def _perception(i: int, modality: str, description: str, channel: Content) -> Content:
    """Return a perception with one channel."""
    base = {"id": 0, "description": description, "mixing_coefficient": 1.0, "body_part_mask": 0} | channel
    return {
        "id": i, "perception_modality": modality, "description": description, "avatar_id": 1,
        "effect_library": [], "channels": [base],
    }  # fmt: skip


def to_rendition(haptics: Haptics) -> Rendition:
    """Play the first vibration of a .hjif file and return it with its taps, lines, friction and unit.

    Parameters
    ----------
    haptics : Haptics
        Contents of a file, as returned by `read_hjif`.

    Raises
    ------
    ValueError
        If the file contains no vibration, or `play_hjif` cannot play it.

    Examples
    --------
    >>> x = np.sin(2 * np.pi * 155 * np.arange(100) / 1000)
    >>> haptics, _ = build_hjif(Rendition("tone", "m/s^2", 1000.0, x, speed=80.0, force=1.0))
    >>> rendition = to_rendition(haptics)
    >>> rendition.name, rendition.fs, rendition.speed
    ('tone', 1000.0, 80.0)
    """
    vibrations = [p for p in haptics.perceptions if p.perception_modality.startswith("Vibrotactile")]
    frictions = [p for p in haptics.perceptions if p.perception_modality == "Friction"][:1]
    if not vibrations:
        raise ValueError("the file contains no vibration. Expected a Vibrotactile perception")
    vibration = vibrations[0]
    channel = vibration.channels[0]
    match = _DESCRIPTION.fullmatch(vibration.description)
    name, speed, force, unit = haptics.description, NOMINAL_SPEED_MM_S, NOMINAL_FORCE_N, "arbitrary"
    if match and match[4] in UNITS:
        name, speed, force, unit = match[1], float(match[2]), float(match[3] or 0), match[4]
    check_positive(speed=speed)
    kinds = {band.band_type for band in channel.bands}
    effects = [(start, effect) for start, effect, _ in basis_effects(channel, vibration)]
    gain = 10.0**vibration.perception_unit_exponent * channel.gain
    taps = _taps(effects if kinds == {"Transient"} else [], gain, haptics.timescale)
    lines = _lines(effects if kinds == {"VectorialWave"} else [], gain)
    fs = float(max(channel.bands[0].upper_frequency_limit, 40)) if kinds == {"WaveletWave"} else FS
    if kinds == {"WaveletWave"} and 40 <= (own := channel.frequency_sampling or 0) < fs:
        fs = float(own)  # the coded signal is band-limited to half the rate of the channel
    x = play_hjif(_select(haptics, vibration), fs)[:, 0]
    mu = [float(np.median(play_hjif(_select(haptics, one), 100.0)[:, 0])) for one in frictions]
    pitch = 0.0
    if vibration.perception_modality == "Vibrotactile Texture":  # ticks are distances
        pitch = 10.0 ** (vibration.unit_exponent + 6) / fs
        fs = speed / pitch
    return Rendition(name, unit, fs, x, speed, force, lines, taps, max([0.0, *mu]), pitch)


def _select(haptics: Haptics, perception: Perception) -> Haptics:
    return haptics.model_copy(update={"perceptions": (perception,)})


def _taps(effects: list[tuple[int, Effect]], gain: float, timescale: int) -> Samples:
    """Return time (s), peak and frequency (Hz) of each transient, shape (n, 3)."""
    rows = [
        ((tick + (frame.relative_position or 0)) / timescale, gain * abs(frame.amplitude_modulation or 0), hz)
        for tick, effect in effects
        for frame in effect.keyframes
        if (hz := frame.frequency_modulation or 0)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _lines(effects: list[tuple[int, Effect]], gain: float) -> Samples:
    """Return frequency (Hz), amplitude and phase of cosines, shape (n, 3); n = 0 if any of them varies."""
    rows = []
    for tick, effect in effects:
        levels = {frame.amplitude_modulation for frame in effect.keyframes} - {None}
        frequencies = {frame.frequency_modulation for frame in effect.keyframes} - {None}
        if tick or effect.base_signal != "Sine" or len(levels) != 1 or len(frequencies) != 1:
            return np.zeros((0, 3))
        level, hz = levels.pop() or 0.0, frequencies.pop() or 0
        phase = effect.phase - np.pi / 2 + (np.pi if level < 0 else 0)
        rows += [(hz, gain * abs(level), phase)] * (0 < hz < FS / 2)
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
