"""How close a texture comes to a recording it has not seen: `abdulali2016`, section 4."""

from dataclasses import dataclass

import numpy as np

from texclass.recording import Samples
from texclass.textures.contract import Texture
from texclass.textures.scan import Scan
from texclass.vibration.scores import goodness_of_fit

WINDOW = 500
"""Samples of a window at 1 kHz; half overlapping."""


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Scores over the windows of a recording.

    Attributes
    ----------
    gfc : ndarray of shape (n_windows,)
        Goodness of fit of the spectrum, eq. (6): 0 ... 1, whatever the level.
    level_error_db : ndarray of shape (n_windows,)
        Level of the rendered over that of the recorded window, dB.
    rendered : ndarray of shape (n_samples,)
        What was compared.
    """

    gfc: Samples
    level_error_db: Samples
    rendered: Samples

    @property
    def mean(self) -> float:
        """Mean GFC, the paper's score."""
        return float(self.gfc.mean())

    @property
    def deviation(self) -> float:
        """Standard deviation of the GFC over windows, the paper's error bars."""
        return float(self.gfc.std())

    @property
    def level_rms_db(self) -> float:
        """RMS of the level error, dB."""
        return float(np.sqrt(np.mean(self.level_error_db**2)))


def cross_validate(texture: Texture, scan: Scan, *, seed: int = 0, window: int = WINDOW) -> CrossValidation:
    """Render a texture along the motion of a conditioned scan, and compare window by window.

    Parameters
    ----------
    texture : Texture
        Of the scan's rate.
    scan : Scan
        Not used for fitting.
    seed : int
        Of the rendered noise.
    window : int
        Samples; half overlapping. Spectra by Welch with Hamming segments of 50 samples.

    Raises
    ------
    ValueError
        If the rates differ or the scan is shorter than a window.
    """
    if texture.fs != scan.fs or len(scan) < window:
        raise ValueError(
            f"texture at {texture.fs:g} Hz, scan of {len(scan)} samples at {scan.fs:g} Hz; "
            f"the rule is one rate, at least {window} samples"
        )
    y = texture.renderer(seed=seed).process(scan.velocity, scan.force, scan.position)
    return compare(scan.acceleration, y, window=window)


def compare(recorded: Samples, rendered: Samples, *, window: int = WINDOW) -> CrossValidation:
    """Return the scores of a rendered against a recorded vibration, both (n_samples,)."""
    pairs = [
        (recorded[i : i + window], rendered[i : i + window])
        for i in range(0, recorded.size - window + 1, window // 2)
    ]
    gfc = np.array([goodness_of_fit(a, b, window=window) for a, b in pairs])
    power = np.array([[np.mean(a**2), np.mean(b**2)] for a, b in pairs])
    least = 1e-12 * power[:, 0].max() + np.finfo(np.float64).tiny
    level = 10 * np.diff(np.log10(np.maximum(power, least)), axis=1)[:, 0]
    return CrossValidation(gfc, level, rendered)
