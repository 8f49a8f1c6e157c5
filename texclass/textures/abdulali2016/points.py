"""Model points: what each segment says of the vibration at its mean input, and points of silence."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import spatial

from texclass.recording import Samples
from texclass.textures.abdulali2016.loudness import Loudness
from texclass.textures.abdulali2016.segmentation import InputSegments
from texclass.textures.scan import Scan
from texclass.vibration import autoregressive, line_spectrum

ORDER = 20
N_STILL = 10
"""Points of zero speed; the paper leaves their number open."""


@dataclass(frozen=True, eq=False)
class Normalisation:
    """What brings each input to zero mean and unit variance over the recording; kept for rendering.

    Attributes
    ----------
    mean, deviation : ndarray of shape (n_inputs,)
        Of v_x, v_y, f_n (mm/s, mm/s, N), or of |v|, f_n.
    """

    mean: Samples
    deviation: Samples

    def apply(self, inputs: ArrayLike) -> Samples:
        """Return the inputs (..., n_inputs) normalised."""
        return np.asarray((np.asarray(inputs, dtype=np.float64) - self.mean) / self.deviation)


@dataclass(frozen=True, eq=False)
class ModelPoints:
    """Samples of the map from input to vibration.

    Attributes
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs.
    lsf : ndarray of shape (n_points, p)
        Line spectral frequencies, rad per sample.
    loudness : ndarray of shape (n_points,)
        What a network learns of it besides the spectrum, see `level_of`; in a new point, the RMS of the
        vibration (unit of the acceleration) or the variance of the innovation (its square).
    weight : ndarray of shape (n_points,)
        Seconds of signal behind each point.
    kind : ndarray of int, shape (n_points,)
        0 a segment, 1 zero force, 2 zero speed.
    """

    u: Samples
    lsf: Samples
    loudness: Samples
    weight: Samples
    kind: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.kind.size)

    def chosen(self, which: NDArray[np.bool_]) -> "ModelPoints":
        """Return the points of a mask."""
        return ModelPoints(
            self.u[which], self.lsf[which], self.loudness[which], self.weight[which], self.kind[which]
        )

    def joined(self, others: "ModelPoints") -> "ModelPoints":
        """Return these points and the others."""
        return ModelPoints(
            np.concatenate([self.u, others.u]),
            np.concatenate([self.lsf, others.lsf]),
            np.concatenate([self.loudness, others.loudness]),
            np.concatenate([self.weight, others.weight]),
            np.concatenate([self.kind, others.kind]),
        )


def inputs_of(velocity: ArrayLike, force: ArrayLike, *, isotropic: bool) -> Samples:
    """Return u = (v_x, v_y, f_n), or (|v|, f_n), of velocities (n, 2) and forces (n,); not yet normalised."""
    v, f = np.asarray(velocity, dtype=np.float64), np.asarray(force, dtype=np.float64)
    columns = [np.hypot(*v.T)] if isotropic else [*v.T]
    return np.column_stack([*columns, f])


def normalisation_of(scan: Scan, *, isotropic: bool) -> Normalisation:
    """Return what normalises the inputs of a scan; an input that never changes is only centred."""
    u = inputs_of(scan.velocity, scan.force, isotropic=isotropic)
    deviation = u.std(axis=0)
    return Normalisation(u.mean(axis=0), np.where(deviation > 1e-9 * np.abs(u).max(axis=0), deviation, 1.0))


def segment_points(
    scan: Scan,
    segments: InputSegments,
    normalisation: Normalisation,
    *,
    isotropic: bool,
    order: int = ORDER,
    method: autoregressive.Method = "burg",
    loudness: Loudness = "level",
) -> ModelPoints:
    """Return one point per segment: its mean normalised input, the LSF of its AR model, and its loudness.

    Parameters
    ----------
    scan : Scan
        Conditioned.
    segments : InputSegments
        Of the scan.
    normalisation : Normalisation
        Of its inputs.
    isotropic : bool
        Whether |v| stands for the velocity.
    order : int
        p of the AR models.
    method : str
        As for `vibration.fit`.
    loudness : {"level", "variance"}
        RMS of the vibration in the segment, or the variance the fit gives (`abdulali2016`).

    Returns
    -------
    ModelPoints

    Raises
    ------
    ValueError
        If no segment is left.
    """
    if not len(segments):
        raise ValueError(
            f"scan {scan.name!r} has no segment of steady direction, speed and force; "
            "the rule is at least one"
        )
    u = segments.means(normalisation.apply(inputs_of(scan.velocity, scan.force, isotropic=isotropic)))
    pieces = segments.pieces(scan.acceleration)
    models = [autoregressive.fit(x, order, method=method, variance="yule_walker") for x in pieces]
    lsf = line_spectrum.from_reflection(np.stack([m.reflection for m in models]))
    if loudness == "level":
        loud = np.array([np.sqrt(np.mean(x**2)) for x in pieces])
    else:
        loud = np.array([float(m.gain) ** 2 for m in models])
    n = len(segments)
    return ModelPoints(
        u, line_spectrum.spread(lsf), loud, segments.n_samples / scan.fs, np.zeros(n, np.int64)
    )


def zero_force_points(points: ModelPoints, normalisation: Normalisation) -> ModelPoints:
    """Return silent points at zero force below the hull of the points: their input projected, LSF as theirs.

    The vertices of the facets of the convex hull whose outward normal points to lower force are projected. If
    the points have no hull (too few, or in one plane) all of them are.

    References
    ----------
    `abdulali2016`, section 3.2 and Fig. 4(b).
    """
    try:
        hull = spatial.ConvexHull(points.u)
    except (spatial.QhullError, ValueError):
        lowest = np.arange(len(points))
    else:
        facing = hull.equations[:, -2] < -1e-9
        lowest = np.unique(hull.simplices[facing])
    u = points.u[lowest].copy()
    u[:, -1] = -normalisation.mean[-1] / normalisation.deviation[-1]
    n = len(lowest)
    return ModelPoints(u, points.lsf[lowest], np.zeros(n), points.weight[lowest], np.ones(n, np.int64))


def zero_speed_points(points: ModelPoints, normalisation: Normalisation, n: int = N_STILL) -> ModelPoints:
    """Return n silent points at rest, from zero force to the largest, with the LSF of the nearest point.

    References
    ----------
    `abdulali2016`, section 3.2.
    """
    still = np.zeros((n, points.u.shape[1]))
    force = points.u[:, -1] * normalisation.deviation[-1] + normalisation.mean[-1]
    still[:, -1] = np.linspace(0.0, max(float(force.max()), 0.0), n)
    u = normalisation.apply(still)
    nearest = spatial.KDTree(points.u).query(u)[1]
    return ModelPoints(u, points.lsf[nearest], np.zeros(n), points.weight[nearest], np.full(n, 2, np.int64))
