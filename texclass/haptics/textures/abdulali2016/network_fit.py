"""From a conditioned scan to a texture: model points, spectra shared, a law of loudness, a network."""

import warnings
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, spatial

from texclass.haptics.textures.abdulali2016.model_points import (
    VARIATION,
    InputSegments,
    Loudness,
    ModelPoints,
    growth_of,
    mirrored,
    segment_input,
    segment_points,
    zero_force_points,
    zero_speed_points,
)
from texclass.haptics.textures.abdulali2016.network_texture import (
    DelaunayTexture,
    Frame,
    NetworkTexture,
    RadialNetwork,
)
from texclass.haptics.textures.scan import Scan
from texclass.recording import Samples
from texclass.vibration import line_spectrum, recursions
from texclass.vibration.autoregressive import Method, from_autocorrelation

Solver = Literal["exact", "sparse"]
Choice = Literal["auto", "none"]

ORDER = 20
"""Of the AR models; and of those that `pool_spectra` compares: enough to tell, and cheap."""
HUSH = 0.1
"""Below this part of the slowest and lightest segment the vibration fades out, whatever the map says."""
REACHES = (0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 4.0, 100.0)
"""Candidates of h, in deviations of the input; the last one is a single spectrum for all."""
SMOOTHING = np.concatenate([[0.0], np.geomspace(1e-2, 1e4, 13)])
"""Candidates of the smoothing, in units of phi for a point of mean weight."""
SPARSITY = 0.03
"""tau over the smallest tau that leaves no centre."""


@dataclass(frozen=True, eq=False)
class ModelledScan:
    """What a texture is fitted to.

    Attributes
    ----------
    name, fs
        Of the scan, Hz.
    segments : InputSegments
    frame : Frame
        Normalisation, range and bounds.
    loudness : {"level", "variance"}
        What the points tell besides the spectrum.
    growth : tuple of float
        Exponents of speed and force in the level, see `level_of`.
    points, silent : ModelPoints
        Of the segments, and of zero force and zero speed.
    reach : float
        Of the pooling of spectra, in deviations of the input; 0: none.
    symmetric : bool
        Whether the points hold each segment twice, for both ways.
    """

    name: str
    fs: float
    segments: InputSegments
    frame: Frame
    loudness: Loudness
    growth: tuple[float, float]
    points: ModelPoints
    silent: ModelPoints
    reach: float
    symmetric: bool

    def network(
        self, solver: Solver = "exact", *, sparsity: float = SPARSITY, **options: Any
    ) -> NetworkTexture:
        """Return the texture of a network through the points.

        Parameters
        ----------
        solver : {"exact", "sparse"}
            Through every point, or with few centres.
        sparsity : float
            As for `fit_sparse`.
        **options
            `buffer` and `glide`, as for `MapTexture`.
        """
        if solver not in get_args(Solver):
            raise ValueError(f"solver is {solver!r}. Expected one of {get_args(Solver)}")
        u, outputs = self._samples()
        net = fit_sparse(u, outputs, sparsity) if solver == "sparse" else fit_exact(u, outputs)
        return NetworkTexture(
            self.name, self.fs, self.frame, net, loudness=self.loudness, growth=self.growth, **options
        )

    def delaunay(self) -> DelaunayTexture:
        """Return the texture of a triangulation of the points; ValueError if they do not span the input."""
        u, outputs = self._samples()
        return DelaunayTexture(
            self.name, self.fs, self.frame, u, outputs, loudness=self.loudness, growth=self.growth
        )

    def _samples(self) -> tuple[Samples, Samples]:
        every = self.points.joined(self.silent)
        return every.u, np.column_stack([every.lsf, every.loudness])


def fit_texture(scan: Scan, *, solver: Solver = "exact", buffer: int = 16, **options: Any) -> NetworkTexture:
    """Return the texture of a conditioned scan.

    Parameters
    ----------
    scan : Scan
        From `condition` or `scan_from_sensors`.
    solver, buffer
        As for `ModelledScan.network`.
    **options
        As for `model_scan`.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.textures import Scan
    >>> from texclass.haptics.textures.abdulali2016 import condition, fit_texture
    >>> t = np.arange(8000) / 1000
    >>> acceleration = np.random.default_rng(0).standard_normal(8000)
    >>> scan = condition(Scan.along_line(acceleration, 60 + 30 * np.sin(t), 1.0, fs=1000.0))
    >>> renderer = fit_texture(scan).renderer(seed=1)
    >>> renderer.process(np.full((500, 2), 60.0), np.full(500, 1.0)).shape
    (500,)
    """
    return model_scan(scan, **options).network(solver, buffer=buffer)


def model_scan(
    scan: Scan,
    *,
    isotropic: bool = False,
    order: int = ORDER,
    loudness: Loudness = "level",
    pooling: Choice = "auto",
    mirror: Choice = "auto",
    method: Method = "burg",
    segments: InputSegments | None = None,
) -> ModelledScan:
    """Turn a conditioned scan into model points.

    Parameters
    ----------
    scan : Scan
        From `condition` or `scan_from_sensors`.
    isotropic : bool
        Whether |v| stands for the velocity.
    order : int
        p of the AR models.
    loudness : {"level", "variance"}
        RMS of the vibration, or the variance of the innovation as in the paper.
    pooling : {"auto", "none"}
        Whether segments may share their spectra, see `pool_spectra`; "none" is the paper.
    mirror : {"auto", "none"}
        Whether segments may count for the opposite direction too, see `is_symmetric`; "none" is the paper.
    method : str
        Of the AR fit, as for `vibration.fit`.
    segments : InputSegments, optional
        `segment_enough` by default.

    Raises
    ------
    ValueError
        If no segment is left, or an argument breaks its rule.
    """
    choices = {"loudness": (loudness, Loudness), "pooling": (pooling, Choice), "mirror": (mirror, Choice)}
    for name, (value, choice) in choices.items():
        if value not in get_args(choice):
            raise ValueError(f"{name} is {value!r}. Expected one of {get_args(choice)}")
    cut = segment_enough(scan) if segments is None else segments
    inputs = np.column_stack([scan.speed, scan.force] if isotropic else [*scan.velocity.T, scan.force])
    deviation = inputs.std(axis=0)  # an input that never changes is only centred
    deviation = np.where(deviation > 1e-9 * np.abs(inputs).max(axis=0), deviation, 1.0)
    scaling = np.stack([inputs.mean(axis=0), deviation])
    points = segment_points(scan, cut, (inputs - scaling[0]) / scaling[1], order, method, loudness)
    symmetric = mirror == "auto" and not isotropic and is_symmetric(points, scaling)
    points, reach = pool_spectra(points) if pooling == "auto" else (points, 0.0)
    growth = (0.0, 0.0)
    if loudness == "level":
        points, growth = _by_law(points, cut, scan)
    if symmetric:
        points = points.joined(mirrored(points, scaling))
    silent = zero_force_points(points, scaling).joined(zero_speed_points(points, scaling))
    if loudness == "level":
        g = fit_exact(points.u, points.loudness[:, np.newaxis])
        silent = silent._replace(loudness=g.at(silent.u)[:, 0])
    u = points.u * scaling[1] + scaling[0]
    speed = u[:, 0] if isotropic else np.hypot(u[:, 0], u[:, 1])
    narrowest = np.diff(points.lsf, axis=1, prepend=0.0, append=np.pi).min(axis=1)
    frame = Frame(
        isotropic,
        tuple(scaling[0].tolist()),
        tuple(scaling[1].tolist()),
        fastest=float(speed.max()),
        hardest=float(u[:, -1].max()),
        slow=HUSH * float(speed.min()),
        light=HUSH * float(u[:, -1].min()),
        loudest=max(float(np.sqrt(np.mean(x**2))) for x in cut.pieces(scan.acceleration)),
        peak=float(np.abs(scan.acceleration).max()),
        # the sharpest quarter counts as chance: 75 samples are easily overfitted
        gap=float(min(np.quantile(narrowest, 0.25), 0.9 * np.pi / (points.lsf.shape[1] + 1))),
    )
    return ModelledScan(scan.name, scan.fs, cut, frame, loudness, growth, points, silent, reach, symmetric)


def segment_enough(scan: Scan) -> InputSegments:
    """Segment with the printed tau_2, doubled until the segments cover half of the scan.

    Where a hand is never steady, 0.08 leaves next to nothing: of `stylus6`, 0 to 18 %.
    """
    variation = VARIATION
    while True:
        segments = segment_input(scan, variation=variation)
        if segments.n_samples.sum() >= 0.5 * len(scan) or variation >= 0.64:  # beyond, nothing is steady
            return segments
        variation *= 2


def _by_law(
    points: ModelPoints, segments: InputSegments, scan: Scan
) -> tuple[ModelPoints, tuple[float, float]]:
    """Return the points with what the law of growth leaves of their levels, smoothed where that predicts."""
    least = max(1e-6 * float(points.loudness.max()), np.finfo(np.float64).tiny)
    level = np.maximum(points.loudness, least)
    speed, force = segments.means(scan.speed), segments.means(scan.force)
    growth = growth_of(speed, force, level, points.weight)
    left = np.log(level) - growth[0] * np.log(speed) - growth[1] * np.log(force)
    g = fit_smooth(points.u, left[:, np.newaxis], points.weight).at(points.u)[:, 0]
    # a mean of logarithms is below the logarithm of the mean: keep the power of all segments
    part = level / level.max()
    lost = 0.5 * np.log(points.weight @ part**2 / (points.weight @ (part * np.exp(g - left)) ** 2))
    return points._replace(loudness=g + lost), growth


def is_symmetric(points: ModelPoints, scaling: Samples) -> bool:
    """Return whether the spectra of segments (inputs v_x, v_y, f_n) are those of the opposite velocity.

    A grain has no sense of direction (hairs and scales do). If the network says of the opposite of each
    segment's velocity what that segment says, about as well as a network without the segment says it of the
    velocity itself, the surface is taken to be symmetric. The paper does not do this.
    """
    back = fit_exact(points.u, points.lsf).at(mirrored(points, scaling).u) - points.lsf
    itself = predict_left_out(points.u, points.lsf) - points.lsf
    weight = points.weight[:, np.newaxis]
    # in our simulations 0.85 to 1.6 where the period over directions is pi, 1.8 to 6 where it is 2 pi
    return bool(np.sum(weight * back**2) <= 1.5 * np.sum(weight * itself**2))


def pool_spectra(points: ModelPoints) -> tuple[ModelPoints, float]:
    """Let spectra of segments help each other out where the input hardly matters; the paper does not.

    A segment of 75 ms gives a poor spectrum, and a network through many poor ones wavers. Autocorrelations
    add up like the data behind them, so that segments near each other in input can share:

        r_i = sum_j n_j exp(-|u_i - u_j|^2 / (2 h^2)) r_j

    with r_j those of the models of the segments, at power 1. (Autocorrelations counted from 75 samples would
    bring the ends of the segments along: in our simulations a floor 10 dB too high.) How near, h, and whether
    at all, is decided by what predicts a segment that was left out: compared is sum_i n_i ln(a^T T_i a) /
    sum_i n_i, the log power of the error with which the model from the others predicts segment i (T_i:
    Toeplitz matrix of its autocorrelation). Unpooled, the model from the others is that of the network. A
    mean of autocorrelations is one: always a stable model.

    Parameters
    ----------
    points : ModelPoints
        Of the segments, without silent ones.

    Returns
    -------
    points : ModelPoints
        With pooled spectra, or as they were.
    reach : float
        h; 0 where pooling predicts worse.
    """
    if len(points.u) < 3:
        return points, 0.0
    R = autocorrelation_of(line_spectrum.to_reflection(points.lsf))
    T = np.array([linalg.toeplitz(r[: ORDER + 1]) for r in R])
    squared = spatial.distance.cdist(points.u, points.u) ** 2

    def pooled(reach: float, *, alone: bool) -> Samples:
        """Return the reflection coefficients from the neighbours and, if not left out, the segment itself."""
        exponent = -squared / (2 * reach**2)
        if not alone:
            np.fill_diagonal(exponent, -np.inf)
        share = points.weight * np.exp(exponent - exponent.max(axis=1, keepdims=True))
        return from_autocorrelation((share / share.sum(axis=1, keepdims=True)) @ R).reflection

    errors = [_prediction_error(pooled(h, alone=False), T, points.weight) for h in REACHES]
    apart = line_spectrum.to_reflection(line_spectrum.spread(predict_left_out(points.u, points.lsf)))
    if _prediction_error(apart, T, points.weight) <= min(errors) + 0.03:  # sharing blurs what does change
        return points, 0.0
    reach = REACHES[int(np.argmin(errors))]
    lsf = line_spectrum.from_reflection(pooled(reach, alone=True))
    return points._replace(lsf=line_spectrum.spread(lsf)), reach


def _prediction_error(k: Samples, T: Samples, weight: Samples) -> float:
    """Return sum_i n_i ln(a^T T_i a) / sum_i n_i of the models with reflection coefficients (n, p)."""
    a = recursions.step_up(np.ascontiguousarray(k[:, : T.shape[1] - 1]))
    error = np.maximum(np.einsum("ni,nij,nj->n", a, T, a), np.finfo(np.float64).tiny)
    return float(weight @ np.log(error) / weight.sum())


def autocorrelation_of(k: Samples) -> Samples:
    """Return r_0 = 1, r_1 ... r_p of the models with reflection coefficients (n, p), shape (n, p + 1).

    Levinson's recursion backwards: r_m = -k_m E_{m-1} - sum_{i<m} a_i r_{m-i}, with a of order m - 1 and
    E_m = prod_{i<=m} (1 - k_i^2).
    """
    n, p = k.shape
    a, r, E = np.zeros((n, p + 1)), np.zeros((n, p + 1)), np.ones(n)
    a[:, 0] = r[:, 0] = 1.0
    for m in range(1, p + 1):
        r[:, m] = -k[:, m - 1] * E - np.einsum("ni,ni->n", a[:, 1:m], r[:, m - 1 : 0 : -1])
        a[:, 1 : m + 1] += k[:, m - 1 : m] * a[:, m - 1 :: -1]
        E = E * (1 - k[:, m - 1] ** 2)
    return r


def fit_exact(u: Samples, f: Samples, smoothing: ArrayLike = 0.0) -> RadialNetwork:
    """Solve eq. (5): through every point, or, with smoothing, as near as it pays.

    ``[[Phi - S, G], [G^T, 0]] [w, d] = [f, 0]`` with S the diagonal of the smoothing: Phi of phi(r) = r is
    conditionally negative, so taking away is what makes it definite.

    Parameters
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs.
    f : ndarray of shape (n_points, n_outputs)
    smoothing : array_like of shape () or (n_points,)
        At least 0; for 0 the printed system.

    Notes
    -----
    Where the system is singular (points that coincide or lie in one plane) the solution of least norm is
    taken.

    References
    ----------
    `abdulali2016`, eq. (5); Wahba, "Spline models for observational data", 1990.
    """
    right = np.concatenate([f, np.zeros((u.shape[1] + 1, f.shape[1]))])
    solved = _solve(u, smoothing, right)
    return RadialNetwork(u, solved[: len(u)], solved[len(u) :])


def fit_smooth(u: Samples, f: Samples, weight: Samples) -> RadialNetwork:
    """Solve eq. (5) with the smoothing that predicts left-out points best; a constant, if none is worth it.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
    weight : ndarray of shape (n_points,)
        Seconds behind each point: estimates scatter with 1 / weight, and so does the smoothing.
    """
    share = weight.mean() / weight
    errors = [np.mean((f - predict_left_out(u, f, s * share)) ** 2) for s in SMOOTHING]
    mean = np.average(f, axis=0, weights=weight)
    left_out = (mean - f) / (1 - weight / weight.sum())[:, np.newaxis] if len(u) > 1 else f
    if min(errors) > 0.9 * np.mean(left_out**2) or len(u) < 2:
        polynomial = np.concatenate([mean[np.newaxis], np.zeros((u.shape[1], f.shape[1]))])
        return RadialNetwork(u, np.zeros(f.shape), polynomial)
    return fit_exact(u, f, SMOOTHING[int(np.argmin(errors))] * share)


def predict_left_out(u: Samples, f: Samples, smoothing: ArrayLike = 0.0) -> Samples:
    """Return what the network of all other points says of each point, shape (n_points, n_outputs).

    The error of point i is w_i / B_ii, with B the inverse of the system of all points: no fit is repeated.
    What the others do not determine is taken as their mean.
    """
    n = len(u)
    inverse = _solve(u, smoothing, np.eye(n + u.shape[1] + 1))[:n, :n]
    diagonal = np.diag(inverse)[:, np.newaxis]
    determined = np.abs(diagonal) > 1e-9 * np.abs(inverse).max()
    error = (inverse @ f) / np.where(determined, diagonal, 1.0)
    return np.where(determined, f - error, f.mean(axis=0))


def fit_sparse(u: Samples, f: Samples, sparsity: float = SPARSITY) -> RadialNetwork:
    """Keep few centres: minimise ``1/2 |A x - y|^2 + tau |x|_1``, SpaRSA's objective, over the centres.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
    sparsity : float
        tau over the smallest tau that leaves no centre; above 0, below 1.

    Raises
    ------
    ValueError
        For a sparsity out of its range.

    Notes
    -----
    Readings. One set of centres serves all outputs (a centre costs its distance once): |x|_1 sums over
    centres the norm over outputs, each output brought to unit deviation. The polynomial is not penalised but
    projected out. The centres found are then fitted without penalty under G^T w = 0, SpaRSA's debiasing.

    References
    ----------
    `abdulali2016`, section 3.2; Wright, Nowak, Figueiredo, "Sparse reconstruction by separable
    approximation", 2009.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import MultiTaskLasso

    if not 0 < sparsity < 1:
        raise ValueError(f"sparsity is {sparsity}. Expected a number between 0 and 1")
    phi, g = spatial.distance.cdist(u, u), np.column_stack([np.ones(len(u)), u])
    free = np.eye(len(u)) - g @ np.linalg.pinv(g)
    deviation = f.std(axis=0)
    A, y = free @ phi, free @ (f / np.where(deviation > 0, deviation, 1.0))
    tau = sparsity * float(np.linalg.norm(A.T @ y, axis=1).max())
    kept = np.zeros(0, dtype=np.intp)
    if tau > 0:
        lasso = MultiTaskLasso(alpha=tau / len(A), fit_intercept=False, max_iter=5000, tol=1e-3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # which centres matter is settled long before
            kept = np.flatnonzero(np.any(lasso.fit(A, y).coef_ != 0, axis=0))
    balanced = linalg.null_space(g[kept].T)
    solved = np.linalg.lstsq(np.hstack([phi[:, kept] @ balanced, g]), f)[0]
    n = balanced.shape[1]
    return RadialNetwork(u[kept], balanced @ solved[:n], np.asarray(solved[n:], dtype=np.float64))


def _solve(u: Samples, smoothing: ArrayLike, right: Samples) -> Samples:
    """Solve the system of eq. (5); where it is (nearly) singular, with the least norm."""
    n, g = len(u), np.column_stack([np.ones(len(u)), u])
    system = np.zeros((n + g.shape[1], n + g.shape[1]))
    system[:n, :n] = spatial.distance.cdist(u, u) - np.diag(np.broadcast_to(np.asarray(smoothing), (n,)))
    system[:n, n:], system[n:, :n] = g, g.T
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", linalg.LinAlgWarning)
            return np.asarray(linalg.solve(system, right, assume_a="sym"))
    except (linalg.LinAlgError, linalg.LinAlgWarning):
        values, vectors = np.linalg.eigh(system)
    kept = np.abs(values) > 1e-10 * np.abs(values).max()
    return np.asarray((vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ right))
