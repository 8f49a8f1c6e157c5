"""A surface in a hundred bytes: the spectrum as quantised reflection coefficients, the level as a law.

The bytes are the whole file: a mark and a checksum, rate, unit, level, and codes of reflection coefficients;
of what was felt at several speeds and forces also the course of the level and the spectra of the slowest and
the fastest; and the modes of a tap and the friction, where they were felt. Every code stands for a |k| below
1 or a mode that decays, so that whatever the bytes, what they render is stable.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.features.hardness import damping
from texclass.features.phase_view import TapView, UndefinedFeatureError, Views
from texclass.phases import segment
from texclass.recording import UNITS, Recording, Samples
from texclass.signals import combine
from texclass.textures.contract import Texture
from texclass.textures.gliding import GlidingRenderer
from texclass.textures.grid import GridModel, shares
from texclass.textures.scan import Scan
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.scores import BAND_EDGES_HZ

MARK = 0xB5
"""The first byte: no safetensors file begins with an odd one."""
LEAST_BYTES, MOST_BYTES = 8, 512
"""That may be asked for; a file may be shorter by what no coefficient needs."""
SHORTEST = 4
RATES = (500, 800, 1000, 1250, 1600, 2000, 2200, 2500, 4000, 5000, 8000, 10_000, 16_000, 44_100, 48_000)
"""Rates of 4 bits, Hz; any other whole number takes 17 more."""
MOST_ORDER, MOST_BITS = 127, 8
LEVELS = -120.0, 0.5, 9
"""Least level in dB re 1 unit, step, bits."""
SLOPES = -16.0, 0.25, 7
"""Of the level at twice the speed, and at twice the force: least, step in dB, bits."""
ENDS = -8.0, 0.0625, 9
"""Slowest, fastest, softest and hardest, in octaves re 1 mm/s and 1 N: least, step, bits."""
MODES = (3.0, 0.04, 8), (1.0, 0.2, 6), (-60.0, 2.5, 6), (0.0, np.pi / 8, 4)
"""Of a tap, 24 bits each: octaves re 1 Hz and re 1/s, dB re 1 unit, phase; least, step and bits."""
MOST_MODES, BYTES_A_MODE, MOST_SAMPLES = 4, 16, 1024
"""One for each 16 bytes that may be used; of a tap so much is looked at."""
MU_STEP, MOST_MU = 0.01, 2.55
"""Of the coefficient of friction: one byte, of which 0 stands for none."""
FRAME_S, LOWEST_HZ = 0.125, 20.0
"""Pieces in which speed and force hold; below, it is the hand that is recorded, not the surface."""
REST_MM_S, LIGHT_N = 5.0, 0.05
"""What is slower or softer is left out of scans, and fades out; above, the level of the slowest holds."""
FELT = np.geomspace(40.0, 200.0, 5), np.geomspace(0.4, 2.0, 3)
"""Speeds and forces at which another texture is felt."""
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
            raise ValueError(f"data have shape {data.shape}; the rule is {SHORTEST} to {MOST_BYTES} bytes")
        sealed = bytes(data.astype(np.uint8))
        if sealed[0] != MARK or sealed[1] != _checksum(sealed[2:]):
            raise ValueError("the bytes are damaged; the rule is their mark and a checksum that fits")
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
        return _decode(self.to_bytes()[2:])

    @property
    def fs(self) -> float:  # type: ignore[override]
        """Sampling rate, Hz."""
        return float(self._read["fs"])

    @property
    def unit(self) -> str:
        """Of the vibration."""
        return str(self._read["unit"])

    @property
    def model(self) -> GridModel:
        """What the bytes stand for: reflection coefficients and powers at its nodes of speed and force."""
        return _grid(self._read)

    @cached_property
    def tap(self) -> DecayingModes:
        """How a tap rings that is as strong as the recorded one; no mode where none was recorded."""
        return _modes(self._read["modes"])

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
            raise ValueError(f"friction is {mu}; the rule is 0 to {MOST_MU:g}")
        facts = {"modes": _mode_codes(self.tap if tap is None else tap), "mu": self.mu if mu is None else mu}
        body = self.to_bytes()[2 : 2 + self._read["size"]] + _held(facts)
        return type(self).from_bytes(bytes([MARK, _checksum(body)]) + body, self.name)

    @property
    def order(self) -> int:
        """Of the models."""
        return int(self._read["k"].shape[1])

    @property
    def operations(self) -> float:
        """Multiplications and additions per rendered sample."""
        return self.model.operations(self.fs)

    def renderer(self, *, seed: int = 0) -> GlidingRenderer:
        """Return a renderer at rest; see `Texture`."""
        model, hop = self.model, max(1, round(self.fs / 1000))
        slow, light = (axis[0] for axis in model.axes)

        def read(velocity: Samples, force: Samples) -> tuple[Samples, Samples]:
            speed = np.hypot(*velocity.T)
            k, power = model.at(np.maximum(speed, slow), np.maximum(force, light))
            heard = np.clip(speed / min(slow, REST_MM_S), 0.0, 1.0)
            heard *= np.clip(force / min(light, LIGHT_N), 0.0, 1.0)
            return np.ascontiguousarray(k), (heard * np.sqrt(power))[:, np.newaxis]

        limit = WIDEST * float(np.sqrt(model.power.max()))
        return GlidingRenderer(
            read, fs=self.fs, order=self.order, hop=hop, limit=limit, seed=seed, motion_hz=30.0
        )


def pack(
    source: Recording | Scan | Texture | ArrayLike,
    n_bytes: int = 64,
    *,
    fs: float | None = None,
    unit: str = "m/s^2",
    name: str = "",
    gain_db: Callable[[Any], Any] | None = None,
    most_hz: float = np.inf,
) -> PackedTexture:
    """Return the texture of at most so many bytes that comes closest to a surface.

    Order and bits of the coefficients are searched for: the goodness of fit of the amplitudes and the
    energies of nine bands (`texclass.vibration.scores`) decide, in the mean over slowest and fastest. A
    tap takes three bytes in sixteen, twelve at most, friction one.

    Parameters
    ----------
    source : Recording, Scan, Texture or array_like of shape (n_samples,)
        A scan tells spectra and level over speed and force; a texture is felt at 15 speeds and forces; a
        vibration alone has one spectrum and one level, whatever the speed. Of a recording it is the movement,
        a scan if it has speed and force; and the tap that is neither the hardest nor the softest, and the
        mean friction, up to 2.55.
    n_bytes : int
        Of the file, 8 to 512.
    fs : float, optional
        Of a vibration, Hz: a whole number up to 131,071.
    unit : str
        Of the vibration; a recording has its own.
    name : str, optional
        Of the surface; by default that of the source.
    gain_db : callable, optional
        Frequencies (Hz) -> dB by which the spectrum is raised; see `retouch`.
    most_hz : float
        The rate at most: what lies above half of it is left out.

    Raises
    ------
    ValueError
        If a rule is broken, the source is silent, or shorter than a piece of 0.125 s.
    """
    if not LEAST_BYTES <= n_bytes <= MOST_BYTES:
        raise ValueError(f"bytes are {n_bytes}; the rule is {LEAST_BYTES} to {MOST_BYTES}")
    if unit not in UNITS:
        raise ValueError(f"unit is {unit!r}; the rule is one of {', '.join(UNITS)}")
    most, name = min(n_bytes // BYTES_A_MODE, MOST_MODES), name or str(getattr(source, "name", ""))
    tap = source.tap.strongest(most) if isinstance(source, PackedTexture) else None
    mu = float(getattr(source, "mu", 0.0))
    if isinstance(source, Recording):
        source, fs, unit, tap, mu = _felt_of(source, most)
    pieces, rate = _pieces(source, fs)
    if rate != round(rate) or not 40 <= min(rate, most_hz) < 1 << 17:
        raise ValueError(f"fs is {rate} Hz; the rule is a whole number, 40 to 131,071")
    seen = _seen(pieces, rate, gain_db, most_hz)
    facts: dict[str, Any] = {
        "unit": unit,
        "modes": [] if tap is None else _mode_codes(tap),
        "mu": min(mu, MOST_MU),
    }
    facts |= {key: seen[key] for key in ("fs", "level_db", "slopes_db", "ends")}
    k = from_autocorrelation(np.fft.irfft(seen["spectra"], axis=-1)[:, : min(MOST_ORDER, seen["most"]) + 1])
    if not _allocations(8 * n_bytes, facts, k.order):  # the spectrum comes first
        facts |= {"modes": [], "mu": 0.0}
    best, least = b"", np.inf
    for bits in _allocations(8 * n_bytes, facts, k.order):
        coded = facts | {"bits": bits, "codes": [_codes(row[: len(bits)], bits) for row in k.reflection]}
        cost = _cost(np.array([_values(c, bits) for c in coded["codes"]]), seen, facts["fs"])
        if cost < least:
            best, least = _encode(coded), cost
    if not best:
        raise ValueError(f"bytes are {n_bytes}; the rule is more of them for several speeds: 16 at least")
    sealed = bytes([MARK, _checksum(best)]) + best
    return PackedTexture.from_bytes(sealed, name)


def _felt_of(
    recording: Recording, most: int
) -> tuple[Scan | Samples, float, str, DecayingModes | None, float]:
    """Return the movement of a recording, rate, unit, at most so many modes of its middle tap, friction."""
    phases = recording.phases or segment(recording)
    begin, end = phases.movement or (0, recording.n_samples)
    combined = combine(recording.acceleration[begin:end])
    felt: Scan | Samples = combined
    if recording.speed is not None and recording.normal_force is not None:
        tracks = recording.speed[begin:end], recording.normal_force[begin:end]
        felt = Scan.along_line(combined, *tracks, recording.fs)
    mu = 0.0 if recording.friction is None else float(np.abs(recording.friction[begin:end]).mean())
    try:
        taps = Views(recording, phases).tap.taps
        hardness = [damping(TapView((tap,), recording.fs)) for tap in taps]
        middle = taps[int(np.argsort(hardness)[(len(taps) - 1) // 2])].impulse
        modes = _ringing(middle[:MOST_SAMPLES], recording.fs, most)
    except UndefinedFeatureError:
        return felt, recording.fs, recording.unit, None, mu
    return felt, recording.fs, recording.unit, modes, mu


def _ringing(x: Samples, fs: float, most: int) -> DecayingModes:
    """Return the modes that explain most of a tap (n,), one after another, then each again beside the others.

    A mode is Re(s exp((2 pi i f - B) t)); of all f and B that can be written, that whose best s leaves least.
    """
    f, B = (2.0 ** _number(np.arange(1 << m[2]), *m) for m in MODES[:2])
    t = np.arange(x.size) / fs
    turns = np.exp(-2j * np.pi * np.outer(f[f < fs / 2], t))
    fades = np.exp(-np.outer(t, B))
    g, h = (fades**2).sum(axis=0), turns**2 @ fades**2
    codes: list[list[int]] = []
    for _ in range(3 * most):
        others = codes if len(codes) < most else codes[1:]
        left = x - _modes(others).synthesize(x.size, fs)
        c = turns @ (left[:, np.newaxis] * fades)
        s = 2 * (c * g - np.conj(c) * h) / np.maximum(g**2 - np.abs(h) ** 2, 1e-9 * g**2)
        j, k = np.unravel_index(np.argmax((np.conj(s) * c).real), s.shape)
        best = DecayingModes(f[j], B[k], np.abs(s[j, k]), np.angle(s[j, k]))
        codes = [*others, *_mode_codes(best)]
    return _modes(codes).strongest(most)


def _mode_codes(modes: DecayingModes) -> list[list[int]]:
    """Return the four codes of each mode."""
    half = MODES[3][1] / 2
    values = [
        np.log2(np.maximum(modes.frequency_hz, 1.0)),
        np.log2(np.maximum(modes.decay_per_s, 1.0)),
        20 * np.log10(np.maximum(modes.amplitude, 1e-10)),
        (modes.phase + half) % (2 * np.pi) - half,
    ]
    return [[_code(v, *rule) for v, rule in zip(row, MODES, strict=True)] for row in np.transpose(values)]


def _modes(codes: Sequence[Sequence[int]]) -> DecayingModes:
    """Return the modes of codes, four each."""
    f, B, A, phi = np.array([[_number(c, *m) for c, m in zip(row, MODES, strict=True)] for row in codes]
                            ).reshape(-1, 4).T  # fmt: skip
    return DecayingModes(2.0**f, 2.0**B, 10 ** (A / 20), phi)


def _pieces(source: Any, fs: float | None) -> tuple[list[tuple[Samples, float, float]], float]:
    """Return pieces of 0.125 s with their speed and force (0 where unknown), and the rate."""
    if isinstance(source, Texture):
        n = round(1.25 * source.fs)
        pieces = []
        for seed, (v, f) in enumerate(product(*FELT)):
            path = np.column_stack([np.full(n, v), np.zeros(n)]), np.full(n, f)
            x = source.renderer(seed=seed).process(*path)[round(0.25 * source.fs) :]
            pieces += [(one, float(v), float(f)) for one in _cut(x, source.fs)]
        return pieces, source.fs
    if isinstance(source, Scan):
        tracks = [_cut(x, source.fs) for x in (source.acceleration, source.speed, source.force)]
        means = [(x, float(v.mean()), float(f.mean())) for x, v, f in zip(*tracks, strict=True)]
        moved = [piece for piece in means if piece[1] >= REST_MM_S and piece[2] >= LIGHT_N]
        if len(moved) < 8:
            raise ValueError(f"scan has {len(moved)} pieces of {FRAME_S} s in motion; the rule is at least 8")
        return moved, source.fs
    if fs is None:
        raise ValueError("fs is missing; the rule is a rate in Hz for a vibration alone")
    x = np.asarray(source, dtype=np.float64)
    if x.ndim != 1 or x.size < FRAME_S * fs or not np.isfinite(x).all():
        raise ValueError(f"vibration has shape {x.shape}; the rule is one axis, finite, {FRAME_S} s at least")
    return [(one, 0.0, 0.0) for one in _cut(x, fs, overlap=2)], fs


def _cut(x: Samples, fs: float, overlap: int = 1) -> list[Samples]:
    n = round(FRAME_S * fs)
    return [x[i : i + n] for i in range(0, x.size - n + 1, n // overlap)]


def _seen(
    pieces: Sequence[tuple[Samples, float, float]],
    fs: float,
    gain_db: Callable[[Any], Any] | None,
    most_hz: float,
) -> dict[str, Any]:
    """Return the spectra to be kept (of the slowest and the fastest, or of all), and the law of the level."""
    samples, speed, force = (np.array(each) for each in zip(*pieces, strict=True))
    n = samples.shape[1]
    window = np.hanning(n + 2)[1:-1]
    centred = (samples - samples.mean(axis=1, keepdims=True)) * window
    f = np.fft.rfftfreq(2 * n, 1 / fs)
    kept = f <= most_hz / 2  # power is the mean over all frequencies
    S = np.abs(np.fft.rfft(centred, 2 * n))[:, kept] ** 2 / (window @ window) * kept.mean()
    f = f[kept]
    if gain_db is not None:
        S *= 10 ** (gain_db(f) / 10)
    low = int(np.searchsorted(f, LOWEST_HZ))
    S[:, :low] = S[:, [low]]
    power = np.fft.irfft(S, axis=-1)[:, 0]
    if not power.max() > 0:
        raise ValueError("the source is silent; the rule is a vibration")
    heard = power > 1e-9 * power.max()
    S, power, speed, force = S[heard], power[heard], speed[heard], force[heard]
    known = bool(speed.min() > 0 and np.ptp(np.log2(speed)) >= 0.5)
    if not known:
        spectra = S.mean(axis=0, keepdims=True)
        law = {"level_db": 10 * np.log10(power.mean()), "slopes_db": None, "ends": None}
    else:
        law = _law(power, speed, force)
        slow, fast, *_ = 2.0 ** np.asarray(law["ends"])
        share = shares((np.array([slow, fast]),), (speed,))
        spectra = share.T @ (S / power[:, np.newaxis])
    spectra = spectra / np.fft.irfft(spectra, axis=-1)[:, :1]
    return law | {"spectra": spectra, "hz": f, "most": f.size - 2, "fs": round(2 * f[-1])}


def _law(power: Samples, speed: Samples, force: Samples) -> dict[str, Any]:
    """Return level (dB at the geometric middle), slopes at twice speed and force, ends in octaves.

    The powers are gamma variables about exp(H theta): a regression with logarithmic link, by scoring.
    """
    at = np.log2([speed, force])
    ends = [float(q) for axis in at for q in np.quantile(axis, [0.05, 0.95])]
    ends = [_number(_code(e, *ENDS), *ENDS) for e in ends]
    middle = np.array([(ends[0] + ends[1]) / 2, (ends[2] + ends[3]) / 2])
    H = np.column_stack([np.ones(speed.size), (at - middle[:, np.newaxis]).T])
    H[:, 2] *= ends[3] - ends[2] >= 0.5
    solve = np.linalg.pinv(H)
    theta = solve @ np.log(power)
    for _ in range(12):
        theta = theta + solve @ np.minimum(power * np.exp(-H @ theta) - 1, 2.0)
    db = 10 / np.log(10) * theta
    return {"level_db": float(db[0]), "slopes_db": [float(db[1]), float(db[2])], "ends": ends}


def _allocations(n_bits: int, facts: dict[str, Any], most: int) -> list[tuple[int, ...]]:
    """Return bits of each coefficient, falling from the first to the last, that fit into so many bits."""
    n_nodes = 1 if facts["ends"] is None else 2
    left = n_bits // 8 * 8 - 8 * len(_held(facts)) - 16 - len(_header(facts, [1]))
    found = []
    for first, last in product(range(2, MOST_BITS + 1), range(2, MOST_BITS + 1)):
        fits = [
            bits
            for order in range(1, min(MOST_ORDER, most) + 1)
            if sum(bits := _falling(first, last, order)) * n_nodes <= left
        ]
        if first >= last and fits:
            chosen = {round(len(fits) * part) for part in (1.0, 0.85, 0.7, 0.5, 0.35, 0.2)}
            found += [fits[max(i, 1) - 1] for i in sorted(chosen)]
    return found


@cache
def _falling(first: int, last: int, order: int) -> tuple[int, ...]:
    return tuple(int(b) for b in np.rint(np.linspace(first, last, order)))


def _codes(k: Samples, bits: Sequence[int]) -> list[int]:
    """Return the codes of reflection coefficients, equal steps of arcsin k."""
    n = 2 ** np.asarray(bits)
    return [int(c) for c in np.clip(np.floor((np.arcsin(k) / np.pi + 0.5) * n), 0, n - 1)]


def _values(codes: Sequence[int], bits: Sequence[int]) -> Samples:
    """Return the reflection coefficients of codes: sin at the middle of a step, |k| < 1 whatever the code.

    References
    ----------
    Gray, Markel, "Quantization and bit allocation in speech processing", 1976.
    """
    return np.asarray(np.sin(np.pi * ((np.asarray(codes) + 0.5) / 2.0 ** np.asarray(bits) - 0.5)))


def _cost(k: Samples, seen: dict[str, Any], fs: float) -> float:
    """Return 1 - GFC of the amplitudes and a hundredth of the RMS difference in dB of the nine bands."""
    f = seen["hz"]
    within = (f >= LOWEST_HZ) & (f <= min(1000.0, fs / 2))
    edges = np.searchsorted(f[within], BAND_EDGES_HZ[fs / 2 >= BAND_EDGES_HZ])[:-1]
    cost = 0.0
    for row, S in zip(k, seen["spectra"], strict=True):
        ln_a = recursions.log_magnitudes(np.ascontiguousarray(row), 2 * np.pi * f[within] / fs)[-1]
        M = np.exp(np.log1p(-(row**2)).sum() - 2 * ln_a)
        T = np.maximum(S[within], 1e-12 * S.max())
        gfc = np.sqrt(M * T).sum() / np.sqrt(M.sum() * T.sum())
        bands = [np.add.reduceat(P, np.unique(np.minimum(edges, T.size - 1))) for P in (M, T)]
        cost += 1 - gfc + 0.01 * np.sqrt(np.mean((10 * np.log10(bands[0] / bands[1])) ** 2))
    return float(cost)


def _header(facts: dict[str, Any], bits: Sequence[int]) -> str:
    """Return rate, unit, order, bits, level and law as binary digits."""
    known = facts["ends"] is not None
    text = f"{int(known)}{UNITS.index(facts['unit']):03b}"
    fs = facts["fs"]
    text += f"{RATES.index(fs):04b}" if fs in RATES else f"1111{fs:017b}"
    text += f"{len(bits):07b}{bits[0] - 1:03b}{bits[-1] - 1:03b}{_digits(facts['level_db'], *LEVELS)}"
    if known:
        text += "".join(_digits(slope, *SLOPES) for slope in facts["slopes_db"])
        text += "".join(_digits(end, *ENDS) for end in facts["ends"])
    return text


def _encode(facts: dict[str, Any]) -> bytes:
    bits = facts["bits"]
    text = _header(facts, bits)
    text += "".join(f"{c:0{b}b}" for codes in facts["codes"] for c, b in zip(codes, bits, strict=True))
    text += "0" * (-len(text) % 8)
    return bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8)) + _held(facts)


def _held(facts: dict[str, Any]) -> bytes:
    """Return the bytes of a tap, three a mode, and of friction, if there is any."""
    modes = [zip(codes, MODES, strict=True) for codes in facts["modes"]]
    text = ["".join(f"{c:0{rule[2]}b}" for c, rule in mode) for mode in modes]
    friction = [code] if (code := round(facts["mu"] / MU_STEP)) else []
    return b"".join(int(mode, 2).to_bytes(3) for mode in text) + bytes(friction)


def _decode(body: bytes) -> dict[str, Any]:
    """Return what the bytes after the checksum say; any of them say something that can be rendered."""
    text, place = "".join(f"{byte:08b}" for byte in body), 0

    def take(n: int) -> int:
        nonlocal place
        if place + n > len(text):
            raise ValueError(f"{len(body) + 2} bytes end within a value; the rule is all that they announce")
        place += n
        return int(text[place - n : place], 2)

    known, unit, rate = take(1), take(3), take(4)
    fs = RATES[rate] if rate < len(RATES) else take(17)
    order, first, last = take(7), take(3) + 1, take(3) + 1
    if unit >= len(UNITS) or order < 1 or fs < 40:
        raise ValueError(f"unit {unit}, order {order}, fs {fs}; the rule is known, above 0, at least 40 Hz")
    found: dict[str, Any] = {"fs": fs, "unit": UNITS[unit]}
    found["level_db"] = _number(take(LEVELS[2]), *LEVELS)
    found["slopes_db"] = [_number(take(SLOPES[2]), *SLOPES) for _ in range(2 * known)]
    found["ends"] = [_number(take(ENDS[2]), *ENDS) for _ in range(4 * known)]
    bits = _falling(first, last, order)
    found["k"] = np.array([_values([take(b) for b in bits], bits) for _ in range(1 + known)])
    place += -place % 8  # whole modes follow, and at most one byte of friction
    found["size"] = place // 8
    n_modes = min((len(text) - place) // 24, MOST_MODES)
    found["modes"] = [[take(rule[2]) for rule in MODES] for _ in range(n_modes)]
    found["mu"] = MU_STEP * take(8) if place < len(text) else 0.0
    return found


def _grid(read: dict[str, Any]) -> GridModel:
    """Return reflection coefficients and powers at the ends of speed and force."""
    k, level = read["k"], 10 ** (read["level_db"] / 10)
    if not read["ends"]:
        axes = np.array([REST_MM_S]), np.array([LIGHT_N])
        return GridModel(axes, k.reshape(1, 1, -1), np.full((1, 1), level), WIDEST * float(np.sqrt(level)))
    slow, fast, soft, hard = read["ends"]
    fast, hard = max(fast, slow + ENDS[1]), max(hard, soft + ENDS[1])
    v, f = (np.array(pair) for pair in ((slow, fast), (soft, hard)))
    of_speed, of_force = read["slopes_db"]
    db = read["level_db"] + of_speed * (v - v.mean())[:, np.newaxis] + of_force * (f - f.mean())
    power = 10 ** (db / 10)
    rows = np.repeat(k[:, np.newaxis], 2, axis=1)
    return GridModel((2.0**v, 2.0**f), rows, power, WIDEST * float(np.sqrt(power.max())))


def _code(value: float, least: float, step: float, bits: int) -> int:
    return int(np.clip(round((value - least) / step), 0, (1 << bits) - 1))


def _digits(value: float, least: float, step: float, bits: int) -> str:
    return f"{_code(value, least, step, bits):0{bits}b}"


def _number(code: Any, least: float, step: float, _bits: int) -> Any:
    return least + step * code


def _checksum(body: bytes) -> int:
    return zlib.crc32(body) & 0xFF
