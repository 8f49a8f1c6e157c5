"""Define packed textures of about a hundred bytes: quantised reflection coefficients and a level law.

A file contains, in this order:

1. a magic number and a checksum;
2. sampling rate, unit and level;
3. for sources with several speeds and forces, the slopes of the level and the range of speed and force;
4. codes of the reflection coefficients of one spectrum, or of the spectra at the lowest and highest speed;
5. optionally, the modes of a tap and the friction coefficient.

Every code decodes to |k| < 1 or to a decaying mode, so the rendered vibration is stable for any bytes.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.textures.contract import NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, Texture
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.grid_texture import LIGHT_N, PEAK_FACTOR, REST_MM_S, grid_renderer
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import UNITS, Samples
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.reflection import log_cosines

MARK = 0xB5
"""Magic number (first byte). It is odd, and no safetensors file begins with an odd byte."""
MIN_BYTES, MAX_BYTES = 4, 512
"""Smallest and largest size of a file in bytes."""
RATES = (500, 800, 1000, 1250, 1600, 2000, 2200, 2500, 4000, 5000, 8000, 10_000, 16_000, 44_100, 48_000)
"""Sampling rates in Hz that are coded in 4 bits; other integer rates take 17 more bits."""


class Quantizer(NamedTuple):
    """Uniform quantizer: lowest value, step, and number of bits of a code."""

    lowest: float
    step: float
    bits: int

    def encode(self, value: float) -> int:
        """Return the code of the nearest quantization level."""
        return int(np.clip(round((value - self.lowest) / self.step), 0, (1 << self.bits) - 1))

    def decode(self, code: Any) -> Any:
        """Return the value of a code, or of an array of codes."""
        return self.lowest + self.step * code


LEVELS, SLOPES = Quantizer(-120.0, 0.5, 9), Quantizer(-16.0, 0.25, 7)
"""Quantizers of the level in dB re 1 unit, and of its change in dB per doubling of speed or force."""
ENDS = Quantizer(-8.0, 0.0625, 9)
"""Quantizer of the limits of the speed and force ranges, in octaves re 1 mm/s and 1 N."""
MODES = (
    Quantizer(3.0, 0.04, 8),
    Quantizer(1.0, 0.2, 6),
    Quantizer(-60.0, 2.5, 6),
    Quantizer(0.0, np.pi / 8, 4),
)
"""Quantizers of a tap mode, 24 bits in total: frequency (octaves re 1 Hz), decay (octaves re 1/s), amplitude
(dB re 1 unit) and phase (rad)."""
MAX_MODES = 4
"""Largest number of modes of a tap."""
MU_STEP, MAX_MU = 0.01, 2.55
"""Step and largest value of the friction coefficient, which is coded in one byte (0: no friction)."""


@dataclass(frozen=True, eq=False)
class PackedTexture(Texture):
    """A texture that is stored in 4 to 512 bytes.

    Parameters
    ----------
    data : array_like of int, shape (n_bytes,)
        Bytes (0 to 255); see `from_bytes`.
    name : str, optional
        Name of the surface, which is not part of the bytes.

    Raises
    ------
    ValueError
        If the number of bytes is not between 4 and 512, or the magic number or checksum is wrong.

    Examples
    --------
    >>> from texclass.haptics.textures import pack
    >>> noise = np.random.default_rng(0).standard_normal(2000)
    >>> texture = pack(noise, n_bytes=16, fs=1000)
    >>> len(texture.to_bytes()), texture.fs, texture.unit
    (16, 1000.0, 'm/s^2')
    """

    family: ClassVar[str] = "packed"
    data: NDArray[np.integer]
    name: str = ""

    def __post_init__(self) -> None:
        data = np.asarray(self.data)
        is_bytes = data.ndim == 1 and data.dtype.kind in "iu" and MIN_BYTES <= data.size <= MAX_BYTES
        if not is_bytes or data.min() < 0 or data.max() > 255:
            raise ValueError(
                f"data must contain {MIN_BYTES} to {MAX_BYTES} bytes (0 to 255), got shape {data.shape}"
            )
        content = bytes(data.astype(np.uint8))
        if content != add_checksum(content[2:]):
            raise ValueError("the data are damaged: wrong magic number or checksum. Pack the texture again")
        frozen = data.astype(np.int64)
        frozen.setflags(write=False)
        object.__setattr__(self, "data", frozen)
        _ = self._contents  # decoding validates the values

    @classmethod
    def from_bytes(cls, data: bytes, name: str = "") -> Self:
        """Create a texture from the bytes of a file."""
        return cls(np.frombuffer(data, dtype=np.uint8).astype(np.int64), name)

    def to_bytes(self) -> bytes:
        """Return the bytes of a file."""
        return bytes(self.data.astype(np.uint8))

    @cached_property
    def _contents(self) -> dict[str, Any]:
        return decode(self.to_bytes()[2:])

    @property
    def fs(self) -> float:
        """Sampling rate in Hz."""
        return float(self._contents["fs"])

    @property
    def unit(self) -> str:
        """Unit of the vibration."""
        return str(self._contents["unit"])

    @property
    def model(self) -> GridModel:
        """Reflection coefficients and powers at the nodes of a grid of speeds and forces."""
        k, level = self._contents["k"], 10 ** (self._contents["level_db"] / 10)
        if not self._contents["ends"]:
            axes = np.array([REST_MM_S]), np.array([LIGHT_N])
            return GridModel(
                axes, k.reshape(1, 1, -1), np.full((1, 1), level), PEAK_FACTOR * float(np.sqrt(level))
            )
        slow, fast, soft, hard = self._contents["ends"]
        fast, hard = max(fast, slow + ENDS.step), max(hard, soft + ENDS.step)
        v, f = (np.array(pair) for pair in ((slow, fast), (soft, hard)))
        slope_speed, slope_force = self._contents["slopes_db"]
        db = (
            self._contents["level_db"]
            + slope_speed * (v - v.mean())[:, np.newaxis]
            + slope_force * (f - f.mean())
        )
        power = 10 ** (db / 10)
        rows = np.repeat(k[:, np.newaxis], 2, axis=1)
        return GridModel((2.0**v, 2.0**f), rows, power, PEAK_FACTOR * float(np.sqrt(power.max())))

    @cached_property
    def speeds(self) -> Samples:
        """Lowest and highest speed in mm/s; the nominal speed if the level does not depend on speed."""
        return self.model.speeds if self._contents["ends"] else np.array([NOMINAL_SPEED_MM_S])

    @cached_property
    def forces(self) -> Samples:
        """Lowest and highest force in N; the nominal force if the level does not depend on force."""
        return self.model.forces if self._contents["ends"] else np.array([NOMINAL_FORCE_N])

    @cached_property
    def tap(self) -> DecayingModes:
        """Response to a tap, with the amplitude of the recording; no modes if no tap was recorded."""
        return decode_modes(self._contents["modes"])

    @property
    def mu(self) -> float:
        """Kinetic friction coefficient, or mean of the friction channel of a recording; 0 if unknown."""
        return float(self._contents["mu"])

    def with_contact(self, *, tap: DecayingModes | None = None, mu: float | None = None) -> Self:
        """Return the texture with another tap (up to 4 modes) or friction coefficient; None keeps the value.

        Raises
        ------
        ValueError
            If the friction coefficient is not between 0 and 2.55.
        """
        if mu is not None and not 0 <= mu <= MAX_MU:
            raise ValueError(f"mu must be between 0 and {MAX_MU:g}, got {mu}")
        modes = encode_modes(self.tap if tap is None else tap)
        contact = encode_contact({"modes": modes, "mu": self.mu if mu is None else mu})
        vibration = self.to_bytes()[2 : 2 + self._contents["size"]]
        return type(self).from_bytes(add_checksum(vibration + contact), self.name)

    @property
    def order(self) -> int:
        """Order of the AR models."""
        return int(self._contents["k"].shape[1])

    @property
    def operations(self) -> float:
        """Multiplications and additions per rendered sample."""
        return self.model.operations(self.fs)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models at speeds (n,) in mm/s and forces (n,) in N."""
        k, power = self.model.at(speed, force)
        return Autoregression(k, np.sqrt(power) * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer whose motion starts at rest; `seed` is the seed of the noise."""
        return grid_renderer(self.model, self.fs, seed=seed)


def encode_modes(modes: DecayingModes) -> list[list[int]]:
    """Encode each mode as four codes: frequency, decay rate, amplitude and phase."""
    half = MODES[3].step / 2
    values = [
        np.log2(np.maximum(modes.frequency_hz, 1.0)),
        np.log2(np.maximum(modes.decay_per_s, 1.0)),
        20 * np.log10(np.maximum(modes.amplitude, 1e-10)),
        (modes.phase + half) % (2 * np.pi) - half,
    ]
    rows = np.transpose(values)
    return [[q.encode(v) for v, q in zip(row, MODES, strict=True)] for row in rows]


def decode_modes(codes: Sequence[Sequence[int]]) -> DecayingModes:
    """Decode modes from four codes per mode; see `encode_modes`."""
    values = [[q.decode(c) for c, q in zip(row, MODES, strict=True)] for row in codes]
    f, B, A, phi = np.array(values).reshape(-1, 4).T
    return DecayingModes(2.0**f, 2.0**B, 10 ** (A / 20), phi)


@cache
def bit_allocation(first: int, last: int, order: int) -> tuple[int, ...]:
    """Return the number of bits of each coefficient, which changes linearly from `first` to `last`."""
    return tuple(int(b) for b in np.rint(np.linspace(first, last, order)))


def decode_reflection(codes: ArrayLike, bits: Sequence[int]) -> Samples:
    """Decode reflection coefficients k, which are quantised in uniform steps of arcsin k.

    Each coefficient is the sine of the middle of a step, so |k| < 1 for any code.

    References
    ----------
    Gray, Markel, "Quantization and bit allocation in speech processing", 1976.
    """
    return np.asarray(np.sin(np.pi * ((np.asarray(codes) + 0.5) / 2.0 ** np.asarray(bits) - 0.5)))


def encode_header(facts: dict[str, Any], bits: Sequence[int]) -> str:
    """Encode sampling rate, unit, order, bit allocation and level law as binary digits."""
    has_range = facts["ends"] is not None
    text = f"{int(has_range)}{UNITS.index(facts['unit']):03b}"
    fs = facts["fs"]
    text += f"{RATES.index(fs):04b}" if fs in RATES else f"1111{fs:017b}"
    text += f"{len(bits):07b}{bits[0] - 1:03b}{bits[-1] - 1:03b}{_digits(facts['level_db'], LEVELS)}"
    if has_range:
        text += "".join(_digits(slope, SLOPES) for slope in facts["slopes_db"])
        text += "".join(_digits(end, ENDS) for end in facts["ends"])
    return text


def _digits(value: float, quantizer: Quantizer) -> str:
    return f"{quantizer.encode(value):0{quantizer.bits}b}"


def encode(facts: dict[str, Any]) -> bytes:
    """Encode sampling rate, unit, level law, codes of spectra, tap and friction as the bytes of a file."""
    bits = facts["bits"]
    text = encode_header(facts, bits)
    text += "".join(f"{c:0{b}b}" for codes in facts["codes"] for c, b in zip(codes, bits, strict=True))
    text += "0" * (-len(text) % 8)
    vibration = bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8))
    return add_checksum(vibration + encode_contact(facts))


def encode_contact(facts: dict[str, Any]) -> bytes:
    """Encode the tap (three bytes per mode) and the friction (at most one byte)."""
    modes = [zip(codes, MODES, strict=True) for codes in facts["modes"]]
    text = ["".join(f"{c:0{q.bits}b}" for c, q in mode) for mode in modes]
    friction = [code] if (code := round(facts["mu"] / MU_STEP)) else []
    return b"".join(int(mode, 2).to_bytes(3) for mode in text) + bytes(friction)


def decode(body: bytes) -> dict[str, Any]:
    """Decode the bytes after the checksum, and validate unit, order and sampling rate."""
    text, position = "".join(f"{byte:08b}" for byte in body), 0

    def take(n: int) -> int:
        nonlocal position
        if position + n > len(text):
            raise ValueError(
                f"the data end within a value, after {len(body) + 2} bytes. Expected a complete texture"
            )
        position += n
        return int(text[position - n : position], 2)

    has_range, unit, rate = take(1), take(3), take(4)
    fs = RATES[rate] if rate < len(RATES) else take(17)
    order, first, last = take(7), take(3) + 1, take(3) + 1
    if unit >= len(UNITS) or order < 1 or fs < 40:
        raise ValueError(
            f"data must have a unit code below {len(UNITS)}, a positive order and a rate of at least 40 Hz, "
            f"got unit code {unit}, order {order} and rate {fs} Hz"
        )
    contents: dict[str, Any] = {"fs": fs, "unit": UNITS[unit]}
    contents["level_db"] = LEVELS.decode(take(LEVELS.bits))
    contents["slopes_db"] = [SLOPES.decode(take(SLOPES.bits)) for _ in range(2 * has_range)]
    contents["ends"] = [ENDS.decode(take(ENDS.bits)) for _ in range(4 * has_range)]
    bits = bit_allocation(first, last, order)
    contents["k"] = decode_reflection([[take(b) for b in bits] for _ in range(1 + has_range)], bits)
    position += -position % 8  # the modes start at a byte boundary, followed by at most one byte of friction
    contents["size"] = position // 8
    n_modes = min((len(text) - position) // 24, MAX_MODES)
    contents["modes"] = [[take(q.bits) for q in MODES] for _ in range(n_modes)]
    contents["mu"] = MU_STEP * take(8) if position < len(text) else 0.0
    return contents


def add_checksum(body: bytes) -> bytes:
    """Return the magic number, the checksum of the body, and the body."""
    return bytes([MARK, zlib.crc32(body) & 0xFF]) + body
