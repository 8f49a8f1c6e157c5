"""A texture that feels otherwise on some of the six scales, and else the same."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from texclass.features.plan import Plan
from texclass.features.scales import SCALES
from texclass.features.sets import load_feature_set
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.textures.contract import Texture
from texclass.textures.packed import PackedTexture
from texclass.textures.packing import pack
from texclass.vibration import DecayingModes

OF_SPECTRUM = ("rough", "bumpy", "fine", "regular")
"""Scales that hang on the spectrum; `hard` hangs on a tap, `sticky` on friction, where a texture has them."""
NODES_HZ = np.array([25.0, 60.0, 120.0, 300.0])
"""Where the spectrum is raised; linear in between over the logarithm, constant beyond."""
SHARPNESS = 0.35, 6.0, 2.0
"""Nepers of frequency over which dB are smoothed, dB above that which count 1, and the most that counts."""
MOST_RATE_HZ = 2000.0
"""A finger feels up to 1 kHz, and few bytes hold the more below it."""
PROBE_S, SPEED_MM_S, FORCE_N, TAP_FS = 20.0, 110.0, 1.0, 10_000.0
MOST_DB, NEAR, EAGER = 30.0, 0.5, 0.6


def felt_scales(texture: Texture, *, seed: int = 0) -> dict[str, float]:
    """Return how a texture feels: see `texclass.features.scales`.

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
    return _felt(_probe(texture, seed), texture.fs) | _touched(*_held(texture))


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
        raise ValueError(f"asked for {told}; the rule is one or more of {', '.join(SCALES)}")
    tap, mu = _held(texture)
    for name, what, lacks in (("hard", "tap", not tap.n_modes), ("sticky", "friction", not mu)):
        if name in asked and lacks:
            raise ValueError(
                f"asked for {name}, and the texture has no {what}; the rule is one with a {what}"
            )
    if "hard" in asked:  # a stiffer spring: a ~ v w sin(w t)
        c = SCALES["hard"].measured(asked["hard"]) / SCALES["hard"].measured(_touched(tap, mu)["hard"])
        higher = np.minimum(c * tap.frequency_hz, 0.49 * TAP_FS)
        tap = DecayingModes(higher, c * tap.decay_per_s, c * tap.amplitude, tap.phase)
    mu = SCALES["sticky"].measured(asked["sticky"]) if "sticky" in asked else mu
    same = isinstance(texture, PackedTexture) and not set(asked) & set(OF_SPECTRUM)
    packed: PackedTexture = texture if same else _reshaped(texture, asked, n_bytes, unit)  # type: ignore[assignment]
    found = packed.holding(tap=tap, mu=mu)
    hard = _touched(found.tap, mu).get("hard", 0.0)
    if abs(hard - asked.get("hard", hard)) > NEAR:
        raise ValueError(f"asked for {asked}; the rule is what a tap of 8 to 5000 Hz holds: hard {hard:.1f}")
    return found


def _reshaped(texture: Texture, asked: dict[str, float], n_bytes: int, unit: str) -> PackedTexture:
    """Return the texture with the least gains with which it feels as asked, packed."""
    x = _probe(texture, 0)
    before = _felt(x, texture.fs)
    wanted = np.array([asked.get(name, value) for name, value in before.items()])
    f = np.fft.rfftfreq(x.size, 1 / texture.fs)
    f = f[f <= MOST_RATE_HZ / 2]
    spectrum = np.fft.rfft(x)[: f.size] * (2 * (f.size - 1) / x.size)
    columns = _columns(f, np.abs(spectrum) ** 2)

    def felt(gains: Samples) -> Samples:
        return _values(np.fft.irfft(spectrum * 10 ** (columns(f) @ gains / 20)), 2 * f[-1])

    gains, aim, nearest = np.zeros(NODES_HZ.size + 1), wanted, np.inf
    for _ in range(6):  # what packing changes is asked for beforehand
        gains = _gains(felt, gains, aim)
        shape = partial(lambda gains, f: columns(f) @ gains, gains)
        one = pack(texture, n_bytes, unit=unit, gain_db=shape, most_hz=MOST_RATE_HZ)
        found = _values(_probe(one, 0), one.fs)
        if (missed := np.abs(found - wanted).max()) < nearest:
            packed, nearest, at = one, missed, found
        if nearest < NEAR / 2:
            break
        aim = aim + EAGER * (wanted - found)
    if nearest > NEAR:
        near = ", ".join(f"{name} {value:.1f}" for name, value in zip(before, at, strict=True))
        raise ValueError(
            f"asked for {asked}; the rule is what {MOST_DB:g} dB and {n_bytes} bytes hold: {near}"
        )
    return packed


def _gains(felt: Callable[[Samples], Samples], gains: Samples, aim: Samples) -> Samples:
    """Return the gains (dB) with which a vibration measures so, by Newton's method, steps may shrink."""
    at = felt(gains)
    for _ in range(12):
        if np.abs(at - aim).max() < 0.05:
            break
        slopes = np.column_stack([felt(gains + step) - at for step in np.eye(gains.size)])
        step = np.clip(np.linalg.pinv(slopes, rcond=1e-2) @ (at - aim), -4.0, 4.0)
        tried = [np.clip(gains - share * step, -MOST_DB, MOST_DB) for share in (1.0, 0.4)]
        found = [felt(one) for one in tried]
        best = int(np.argmin([np.abs(one - aim).max() for one in found]))
        gains, at = tried[best], found[best]
    return gains


def _columns(f: Any, power: Any) -> Callable[[Any], Samples]:
    """Return what makes the columns of gains at frequencies: of each node, and of what stands out by 6 dB."""
    grid = np.geomspace(10.0, f[-1], 300)
    within = np.abs(np.log(f[1:] / grid[:, np.newaxis])) < np.maximum(0.03, 2.0 / grid)[:, np.newaxis]
    db = 10 * np.log10(within @ power[1:] / within.sum(axis=1) + 1e-300)
    near = np.exp(-0.5 * (np.log(grid / grid[:, np.newaxis]) / SHARPNESS[0]) ** 2)
    above = np.clip((db - near @ db / near.sum(axis=1)) / SHARPNESS[1], -SHARPNESS[2], SHARPNESS[2])

    def columns(f: Any) -> Samples:
        ln_f = np.log(np.maximum(f, 1.0))
        raised = [np.interp(ln_f, np.log(NODES_HZ), one) for one in np.eye(NODES_HZ.size)]
        return np.column_stack([*raised, np.interp(ln_f, np.log(grid), above)])

    return columns


def _probe(texture: Texture, seed: int) -> Samples:
    """Return the vibration of 20 strokes of a second to and fro, without the first tenth."""
    t = np.arange(round((PROBE_S + 0.1) * texture.fs)) / texture.fs
    speed = SPEED_MM_S * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    velocity = np.column_stack([speed * np.sign(np.sin(np.pi * t) + 1e-12), np.zeros(t.size)])
    felt = texture.renderer(seed=seed).process(velocity, np.full(t.size, FORCE_N))
    return np.asarray(felt[round(0.1 * texture.fs) :])


def _felt(x: Samples, fs: float) -> dict[str, float]:
    """Return what the scales of the spectrum say of a movement in m/s^2."""
    stroke = Recording(x, fs, "m/s^2", "stroke", phases=Phases(movement=(0, x.size)))
    return _told(stroke, OF_SPECTRUM, f"texture at {fs:g} Hz")


def _held(texture: Texture) -> tuple[DecayingModes, float]:
    """Return the tap, of no mode where there is none, and the friction, 0 where there is none."""
    none = DecayingModes(*np.zeros((4, 0)))
    return getattr(texture, "tap", none), float(getattr(texture, "mu", 0.0))


def _touched(tap: DecayingModes, mu: float) -> dict[str, float]:
    """Return what the scales of a tap and of friction say, where there is one."""
    found: dict[str, float] = {}
    if tap.n_modes:
        x = np.concatenate([np.zeros(500), tap.synthesize(4000, TAP_FS)])
        struck = Phases(taps=(Tap(0, 500, x.size),))
        found |= _told(Recording(x, TAP_FS, "m/s^2", "tap", phases=struck), ("hard",), "tap")
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


def _values(x: Samples, fs: float) -> Samples:
    return np.array(list(_felt(x, fs).values()))
