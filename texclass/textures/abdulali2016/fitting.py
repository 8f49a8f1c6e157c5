"""From a conditioned scan to a texture: segments, model points, silent points, network."""

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from texclass.textures.abdulali2016.delaunay import DelaunayTexture
from texclass.textures.abdulali2016.frame import Frame
from texclass.textures.abdulali2016.loudness import Loudness, floored, growth_of, residual_of
from texclass.textures.abdulali2016.mirroring import is_symmetric, mirrored
from texclass.textures.abdulali2016.network import (
    SPARSITY,
    Solver,
    fit_exact,
    fit_smooth,
    fit_sparse,
)
from texclass.textures.abdulali2016.points import (
    ORDER,
    ModelPoints,
    Normalisation,
    normalisation_of,
    segment_points,
    zero_force_points,
    zero_speed_points,
)
from texclass.textures.abdulali2016.pooling import pool_spectra
from texclass.textures.abdulali2016.rendering import BUFFER
from texclass.textures.abdulali2016.segmentation import VARIATION, InputSegments, segment_input
from texclass.textures.abdulali2016.texture import NetworkTexture
from texclass.textures.scan import Scan
from texclass.vibration.autoregressive import Method

Pooling = Literal["auto", "none"]

COVERAGE = 0.5
"""Part of the scan that segments have to cover before tau_2 is left alone."""
LOOSEST = 0.64
"""Beyond this, speed and force of a segment are not steady in any sense."""


@dataclass(frozen=True, eq=False)
class ModelledScan:
    """What a texture is fitted to.

    Attributes
    ----------
    name, fs
        Of the scan, Hz.
    segments : InputSegments
    isotropic : bool
        Whether the inputs are |v|, f_n.
    normalisation : Normalisation
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
    frame : Frame
        Range and bounds.
    """

    name: str
    fs: float
    segments: InputSegments
    isotropic: bool
    normalisation: Normalisation
    loudness: Loudness
    growth: tuple[float, float]
    points: ModelPoints
    silent: ModelPoints
    reach: float
    symmetric: bool
    frame: Frame

    def network(
        self,
        solver: Solver = "exact",
        *,
        sparsity: float = SPARSITY,
        buffer: int = BUFFER,
        glide: bool = True,
    ) -> NetworkTexture:
        """Return the texture of a network through the points.

        Parameters
        ----------
        solver : {"exact", "sparse"}
            Through every point, or with few centres.
        sparsity : float
            As for `fit_sparse`.
        buffer, glide
            As for `NetworkTexture`.
        """
        if solver not in get_args(Solver):
            raise ValueError(f"solver is {solver!r}; the rule is one of {get_args(Solver)}")
        every = self.points.joined(self.silent)
        outputs = np.column_stack([every.lsf, every.loudness])
        sparse = solver == "sparse"
        net = fit_sparse(every.u, outputs, sparsity) if sparse else fit_exact(every.u, outputs)
        return NetworkTexture(self.name, self.fs, self.frame, net, self.loudness, self.growth, buffer, glide)

    def delaunay(self, *, buffer: int = BUFFER, glide: bool = True) -> DelaunayTexture:
        """Return the texture of a triangulation of the points; ValueError if they do not span the input."""
        every = self.points.joined(self.silent)
        outputs = np.column_stack([every.lsf, every.loudness])
        return DelaunayTexture(
            self.name, self.fs, self.frame, every.u, outputs, self.loudness, self.growth, buffer, glide
        )


def segment_enough(scan: Scan) -> InputSegments:
    """Segment with the printed tau_2, doubled until the segments cover half of the scan.

    Where a hand is never steady, 0.08 leaves next to nothing: of `stylus6`, 0 to 18 %.
    """
    variation = VARIATION
    while True:
        segments = segment_input(scan, variation=variation)
        if segments.n_samples.sum() >= COVERAGE * len(scan) or variation >= LOOSEST:
            return segments
        variation *= 2


def model_scan(
    scan: Scan,
    *,
    isotropic: bool = False,
    order: int = ORDER,
    loudness: Loudness = "level",
    pooling: Pooling = "auto",
    mirror: Pooling = "auto",
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

    Returns
    -------
    ModelledScan

    Raises
    ------
    ValueError
        If no segment is left, or an argument breaks its rule.
    """
    for value, rule in ((loudness, Loudness), (pooling, Pooling), (mirror, Pooling)):
        if value not in get_args(rule):
            raise ValueError(
                f"got {value!r}; the rule for loudness, pooling, mirror is one of {get_args(rule)}"
            )
    cut = segment_enough(scan) if segments is None else segments
    normalisation = normalisation_of(scan, isotropic=isotropic)
    points = segment_points(
        scan, cut, normalisation, isotropic=isotropic, order=order, method=method, loudness=loudness
    )
    symmetric = mirror == "auto" and not isotropic and is_symmetric(points, normalisation)
    reach = 0.0
    if pooling == "auto":
        points, reach = pool_spectra(points)
    growth = (0.0, 0.0)
    if loudness == "level":
        points, growth = _by_law(points, cut, scan)
    if symmetric:
        points = points.joined(mirrored(points, normalisation))
    silent = zero_force_points(points, normalisation).joined(zero_speed_points(points, normalisation))
    if loudness == "level":
        g = fit_exact(points.u, points.loudness[:, np.newaxis])
        silent = replace(silent, loudness=g.at(silent.u)[:, 0])
    loudest = max(float(np.sqrt(np.mean(x**2))) for x in cut.pieces(scan.acceleration))
    peak = float(np.abs(scan.acceleration).max())
    frame = Frame.around(points, normalisation, isotropic=isotropic, loudest=loudest, peak=peak)
    return ModelledScan(
        scan.name,
        scan.fs,
        cut,
        isotropic,
        normalisation,
        loudness,
        growth,
        points,
        silent,
        reach,
        symmetric,
        frame,
    )


def _by_law(
    points: ModelPoints, segments: InputSegments, scan: Scan
) -> tuple[ModelPoints, tuple[float, float]]:
    """Return the points with what the law of growth leaves of their levels, smoothed where that predicts."""
    level, speed, force = floored(points.loudness), segments.means(scan.speed), segments.means(scan.force)
    growth = growth_of(speed, force, level, points.weight)
    left = residual_of(level, speed, force, growth)
    g = fit_smooth(points.u, left[:, np.newaxis], points.weight).at(points.u)[:, 0]
    # a mean of logarithms is below the logarithm of the mean: keep the power of all segments
    part = level / level.max()
    lost = 0.5 * np.log(points.weight @ part**2 / (points.weight @ (part * np.exp(g - left)) ** 2))
    return replace(points, loudness=g + lost), growth


def fit_texture(
    scan: Scan, *, solver: Solver = "exact", buffer: int = BUFFER, **options: Any
) -> NetworkTexture:
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
    >>> from texclass.textures.abdulali2016 import fit_texture, simulate_scan, surface
    >>> scan = simulate_scan(surface("S4"), 10.0, 1000.0, np.random.default_rng(0))
    >>> texture = fit_texture(scan)
    >>> renderer = texture.renderer(seed=1)
    >>> renderer.process(np.full((500, 2), 60.0), np.full(500, 1.0)).shape
    (500,)
    """
    return model_scan(scan, **options).network(solver, buffer=buffer)


def fit_as_published(scan: Scan, *, isotropic: bool = False, order: int = ORDER) -> NetworkTexture:
    """Return the texture as the paper has it.

    No pooling, the printed thresholds, variance as extra output, sparse network, 16-sample buffer with jumps.
    """
    modelled = model_scan(
        scan,
        isotropic=isotropic,
        order=order,
        loudness="variance",
        pooling="none",
        mirror="none",
        method="autocorrelation",
        segments=segment_input(scan),
    )
    return modelled.network("sparse", glide=False)
