"""The limits beyond which a measured file is refused or remarked upon, with meaning, unit and reason."""

from dataclasses import dataclass, field
from math import pi


@dataclass(frozen=True)
class RecordingLimits:
    """Limits that noise, steps of an encoder and impacts stay within, and mistaken units and columns do not.

    Attributes
    ----------
    min_samples : int
        A run and each of its channels need this many values: fewer tell no course over a revolution.
    max_value_si : float
        [SI] No channel has a larger value: it stands for something else, such as 'no data'.
    copied_share : float
        [1, of the samples of the shorter file] Samples of which so many are, to the last digit and in all columns, in
        another run's file too are a copy: noise leaves none alike.
    min_revolutions : float
        One, less what rounding takes off.
    min_samples_per_revolution : float
        Fewer cannot tell whether the angle rises or falls.
    speed_ratios : dict of drive to (float, float)
        [1] Mean speed over nominal speed beyond which something other than the speed is wrong; a motor may start from
        rest.
    speed_tolerance : float
        [1, of the nominal speed] So near must the speed in another unit come for the unit to be proposed.
    clipped_width : float
        [1, of the range] Samples so near to each other stand at one level: rounding keeps them apart.
    clipped_share, clipped_count : float, int
        [1, of the samples] and samples: an extreme value that occurs less often may be chance.
    clipped_excess : float
        [1] How many times as often as the next value an extreme one occurs where it is clipped; a sine's rounded crest
        has 1.4.
    no_data_count, no_data_ranges : int, float
        samples and [1]: an extreme value that occurs so often, and is farther from the next one than so many times the
        range of all others, stands for 'no data'.
    stuck_count, stuck_excess : int, float
        samples and [1]: a sensor that reads one value for so many samples in a row, and for so many times as long as
        any other value, is stuck; a quantised sine stands about as long at its crest as in its trough.
    stuck_turn_rad : float
        [rad] So far has the crank to turn meanwhile: with the crank at rest all stands still.
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
    standstill_window_rad, standstill_share : float
        [rad] and [1, of the nominal speed]: a crank that is slower for as long as it takes to turn so far at the
        nominal speed stands still; one whose speed falls to 5 % once a turn is faster on the mean.
    turned_back_share : float
        [1, of the nominal speed] So fast it turns again, or back; slower, noise may be all of it.
    turning_share : float
        [1, of the record] At least so long the crank turns at about its nominal speed: otherwise units are wrong.
    compared_orders : int
        [1] Orders of the crank that are held against the ideal motion: beyond the fourth a slider-crank has hardly any.
    steady_speed : float
        [1, of the mean] Standard deviation of the speed over quarter turns from which on the motion is not compared
        with that of a steady crank.
    speed_doubted : float
        [1] Ratio of the speed that the times make and the stated one from which on one of both is doubted; speeds of
        rigs are stated to some percent.
    same_agreement : float
        [1] Share of the best agreement that the stated speed has to reach where no encoder tells the speed.
    least_agreement : float
        [1, of the variance] What the ideal motion has to explain at another speed than stated: noise and impacts leave
        less, and say nothing of the speed.
    order_of_a_load : float
        [1, orders of the crank] So far from whole orders of the stated speed must forces repeat to say that it is
        wrong: half of what a record of few turns tells apart.
    searched_speed_ratios : (float, float)
        [1, of the stated speed] Where a speed is searched for without an encoder: short of half and double the speed,
        at which one order of the crank is taken for another.
    searched_turns : float
        [1] Turns in which a speed is searched for: more would take time with the square of their number.
    clear_error : float
        [1, of the orders] Standard error from which on low orders say nothing: impacts hide them.
    least_phase_rad : float
        [rad] An encoder that is off by less is left to the analysis, which names it.
    force_correlation : float
        [1] As `comparable_correlation`, of torque and forces: an effect five times the noise leaves this much.
    gains_of_forces : (float, float)
        [1] As `gains`, of torque and forces, which masses and loads change too.
    alike_factors : float
        [1] Largest ratio of a channel's factors in different runs where a sensor is the cause: that of a load goes with
        the inverse square of the speed.
    apart_speeds : float
        [1] Ratio of the fastest run to the slowest from which on a load that turns the sign of a force breaks
        `alike_factors`, even if it grows in proportion to the speed.
    share_of_usual : float
        [1] Below this share of what is expected a channel of one run is not of that run.
    repeating_share, stray_share : float
        [1, of the variance] What a channel repeats with the crank at least, and at most where it is of another run.
    same_samples : float
        [1] Correlation, sample by sample, from which on a channel is that of another run: noise of its own leaves less.
    least_stray_turns : float
        [1] A channel of another run has to repeat so often to be told by it.
    swapped_misfit : float
        [1, of what is expected] Both channels have to be off by more to be called swapped.
    exchanged_misfit, exchanged_force_misfit : float
        [1] And by less with their columns exchanged; of torque and forces loads are in it.
    swapped_gain, swapped_gain_of_forces : float
        [1] And both together by this share of what they were.
    """

    min_samples: int = 12
    max_value_si: float = 1e12
    copied_share: float = 0.9
    min_revolutions: float = 1.0 - 1e-3
    min_samples_per_revolution: float = 4.0
    speed_ratios: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {"constant_speed": (0.5, 1.5), "measured_angle": (0.5, 1.5), "motor": (0.2, 5.0)}
    )
    speed_tolerance: float = 0.2
    clipped_width: float = 1e-9
    clipped_share: float = 0.01
    clipped_count: int = 5
    clipped_excess: float = 6.0
    no_data_count: int = 2
    no_data_ranges: float = 10.0
    stuck_count: int = 10
    stuck_excess: float = 8.0
    stuck_turn_rad: float = 0.1
    outlier_interquartile_ranges: float = 300.0
    angle_outlier_rad: float = 0.1
    angle_outlier_medians: float = 15.0
    comparable_correlation: float = 0.9
    unrelated_correlation: float = 0.5
    gains: tuple[float, float] = (0.8, 1.25)
    unit_tolerance: float = 0.05
    unsteady_share: float = 0.01
    unsteady_standard_errors: float = 5.0
    standstill_window_rad: float = 0.25 * pi
    standstill_share: float = 0.02
    turned_back_share: float = 0.1
    turning_share: float = 0.1
    compared_orders: int = 4
    steady_speed: float = 0.15
    speed_doubted: float = 1.1
    same_agreement: float = 0.6
    least_agreement: float = 0.5
    order_of_a_load: float = 0.15
    searched_speed_ratios: tuple[float, float] = (0.53, 1.9)
    searched_turns: float = 20.0
    clear_error: float = 0.25
    least_phase_rad: float = 0.5
    force_correlation: float = 0.8
    gains_of_forces: tuple[float, float] = (0.5, 2.0)
    alike_factors: float = 1.35
    apart_speeds: float = 1.35
    share_of_usual: float = 0.4
    repeating_share: float = 0.7
    stray_share: float = 0.5
    same_samples: float = 0.99
    least_stray_turns: float = 2.0
    swapped_misfit: float = 0.15
    exchanged_misfit: float = 0.15
    exchanged_force_misfit: float = 0.7
    swapped_gain: float = 0.3
    swapped_gain_of_forces: float = 0.5


DEFAULT_LIMITS = RecordingLimits()
