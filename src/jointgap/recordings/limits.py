"""The limits beyond which a measured file is refused or remarked upon, with meaning, unit and reason."""

from dataclasses import dataclass, field
from math import pi


@dataclass(frozen=True)
class RecordingLimits:
    """Limits that noise, steps of an encoder and impacts stay within, and mistaken units and columns do not."""

    min_samples: int = 12  # A run and each of its channels need this many values
    max_value_si: float = 1e12  # [SI] No channel has a larger value: it stands for something else, such as 'no data'
    copied_share: float = 0.9
    min_revolutions: float = 1.0 - 1e-3  # One, less what rounding takes off
    min_samples_per_revolution: float = 4.0  # Fewer cannot tell whether the angle rises or falls
    speed_ratios: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {"constant_speed": (0.5, 1.5), "measured_angle": (0.5, 1.5), "motor": (0.2, 5.0)}
    )  # [1] Mean speed over nominal speed beyond which something other than the speed is wrong
    speed_tolerance: float = 0.2
    clipped_width: float = 1e-9  # [1, of the range] Samples so near to each other stand at one level
    clipped_share: float = 0.01  # [1, of the samples] and samples
    clipped_count: int = 5  # [1, of the samples] and samples: an extreme value that occurs less often may be chance
    clipped_excess: float = 6.0
    no_data_count: int = 2  # samples and [1]
    no_data_ranges: float = 10.0  # samples and [1]
    stuck_count: int = 10  # samples and [1]
    stuck_excess: float = 8.0  # samples and [1]
    stuck_turn_rad: float = 0.1  # [rad] So far has the crank to turn meanwhile: with the crank at rest all stands still
    outlier_interquartile_ranges: float = 300.0  # [1] A value farther from the median is doubted
    angle_outlier_rad: float = 0.1  # [rad] A crank angle that misses the line between its neighbours by more is doubted
    angle_outlier_medians: float = 15.0  # [1, median distances] It has to miss by this much more than usual too
    comparable_correlation: float = 0.9  # [1] From this correlation on a factor between two channels means something
    unrelated_correlation: float = 0.5  # [1] Below it a channel is not what it is said to be
    gains: tuple[float, float] = (0.8, 1.25)  # [1] Factors that a sensor's gain may have: these the analysis names
    unit_tolerance: float = 0.05  # [1] So near must a ratio of units come for the unit to be proposed
    unsteady_share: float = 0.01
    unsteady_standard_errors: float = 5.0
    standstill_window_rad: float = 0.25 * pi  # [rad] and [1, of the nominal speed]
    standstill_share: float = 0.02  # [rad] and [1, of the nominal speed]
    turned_back_share: float = 0.1  # [1, of the nominal speed] So fast it turns again, or back
    turning_share: float = 0.1  # [1, of the record] At least so long the crank turns at about its nominal speed
    compared_orders: int = 4  # [1] Orders of the crank that are held against the ideal motion
    steady_speed: float = 0.15
    speed_doubted: float = 1.1
    same_agreement: float = 0.6
    least_agreement: float = 0.5
    order_of_a_load: float = 0.15
    searched_speed_ratios: tuple[float, float] = (0.53, 1.9)
    searched_turns: float = 20.0  # [1] Turns in which a speed is searched for
    clear_error: float = 0.25  # [1, of the orders] Standard error from which on low orders say nothing
    least_phase_rad: float = 0.5  # [rad] An encoder that is off by less is left to the analysis, which names it
    force_correlation: float = 0.8  # [1] As `comparable_correlation`, of torque and forces
    gains_of_forces: tuple[float, float] = (0.5, 2.0)
    alike_factors: float = 1.35
    apart_speeds: float = 1.35
    share_of_usual: float = 0.4  # [1] Below this share of what is expected a channel of one run is not of that run
    repeating_share: float = 0.7
    stray_share: float = 0.5
    same_samples: float = 0.99  # [1] Correlation, sample by sample, from which on a channel is that of another run
    least_stray_turns: float = 2.0  # [1] A channel of another run has to repeat so often to be told by it
    swapped_misfit: float = 0.15  # [1, of what is expected] Both channels have to be off by more to be called swapped
    exchanged_misfit: float = 0.15  # [1] And by less with their columns exchanged; of torque and forces loads are in it
    exchanged_force_misfit: float = 0.7  # [1] And by less with their columns exchanged
    swapped_gain: float = 0.3  # [1] And both together by this share of what they were
    swapped_gain_of_forces: float = 0.5  # [1] And both together by this share of what they were


DEFAULT_LIMITS = RecordingLimits()
