"""Settings of the segmentation into phases: thresholds and durations."""

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

Contents = Literal["taps and strokes", "taps"]


@dataclass(frozen=True, kw_only=True)
class PhaseSettings:
    """Settings of `find_phases`; the defaults suit a hand-held tool.

    Durations are in s. Ratios are ratios of power to noise power.

    Attributes
    ----------
    contents
        Content of the recordings: "taps and strokes", or "taps" (only taps, in any number).
    tap_spacing_s
        Impulses that are less than this time apart are one tap and its rebounds.
    rebound_db
        A tap begins with its first impulse, even if a rebound is stronger by up to this level.

    hand_hz
        Frequency in Hz below which the signal is dominated by hand motion, tremor and gravity.
    hand_s
        Longest duration of the hand's acceleration before an impact.
    bin_s
        Time resolution at which levels are computed.
    quiet_s
        Length of the quietest segment, which gives the noise floor.
    rest_s
        Shortest rest at the end of a recording; a shorter one is a turning point of the movement.
    opening_s
        An impulse within this time of the start cannot be measured, because the hand acceleration before it
        is not recorded. Vibration that lasts twice this time at the start is a stroke.
    kink_s
        Time for which the filter rings after the kink of gravity at the start or end of a fade.

    active_ratio, stroke_ratio
        Ratio of vibration to noise above which a bin is active, and above which lasting vibration is a
        stroke.
    tap_ratio
        Smallest ratio of the peak of a tap to the noise.
    prominence_db
        Smallest rise of a tap above the level before it, and smallest fall after it.
    look_back_s
        Length of the window before an impulse whose level is compared with the peak.
    window_s, share
        Length of a window, and smallest fraction of active bins in it during a stroke. During a tap, most of
        the window is quiet.
    gap_s
        Shortest rest that interrupts vibration.
    pause_s
        Time after a stroke in which all vibration, however faint, belongs to strokes and not to taps.
    range_db
        Taps are at most this level below the strongest tap. Lifting, setting down or turning the tool causes
        weaker impulses.
    clear_db, clear_s, clear_range_db
        A weaker impulse, at most `clear_range_db` below the strongest, is a tap if its level reaches
        `clear_db` and its duration is at most `clear_s`.
    lasting_db, ring_db
        An impulse below `lasting_db` is too short to be mistaken for movement. An impulse that falls by
        less than `ring_db` before other vibration starts may be the first impulse of a texture.
    strong_db
        An impulse that exceeds the 95 % quantile of the stroke levels by this level is a tap.
    first_gap_s
        Impulses that are weaker than the strokes and less than this time before them are the start of a slow
        stroke.
    echo_db, echo_s, between_s
        Vibration that is weaker than the strongest tap by `echo_db` is not movement if it is shorter than
        `echo_s` (after all taps) or `between_s` (before or between taps).
    soft_db
        Level over all bands below which an impulse is visible only in the soft band.
    pull_s, pull_db
        A soft impulse is caused by a pull of the hand if an impulse stronger by `pull_db` follows within
        `pull_s`.
    min_impulses, certain_db
        Fewer than `min_impulses` impulses, all below `certain_db`, may come from faint strokes.
    faint_ratio
        Vibration is faint if its mean ratio over `quiet_s` stays below this value.

    sharp_s, calm_s
        Averaging windows of the levels for locating a peak and for following its decay.
    rise_s
        Longest rise of an impulse: half the duration of a soft contact plus the delay of the filter.
    stall_s, stall_db
        A level that falls by less than `stall_db` within `stall_s` has stopped decaying (27 dB/s, a time
        constant of 0.33 s).
    tail_s, tail_db
        Longest tail of an impulse, and the rise in level that ends the tail.
    onset_db, width_db, decay_db
        Levels below the peak: at the start of an impulse, for measuring its width, and at its end.
    margin_s
        Time around an impulse in which the sample of its impact is located.

    rate_hz
        Sampling rate in Hz to which faster recordings are reduced by averaging.
    soft_band_hz, soft_s
        Frequency band of soft contacts, and window over which its level is averaged. The band is analysed
        separately so that noise at higher frequencies does not mask soft contacts.
    soft_margin
        Ratio of the level of the soft band to its median at rest. Hand motion does not reach this ratio.
    soft_tail
        Level that noise exceeds once in 100,000 bins: its distance in dB from the median, divided by the
        distance of the 90 % quantile from the median (2.5 to 2.9 for chi-squared powers with 5 to 20 degrees
        of freedom).
    soft_impulse
        Ratio assigned to a bin of the soft band that exceeds `soft_tail`: just above the threshold of a tap.
    unrest_ratio
        Ratio over all bands below which there is no vibration other than hand motion.
    steady_ratio, steady_samples
        The quietest segment is steady if the levels of its fifths differ by at most `steady_ratio`. With
        fewer samples than `steady_samples`, a larger ratio is allowed.
    quiet_spread, noisy_spread, noisy_contrast
        Largest ratio of the noise level to the level of the quietest segment. The second limit applies if the
        recording contains vibration above `noisy_contrast` times that level, so that intermittent noise of a
        room or machine is not detected as strokes.
    noisy_weight
        Factor for the level of strokes if the noise is intermittent.
    opening_ratio, opening_spread
        The level at the start is noise if its fifths differ by at most this ratio, and if it exceeds the
        quietest window by at most this ratio: an automatic gain lowers the noise after the first tap.

    Examples
    --------
    >>> PhaseSettings(tap_spacing_s=0.05).changes
    {'tap_spacing_s': 0.05}
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    contents: Contents = "taps and strokes"
    tap_spacing_s: float = 0.08
    rebound_db: float = 6.0

    hand_hz: float = 60.0
    hand_s: float = 0.25
    bin_s: float = 0.001
    quiet_s: float = 0.1
    rest_s: float = 0.3
    opening_s: float = 0.03
    kink_s: float = 0.01

    active_ratio: float = 2.0
    stroke_ratio: float = 1.5
    tap_ratio: float = 40.0
    prominence_db: float = 10.0
    look_back_s: float = 0.03
    window_s: float = 0.3
    share: float = 0.65
    gap_s: float = 0.03
    pause_s: float = 1.0
    range_db: float = 20.0
    clear_db: float = 30.0
    clear_s: float = 0.02
    clear_range_db: float = 32.0
    lasting_db: float = 25.0
    ring_db: float = 18.0
    strong_db: float = 6.0
    first_gap_s: float = 0.1
    echo_db: float = 22.0
    echo_s: float = 0.7
    between_s: float = 1.2
    soft_db: float = 16.0
    pull_s: float = 0.15
    pull_db: float = 6.0
    min_impulses: int = 3
    certain_db: float = 20.0
    faint_ratio: float = 30.0

    sharp_s: float = 0.003
    calm_s: float = 0.02
    rise_s: float = 0.015
    stall_s: float = 0.075
    stall_db: float = 2.0
    tail_s: float = 0.7
    tail_db: float = 6.0
    onset_db: float = 20.0
    width_db: float = 10.0
    decay_db: float = 30.0
    margin_s: float = 0.003

    rate_hz: float = 10_000.0
    soft_band_hz: tuple[float, float] = (30.0, 150.0)
    soft_s: float = 0.008
    soft_margin: float = 3.0
    soft_tail: float = 2.8
    soft_impulse: float = 50.0
    unrest_ratio: float = 1.4
    steady_ratio: float = 2.5
    steady_samples: float = 60.0
    quiet_spread: float = 1.6
    noisy_spread: float = 6.0
    noisy_contrast: float = 1000.0
    noisy_weight: float = 0.75
    opening_ratio: float = 1.5
    opening_spread: float = 10.0

    def __post_init__(self) -> None:
        if not 0 < self.tap_spacing_s < float("inf"):
            raise ValueError(f"tap_spacing_s must be positive, got {self.tap_spacing_s} s")
        if self.contents not in ("taps and strokes", "taps"):
            raise ValueError(f"contents must be 'taps and strokes' or 'taps', got {self.contents!r}")

    @property
    def changes(self) -> dict[str, Any]:
        """Settings that differ from the defaults of `PhaseSettings`."""
        values = {field.name: getattr(self, field.name) for field in fields(PhaseSettings)}
        return {name: value for name, value in values.items() if value != getattr(PhaseSettings, name)}
