"""The limits beyond which a measured file is refused or remarked upon, with meaning, unit and reason."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class RecordingLimits:
    """Limits that noise, steps of an encoder and impacts stay within, and mistaken units and columns do not.

    Attributes
    ----------
    min_samples : int
        A run and each of its channels need this many values: fewer tell no course over a revolution.
    max_value_si : float
        [SI] No channel has a larger value: it stands for something else, such as 'no data'.
    min_revolutions : float
        One, less what rounding takes off.
    min_samples_per_revolution : float
        Fewer cannot tell whether the angle rises or falls.
    speed_ratios : dict of drive to (float, float)
        [1] Mean speed over nominal speed beyond which something other than the speed is wrong; a motor may start from
        rest.
    speed_tolerance : float
        [1, of the nominal speed] So near must the speed in another unit come for the unit to be proposed.
    clipped_share, clipped_count : float, int
        [1, of the samples] and samples: an extreme value that occurs less often may be chance.
    clipped_excess : float
        [1] How many times as often as the next value an extreme one occurs where it is clipped; a sine's rounded crest
        has 1.4.
    outlier_interquartile_ranges : float
        [1] A value farther from the median is doubted; impacts come some ten times less far.
    angle_outlier_rad : float
        [rad] A crank angle that misses the line between its neighbours by more is doubted; an encoder's noise is far
        smaller.
    angle_outlier_medians : float
        [1, median distances] It has to miss by this much more than usual too: coarse encoders miss by a step
        everywhere.
    comparable_correlation : float
        [1] From this correlation on a factor between two channels means something.
    unrelated_correlation : float
        [1] Below it a channel is not what it is said to be.
    gains : (float, float)
        [1] Factors that a sensor's gain may have: these the analysis names.
    unit_tolerance : float
        [1] So near must a ratio of units come for the unit to be proposed.
    unsteady_share : float
        [1, of the mean speed] A crank whose speed varies by less either way turns steadily enough for constant_speed.
    unsteady_standard_errors : float
        [1] By so many standard errors must the speed vary for it to be the crank's, not the encoder's.
    max_kurtosis : float
        [1] From it on samples say little of what was between them; a normal distribution has 3, a sine 1.5.
    """

    min_samples: int = 12
    max_value_si: float = 1e12
    min_revolutions: float = 1.0 - 1e-3
    min_samples_per_revolution: float = 4.0
    speed_ratios: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {"constant_speed": (0.5, 1.5), "measured_angle": (0.5, 1.5), "motor": (0.2, 5.0)}
    )
    speed_tolerance: float = 0.2
    clipped_share: float = 0.01
    clipped_count: int = 5
    clipped_excess: float = 6.0
    outlier_interquartile_ranges: float = 300.0
    angle_outlier_rad: float = 0.1
    angle_outlier_medians: float = 15.0
    comparable_correlation: float = 0.9
    unrelated_correlation: float = 0.5
    gains: tuple[float, float] = (0.8, 1.25)
    unit_tolerance: float = 0.05
    unsteady_share: float = 0.01
    unsteady_standard_errors: float = 5.0
    max_kurtosis: float = 10.0


DEFAULT_LIMITS = RecordingLimits()
