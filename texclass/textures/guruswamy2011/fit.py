"""From a scan to the texture: normalise, band-pass, segment, one filter a segment, placed in space."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from texclass.recording import Samples
from texclass.textures.guruswamy2011.level import Amplitude, LevelLaw, normalised
from texclass.textures.guruswamy2011.profile import RESOLUTION, SMOOTHING_HZ, Phase, Profile, profile_of
from texclass.textures.guruswamy2011.responses import Method, Responses, fit_responses
from texclass.textures.guruswamy2011.texture import Course, SinusoidTexture, SpatialTexture
from texclass.textures.scan import Scan

EVEN = LevelLaw(k_v=0.0, k_c=0.0, a_0=1.0)
"""A level that neither speed nor force change: for scans without a law of their own."""


@dataclass(frozen=True, eq=False)
class FittedScan:
    """A scan on its way to a texture, with what was found on the way.

    Attributes
    ----------
    scan : Scan
    normalised : ndarray of shape (n_samples,)
        Acceleration as at the mean speed and force.
    profile : Profile
        That within its band, and its segments.
    responses : Responses
        One filter per segment.
    texture : SpatialTexture
    """

    scan: Scan
    normalised: Samples = field(repr=False)
    profile: Profile
    responses: Responses
    texture: SpatialTexture


def fit_texture(
    scan: Scan,
    law: LevelLaw = EVEN,
    *,
    resolution: float = RESOLUTION,
    method: Method = "modes",
    phase: Phase = "causal",
    tails: Literal["subtracted", "ignored"] = "subtracted",
    smoothing_hz: float = SMOOTHING_HZ,
    compensated: bool = True,
    course: Course = "line",
) -> FittedScan:
    """Fit a texture to the scan of a surface.

    Parameters
    ----------
    scan : Scan
        One stroke, at best slow and steady: features that come before the last has decayed merge.
    law : LevelLaw
        Of the surface, from `fit_level_law`; by default speed and force change nothing.
    resolution : float
        One bit of the sensor, in the unit of the acceleration.
    method : {"modes", "sinusoid"}
        Filters of the order that each segment needs, or one decaying sinusoid each (the baseline).
    phase : {"causal", "zero"}
        Of the band-pass, see `profile_of`.
    tails : {"subtracted", "ignored"}
        See `fit_responses`.
    smoothing_hz : float
        Low-pass of the spectrum, see `band_of`.
    compensated : bool
        See `Amplitude`.
    course : {"line", "travelled"}
        See `SpatialTexture`.

    Returns
    -------
    FittedScan

    Raises
    ------
    ValueError
        If the tip does not move, the acceleration is silent, or nothing in it exceeds the resolution.

    References
    ----------
    `guruswamy2011`, sections III and IV.
    """
    length = scan.distance_mm[-1]
    speed = float(scan.speed.mean())
    if not (length > 0 and speed > 0):
        raise ValueError(
            f"scan {scan.name!r} is {length:g} mm long at {speed:g} mm/s; the rule is a stroke that moves"
        )
    scaling = Amplitude(law, speed, max(float(scan.force.mean()), 0.0), compensated)
    a = normalised(scan, scaling)
    profile = profile_of(a, scan.fs, resolution=resolution, phase=phase, smoothing_hz=smoothing_hz)
    responses = fit_responses(
        profile.samples, profile.segmentation.bounds.tolist(), scan.fs, resolution, method=method, tails=tails
    )
    texture = _placed(scan, profile, responses, scaling, method, course)
    return FittedScan(scan, a - a.mean(), profile, responses, texture)


def _placed(
    scan: Scan, profile: Profile, responses: Responses, scaling: Amplitude, method: Method, course: Course
) -> SpatialTexture:
    """Put each filter where its segment begins: x_k in mm along the path, half a sample before the start."""
    kept = [i for i, modes in enumerate(responses.modes) if modes.n_modes]
    if not kept:
        raise ValueError(f"scan {scan.name!r}: the rule is a vibration that exceeds the resolution somewhere")
    x = scan.distance_mm
    start = responses.start[kept].astype(np.int64)
    passed = (x[np.maximum(start - 1, 0)] + x[start]) / 2  # after the last sample without it
    modes = [responses.modes[i] for i in kept]
    kind = SinusoidTexture if method == "sinusoid" else SpatialTexture
    return kind(
        name=scan.name,
        fs=scan.fs,
        length_mm=max(float(x[-1]), float(np.nextafter(passed[-1], np.inf))),
        position_mm=passed,
        feature=np.repeat(np.arange(float(len(kept))), [m.n_modes for m in modes]),
        frequency_hz=np.concatenate([m.frequency_hz for m in modes]),
        decay_per_s=np.concatenate([m.decay_per_s for m in modes]),
        amplitude=np.concatenate([m.amplitude for m in modes]),
        phase=np.concatenate([m.phase for m in modes]),
        scaling=scaling,
        peak=float(np.max(np.abs(profile.samples))),
        direction=(u := _direction(scan)),
        course=course,
        origin_mm=float(scan.position[0] @ u),
    )


def _direction(scan: Scan) -> Samples:
    """Return the unit vector in which the stroke runs: first principal axis, pointing from start to end."""
    centred = scan.position - scan.position.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    forth = float((scan.position[-1] - scan.position[0]) @ axis)
    return np.asarray(-axis if forth < 0 else axis)
