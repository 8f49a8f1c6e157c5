"""Fit textures to conditioned scans: model points, pooling of spectra, level law, and network."""

import warnings
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, spatial

from texclass.haptics.textures.abdulali2016.model_points import (
    VARIATION,
    InputSegments,
    Loudness,
    ModelPoints,
    fit_growth,
    mirror_points,
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
"""Default order of the AR models, and largest order at which `pool_spectra` compares spectra."""
FADE_FRACTION = 0.1
"""Fraction of the lowest segment speed and force below which the vibration fades out (our choice)."""
REACHES = (0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 4.0, 100.0)
"""Candidate bandwidths h of the kernel that pools spectra, in standard deviations of the input. The largest
bandwidth averages all spectra."""
SMOOTHING = np.concatenate([[0.0], np.geomspace(1e-2, 1e4, 13)])
"""Candidate values of the smoothing of a point of mean weight, in the unit of phi."""
SPARSITY = 0.03
"""Penalty tau as a fraction of the smallest tau that removes all centres."""


@dataclass(frozen=True, eq=False)
class ModelledScan:
    """Model points of a scan, to which a texture is fitted.

    Attributes
    ----------
    name, fs
        Name and sampling rate (Hz) of the scan.
    segments : InputSegments
        Segments of the scan.
    frame : Frame
        Normalisation and range of the inputs, and limits of the output.
    loudness : {"level", "variance"}
        Loudness measure of the points.
    growth : tuple of float
        Exponents of speed and force in the level, see `compute_level`.
    points, silent : ModelPoints
        Points of the segments, and silent points at zero force and zero speed.
    reach : float
        Bandwidth h of the Gaussian kernel that pools spectra, in standard deviations of the input; 0 without
        pooling.
    is_symmetric : bool
        Whether each segment is also used with the opposite direction.
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
    is_symmetric: bool

    def network(
        self,
        solver: Solver = "exact",
        *,
        sparsity: float = SPARSITY,
        buffer: int = 16,
        glide: bool = True,
    ) -> NetworkTexture:
        """Fit a network to the points and return its texture.

        Parameters
        ----------
        solver : {"exact", "sparse"}
            "exact" (default) interpolates all points; "sparse" uses few centres.
        sparsity : float
            Sparsity of the solver "sparse"; see `fit_sparse`.
        buffer, glide : optional
            Parameters of `MapTexture`.
        """
        if solver not in get_args(Solver):
            raise ValueError(f"solver must be one of {get_args(Solver)}, got {solver!r}")
        u, outputs = self._training_data()
        network = fit_sparse(u, outputs, sparsity) if solver == "sparse" else fit_exact(u, outputs)
        return NetworkTexture(
            self.name,
            self.fs,
            self.frame,
            network,
            loudness=self.loudness,
            growth=self.growth,
            buffer=buffer,
            glide=glide,
        )

    def delaunay(self) -> DelaunayTexture:
        """Triangulate the points and return the texture; raise ValueError if all points lie in one plane."""
        u, outputs = self._training_data()
        return DelaunayTexture(
            self.name, self.fs, self.frame, u, outputs, loudness=self.loudness, growth=self.growth
        )

    def _training_data(self) -> tuple[Samples, Samples]:
        points = self.points.concatenate(self.silent)
        return points.u, np.column_stack([points.lsf, points.loudness])


def fit_texture(
    scan: Scan,
    *,
    solver: Solver = "exact",
    buffer: int = 16,
    isotropic: bool = False,
    order: int = ORDER,
    loudness: Loudness = "level",
    pooling: Choice = "auto",
    mirror: Choice = "auto",
    method: Method = "burg",
    segments: InputSegments | None = None,
) -> NetworkTexture:
    """Fit the texture of a conditioned scan.

    Parameters
    ----------
    scan : Scan
        Result of `condition` or `scan_from_sensors`.
    solver, buffer
        Parameters of `ModelledScan.network`.
    isotropic, order, loudness, pooling, mirror, method, segments : optional
        Parameters of `model_scan`.

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
    modelled = model_scan(
        scan,
        isotropic=isotropic,
        order=order,
        loudness=loudness,
        pooling=pooling,
        mirror=mirror,
        method=method,
        segments=segments,
    )
    return modelled.network(solver, buffer=buffer)


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
    """Compute the model points of a conditioned scan.

    Parameters
    ----------
    scan : Scan
        Result of `condition` or `scan_from_sensors`.
    isotropic : bool
        Whether to use the speed |v| as input instead of the velocity (default False).
    order : int
        Order p of the AR models (default 20).
    loudness : {"level", "variance"}
        Loudness measure: RMS of the vibration (default), or variance of the innovation as in the paper.
    pooling : {"auto", "none"}
        "auto" (default) averages spectra of similar segments if this improves predictions, see
        `pool_spectra`; "none" is the method of the paper.
    mirror : {"auto", "none"}
        "auto" (default) also uses segments with the opposite direction if the surface is symmetric, see
        `has_symmetric_spectra`; "none" is the method of the paper.
    method : str
        AR fitting method; see `vibration.fit`.
    segments : InputSegments, optional
        Segments (default: `segment_adaptively`).

    Raises
    ------
    ValueError
        If there is no segment, or an argument is invalid.

    Examples
    --------
    >>> from texclass.haptics.textures.abdulali2016 import condition
    >>> t = np.arange(4000) / 1000
    >>> acceleration = np.random.default_rng(0).standard_normal(4000)
    >>> scan = condition(Scan.along_line(acceleration, 60 + 30 * np.sin(t), 1.0, fs=1000.0))
    >>> modelled = model_scan(scan, order=4, isotropic=True)
    >>> len(modelled.segments), modelled.points.lsf.shape
    (2, (2, 4))
    """
    choices = {"loudness": (loudness, Loudness), "pooling": (pooling, Choice), "mirror": (mirror, Choice)}
    for name, (value, choice) in choices.items():
        if value not in get_args(choice):
            raise ValueError(f"{name} must be one of {get_args(choice)}, got {value!r}")
    cut = segment_adaptively(scan) if segments is None else segments
    inputs = np.column_stack([scan.speed, scan.force] if isotropic else [*scan.velocity.T, scan.force])
    deviation = inputs.std(axis=0)  # a constant input is centred, but not scaled
    deviation = np.where(deviation > 1e-9 * np.abs(inputs).max(axis=0), deviation, 1.0)
    scaling = np.stack([inputs.mean(axis=0), deviation])
    points = segment_points(scan, cut, (inputs - scaling[0]) / scaling[1], order, method, loudness)
    use_mirror = mirror == "auto" and not isotropic and has_symmetric_spectra(points, scaling)
    points, reach = pool_spectra(points) if pooling == "auto" else (points, 0.0)
    growth = (0.0, 0.0)
    if loudness == "level":
        points, growth = _fit_level_law(points, cut, scan)
    if use_mirror:
        points = points.concatenate(mirror_points(points, scaling))
    silent = zero_force_points(points, scaling).concatenate(zero_speed_points(points, scaling))
    if loudness == "level":
        g = fit_exact(points.u, points.loudness[:, np.newaxis])
        silent = silent._replace(loudness=g.at(silent.u)[:, 0])
    u = points.u * scaling[1] + scaling[0]
    speed = u[:, 0] if isotropic else np.hypot(u[:, 0], u[:, 1])
    low, high = (
        np.quantile(np.concatenate(cut.cut(np.column_stack([scan.speed, scan.force]))), q, axis=0)
        for q in (0.05, 0.95)
    )
    narrowest = np.diff(points.lsf, axis=1, prepend=0.0, append=np.pi).min(axis=1)
    frame = Frame(
        isotropic,
        tuple(scaling[0].tolist()),
        tuple(scaling[1].tolist()),
        fastest=float(speed.max()),
        hardest=float(u[:, -1].max()),
        slow=FADE_FRACTION * float(speed.min()),
        light=FADE_FRACTION * float(u[:, -1].min()),
        loudest=max(float(np.sqrt(np.mean(x**2))) for x in cut.cut(scan.acceleration)),
        peak=float(np.abs(scan.acceleration).max()),
        speed_range=(float(low[0]), float(high[0])),
        force_range=(float(low[1]), float(high[1])),
        # the sharpest quarter is ignored because models of 75 samples overfit
        gap=float(min(np.quantile(narrowest, 0.25), 0.9 * np.pi / (points.lsf.shape[1] + 1))),
    )
    return ModelledScan(scan.name, scan.fs, cut, frame, loudness, growth, points, silent, reach, use_mirror)


def segment_adaptively(scan: Scan) -> InputSegments:
    """Segment a scan, and double the tau_2 of the paper until the segments cover at least half of the scan.

    The largest tau_2 is 0.64. If the motion is unsteady, tau_2 = 0.08 yields few segments: they cover 0 to
    18 % of the recordings of `stylus6`.
    """
    variation = VARIATION
    while True:
        segments = segment_input(scan, variation=variation)
        if (
            segments.n_samples.sum() >= 0.5 * len(scan) or variation >= 0.64
        ):  # segments are not steady above this value
            return segments
        variation *= 2


def _fit_level_law(
    points: ModelPoints, segments: InputSegments, scan: Scan
) -> tuple[ModelPoints, tuple[float, float]]:
    """Fit the level law; return points whose loudness is the residual, and the exponents of the law."""
    lowest = max(1e-6 * float(points.loudness.max()), np.finfo(np.float64).tiny)
    level = np.maximum(points.loudness, lowest)
    speed, force = segments.means(scan.speed), segments.means(scan.force)
    growth = fit_growth(speed, force, level, points.weight)
    residual = np.log(level) - growth[0] * np.log(speed) - growth[1] * np.log(force)
    g = fit_smooth(points.u, residual[:, np.newaxis], points.weight).at(points.u)[:, 0]
    # smoothing averages logarithms and thereby lowers the mean power, which is restored here
    relative = level / level.max()
    smoothed = relative * np.exp(g - residual)
    correction = 0.5 * np.log(points.weight @ relative**2 / (points.weight @ smoothed**2))
    return points._replace(loudness=g + correction), growth


def has_symmetric_spectra(points: ModelPoints, scaling: Samples) -> bool:
    """Return whether spectra at opposite velocities are equal, for inputs (v_x, v_y, f_n).

    A grain has the same effect in both directions; hairs and scales do not. For each segment, the network is
    evaluated at the opposite velocity. If this prediction is about as accurate as a leave-one-out prediction
    at the velocity of the segment, the surface is treated as symmetric. This step is not in the paper.
    """
    opposite = fit_exact(points.u, points.lsf).at(mirror_points(points, scaling).u) - points.lsf
    own = predict_left_out(points.u, points.lsf) - points.lsf
    weight = points.weight[:, np.newaxis]
    # ratio in our simulations: 0.85 to 1.6 for a period of pi over directions, 1.8 to 6 for a period of 2 pi
    return bool(np.sum(weight * opposite**2) <= 1.5 * np.sum(weight * own**2))


def pool_spectra(points: ModelPoints) -> tuple[ModelPoints, float]:
    """Average the spectra of segments with similar inputs if this improves predictions (not in the paper).

    The spectrum of a segment of 75 ms has a large variance, and a network that interpolates many such spectra
    fluctuates. Autocorrelations are additive, so segments with similar inputs can be pooled:

        r_i = sum_j n_j exp(-|u_i - u_j|^2 / (2 h^2)) r_j

    where r_j is the autocorrelation of the model of segment j at power 1. (Autocorrelations estimated
    directly from 75 samples include edge effects: in our simulations, the noise floor was 10 dB too high.)

    Leave-one-out prediction selects the bandwidth h, and whether to pool at all. The criterion is sum_i n_i
    ln(a^T T_i a) / sum_i n_i, the mean logarithm of the error power with which the model `a`, pooled from the
    other segments, predicts segment i. T_i is the Toeplitz matrix of the autocorrelation of segment i. The
    alternative without pooling is the leave-one-out prediction of the network. A mean of autocorrelations is
    an autocorrelation, so the pooled models are stable.

    Parameters
    ----------
    points : ModelPoints
        Points of the segments, without silent points.

    Returns
    -------
    points : ModelPoints
        Points with pooled spectra, or the original points.
    reach : float
        Bandwidth h; 0 if pooling does not improve the prediction.
    """
    if len(points.u) < 3:
        return points, 0.0
    R = to_autocorrelation(line_spectrum.to_reflection(points.lsf))
    T = np.array([linalg.toeplitz(r[: ORDER + 1]) for r in R])
    squared = spatial.distance.cdist(points.u, points.u) ** 2

    def pool(reach: float, *, include_self: bool) -> Samples:
        """Return reflection coefficients pooled over neighbours, with or without the segment itself."""
        exponent = -squared / (2 * reach**2)
        if not include_self:
            np.fill_diagonal(exponent, -np.inf)
        weight = points.weight * np.exp(exponent - exponent.max(axis=1, keepdims=True))
        return from_autocorrelation((weight / weight.sum(axis=1, keepdims=True)) @ R).reflection

    errors = [_prediction_error(pool(h, include_self=False), T, points.weight) for h in REACHES]
    unpooled = line_spectrum.to_reflection(line_spectrum.spread(predict_left_out(points.u, points.lsf)))
    # the margin favours the unpooled points, because pooling blurs real changes
    if _prediction_error(unpooled, T, points.weight) <= min(errors) + 0.03:
        return points, 0.0
    reach = REACHES[int(np.argmin(errors))]
    lsf = line_spectrum.from_reflection(pool(reach, include_self=True))
    return points._replace(lsf=line_spectrum.spread(lsf)), reach


def _prediction_error(k: Samples, T: Samples, weight: Samples) -> float:
    """Return sum_i n_i ln(a^T T_i a) / sum_i n_i of models with reflection coefficients (n, p)."""
    a = recursions.step_up(np.ascontiguousarray(k[:, : T.shape[1] - 1]))
    error = np.maximum(np.einsum("ni,nij,nj->n", a, T, a), np.finfo(np.float64).tiny)
    return float(weight @ np.log(error) / weight.sum())


def to_autocorrelation(k: Samples) -> Samples:
    """Return the autocorrelations r_0 = 1, r_1 ... r_p of models with reflection coefficients (n, p).

    Inverse Levinson recursion: r_m = -k_m E_{m-1} - sum_{i<m} a_i r_{m-i}, with a of order m - 1 and
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
    """Solve eq. (5) for a network that interpolates all points or, with smoothing, approximates them.

    ``[[Phi - S, G], [G^T, 0]] [w, d] = [f, 0]`` with S the diagonal matrix of the smoothing. Phi is
    conditionally negative definite for phi(r) = r, so subtracting S regularises it.

    Parameters
    ----------
    u : ndarray of shape (n_points, n_inputs)
        Normalised inputs.
    f : ndarray of shape (n_points, n_outputs)
        Outputs at the points.
    smoothing : array_like of shape () or (n_points,)
        Smoothing, at least 0; 0 (default) is the system in the paper.

    Notes
    -----
    If the system is singular because points coincide or lie in one plane, the minimum-norm solution is used.

    References
    ----------
    `abdulali2016`, eq. (5); Wahba, "Spline models for observational data", 1990.

    Examples
    --------
    >>> u = np.array([[0.0], [1.0], [2.0]])
    >>> network = fit_exact(u, np.array([[0.0], [1.0], [4.0]]))
    >>> network.at([[1.0], [1.5]]).round(3).ravel().tolist()
    [1.0, 2.5]
    """
    right = np.concatenate([f, np.zeros((u.shape[1] + 1, f.shape[1]))])
    solution = _solve(u, smoothing, right)
    return RadialNetwork(u, solution[: len(u)], solution[len(u) :])


def fit_smooth(u: Samples, f: Samples, weight: Samples) -> RadialNetwork:
    """Solve eq. (5) with the best smoothing by leave-one-out error; fit a constant if it is about as good.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
        Normalised inputs and outputs.
    weight : ndarray of shape (n_points,)
        Duration in s of the signal of each point. The variance of the estimates, and therefore the smoothing,
        is proportional to 1 / weight.
    """
    relative = weight.mean() / weight
    errors = [np.mean((f - predict_left_out(u, f, s * relative)) ** 2) for s in SMOOTHING]
    mean = np.average(f, axis=0, weights=weight)
    constant_error = (mean - f) / (1 - weight / weight.sum())[:, np.newaxis] if len(u) > 1 else f
    if min(errors) > 0.9 * np.mean(constant_error**2) or len(u) < 2:
        polynomial = np.concatenate([mean[np.newaxis], np.zeros((u.shape[1], f.shape[1]))])
        return RadialNetwork(u, np.zeros(f.shape), polynomial)
    return fit_exact(u, f, SMOOTHING[int(np.argmin(errors))] * relative)


def predict_left_out(u: Samples, f: Samples, smoothing: ArrayLike = 0.0) -> Samples:
    """Return the leave-one-out prediction of the network for each point, shape (n_points, n_outputs).

    The error of point i is w_i / B_ii, with B the inverse of the system of all points, so no refit is needed.
    If the other points do not determine the prediction, the mean of the outputs is used.
    """
    n = len(u)
    inverse = _solve(u, smoothing, np.eye(n + u.shape[1] + 1))[:n, :n]
    diagonal = np.diag(inverse)[:, np.newaxis]
    is_determined = np.abs(diagonal) > 1e-9 * np.abs(inverse).max()
    error = (inverse @ f) / np.where(is_determined, diagonal, 1.0)
    return np.where(is_determined, f - error, f.mean(axis=0))


def fit_sparse(u: Samples, f: Samples, sparsity: float = SPARSITY) -> RadialNetwork:
    """Fit a network with few centres by minimising ``1/2 |A x - y|^2 + tau |x|_1``, the objective of SpaRSA.

    Parameters
    ----------
    u, f : ndarray of shape (n_points, n_inputs), (n_points, n_outputs)
        Normalised inputs and outputs.
    sparsity : float
        Penalty tau as a fraction of the smallest tau that removes all centres, between 0 and 1 (default
        0.03).

    Raises
    ------
    ValueError
        If the sparsity is not between 0 and 1.

    Notes
    -----
    Our interpretation of the paper: all outputs share one set of centres, because each centre
    costs one distance computation. |x|_1 is therefore the sum over centres of the norm over outputs, which
    are scaled to unit standard deviation. The polynomial is projected out and not penalised. The weights of
    the selected centres are refitted without penalty under G^T w = 0 (debiasing in SpaRSA).

    References
    ----------
    `abdulali2016`, section 3.2; Wright, Nowak, Figueiredo, "Sparse reconstruction by separable
    approximation", 2009.

    Examples
    --------
    >>> u = np.linspace(-1, 1, 21)[:, np.newaxis]
    >>> len(fit_exact(u, np.abs(u)).centres), len(fit_sparse(u, np.abs(u)).centres)
    (21, 2)
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import MultiTaskLasso

    if not 0 < sparsity < 1:
        raise ValueError(f"sparsity must be between 0 and 1, got {sparsity}")
    phi, g = spatial.distance.cdist(u, u), np.column_stack([np.ones(len(u)), u])
    projector = np.eye(len(u)) - g @ np.linalg.pinv(g)
    deviation = f.std(axis=0)
    A, y = projector @ phi, projector @ (f / np.where(deviation > 0, deviation, 1.0))
    tau = sparsity * float(np.linalg.norm(A.T @ y, axis=1).max())
    selected = np.zeros(0, dtype=np.intp)
    if tau > 0:
        lasso = MultiTaskLasso(alpha=tau / len(A), fit_intercept=False, max_iter=5000, tol=1e-3)
        with warnings.catch_warnings():
            # the set of selected centres converges long before the weights
            warnings.simplefilter("ignore", ConvergenceWarning)
            selected = np.flatnonzero(np.any(lasso.fit(A, y).coef_ != 0, axis=0))
    basis = linalg.null_space(g[selected].T)
    solution = np.linalg.lstsq(np.hstack([phi[:, selected] @ basis, g]), f)[0]
    n = basis.shape[1]
    return RadialNetwork(u[selected], basis @ solution[:n], np.asarray(solution[n:], dtype=np.float64))


def _solve(u: Samples, smoothing: ArrayLike, right: Samples) -> Samples:
    """Solve the system of eq. (5), with the minimum-norm solution if it is (nearly) singular."""
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
    is_regular = np.abs(values) > 1e-10 * np.abs(values).max()
    return np.asarray((vectors[:, is_regular] / values[is_regular]) @ (vectors[:, is_regular].T @ right))
