"""A texture that feels rougher, bumpier or finer, and else the same."""

from functools import partial
from typing import Any

import numpy as np

from texclass.features.scales import SCALES, scale_values
from texclass.recording import Phases, Recording, Samples
from texclass.textures.contract import Texture
from texclass.textures.packed import PackedTexture, pack

RETOUCHED = ("rough", "bumpy", "fine")
"""Scales that hang on the spectrum: the others are of taps, of friction, and of what repeats."""
NODES_HZ = np.array([25.0, 60.0, 120.0, 300.0])
"""Where the spectrum is raised; linear in between over the logarithm, constant beyond."""
PROBE_S, SPEED_MM_S, FORCE_N = 20.0, 110.0, 1.0
MOST_DB, NEAR = 30.0, 0.5


def felt_scales(texture: Texture, *, seed: int = 0) -> dict[str, float]:
    """Return how a texture feels on the scales `rough`, `bumpy` and `fine`: see `texclass.features.scales`.

    It is stroked to and fro for 20 s, by 1 N and 110 mm/s in the mean.

    Parameters
    ----------
    texture : Texture
        Of a vibration in m/s^2, at more than 300 Hz.
    seed : int
        Of its noise.

    Raises
    ------
    ValueError
        If the texture is silent, or its rate is too low for the scales.
    """
    return _felt(_probe(texture, seed), texture.fs)


def retouch(texture: Texture, n_bytes: int = 128, *, unit: str = "m/s^2", **asked: float) -> PackedTexture:
    """Return a texture that feels as asked on some scales, and as before on the others of the three.

    The spectrum is raised around 25, 60, 120 and 300 Hz, by the same at every speed and force: by the least
    gains, found on a rendered stroke, with which it measures so.

    Parameters
    ----------
    texture : Texture
        As for `felt_scales`.
    n_bytes : int
        Of the result; see `pack`.
    unit : str
        Of the vibration.
    **asked : float
        `rough`, `bumpy`, `fine`: where on the scale, usually 0 to 10.

    Raises
    ------
    ValueError
        If another scale is asked for, none is, or what is asked is out of reach: the result is more than half
        a point off.
    """
    if not asked or not set(asked) <= set(RETOUCHED):
        told = ", ".join(asked) or "nothing"
        raise ValueError(f"asked for {told}; the rule is one or more of {', '.join(RETOUCHED)}")
    x = _probe(texture, 0)
    before = _felt(x, texture.fs)
    wanted = np.array(list((before | asked).values()))
    gains, aim = np.zeros(NODES_HZ.size), wanted
    for _ in range(3):  # what packing changes is asked for beforehand
        gains = _gains(x, texture.fs, gains, aim)
        packed = pack(texture, n_bytes, unit=unit, gain_db=partial(_gain_db, gains))
        found = np.array(list(felt_scales(packed).values()))
        if np.abs(found - wanted).max() < NEAR / 2:
            return packed
        aim = aim + wanted - found
    if np.abs(found - wanted).max() > NEAR:
        near = ", ".join(f"{name} {value:.1f}" for name, value in zip(before, found, strict=True))
        raise ValueError(
            f"asked for {asked}; the rule is what {MOST_DB:g} dB and {n_bytes} bytes hold: {near}"
        )
    return packed


def _gains(x: Samples, fs: float, gains: Samples, aim: Samples) -> Samples:
    """Return the gains (dB) with which a vibration measures so on the three scales, by Newton's method."""
    spectrum, f = np.fft.rfft(x), np.fft.rfftfreq(x.size, 1 / fs)

    def felt(gains: Samples) -> Samples:
        raised = np.fft.irfft(spectrum * 10 ** (_gain_db(gains, f) / 20), x.size)
        return np.array(list(_felt(np.asarray(raised), fs).values()))

    for _ in range(10):
        missed = felt(gains) - aim
        if np.abs(missed).max() < 0.05:
            break
        slopes = np.column_stack([felt(gains + step) - felt(gains) for step in np.eye(gains.size)])
        gains = gains - np.clip(np.linalg.pinv(slopes, rcond=1e-2) @ missed, -4.0, 4.0)
        gains = np.clip(gains, -MOST_DB, MOST_DB)
    return gains


def _gain_db(gains: Samples, f: Any) -> Any:
    return np.interp(np.log(np.maximum(f, 1.0)), np.log(NODES_HZ), gains)


def _probe(texture: Texture, seed: int) -> Samples:
    """Return the vibration of 20 strokes of a second to and fro, without the first tenth."""
    t = np.arange(round((PROBE_S + 0.1) * texture.fs)) / texture.fs
    speed = SPEED_MM_S * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    velocity = np.column_stack([speed * np.sign(np.sin(np.pi * t) + 1e-12), np.zeros(t.size)])
    felt = texture.renderer(seed=seed).process(velocity, np.full(t.size, FORCE_N))
    return np.asarray(felt[round(0.1 * texture.fs) :])


def _felt(x: Samples, fs: float) -> dict[str, float]:
    """Return the three scales of a movement in m/s^2."""
    from texclass.features.extractor import FeatureExtractor

    stroke = Recording(x, fs, "m/s^2", "stroke", phases=Phases(movement=(0, x.size)))
    found = FeatureExtractor("scales").fit([stroke]).extract([stroke])
    values = scale_values(found.table).iloc[0]
    for reason in found.reasons:
        if reason.feature in {SCALES[name].column.partition(".")[0] for name in RETOUCHED}:
            raise ValueError(f"texture at {fs:g} Hz: {reason.reason}")
    return {name: float(values[name]) for name in RETOUCHED}
