"""Fit packed textures to surfaces, and measure and change their perceptual scales."""

import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
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
from texclass.haptics.textures.contract import Renderer, Texture, constant_stroke, stroke_range
from texclass.haptics.textures.grid import fit_gamma_regression, interpolation_weights
from texclass.haptics.textures.grid_texture import LIGHT_N, REST_MM_S, grid_renderer
from texclass.haptics.textures.packed import PackedTexture
from texclass.haptics.textures.scan import Scan, motion_at_acceleration
from texclass.phases import find_phases
from texclass.recording import UNITS, Phases, Recording, Samples, Tap
from texclass.signals import combine
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.decaying_modes import NO_MODES, DecayingModes
from texclass.vibration.scores import BAND_EDGES_HZ

MIN_BYTES = 8
"""Smallest size in bytes that `pack` accepts. The file is smaller if more coefficients do not improve it."""
MAX_ORDER, MAX_BITS = 127, 8
"""Largest order, and largest number of bits per coefficient, that the format can store."""
FRAME_S, LOWEST_HZ = 0.125, 20.0
"""Length of a frame with nearly constant speed and force in s, and frequency in Hz below which hand motion
dominates."""
N_SAMPLED_SPEEDS, N_SAMPLED_FORCES = 5, 3
"""Numbers of speeds and forces at which other textures are sampled, over their range."""

Frame = tuple[Samples, float, float]
"""Vibration, mean speed (mm/s) and mean force (N) of a frame; speed and force are 0 if unknown."""


def pack(
    source: Recording | Scan | Texture | ArrayLike,
    n_bytes: int = 64,
    *,
    fs: float | None = None,
    unit: str = "m/s^2",
    name: str = "",
    gain_db: Callable[[Any], Any] | None = None,
    max_hz: float = np.inf,
) -> PackedTexture:
    """Fit a packed texture of at most `n_bytes` bytes to a surface.

    The order and the number of bits of each coefficient are found by search. The criterion combines the
    goodness of fit of the amplitudes and the error of the energies in nine bands
    (`texclass.vibration.scores`), averaged over the spectra at the lowest and highest speed. The tap takes
    three of every 16 bytes, at most twelve. The friction takes one byte.

    Parameters
    ----------
    source : Recording, Scan, Texture or array_like of shape (n_samples,)
        Source of the texture:

        - a recording: its movement (used as a scan if speed and force are recorded), the tap of median
          hardness, and the mean friction up to 2.55;
        - a scan: spectra and level as functions of speed and force;
        - a texture: spectra and level, sampled at 15 speeds and forces over its range;
        - a vibration: one spectrum and one level for all speeds.
    n_bytes : int
        Largest size of the file in bytes, 8 to 512 (default 64).
    fs : float, optional
        Sampling rate in Hz, an integer up to 131,071. Required if the source is an array; otherwise ignored.
    unit : str
        Unit of the vibration (default "m/s^2"); ignored for recordings, which contain their unit.
    name : str, optional
        Name of the surface (default: the name of the source).
    gain_db : callable, optional
        Function that maps frequencies (Hz) to gains in dB, which are applied to the spectrum; see `retouch`.
    max_hz : float
        Largest sampling rate of the result in Hz; frequencies above half this rate are removed.

    Raises
    ------
    ValueError
        If an argument is invalid, or the source is silent or shorter than a frame of 0.125 s.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(4000)
    >>> texture = pack(noise, n_bytes=32, fs=1000, name="noise")
    >>> len(texture.to_bytes()) <= 32, texture.name
    (True, 'noise')
    """
    if not MIN_BYTES <= n_bytes <= packed.MAX_BYTES:
        raise ValueError(f"n_bytes must be between {MIN_BYTES} and {packed.MAX_BYTES}, got {n_bytes}")
    if unit not in UNITS:
        raise ValueError(f"unit must be one of {', '.join(UNITS)}, got {unit!r}")
    # one tap mode per 16 bytes
    max_modes, name = min(n_bytes // 16, packed.MAX_MODES), name or str(getattr(source, "name", ""))
    tap = source.tap.strongest(max_modes) if isinstance(source, PackedTexture) else NO_MODES
    mu = float(getattr(source, "mu", 0.0))
    if isinstance(source, Recording):
        source, fs, unit, tap, mu = _contents_of(source, max_modes)
    frames, rate = _cut_frames(source, fs)
    if rate != round(rate) or not 40 <= min(rate, max_hz) < 1 << 17:
        raise ValueError(f"fs must be an integer between 40 and 131,071 Hz, got {rate} Hz")
    target = _estimate_target(frames, rate, gain_db, max_hz)
    facts: dict[str, Any] = {"unit": unit, "modes": packed.encode_modes(tap), "mu": min(mu, packed.MAX_MU)}
    facts |= {key: target[key] for key in ("fs", "level_db", "slopes_db", "ends")}
    autocorrelation = np.fft.irfft(target["spectra"], axis=-1)
    k = from_autocorrelation(autocorrelation[:, : min(MAX_ORDER, target["max_order"]) + 1])
    if not _allocations(8 * n_bytes, facts, k.order):  # the spectrum has priority over tap and friction
        facts |= {"modes": [], "mu": 0.0}
    best, lowest_cost = b"", np.inf
    for bits in _allocations(8 * n_bytes, facts, k.order):
        steps, fraction = 2 ** np.array(bits), np.arcsin(k.reflection[:, : len(bits)]) / np.pi + 0.5
        codes = np.clip(np.floor(fraction * steps), 0, steps - 1).astype(np.int64)
        cost = _cost(packed.decode_reflection(codes, bits), target, facts["fs"])
        if cost < lowest_cost:
            best, lowest_cost = packed.encode(facts | {"bits": bits, "codes": codes.tolist()}), cost
    if not best:
        raise ValueError(f"n_bytes must be at least 16 for a source with several speeds, got {n_bytes}")
    return PackedTexture.from_bytes(best, name)


def _contents_of(
    recording: Recording, max_modes: int
) -> tuple[Scan | Samples, float, str, DecayingModes, float]:
    """Return movement, sampling rate, unit, modes of the tap of median hardness, and mean friction."""
    phases = recording.phases or find_phases(recording)
    recording = motion_at_acceleration(recording)
    begin, end = phases.movement or (0, recording.n_samples)
    combined = combine(recording.acceleration[begin:end])
    movement: Scan | Samples = combined
    if recording.speed is not None and recording.normal_force is not None:
        tracks = recording.speed[begin:end], recording.normal_force[begin:end]
        movement = Scan.along_line(combined, *tracks, recording.fs)
    mu = (
        0.0
        if recording.friction is None
        else float(np.abs(recording.friction[slice(*recording.span_of("friction", begin, end))]).mean())
    )
    modes = NO_MODES
    with suppress(UndefinedFeatureError):  # the hardness is undefined for all taps
        taps = Views(recording, phases).tap.taps
        hardness = [damping(TapView((tap,), recording.fs)) for tap in taps]
        middle = taps[int(np.argsort(hardness)[(len(taps) - 1) // 2])].impulse
        modes = _fit_modes(middle[:1024], recording.fs, max_modes)
    return movement, recording.fs, recording.unit, modes, mu


def _fit_modes(x: Samples, fs: float, max_modes: int) -> DecayingModes:
    """Fit modes to a tap (n,) by matching pursuit; each mode is refitted twice while the others are fixed.

    A mode is Re(s exp((2 pi i f - B) t)). Among all f and B that can be coded, the pair with the smallest
    residual at the optimal s is selected.
    """
    f, B = (2.0 ** q.decode(np.arange(1 << q.bits)) for q in packed.MODES[:2])
    t = np.arange(x.size) / fs
    turns = np.exp(-2j * np.pi * np.outer(f[f < fs / 2], t))
    fades = np.exp(-np.outer(t, B))
    g, h = (fades**2).sum(axis=0), turns**2 @ fades**2
    codes: list[list[int]] = []
    for _ in range(3 * max_modes):
        others = codes if len(codes) < max_modes else codes[1:]
        residual = x - packed.decode_modes(others).synthesize(x.size, fs)
        c = turns @ (residual[:, np.newaxis] * fades)
        s = 2 * (c * g - np.conj(c) * h) / np.maximum(g**2 - np.abs(h) ** 2, 1e-9 * g**2)
        j, k = np.unravel_index(np.argmax((np.conj(s) * c).real), s.shape)
        best = DecayingModes(f[j], B[k], np.abs(s[j, k]), np.angle(s[j, k]))
        codes = [*others, *packed.encode_modes(best)]
    return packed.decode_modes(codes).strongest(max_modes)


def _cut_frames(source: Any, fs: float | None) -> tuple[list[Frame], float]:
    """Return the frames of a source and its sampling rate in Hz."""
    if isinstance(source, Texture):
        return _sample_texture(source), source.fs
    if isinstance(source, Scan):
        tracks = [_cut(x, source.fs) for x in (source.acceleration, source.speed, source.force)]
        means = [(x, float(v.mean()), float(f.mean())) for x, v, f in zip(*tracks, strict=True)]
        moving = [frame for frame in means if frame[1] >= REST_MM_S and frame[2] >= LIGHT_N]
        if len(moving) < 8:
            raise ValueError(
                f"the scan must have at least 8 frames of {FRAME_S} s with motion and contact, "
                f"got {len(moving)}"
            )
        return moving, source.fs
    if fs is None:
        raise ValueError("fs is missing. Pass the sampling rate of the vibration in Hz")
    x = np.asarray(source, dtype=np.float64)
    if x.ndim != 1 or x.size < FRAME_S * fs or not np.isfinite(x).all():
        raise ValueError(
            f"the vibration must be one finite axis of at least {FRAME_S} s, got shape {x.shape} at {fs:g} Hz"
        )
    return [(frame, 0.0, 0.0) for frame in _cut(x, fs, overlap=2)], fs


@lru_cache(maxsize=1)  # `retouch` packs the same texture several times
def _sample_texture(texture: Texture) -> list[Frame]:
    """Return the frames of strokes at constant speeds and forces over the range of a texture."""
    n, n_settling = round(1.25 * texture.fs), round(0.25 * texture.fs)
    frames = []
    for seed, (v, f) in enumerate(product(*sampled_axes(texture))):
        x = constant_stroke(texture, v, f, n - n_settling, n_settling=n_settling, seed=seed)
        frames += [(frame, float(v), float(f)) for frame in _cut(x, texture.fs)]
    return frames


def sampled_axes(texture: Texture) -> tuple[Samples, Samples]:
    """Return the speeds (mm/s) and forces (N) at which a texture is sampled before it is packed."""
    speeds, forces = stroke_range(texture)
    return np.geomspace(*speeds, N_SAMPLED_SPEEDS), np.geomspace(*forces, N_SAMPLED_FORCES)


def _cut(x: Samples, fs: float, overlap: int = 1) -> list[Samples]:
    n = round(FRAME_S * fs)
    return [x[i : i + n] for i in range(0, x.size - n + 1, n // overlap)]


def _estimate_target(
    frames: Sequence[Frame],
    fs: float,
    gain_db: Callable[[Any], Any] | None,
    max_hz: float,
) -> dict[str, Any]:
    """Return the level law and the spectra to pack: at the lowest and highest speed, or one mean."""
    samples, speed, force = (np.array(column) for column in zip(*frames, strict=True))
    n = samples.shape[1]
    window = np.hanning(n + 2)[1:-1]
    centred = (samples - samples.mean(axis=1, keepdims=True)) * window
    f = np.fft.rfftfreq(2 * n, 1 / fs)
    is_in_band = f <= max_hz / 2  # the scaling below keeps the power equal to the mean over all frequencies
    S = np.abs(np.fft.rfft(centred, 2 * n))[:, is_in_band] ** 2 / (window @ window) * is_in_band.mean()
    f = f[is_in_band]
    if gain_db is not None:
        S *= 10 ** (gain_db(f) / 10)
    low = int(np.searchsorted(f, LOWEST_HZ))
    S[:, :low] = S[:, [low]]
    power = np.fft.irfft(S, axis=-1)[:, 0]
    if not power.max() > 0:
        raise ValueError("the source is silent. Expected a vibration")
    is_audible = power > 1e-9 * power.max()
    S, power, speed, force = S[is_audible], power[is_audible], speed[is_audible], force[is_audible]
    has_range = bool(speed.min() > 0 and np.ptp(np.log2(speed)) >= 0.5)
    if not has_range:
        spectra = S.mean(axis=0, keepdims=True)
        law = {"level_db": 10 * np.log10(power.mean()), "slopes_db": None, "ends": None}
    else:
        law = _fit_level_law(power, speed, force)
        slow, fast, *_ = 2.0 ** np.asarray(law["ends"])
        weights = interpolation_weights((np.array([slow, fast]),), (speed,))
        spectra = weights.T @ (S / power[:, np.newaxis])
    spectra = spectra / np.fft.irfft(spectra, axis=-1)[:, :1]
    return law | {"spectra": spectra, "hz": f, "max_order": f.size - 2, "fs": round(2 * f[-1])}


def _fit_level_law(power: Samples, speed: Samples, force: Samples) -> dict[str, Any]:
    """Fit the level law: level (dB) at the middle of the ranges, slopes (dB/octave), and limits (octaves)."""
    octaves = np.log2([speed, force])
    ends = [float(q) for axis in octaves for q in np.quantile(axis, [0.05, 0.95])]
    ends = [packed.ENDS.decode(packed.ENDS.encode(e)) for e in ends]
    middle = np.array([(ends[0] + ends[1]) / 2, (ends[2] + ends[3]) / 2])
    H = np.column_stack([np.ones(speed.size), (octaves - middle[:, np.newaxis]).T])
    H[:, 2] *= ends[3] - ends[2] >= 0.5
    db = 10 / np.log(10) * fit_gamma_regression(H, power)
    return {"level_db": float(db[0]), "slopes_db": [float(db[1]), float(db[2])], "ends": ends}


def _allocations(n_bits: int, facts: dict[str, Any], max_order: int) -> list[tuple[int, ...]]:
    """Return candidate bit allocations (non-increasing bits per coefficient) that fit into `n_bits` bits."""
    n_nodes = 1 if facts["ends"] is None else 2
    n_contact = 8 * len(packed.encode_contact(facts))
    n_available = n_bits // 8 * 8 - n_contact - 16 - len(packed.encode_header(facts, [1]))
    candidates = []
    for first, last in product(range(2, MAX_BITS + 1), range(2, MAX_BITS + 1)):
        fits = [
            bits
            for order in range(1, min(MAX_ORDER, max_order) + 1)
            if sum(bits := packed.bit_allocation(first, last, order)) * n_nodes <= n_available
        ]
        if first >= last and fits:
            counts = {round(len(fits) * fraction) for fraction in (1.0, 0.85, 0.7, 0.5, 0.35, 0.2)}
            candidates += [fits[max(i, 1) - 1] for i in sorted(counts)]
    return candidates


def _cost(k: Samples, target: dict[str, Any], fs: float) -> float:
    """Return the sum over spectra of 1 - GFC of the amplitudes and 0.01 times the RMS band error in dB."""
    f = target["hz"]
    is_in_band = (f >= LOWEST_HZ) & (f <= min(1000.0, fs / 2))
    edges = np.searchsorted(f[is_in_band], BAND_EDGES_HZ[fs / 2 >= BAND_EDGES_HZ])[:-1]
    cost = 0.0
    for row, S in zip(k, target["spectra"], strict=True):
        ln_a = recursions.log_magnitude(np.ascontiguousarray(row), 2 * np.pi * f[is_in_band] / fs)
        M = np.exp(np.log1p(-(row**2)).sum() - 2 * ln_a)
        T = np.maximum(S[is_in_band], 1e-12 * S.max())
        gfc = np.sqrt(M * T).sum() / np.sqrt(M.sum() * T.sum())
        bands = [np.add.reduceat(P, np.unique(np.minimum(edges, T.size - 1))) for P in (M, T)]
        cost += 1 - gfc + 0.01 * np.sqrt(np.mean((10 * np.log10(bands[0] / bands[1])) ** 2))
    return float(cost)


# Change some perceptual scales and keep the others ----------------------------------------------------------

SPECTRAL_SCALES = ("rough", "bumpy", "fine", "regular")
"""Perceptual scales that depend on the spectrum; `hard` depends on the tap, and `sticky` on the friction."""


@dataclass(frozen=True)
class RetouchSettings:
    """Settings for measuring and changing perceptual scales.

    Attributes
    ----------
    nodes_hz : tuple[float, ...]
        Frequencies in Hz at which gains are defined. The gain is linear over log frequency between them and
        constant beyond them.
    sharpness : tuple[float, float, float]
        Parameters of the basis function that sharpens peaks: smoothing width of the spectrum (nepers of
        frequency), height above the smoothed spectrum at which the function is 1 (dB), and largest value of
        the function.
    max_rate_hz : float
        Largest sampling rate of the result in Hz. Humans perceive vibration up to 1 kHz by touch, and few
        bytes describe a narrower band more accurately.
    probe_s, speed_mm_s, force_n : float
        Duration (s), mean speed (mm/s) and force (N) of the back-and-forth stroke used for the measurement.
    tap_fs : float
        Sampling rate in Hz of the tap used for the measurement.
    max_db : float
        Largest gain in dB.
    tolerance, max_change : float
        Largest accepted error of a scale with a target, and largest accepted change of the other scales.
    step : float
        Fraction of the error by which the target of the next iteration is moved.
    """

    nodes_hz: tuple[float, ...] = (25.0, 60.0, 120.0, 300.0)
    sharpness: tuple[float, float, float] = (0.35, 6.0, 2.0)
    max_rate_hz: float = 2000.0
    probe_s: float = 20.0
    speed_mm_s: float = 110.0
    force_n: float = 1.0
    tap_fs: float = 10_000.0
    max_db: float = 30.0
    tolerance: float = 0.5
    max_change: float = 1.0
    step: float = 0.6


RETOUCH = RetouchSettings()


def measure_scales(texture: Texture, *, seed: int = 0) -> dict[str, float]:
    """Measure the perceptual scales of a texture, see `texclass.haptics.scales`.

    The texture is stroked back and forth for 20 s, with a force of 1 N and a mean speed of 110 mm/s.

    Parameters
    ----------
    texture : Texture
        Texture whose vibration is in m/s^2, with a sampling rate above 300 Hz.
    seed : int
        Seed of the noise (default 0).

    Returns
    -------
    dict of str to float
        Values from 0 to 10 of `rough`, `bumpy`, `fine` and `regular`; also `hard` if the texture has a
        `tap`, and `sticky` if it has friction (`mu`).

    Raises
    ------
    ValueError
        If the texture is silent, or its sampling rate is too low for the scales.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(4000)
    >>> sorted(measure_scales(pack(noise, n_bytes=16, fs=1000)))
    ['bumpy', 'fine', 'regular', 'rough']
    """
    values = _spectral_scales(_probe(texture.renderer(seed=seed), texture.fs), texture.fs).clip(0.0, 10.0)
    return dict(zip(SPECTRAL_SCALES, values.tolist(), strict=True)) | _contact_scales(*_contact(texture))


def scales_halfway(one: PackedTexture, other: PackedTexture) -> dict[str, float]:
    """Measure the spectral scales of the model halfway between two textures of equal sampling rate.

    The model is the mean in arctanh of the reflection coefficients, and in the logarithm of the powers.
    """
    models, order = (one.model, other.model), max(one.order, other.order)
    rows = [np.arctanh(np.pad(m.rows, [(0, 0), (0, 0), (0, order - m.order)])) for m in models]
    power = np.sqrt(one.model.power * other.model.power)
    model = replace(one.model, rows=np.tanh(np.mean(rows, axis=0)), power=power)
    values = _spectral_scales(_probe(grid_renderer(model, one.fs), one.fs), one.fs).clip(0.0, 10.0)
    return dict(zip(SPECTRAL_SCALES, values.tolist(), strict=True))


def retouch(
    texture: Texture,
    n_bytes: int = 128,
    *,
    unit: str = "m/s^2",
    hard: float | None = None,
    rough: float | None = None,
    bumpy: float | None = None,
    sticky: float | None = None,
    fine: float | None = None,
    regular: float | None = None,
) -> PackedTexture:
    """Change a texture on some perceptual scales and preserve its values on the other scales.

    Spectrum: gains around 25, 60, 120 and 300 Hz and a sharpening of the peaks are applied, equally at all
    speeds and forces. They are the smallest gains with which a rendered stroke reaches the targets.
    Frequencies above 1 kHz are removed, and the level below 1 kHz is raised to compensate.

    Tap: a harder tap has a higher frequency and a shorter decay at the same damping ratio, and a
    proportionally larger amplitude, as with a stiffer spring.

    Parameters
    ----------
    texture : Texture
        Texture whose vibration is in m/s^2; see `measure_scales`.
    n_bytes : int
        Largest size of the result in bytes (default 128); see `pack`.
    unit : str
        Unit of the vibration (default "m/s^2").
    hard, rough, bumpy, sticky, fine, regular : float, optional
        New value of each scale, from 0 to 10 (default: as before). `hard` requires a texture with a `tap`,
        and `sticky` a texture with friction (`mu`).

    Raises
    ------
    ValueError
        If there is no target or a target is not from 0 to 10, if the texture has no tap or friction to
        change, or if a target cannot be reached within half a point.

    Warns
    -----
    UserWarning
        If another scale changes by more than one point.

    Examples
    --------
    Change only the friction:

    >>> noise = np.random.default_rng(0).standard_normal(4000)
    >>> texture = pack(noise, n_bytes=32, fs=1000).with_contact(mu=0.4)
    >>> round(retouch(texture, sticky=7.0).mu, 2), round(retouch(texture, sticky=3.0).mu, 2)
    (0.5, 0.36)
    """
    values = {
        "hard": hard,
        "rough": rough,
        "bumpy": bumpy,
        "sticky": sticky,
        "fine": fine,
        "regular": regular,
    }
    targets = {name: value for name, value in values.items() if value is not None}
    if not targets:
        raise ValueError(f"pass one or more of the scales {', '.join(SCALES)}")
    if outside := [f"{name}={value:g}" for name, value in targets.items() if not 0 <= value <= 10]:
        raise ValueError(f"values on a scale must be from 0 to 10, got {', '.join(outside)}")
    tap, mu = _contact(texture)
    for name, part, is_missing in (("hard", "a tap", not tap.n_modes), ("sticky", "friction", not mu)):
        if name in targets and is_missing:
            raise ValueError(f"{name!r} requires a texture with {part}, but the texture has none")
    if "hard" in targets:  # a stiffer spring: a ~ v w sin(w t)
        c = SCALES["hard"].feature_value(targets["hard"]) / _tap_frequency(tap)
        higher = np.minimum(c * tap.frequency_hz, 0.49 * RETOUCH.tap_fs)
        tap = DecayingModes(higher, c * tap.decay_per_s, c * tap.amplitude, tap.phase)
    mu = SCALES["sticky"].feature_value(targets["sticky"]) if "sticky" in targets else mu
    if isinstance(texture, PackedTexture) and not set(targets) & set(SPECTRAL_SCALES):
        result = texture.with_contact(tap=tap, mu=mu)
    else:
        result = _reshape(texture, targets, n_bytes, unit).with_contact(tap=tap, mu=mu)
    hard = _contact_scales(result.tap, mu).get("hard", 0.0)
    if abs(hard - targets.get("hard", hard)) > RETOUCH.tolerance:
        raise ValueError(
            f"targets {targets} are out of reach: taps of 8 to 5000 Hz reach hard = {hard:.1f} at most. "
            "Use a target closer to this value"
        )
    return result


def _reshape(texture: Texture, targets: dict[str, float], n_bytes: int, unit: str) -> PackedTexture:
    """Apply the smallest gains that reach the targets, and return the packed texture."""
    x, present = _measure_texture(texture)
    wanted = np.array(
        [targets.get(name, value) for name, value in zip(SPECTRAL_SCALES, present, strict=True)]
    ).clip(0, 10)
    f = np.fft.rfftfreq(x.size, 1 / texture.fs)
    f = f[f <= RETOUCH.max_rate_hz / 2]
    spectrum = np.fft.rfft(x)[: f.size] * (2 * (f.size - 1) / x.size)
    basis = _gain_basis(f, np.abs(spectrum) ** 2)

    def scales_with(gains: Samples) -> Samples:
        return _spectral_scales(np.fft.irfft(spectrum * 10 ** (basis(f) @ gains / 20)), 2 * f[-1])

    limits = [RETOUCH.tolerance if name in targets else RETOUCH.max_change for name in SPECTRAL_SCALES]
    is_target = np.array([name in targets for name in SPECTRAL_SCALES])
    gains, aim, smallest_error = np.zeros(len(RETOUCH.nodes_hz) + 1), wanted, (True, np.inf)
    for _ in range(6):  # the aim compensates for changes caused by packing
        gains = _solve_gains(scales_with, gains, aim, wanted)
        shape = partial(lambda gains, f: basis(f) @ gains, gains)
        candidate = pack(texture, n_bytes, unit=unit, gain_db=shape, max_hz=RETOUCH.max_rate_hz)
        values = _spectral_scales(_probe(candidate.renderer(), candidate.fs), candidate.fs)
        errors = np.abs(_distance(values, wanted, wanted)) / limits
        error = bool(errors[is_target].max(initial=0.0) > 1), float(errors.max())  # targets come first
        if error < smallest_error:
            nearest, smallest_error, nearest_values = candidate, error, values
        if smallest_error[1] < 0.5:
            break
        aim = aim - RETOUCH.step * _distance(values, wanted, wanted)
    if smallest_error[1] > 1.0:
        _report_errors(targets, present.clip(0, 10), nearest_values.clip(0, 10), n_bytes)
    return nearest


def _distance(values: Samples, aim: Samples, wanted: Samples) -> Samples:
    """Return values minus aim; 0 for scales at an end (0 or 10) if that end is wanted, or exceeded."""
    is_at_end = ((values <= 0) & (wanted == 0)) | ((values >= 10) & (wanted == 10))
    return np.where(is_at_end, 0.0, values - aim)


def _report_errors(targets: dict[str, float], present: Samples, reached: Samples, n_bytes: int) -> None:
    """Raise a ValueError about targets that are missed, or warn about other scales that change."""
    missed, changed = [], []
    for name, old, new in zip(SPECTRAL_SCALES, present.tolist(), reached.tolist(), strict=True):
        if name in targets and abs(new - targets[name]) > RETOUCH.tolerance:
            missed.append(f"{name} {new:.1f} instead of {targets[name]:g}")
        elif name not in targets and abs(new - old) > RETOUCH.max_change:
            changed.append(f"{name} from {old:.1f} to {new:.1f}")
    names = ", ".join(f"{name}={value:g}" for name, value in targets.items())
    if missed:
        raise ValueError(
            f"{names} cannot be reached with {RETOUCH.max_db:g} dB and {n_bytes} bytes: the nearest texture "
            f"has {', '.join(missed)}. Use targets closer to the present values"
        )
    if changed:
        warnings.warn(
            f"{names} also changes {', '.join(changed)}. To keep a scale, set it as well, or use a target "
            "closer to the present value",
            stacklevel=4,
        )


def _solve_gains(
    scales_with: Callable[[Samples], Samples], gains: Samples, aim: Samples, wanted: Samples
) -> Samples:
    """Find the gains (dB) with which the scales reach the aim, by Newton's method with step control."""
    values = scales_with(gains)
    for _ in range(12):
        if np.abs(_distance(values, aim, wanted)).max() < 0.05:
            break
        slopes = np.column_stack([scales_with(gains + unit) - values for unit in np.eye(gains.size)])
        step = np.clip(np.linalg.pinv(slopes, rcond=1e-2) @ _distance(values, aim, wanted), -4.0, 4.0)
        trials = [np.clip(gains - part * step, -RETOUCH.max_db, RETOUCH.max_db) for part in (1.0, 0.4)]
        trial_values = [scales_with(trial) for trial in trials]
        best = int(np.argmin([np.abs(_distance(trial, aim, wanted)).max() for trial in trial_values]))
        gains, values = trials[best], trial_values[best]
    return gains


def _gain_basis(f: Any, power: Any) -> Callable[[Any], Samples]:
    """Return the basis functions of the gain over frequency: one per node, and one that sharpens peaks."""
    grid = np.geomspace(10.0, f[-1], 300)
    is_near = np.abs(np.log(f[1:] / grid[:, np.newaxis])) < np.maximum(0.03, 2.0 / grid)[:, np.newaxis]
    db = 10 * np.log10(is_near @ power[1:] / is_near.sum(axis=1) + 1e-300)
    width, unit_db, largest = RETOUCH.sharpness
    kernel = np.exp(-0.5 * (np.log(grid / grid[:, np.newaxis]) / width) ** 2)
    peaks = np.clip((db - kernel @ db / kernel.sum(axis=1)) / unit_db, -largest, largest)

    def basis(f: Any) -> Samples:
        ln_f = np.log(np.maximum(f, 1.0))
        nodes = [np.interp(ln_f, np.log(RETOUCH.nodes_hz), row) for row in np.eye(len(RETOUCH.nodes_hz))]
        return np.column_stack([*nodes, np.interp(ln_f, np.log(grid), peaks)])

    return basis


@lru_cache(maxsize=1)  # a page with sliders changes the same texture many times
def _measure_texture(texture: Texture) -> tuple[Samples, Samples]:
    """Return the stroke of `_probe` over a texture, and its unlimited values of `SPECTRAL_SCALES`."""
    x = _probe(texture.renderer(), texture.fs)
    return x, _spectral_scales(x, texture.fs)


def _probe(renderer: Renderer, fs: float) -> Samples:
    """Render 20 back-and-forth strokes of 1 s, and discard the first 0.1 s."""
    t = np.arange(round((RETOUCH.probe_s + 0.1) * fs)) / fs
    speed = RETOUCH.speed_mm_s * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    velocity = np.column_stack([speed * np.sign(np.sin(np.pi * t) + 1e-12), np.zeros(t.size)])
    vibration = renderer.process(velocity, np.full(t.size, RETOUCH.force_n))
    return np.asarray(vibration[round(0.1 * fs) :])


def _spectral_scales(x: Samples, fs: float) -> Samples:
    """Compute the unlimited values of `SPECTRAL_SCALES` for a movement in m/s^2."""
    stroke = Recording(x, fs, "m/s^2", "stroke", phases=Phases(movement=(0, x.size)))
    features = _features_of(stroke, SPECTRAL_SCALES, f"texture at {fs:g} Hz")
    return np.array([SCALES[name].unlimited_value(feature) for name, feature in features.items()])


def _contact(texture: Texture) -> tuple[DecayingModes, float]:
    """Return the tap (no modes if the texture has no tap) and the friction (0 if unknown)."""
    return getattr(texture, "tap", NO_MODES), float(getattr(texture, "mu", 0.0))


def _contact_scales(tap: DecayingModes, mu: float) -> dict[str, float]:
    """Return the scale `hard` if there is a tap, and the scale `sticky` if there is friction."""
    values = {"hard": SCALES["hard"].value(_tap_frequency(tap))} if tap.n_modes else {}
    return values | ({"sticky": SCALES["sticky"].value(mu)} if mu else {})


def _tap_frequency(tap: DecayingModes) -> float:
    """Return the spectral centroid of a tap in Hz, the feature of the scale `hard`."""
    x = np.concatenate([np.zeros(500), tap.synthesize(4000, RETOUCH.tap_fs)])
    phases = Phases(taps=(Tap(0, 500, x.size),))
    recording = Recording(x, RETOUCH.tap_fs, "m/s^2", "tap", phases=phases)
    return _features_of(recording, ("hard",), "tap")["hard"]


@cache
def _plan(names: tuple[str, ...]) -> Plan:
    return Plan.of(load_feature_set("scales")).restricted_to(SCALES[name].column for name in names)


def _features_of(recording: Recording, names: tuple[str, ...], source: str) -> dict[str, float]:
    """Return the features of the named scales; raise ValueError if any of them is undefined."""
    plan = _plan(names)
    computed = plan.compute(recording)
    for _, reason in computed.reasons:
        raise ValueError(f"{source}: {reason}")
    measured = dict(zip(plan.columns, computed.values.tolist(), strict=True))
    return {name: measured[SCALES[name].column] for name in names}
