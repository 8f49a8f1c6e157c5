"""A surface in a hundred bytes: the spectrum as quantised reflection coefficients, the level as a law.

The bytes are the whole file: a mark and a checksum, rate, unit, level, and codes of reflection coefficients;
of what was felt at several speeds and forces also the course of the level and the spectra of the slowest and
the fastest; and the modes of a tap and the friction, where they were felt. Every code stands for a |k| below
1 or a mode that decays, so that whatever the bytes, what they render is stable.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.textures.contract import USUAL_MM_S, USUAL_N, Texture
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MotionRenderer
from texclass.recording import UNITS, Samples
from texclass.vibration.autoregressive import Autoregression
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.reflection import log_cosines

MARK = 0xB5
"""The first byte: no safetensors file begins with an odd one."""
SHORTEST, MOST_BYTES = 4, 512
"""Of a file."""
RATES = (500, 800, 1000, 1250, 1600, 2000, 2200, 2500, 4000, 5000, 8000, 10_000, 16_000, 44_100, 48_000)
"""Rates of 4 bits, Hz; any other whole number takes 17 more."""


class Steps(NamedTuple):
    """Numbers as codes: the least one, the step between two, and the bits of a code."""

    least: float
    step: float
    bits: int

    def code(self, value: float) -> int:
        """Return the code of the nearest number there is."""
        return int(np.clip(round((value - self.least) / self.step), 0, (1 << self.bits) - 1))

    def number(self, code: Any) -> Any:
        """Return the number of a code, or those of an array."""
        return self.least + self.step * code


LEVELS, SLOPES = Steps(-120.0, 0.5, 9), Steps(-16.0, 0.25, 7)
"""Of the level in dB re 1 unit, and of its rise at twice the speed, and at twice the force."""
ENDS = Steps(-8.0, 0.0625, 9)
"""Of the slowest, fastest, softest and hardest, in octaves re 1 mm/s and 1 N."""
MODES = Steps(3.0, 0.04, 8), Steps(1.0, 0.2, 6), Steps(-60.0, 2.5, 6), Steps(0.0, np.pi / 8, 4)
"""Of a mode of a tap, 24 bits in all: octaves re 1 Hz and re 1/s, dB re 1 unit, phase."""
MOST_MODES = 4
"""Of a tap."""
MU_STEP, MOST_MU = 0.01, 2.55
"""Of the coefficient of friction: one byte, of which 0 stands for none."""
REST_MM_S, LIGHT_N = 5.0, 0.05
"""What is slower or softer is left out of scans, and fades out; above, the level of the slowest holds."""
WIDEST = 6.0
"""No rendered sample exceeds this many times the largest level."""


@dataclass(frozen=True, eq=False)
class PackedTexture(Texture):
    """A texture that is its bytes.

    Parameters
    ----------
    data : array_like of int, shape (n_bytes,)
        0 ... 255, as `pack` makes them.
    name : str, optional
        Of the surface; the bytes have none.

    Raises
    ------
    ValueError
        If it is not 4 to 512 bytes, they do not begin with the mark, or do not fit their checksum.
    """

    family: ClassVar[str] = "packed"
    data: NDArray[np.integer]
    name: str = ""

    def __post_init__(self) -> None:
        data = np.asarray(self.data)
        whole = data.ndim == 1 and data.dtype.kind in "iu" and SHORTEST <= data.size <= MOST_BYTES
        if not whole or data.min() < 0 or data.max() > 255:
            raise ValueError(f"data have shape {data.shape}. Expected {SHORTEST} to {MOST_BYTES} bytes")
        content = bytes(data.astype(np.uint8))
        if content != sealed(content[2:]):
            raise ValueError("the bytes are damaged. Expected their mark and a checksum that fits")
        kept = data.astype(np.int64)
        kept.setflags(write=False)
        object.__setattr__(self, "data", kept)
        _ = self._read  # its rules

    @classmethod
    def from_bytes(cls, data: bytes, name: str = "") -> Self:
        """Return the texture of the bytes of a file."""
        return cls(np.frombuffer(data, dtype=np.uint8).astype(np.int64), name)

    def to_bytes(self) -> bytes:
        """Return the bytes."""
        return bytes(self.data.astype(np.uint8))

    @cached_property
    def _read(self) -> dict[str, Any]:
        return decode(self.to_bytes()[2:])

    @property
    def fs(self) -> float:
        """Sampling rate, Hz."""
        return float(self._read["fs"])

    @property
    def unit(self) -> str:
        """Of the vibration."""
        return str(self._read["unit"])

    @property
    def model(self) -> GridModel:
        """What the bytes stand for: reflection coefficients and powers at its nodes of speed and force."""
        k, level = self._read["k"], 10 ** (self._read["level_db"] / 10)
        if not self._read["ends"]:
            axes = np.array([REST_MM_S]), np.array([LIGHT_N])
            return GridModel(
                axes, k.reshape(1, 1, -1), np.full((1, 1), level), WIDEST * float(np.sqrt(level))
            )
        slow, fast, soft, hard = self._read["ends"]
        fast, hard = max(fast, slow + ENDS.step), max(hard, soft + ENDS.step)
        v, f = (np.array(pair) for pair in ((slow, fast), (soft, hard)))
        of_speed, of_force = self._read["slopes_db"]
        db = self._read["level_db"] + of_speed * (v - v.mean())[:, np.newaxis] + of_force * (f - f.mean())
        power = 10 ** (db / 10)
        rows = np.repeat(k[:, np.newaxis], 2, axis=1)
        return GridModel((2.0**v, 2.0**f), rows, power, WIDEST * float(np.sqrt(power.max())))

    @cached_property
    def speeds(self) -> Samples:
        """Of the slowest and the fastest spectrum, mm/s; a usual one where the level follows none."""
        return self.model.speeds if self._read["ends"] else np.array([USUAL_MM_S])

    @cached_property
    def forces(self) -> Samples:
        """Softest and hardest, N; a usual one where the level follows none."""
        return self.model.forces if self._read["ends"] else np.array([USUAL_N])

    @cached_property
    def tap(self) -> DecayingModes:
        """How a tap rings that is as strong as the recorded one; no mode where none was recorded."""
        return modes_of(self._read["modes"])

    @property
    def mu(self) -> float:
        """Coefficient of kinetic friction (of a recording: V of its bridge); 0 where none is known."""
        return float(self._read["mu"])

    def holding(self, *, tap: DecayingModes | None = None, mu: float | None = None) -> Self:
        """Return the texture with another tap (up to 4 modes) or friction; None keeps it.

        Raises
        ------
        ValueError
            If the friction is not 0 to 2.55.
        """
        if mu is not None and not 0 <= mu <= MOST_MU:
            raise ValueError(f"friction is {mu}. Expected 0 to {MOST_MU:g}")
        facts = {"modes": mode_codes(self.tap if tap is None else tap), "mu": self.mu if mu is None else mu}
        body = self.to_bytes()[2 : 2 + self._read["size"]] + held(facts)
        return type(self).from_bytes(sealed(body), self.name)

    @property
    def order(self) -> int:
        """Of the models."""
        return int(self._read["k"].shape[1])

    @property
    def operations(self) -> float:
        """Multiplications and additions per rendered sample."""
        return self.model.operations(self.fs)

    def autoregressions(self, speed: Samples, force: Samples) -> Autoregression:
        """Return the AR models at speeds (n,) and forces (n,)."""
        k, power = self.model.at(speed, force)
        return Autoregression(k, np.sqrt(power) * np.exp(log_cosines(k).sum(axis=-1)))

    def renderer(self, *, seed: int = 0) -> MotionRenderer:
        """Return a renderer at rest; see `Texture`."""
        return grid_renderer(self.model, self.fs, seed=seed)


def grid_renderer(model: GridModel, fs: float, *, seed: int = 0) -> MotionRenderer:
    """Return a renderer at rest of a model over speed and force; it is silent without either."""
    slow, light = (axis[0] for axis in model.axes)

    def read(course: Samples) -> tuple[Samples, Samples]:
        speed, force = np.hypot(course[:, 0], course[:, 1]), course[:, 2]
        k, power = model.at(np.maximum(speed, slow), np.maximum(force, light))
        heard = np.clip(speed / min(slow, REST_MM_S), 0.0, 1.0)
        heard *= np.clip(force / min(light, LIGHT_N), 0.0, 1.0)
        return k, (heard * np.sqrt(power))[:, np.newaxis]

    return MotionRenderer(
        read,
        fs=fs,
        order=model.order,
        hop=max(1, round(fs / 1000)),
        limit=WIDEST * float(np.sqrt(model.power.max())),
        seed=seed,
        motion_hz=30.0,
        n_drawn=model.order + 1,
    )


def mode_codes(modes: DecayingModes) -> list[list[int]]:
    """Return the four codes of each mode."""
    half = MODES[3].step / 2
    values = [
        np.log2(np.maximum(modes.frequency_hz, 1.0)),
        np.log2(np.maximum(modes.decay_per_s, 1.0)),
        20 * np.log10(np.maximum(modes.amplitude, 1e-10)),
        (modes.phase + half) % (2 * np.pi) - half,
    ]
    return [[steps.code(v) for v, steps in zip(row, MODES, strict=True)] for row in np.transpose(values)]


def modes_of(codes: Sequence[Sequence[int]]) -> DecayingModes:
    """Return the modes of codes, four each."""
    found = [[steps.number(c) for c, steps in zip(row, MODES, strict=True)] for row in codes]
    f, B, A, phi = np.array(found).reshape(-1, 4).T
    return DecayingModes(2.0**f, 2.0**B, 10 ** (A / 20), phi)


@cache
def falling(first: int, last: int, order: int) -> tuple[int, ...]:
    """Return the bits of each coefficient, evenly from those of the first to those of the last."""
    return tuple(int(b) for b in np.rint(np.linspace(first, last, order)))


def reflection_of(codes: ArrayLike, bits: Sequence[int]) -> Samples:
    """Return the reflection coefficients of codes (..., order), equal steps of arcsin k.

    They are sin at the middle of a step: |k| < 1 whatever the code.

    References
    ----------
    Gray, Markel, "Quantization and bit allocation in speech processing", 1976.
    """
    return np.asarray(np.sin(np.pi * ((np.asarray(codes) + 0.5) / 2.0 ** np.asarray(bits) - 0.5)))


def header(facts: dict[str, Any], bits: Sequence[int]) -> str:
    """Return rate, unit, order, bits, level and law as binary digits."""
    known = facts["ends"] is not None
    text = f"{int(known)}{UNITS.index(facts['unit']):03b}"
    fs = facts["fs"]
    text += f"{RATES.index(fs):04b}" if fs in RATES else f"1111{fs:017b}"
    text += f"{len(bits):07b}{bits[0] - 1:03b}{bits[-1] - 1:03b}{_digits(facts['level_db'], LEVELS)}"
    if known:
        text += "".join(_digits(slope, SLOPES) for slope in facts["slopes_db"])
        text += "".join(_digits(end, ENDS) for end in facts["ends"])
    return text


def _digits(value: float, steps: Steps) -> str:
    return f"{steps.code(value):0{steps.bits}b}"


def encode(facts: dict[str, Any]) -> bytes:
    """Return the bytes of a file: rate, unit, level and its law, codes of spectra, tap and friction."""
    bits = facts["bits"]
    text = header(facts, bits)
    text += "".join(f"{c:0{b}b}" for codes in facts["codes"] for c, b in zip(codes, bits, strict=True))
    text += "0" * (-len(text) % 8)
    return sealed(bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8)) + held(facts))


def held(facts: dict[str, Any]) -> bytes:
    """Return the bytes of a tap, three a mode, and of friction, if there is any."""
    modes = [zip(codes, MODES, strict=True) for codes in facts["modes"]]
    text = ["".join(f"{c:0{steps.bits}b}" for c, steps in mode) for mode in modes]
    friction = [code] if (code := round(facts["mu"] / MU_STEP)) else []
    return b"".join(int(mode, 2).to_bytes(3) for mode in text) + bytes(friction)


def decode(body: bytes) -> dict[str, Any]:
    """Return what the bytes after the checksum say; any of them say something that can be rendered."""
    text, place = "".join(f"{byte:08b}" for byte in body), 0

    def take(n: int) -> int:
        nonlocal place
        if place + n > len(text):
            raise ValueError(f"{len(body) + 2} bytes end within a value. Expected all that they announce")
        place += n
        return int(text[place - n : place], 2)

    known, unit, rate = take(1), take(3), take(4)
    fs = RATES[rate] if rate < len(RATES) else take(17)
    order, first, last = take(7), take(3) + 1, take(3) + 1
    if unit >= len(UNITS) or order < 1 or fs < 40:
        raise ValueError(f"unit {unit}, order {order}, fs {fs}. Expected known, above 0, at least 40 Hz")
    found: dict[str, Any] = {"fs": fs, "unit": UNITS[unit]}
    found["level_db"] = LEVELS.number(take(LEVELS.bits))
    found["slopes_db"] = [SLOPES.number(take(SLOPES.bits)) for _ in range(2 * known)]
    found["ends"] = [ENDS.number(take(ENDS.bits)) for _ in range(4 * known)]
    bits = falling(first, last, order)
    found["k"] = reflection_of([[take(b) for b in bits] for _ in range(1 + known)], bits)
    place += -place % 8  # whole modes follow, and at most one byte of friction
    found["size"] = place // 8
    n_modes = min((len(text) - place) // 24, MOST_MODES)
    found["modes"] = [[take(steps.bits) for steps in MODES] for _ in range(n_modes)]
    found["mu"] = MU_STEP * take(8) if place < len(text) else 0.0
    return found


def sealed(body: bytes) -> bytes:
    """Return the mark, a checksum, and the bytes that it is of."""
    return bytes([MARK, zlib.crc32(body) & 0xFF]) + body
