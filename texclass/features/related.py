"""Temporal features of related work in Table I of strese2015; numbers in brackets are its references."""

import numpy as np
from scipy.linalg import LinAlgError, solve_toeplitz

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.filtered import details
from texclass.features.transforms import level, require, unit
from texclass.features.view import PhaseView
from texclass.recording import Samples


@feature(
    phase="movement",
    unit="(m/s^2)^2",
    reference="strese2015, Table I [7] (Fishel and Loeb, 2012)",
    gain=Gain(power=2),
)
def standard_roughness(view: PhaseView) -> float:
    """Power of the vibration, mean x^2.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    return float(x @ x) / x.size * level(view) ** 2


def _lpc_names(*, order: int) -> tuple[str, ...]:
    return tuple(f"a{k + 1}" for k in range(order))


@feature(
    phase="movement",
    unit="1",
    reference="strese2015, Table I [10] (Culbertson et al., 2014)",
    outputs=_lpc_names,
    depends_on=("rate",),
)
def lpc_coefficients(view: PhaseView, *, order: int = 10) -> Samples:
    """Linear prediction x_n = sum_k a_k x_(n-k) of the movement, by the autocorrelation method.

    a solves the Toeplitz equations of r_0 ... r_order (biased autocorrelation), so the predictor is stable.

    Parameters
    ----------
    view : PhaseView
        Movement.
    order : int
        Number of coefficients.

    Returns
    -------
    ndarray of shape (order,)

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 10 x order samples, or a singular system.
    """
    require(view, 10 * order, "10 times the order")
    x = unit(view)
    r = np.array([x[k:] @ x[: x.size - k] for k in range(order + 1)]) / (x @ x)
    try:
        a = np.asarray(solve_toeplitz(r[:-1], r[1:]))
    except LinAlgError as error:
        raise UndefinedFeatureError(f"prediction of order {order} has no solution ({error})") from None
    if not np.isfinite(a).all():
        raise UndefinedFeatureError(f"prediction of order {order} has no finite solution")
    return a


@feature(
    phase="movement",
    unit="m/s^2",
    reference="strese2015, Table I [17] (Chathuranga et al., 2013)",
    gain=Gain(power=1),
)
def mean_magnitude(view: PhaseView) -> float:
    """Mean of |x|: the movement's own mean is gravity and removed with it.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    return float(np.abs(unit(view)).mean()) * level(view)


@feature(
    phase="movement",
    unit="(m/s^2)^2",
    reference="strese2015, Table I [17] (Chathuranga et al., 2013)",
    gain=Gain(power=2),
)
def variance(view: PhaseView) -> float:
    """Variance of the movement.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    return (float(x @ x) / x.size - float(x.mean()) ** 2) * level(view) ** 2


@feature(
    phase="movement",
    unit="(m/s^2)^2",
    reference="strese2015, Table I [17] (Chathuranga et al., 2013)",
    gain=Gain(power=2),
    depends_on=("rate",),
)
def wavelet_energy(view: PhaseView, *, wavelet: str = "coif3", depth: int = 5) -> float:
    """Energy of the wavelet details d_1 ... d_5 per sample, of the movement high-passed at 100 Hz.

    The transform is that of `temporal_roughness_as_printed` and computed once for both.

    Parameters
    ----------
    view : PhaseView
        Movement.
    wavelet : str
        Name in PyWavelets.
    depth : int
        Number of levels.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 544 samples (coif3, level 5), or fs/2 not above 100 Hz.
    """
    energy = sum(float(np.sum(d * d, dtype=np.float64)) for d in details(view, 100.0, wavelet, depth))
    if energy == 0:
        raise UndefinedFeatureError("silence: no energy in the details")
    return energy / view.n_samples * level(view) ** 2
