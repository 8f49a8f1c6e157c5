"""What `guruswamy2011` printed: Tables I, II and III, and the law of level of section V-B."""

from dataclasses import dataclass

from texclass.textures.guruswamy2011.level import LevelLaw


@dataclass(frozen=True)
class ScanRow:
    """One scan in Table I or III.

    Attributes
    ----------
    f_max_hz, f_major_hz : float
        Upper cut-off and major frequency.
    segments_per_mm : float
    order : float
        Mean of M + 1 = N + 1 over the segments.
    sad_bandpass, sad_original : float
        Mean absolute difference of the filters to the band-passed and the recorded profile, mm/s^2.
    speed, force : float
        Means, mm/s and N.
    """

    f_max_hz: float
    f_major_hz: float
    segments_per_mm: float
    order: float
    sad_bandpass: float
    sad_original: float
    speed: float
    force: float


TABLE_1 = {
    "Jewel-case": ScanRow(322.8, 69.5, 1.548, 29.5, 51.7, 84.0, 8.2, 0.874),
    "Tire tread": ScanRow(133.2, 20.6, 0.317, 35.5, 88.9, 110.2, 20.7, 0.511),
    "Rubber mat": ScanRow(78.6, 17.8, 0.316, 29.4, 103.9, 133.2, 21.4, 0.443),
    "SP 120 grit": ScanRow(285.5, 12.6, 1.325, 12.3, 56.3, 167.4, 23.3, 0.636),
    "SP 80 grit": ScanRow(208.0, 42.3, 1.011, 16.7, 84.4, 110.7, 19.9, 0.353),
}
"""Note that the text of section V-A gives 158 Hz for the tire tread, the table 133.2 Hz."""

TABLE_2 = {
    "Jewel-case": ((1.637, 0.270), (23.31, 5.39)),
    "Tire tread": ((0.359, 0.098), (39.41, 2.81)),
    "Rubber mat": ((0.345, 0.031), (31.06, 6.14)),
    "SP 120 grit": ((1.181, 0.132), (14.43, 2.72)),
    "SP 80 grit": ((1.030, 0.066), (17.71, 3.63)),
}
"""Mean and deviation over five scans: segments per mm, order."""

TABLE_3 = {
    "Rubber mat": (
        ScanRow(91.4, 18.7, 0.373, 33.2, 91.7, 138.0, 19.1, 0.439),
        ScanRow(79.5, 18.6, 0.365, 24.9, 105.0, 134.7, 21.4, 0.624),
        ScanRow(78.6, 17.8, 0.316, 29.4, 103.9, 133.2, 21.4, 0.443),
        ScanRow(79.0, 17.2, 0.307, 27.2, 105.8, 139.3, 25.3, 0.477),
        ScanRow(86.9, 17.5, 0.366, 40.6, 92.9, 147.9, 17.5, 0.525),
    ),
    "SP 80 grit": (
        ScanRow(190.6, 25.9, 0.992, 13.5, 89.9, 168.1, 22.6, 0.187),
        ScanRow(208.0, 42.3, 1.011, 16.7, 84.4, 110.7, 19.9, 0.353),
        ScanRow(286.7, 49.4, 1.146, 20.1, 76.9, 112.9, 15.1, 0.385),
        ScanRow(197.3, 32.9, 0.985, 22.6, 75.2, 95.8, 15.1, 0.344),
        ScanRow(217.5, 24.4, 1.014, 15.7, 82.3, 125.5, 21.1, 0.143),
    ),
}

LAWS = {
    "Rubber mat": LevelLaw(k_v=18.5, k_c=0.117, a_0=0.435),
    "SP 80 grit": LevelLaw(k_v=19.4, k_c=1.0, a_0=0.287),
}
