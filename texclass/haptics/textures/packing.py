"""How a surface becomes a texture of so many bytes, as it feels, or as it shall feel on the six scales."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.features.hardness import damping
from texclass.features.phase_view import TapView, UndefinedFeatureError, Views
from texclass.features.plan import Plan
from texclass.features.sets import load_feature_set
from texclass.haptics.scales import SCALES
from texclass.haptics.textures import packed
from texclass.haptics.textures.contract import Renderer, Texture, constant_stroke
from texclass.haptics.textures.grid import likeliest_logarithms, shares
from texclass.haptics.textures.packed import PackedTexture, grid_renderer
from texclass.haptics.textures.scan import Scan
from texclass.phases import find_phases
from texclass.recording import UNITS, Phases, Recording, Samples, Tap
from texclass.signals import combine
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.decaying_modes import NO_MODES, DecayingModes
from texclass.vibration.scores import BAND_EDGES_HZ

LEAST_BYTES = 8
"""That may be asked for; a file may be shorter by what no coefficient needs."""
MOST_ORDER, MOST_BITS = 127, 8
FRAME_S, LOWEST_HZ = 0.125, 20.0
"""Pieces in which speed and force hold; below, it is the hand that is recorded, not the surface."""
FELT = np.geomspace(40.0, 200.0, 5), np.geomspace(0.4, 2.0, 3)
"""Speeds and forces at which another texture is felt."""


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
    if not LEAST_BYTES <= n_bytes <= packed.MOST_BYTES:
        raise ValueError(f"bytes are {n_bytes}. Expected {LEAST_BYTES} to {packed.MOST_BYTES}")
    if unit not in UNITS:
        raise ValueError(f"unit is {unit!r}. Expected one of {', '.join(UNITS)}")
    # a mode for each 16 bytes that may be used
    most, name = min(n_bytes // 16, packed.MOST_MODES), name or str(getattr(source, "name", ""))
    tap = source.tap.strongest(most) if isinstance(source, PackedTexture) else NO_MODES
    mu = float(getattr(source, "mu", 0.0))
    if isinstance(source, Recording):
        source, fs, unit, tap, mu = _felt_of(source, most)
    pieces, rate = _pieces(source, fs)
    if rate != round(rate) or not 40 <= min(rate, most_hz) < 1 << 17:
        raise ValueError(f"fs is {rate} Hz. Expected a whole number, 40 to 131,071")
    seen = _seen(pieces, rate, gain_db, most_hz)
    facts: dict[str, Any] = {"unit": unit, "modes": packed.mode_codes(tap), "mu": min(mu, packed.MOST_MU)}
    facts |= {key: seen[key] for key in ("fs", "level_db", "slopes_db", "ends")}
    k = from_autocorrelation(np.fft.irfft(seen["spectra"], axis=-1)[:, : min(MOST_ORDER, seen["most"]) + 1])
    if not _allocations(8 * n_bytes, facts, k.order):  # the spectrum comes first
        facts |= {"modes": [], "mu": 0.0}
    best, least = b"", np.inf
    for bits in _allocations(8 * n_bytes, facts, k.order):
        steps, share = 2 ** np.array(bits), np.arcsin(k.reflection[:, : len(bits)]) / np.pi + 0.5
        codes = np.clip(np.floor(share * steps), 0, steps - 1).astype(np.int64)
        cost = _cost(packed.reflection_of(codes, bits), seen, facts["fs"])
        if cost < least:
            best, least = packed.encode(facts | {"bits": bits, "codes": codes.tolist()}), cost
    if not best:
        raise ValueError(f"bytes are {n_bytes}. Expected more of them for several speeds: 16 at least")
    return PackedTexture.from_bytes(best, name)


def _felt_of(recording: Recording, most: int) -> tuple[Scan | Samples, float, str, DecayingModes, float]:
    """Return the movement of a recording, rate, unit, at most so many modes of its middle tap, friction."""
    phases = recording.phases or find_phases(recording)
    begin, end = phases.movement or (0, recording.n_samples)
    combined = combine(recording.acceleration[begin:end])
    felt: Scan | Samples = combined
    if recording.speed is not None and recording.normal_force is not None:
        tracks = recording.speed[begin:end], recording.normal_force[begin:end]
        felt = Scan.along_line(combined, *tracks, recording.fs)
    mu = 0.0 if recording.friction is None else float(np.abs(recording.friction[begin:end]).mean())
    modes = NO_MODES
    with suppress(UndefinedFeatureError):  # no tap whose hardness is defined
        taps = Views(recording, phases).tap.taps
        hardness = [damping(TapView((tap,), recording.fs)) for tap in taps]
        middle = taps[int(np.argsort(hardness)[(len(taps) - 1) // 2])].impulse
        modes = _ringing(middle[:1024], recording.fs, most)
    return felt, recording.fs, recording.unit, modes, mu


def _ringing(x: Samples, fs: float, most: int) -> DecayingModes:
    """Return the modes that explain most of a tap (n,), one after another, then each again beside the others.

    A mode is Re(s exp((2 pi i f - B) t)); of all f and B that can be written, that whose best s leaves least.
    """
    f, B = (2.0 ** steps.number(np.arange(1 << steps.bits)) for steps in packed.MODES[:2])
    t = np.arange(x.size) / fs
    turns = np.exp(-2j * np.pi * np.outer(f[f < fs / 2], t))
    fades = np.exp(-np.outer(t, B))
    g, h = (fades**2).sum(axis=0), turns**2 @ fades**2
    codes: list[list[int]] = []
    for _ in range(3 * most):
        others = codes if len(codes) < most else codes[1:]
        left = x - packed.modes_of(others).synthesize(x.size, fs)
        c = turns @ (left[:, np.newaxis] * fades)
        s = 2 * (c * g - np.conj(c) * h) / np.maximum(g**2 - np.abs(h) ** 2, 1e-9 * g**2)
        j, k = np.unravel_index(np.argmax((np.conj(s) * c).real), s.shape)
        best = DecayingModes(f[j], B[k], np.abs(s[j, k]), np.angle(s[j, k]))
        codes = [*others, *packed.mode_codes(best)]
    return packed.modes_of(codes).strongest(most)


def _pieces(source: Any, fs: float | None) -> tuple[list[tuple[Samples, float, float]], float]:
    """Return pieces of 0.125 s with their speed and force (0 where unknown), and the rate."""
    if isinstance(source, Texture):
        n, settled = round(1.25 * source.fs), round(0.25 * source.fs)
        pieces = []
        for seed, (v, f) in enumerate(product(*FELT)):
            x = constant_stroke(source, v, f, n - settled, settled=settled, seed=seed)
            pieces += [(one, float(v), float(f)) for one in _cut(x, source.fs)]
        return pieces, source.fs
    if isinstance(source, Scan):
        tracks = [_cut(x, source.fs) for x in (source.acceleration, source.speed, source.force)]
        means = [(x, float(v.mean()), float(f.mean())) for x, v, f in zip(*tracks, strict=True)]
        moved = [piece for piece in means if piece[1] >= packed.REST_MM_S and piece[2] >= packed.LIGHT_N]
        if len(moved) < 8:
            raise ValueError(f"scan has {len(moved)} pieces of {FRAME_S} s in motion. Expected at least 8")
        return moved, source.fs
    if fs is None:
        raise ValueError("fs is missing. Expected a rate in Hz for a vibration alone")
    x = np.asarray(source, dtype=np.float64)
    if x.ndim != 1 or x.size < FRAME_S * fs or not np.isfinite(x).all():
        raise ValueError(f"vibration has shape {x.shape}. Expected one axis, finite, {FRAME_S} s at least")
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
        raise ValueError("the source is silent. Expected a vibration")
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
    """Return level (dB at the geometric middle), slopes at twice speed and force, ends in octaves."""
    at = np.log2([speed, force])
    ends = [float(q) for axis in at for q in np.quantile(axis, [0.05, 0.95])]
    ends = [packed.ENDS.number(packed.ENDS.code(e)) for e in ends]
    middle = np.array([(ends[0] + ends[1]) / 2, (ends[2] + ends[3]) / 2])
    H = np.column_stack([np.ones(speed.size), (at - middle[:, np.newaxis]).T])
    H[:, 2] *= ends[3] - ends[2] >= 0.5
    db = 10 / np.log(10) * likeliest_logarithms(H, power)
    return {"level_db": float(db[0]), "slopes_db": [float(db[1]), float(db[2])], "ends": ends}


def _allocations(n_bits: int, facts: dict[str, Any], most: int) -> list[tuple[int, ...]]:
    """Return bits of each coefficient, falling from the first to the last, that fit into so many bits."""
    n_nodes = 1 if facts["ends"] is None else 2
    left = n_bits // 8 * 8 - 8 * len(packed.held(facts)) - 16 - len(packed.header(facts, [1]))
    found = []
    for first, last in product(range(2, MOST_BITS + 1), range(2, MOST_BITS + 1)):
        fits = [
            bits
            for order in range(1, min(MOST_ORDER, most) + 1)
            if sum(bits := packed.falling(first, last, order)) * n_nodes <= left
        ]
        if first >= last and fits:
            chosen = {round(len(fits) * part) for part in (1.0, 0.85, 0.7, 0.5, 0.35, 0.2)}
            found += [fits[max(i, 1) - 1] for i in sorted(chosen)]
    return found


def _cost(k: Samples, seen: dict[str, Any], fs: float) -> float:
    """Return 1 - GFC of the amplitudes and a hundredth of the RMS difference in dB of the nine bands."""
    f = seen["hz"]
    within = (f >= LOWEST_HZ) & (f <= min(1000.0, fs / 2))
    edges = np.searchsorted(f[within], BAND_EDGES_HZ[fs / 2 >= BAND_EDGES_HZ])[:-1]
    cost = 0.0
    for row, S in zip(k, seen["spectra"], strict=True):
        ln_a = recursions.log_magnitude(np.ascontiguousarray(row), 2 * np.pi * f[within] / fs)
        M = np.exp(np.log1p(-(row**2)).sum() - 2 * ln_a)
        T = np.maximum(S[within], 1e-12 * S.max())
        gfc = np.sqrt(M * T).sum() / np.sqrt(M.sum() * T.sum())
        bands = [np.add.reduceat(P, np.unique(np.minimum(edges, T.size - 1))) for P in (M, T)]
        cost += 1 - gfc + 0.01 * np.sqrt(np.mean((10 * np.log10(bands[0] / bands[1])) ** 2))
    return float(cost)


# To feel otherwise on some scales, and else the same --------------------------------------------------------

OF_SPECTRUM = ("rough", "bumpy", "fine", "regular")
"""Scales that hang on the spectrum; `hard` hangs on a tap, `sticky` on friction, where a texture has them."""


@dataclass(frozen=True)
class RetouchSettings:
    """How textures are felt and changed.

    Attributes
    ----------
    nodes_hz : tuple[float, ...]
        Where the spectrum is raised; linear in between over the logarithm, constant beyond.
    sharpness : tuple[float, float, float]
        Nepers of frequency over which dB are smoothed, dB above that which count 1, and the most that counts.
    most_rate_hz : float
        Rate of the result at most: a finger feels up to 1 kHz, and few bytes hold the more below it.
    probe_s, speed_mm_s, force_n : float
        Duration (s), mean speed (mm/s) and force (N) of the stroke to and fro that is measured.
    tap_fs : float
        Rate of the tap that is measured, Hz.
    most_db : float
        Largest gain at a node, dB.
    near : float
        Largest error of a scale.
    eager : float
        Part of an error by which the next aim is moved.
    """

    nodes_hz: tuple[float, ...] = (25.0, 60.0, 120.0, 300.0)
    sharpness: tuple[float, float, float] = (0.35, 6.0, 2.0)
    most_rate_hz: float = 2000.0
    probe_s: float = 20.0
    speed_mm_s: float = 110.0
    force_n: float = 1.0
    tap_fs: float = 10_000.0
    most_db: float = 30.0
    near: float = 0.5
    eager: float = 0.6


RETOUCH = RetouchSettings()


def felt_scales(texture: Texture, *, seed: int = 0) -> dict[str, float]:
    """Return how a texture feels: see `texclass.haptics.scales`.

    It is stroked to and fro for 20 s, by 1 N and 110 mm/s in the mean.

    Parameters
    ----------
    texture : Texture
        Of a vibration in m/s^2, at more than 300 Hz.
    seed : int
        Of its noise.

    Returns
    -------
    dict of str to float
        `rough`, `bumpy`, `fine` and `regular`; `hard` if it has a `tap`, `sticky` if it has friction (`mu`).

    Raises
    ------
    ValueError
        If the texture is silent, or its rate is too low for the scales.
    """
    of_spectrum = _felt(_probe(texture.renderer(seed=seed), texture.fs), texture.fs)
    return dict(zip(OF_SPECTRUM, of_spectrum.tolist(), strict=True)) | _touched(*_held(texture))


def scales_halfway(one: PackedTexture, other: PackedTexture) -> dict[str, float]:
    """Return the scales of the spectrum of the model halfway between those of two textures of equal rate.

    Reflection coefficients are averaged as their inverse hyperbolic tangent, powers as their logarithm.
    """
    models, order = (one.model, other.model), max(one.order, other.order)
    rows = [np.arctanh(np.pad(m.rows, [(0, 0), (0, 0), (0, order - m.order)])) for m in models]
    power = np.sqrt(one.model.power * other.model.power)
    model = replace(one.model, rows=np.tanh(np.mean(rows, axis=0)), power=power)
    values = _felt(_probe(grid_renderer(model, one.fs), one.fs), one.fs)
    return dict(zip(OF_SPECTRUM, values.tolist(), strict=True))


def retouch(texture: Texture, n_bytes: int = 128, *, unit: str = "m/s^2", **asked: float) -> PackedTexture:
    """Return a texture that feels as asked on some scales, and as before on the others.

    The spectrum is raised around 25, 60, 120 and 300 Hz, and sharpened or flattened, by the same at every
    speed and force: by the least gains, found on a rendered stroke, with which it measures so. What lies
    above 1 kHz is left out, and its level made up for below. A harder tap rings higher and shorter, at the
    same damping, and is as much stronger: that of a stiffer spring.

    Parameters
    ----------
    texture : Texture
        As for `felt_scales`.
    n_bytes : int
        Of the result; see `pack`.
    unit : str
        Of the vibration.
    **asked : float
        Scale -> where on it, usually 0 to 10. `hard` needs a texture with a `tap`, `sticky` one with
        friction (`mu`).

    Raises
    ------
    ValueError
        If another scale is asked for, none is, the texture lacks what it hangs on, or what is asked is out of
        reach: the result is more than half a point off.
    """
    if not asked or not set(asked) <= set(SCALES):
        told = ", ".join(asked) or "nothing"
        raise ValueError(f"asked for {told}. Expected one or more of {', '.join(SCALES)}")
    tap, mu = _held(texture)
    for name, what, lacks in (("hard", "tap", not tap.n_modes), ("sticky", "friction", not mu)):
        if name in asked and lacks:
            raise ValueError(f"asked for {name}, and the texture has no {what}. Expected one with a {what}")
    if "hard" in asked:  # a stiffer spring: a ~ v w sin(w t)
        c = SCALES["hard"].measured(asked["hard"]) / SCALES["hard"].measured(_touched(tap, mu)["hard"])
        higher = np.minimum(c * tap.frequency_hz, 0.49 * RETOUCH.tap_fs)
        tap = DecayingModes(higher, c * tap.decay_per_s, c * tap.amplitude, tap.phase)
    mu = SCALES["sticky"].measured(asked["sticky"]) if "sticky" in asked else mu
    if isinstance(texture, PackedTexture) and not set(asked) & set(OF_SPECTRUM):
        found = texture.holding(tap=tap, mu=mu)
    else:
        found = _reshaped(texture, asked, n_bytes, unit).holding(tap=tap, mu=mu)
    hard = _touched(found.tap, mu).get("hard", 0.0)
    if abs(hard - asked.get("hard", hard)) > RETOUCH.near:
        raise ValueError(f"asked for {asked}. Expected what a tap of 8 to 5000 Hz holds: hard {hard:.1f}")
    return found


def _reshaped(texture: Texture, asked: dict[str, float], n_bytes: int, unit: str) -> PackedTexture:
    """Return the texture with the least gains with which it feels as asked, packed."""
    x = _probe(texture.renderer(), texture.fs)
    before = _felt(x, texture.fs)
    wanted = np.array([asked.get(name, value) for name, value in zip(OF_SPECTRUM, before, strict=True)])
    f = np.fft.rfftfreq(x.size, 1 / texture.fs)
    f = f[f <= RETOUCH.most_rate_hz / 2]
    spectrum = np.fft.rfft(x)[: f.size] * (2 * (f.size - 1) / x.size)
    columns = _columns(f, np.abs(spectrum) ** 2)

    def felt(gains: Samples) -> Samples:
        return _felt(np.fft.irfft(spectrum * 10 ** (columns(f) @ gains / 20)), 2 * f[-1])

    gains, aim, least = np.zeros(len(RETOUCH.nodes_hz) + 1), wanted, np.inf
    for _ in range(6):  # what packing changes is asked for beforehand
        gains = _gains(felt, gains, aim)
        shape = partial(lambda gains, f: columns(f) @ gains, gains)
        one = pack(texture, n_bytes, unit=unit, gain_db=shape, most_hz=RETOUCH.most_rate_hz)
        found = _felt(_probe(one.renderer(), one.fs), one.fs)
        if (missed := np.abs(found - wanted).max()) < least:
            nearest, least, at = one, missed, found
        if least < RETOUCH.near / 2:
            break
        aim = aim + RETOUCH.eager * (wanted - found)
    if least > RETOUCH.near:
        near = ", ".join(f"{name} {value:.1f}" for name, value in zip(OF_SPECTRUM, at, strict=True))
        raise ValueError(
            f"asked for {asked}. Expected what {RETOUCH.most_db:g} dB and {n_bytes} bytes hold: {near}"
        )
    return nearest


def _gains(felt: Callable[[Samples], Samples], gains: Samples, aim: Samples) -> Samples:
    """Return the gains (dB) with which a vibration measures so, by Newton's method, steps may shrink."""
    at = felt(gains)
    for _ in range(12):
        if np.abs(at - aim).max() < 0.05:
            break
        slopes = np.column_stack([felt(gains + step) - at for step in np.eye(gains.size)])
        step = np.clip(np.linalg.pinv(slopes, rcond=1e-2) @ (at - aim), -4.0, 4.0)
        tried = [np.clip(gains - share * step, -RETOUCH.most_db, RETOUCH.most_db) for share in (1.0, 0.4)]
        found = [felt(one) for one in tried]
        best = int(np.argmin([np.abs(one - aim).max() for one in found]))
        gains, at = tried[best], found[best]
    return gains


def _columns(f: Any, power: Any) -> Callable[[Any], Samples]:
    """Return what makes the columns of gains at frequencies: of each node, and of what stands out by 6 dB."""
    grid = np.geomspace(10.0, f[-1], 300)
    within = np.abs(np.log(f[1:] / grid[:, np.newaxis])) < np.maximum(0.03, 2.0 / grid)[:, np.newaxis]
    db = 10 * np.log10(within @ power[1:] / within.sum(axis=1) + 1e-300)
    width, scale, most = RETOUCH.sharpness
    near = np.exp(-0.5 * (np.log(grid / grid[:, np.newaxis]) / width) ** 2)
    above = np.clip((db - near @ db / near.sum(axis=1)) / scale, -most, most)

    def columns(f: Any) -> Samples:
        ln_f = np.log(np.maximum(f, 1.0))
        raised = [np.interp(ln_f, np.log(RETOUCH.nodes_hz), one) for one in np.eye(len(RETOUCH.nodes_hz))]
        return np.column_stack([*raised, np.interp(ln_f, np.log(grid), above)])

    return columns


def _probe(renderer: Renderer, fs: float) -> Samples:
    """Return the vibration of 20 strokes of a second to and fro, without the first tenth."""
    t = np.arange(round((RETOUCH.probe_s + 0.1) * fs)) / fs
    speed = RETOUCH.speed_mm_s * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    velocity = np.column_stack([speed * np.sign(np.sin(np.pi * t) + 1e-12), np.zeros(t.size)])
    felt = renderer.process(velocity, np.full(t.size, RETOUCH.force_n))
    return np.asarray(felt[round(0.1 * fs) :])


def _felt(x: Samples, fs: float) -> Samples:
    """Return what the scales of the spectrum, `OF_SPECTRUM`, say of a movement in m/s^2."""
    stroke = Recording(x, fs, "m/s^2", "stroke", phases=Phases(movement=(0, x.size)))
    return np.array(list(_told(stroke, OF_SPECTRUM, f"texture at {fs:g} Hz").values()))


def _held(texture: Texture) -> tuple[DecayingModes, float]:
    """Return the tap, of no mode where there is none, and the friction, 0 where there is none."""
    return getattr(texture, "tap", NO_MODES), float(getattr(texture, "mu", 0.0))


def _touched(tap: DecayingModes, mu: float) -> dict[str, float]:
    """Return what the scales of a tap and of friction say, where there is one."""
    found: dict[str, float] = {}
    if tap.n_modes:
        x = np.concatenate([np.zeros(500), tap.synthesize(4000, RETOUCH.tap_fs)])
        struck = Phases(taps=(Tap(0, 500, x.size),))
        found |= _told(Recording(x, RETOUCH.tap_fs, "m/s^2", "tap", phases=struck), ("hard",), "tap")
    if mu:
        found["sticky"] = SCALES["sticky"].told(mu)
    return found


@cache
def _plan(names: tuple[str, ...]) -> Plan:
    return Plan.of(load_feature_set("scales")).restricted_to(SCALES[name].column for name in names)


def _told(recording: Recording, names: tuple[str, ...], what: str) -> dict[str, float]:
    """Return what scales say of a recording; all of them have to be defined."""
    plan = _plan(names)
    found = plan.compute(recording)
    for _, reason in found.reasons:
        raise ValueError(f"{what}: {reason}")
    measured = dict(zip(plan.columns, found.values.tolist(), strict=True))
    return {name: SCALES[name].told(measured[SCALES[name].column]) for name in names}
