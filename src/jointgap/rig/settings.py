"""Settings of reading and simulating measured runs."""

import math
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


@dataclass(frozen=True)
class SimulationSettings:
    """How accurately and for how long the motion is simulated."""

    # [m] Local error of a step. Whitened channels of loose pins with friction are then rough by some hundredths in
    # length, over all samples; 1e-9 saves a sixth of the time and is ten to thirty times as rough, so that fits do
    # not converge
    tolerance_m: float = 1e-10
    fast_tolerance_m: float = 1e-8  # [m] The same for a search, which needs the energy of impacts, not their phase
    # Most steps of a search: plain motions take 1000 to 4000. Where friction makes a journal whirl, with forces far
    # beyond any reading, there are ten times as many. With 6000 the truth itself was given up from some starts in
    # four of seven trials with a hidden clearance, three of them of 2 um, in which journals stick and chatter
    fast_steps_per_revolution: int = 12_000
    # [m] The same where a joint is lubricated: films are stiff, so that steps are short anyway, and thin; 1e-11
    # costs no more
    film_tolerance_m: float = 1e-11
    # Revolutions simulated before the first sample, so that the transient of the start decays in contacts with
    # restitution
    settling_revolutions: int = 2
    # The most, for slow transients (a bending rod, a motor): a guard against simulations without end
    max_settling_revolutions: int = 30
    settling_time_constants: float = 7.0  # [1] Length of a slow transient: exp(-7) is a thousandth
    # [1] A revolution stands for all later ones if what is read changed by less than this from the one before it,
    # and is less than this away from what the last two changes tend to: lengths, over all samples and channels,
    # over the noise. A parameter is then off by a standard error at most, and by much less as a rule, for each
    # change is a small part of the one before
    settled_length: float = 1.0
    # Least and most revolutions dropped before the one that is kept, the least at least two; never fewer than are
    # simulated before the first sample. After three or four most motions of loose pins have settled; with a loose
    # crank pivot some take ten. What has not settled after the most is simulated as long as the record, from there
    settled_after: tuple[int, int] = (3, 12)
    # The same for a search. A third of the points of two searches did not settle and took 52 and 60 % of the time
    # with twelve revolutions dropped; of those that did, 87 and 92 % did so with six. The record is simulated from
    # there all the same: in 234 such points of a loose mechanism the features of the truth were not met in 36 % by
    # the last revolution alone, in 26 % by the record, each by the numerics of the search
    fast_settled_after: tuple[int, int] = (3, 6)
    # Samples of a revolution by which it is compared with the one before, spread over the crank angle: each costs
    # about as much as a step. Of 33 drawn rigs all settled in as many revolutions as by all samples
    compared_samples: int = 120
    # [1, of the noise] As `settled_length`, in a search, for the root of the mean square of the changes: less
    # hardly changes the energy of a residual beside that of the noise
    fast_settled: float = 0.3
    # [revolutions] How much earlier the motion begins for each further start: one, and the part of the next that
    # meets no symmetry of a slider-crank (the golden section), so that starts lie evenly over the crank angle
    other_start_revolutions: float = 1.382
    # [revolutions] From which they count from the usual start on again: motions that repeat after two revolutions
    # come in two phases
    most_start_revolutions: float = 2.0
    # From so many starts the motion of a run is simulated of which nobody knows where it began. In blind trials a
    # motion that lasts came from one start in two to one in five
    starts: int = 8
    # A record that begins earlier than this after the start is simulated in full: its user wants to see how the
    # motion settles
    transient_revolutions: float = 1.5
    # Samples through which a motor's angle over time is a cubic spline: six degrees of a motion with a flywheel's
    # inertia
    motor_samples_per_revolution: int = 60
    # [rad/s] Speed that stands for rest, at which a drive that is parametrised by the crank angle cannot start
    rest_speed_rad_s: float = 1e-3


@dataclass(frozen=True)
class SensorSettings:
    """Filters and lags of sensors."""

    # Samples per period of a low-pass filter's corner frequency: the frequencies that the digital filter warps lie
    # above the corner then, where little passes
    samples_per_corner_period: float = 10.0
    # Samples of a revolution, at least, on which filters and lags are computed: half a degree, short of most
    # impacts' ringing
    samples_per_revolution: int = 720
    # Revolutions before and after the samples that filters and lags see, for their transients to decay
    padding_revolutions: float = 0.25


@dataclass(frozen=True)
class SampleGridSettings:
    """Where samples lie in time and crank angle, as far as the record tells, and what is planned without one."""

    # A run yet to be measured. Four cycles tell what repeats from what does not; 120 samples resolve the orders
    # that effects have
    planned_revolutions: int = 4
    # A run yet to be measured. Four cycles tell what repeats from what does not; 120 samples resolve the orders
    # that effects have
    planned_samples_per_revolution: int = 120
    # Of a chaotic run that is planned as long as it was recorded: beyond, the simulated cycles limit what is told
    max_planned_revolutions: int = 60
    # [1, of the crank's speed] Frequency of a force that swings by itself, before data tell it: near no harmonic of
    # the crank
    planned_force_order: float = 1.37
    # [1, robust standard deviations] A reading of the crank angle farther from its straight line is an outlier;
    # usual
    outlier_standard_deviations: float = 5.0
    # [rad] Angles without times that keep this near a line over their rows were sampled evenly in time
    even_rows_rad: float = math.radians(0.5)
    # [1] An estimated speed or phase may be off by this many standard errors: bounds that no fit should meet
    reach_standard_errors: float = 5.0
    # [1] Standard errors are larger by this than those of independent readings: errors of an encoder repeat
    # (experience)
    error_inflation: float = 2.0
    # Orders of the Fourier series whose misfit tells the speed of a crank without encoder: what is smooth in a
    # slider-crank's motion
    speed_harmonics: int = 6
    # [revolutions over the whole record] Between the speeds tried: an eighth of the period of the sixth harmonic
    speed_step_revolutions: float = 0.02
    # Crank angles per revolution at which an unknown first angle is tried: half a degree; the fit goes on from
    # there
    first_angles_tried: int = 720
    # [1, of the scatter by rounding alone] Up to this scatter of its readings an encoder's step tells how smooth a
    # driving angle is; beyond, a spline that keeps to the step would follow noise
    hardly_noisy: float = 1.15


@dataclass(frozen=True)
class NuisanceSettings:
    """Nuisances as parameters of a fit."""

    # [1] Typical change of a nuisance, as a share of the width of its bounds (experience)
    step_share_of_bounds: float = 0.02
    # [1] Friction may be regularised over a sliding speed lower or higher by this factor than the contact says:
    # nobody measures it
    friction_speed_factor: float = 4.0
    # [1] A contact that lasts may be damped less or more by this factor than it says. Nobody measures it; the last
    # impacts before pins stay in contact, whose damping the published laws keep, come at 0.02 to 0.22 m/s beside
    # the 0.05 m/s of the default
    lasting_damping_factor: float = 4.0
    # [rad] A first angle found by a search may be off by this: 30 deg, for the model as it stands may lack an
    # effect
    first_angle_reach_rad: float = math.pi / 6


@dataclass(frozen=True)
class ChaosSettings:
    """When a channel is chaotic, and how many cycles are simulated then."""

    start_distance_m: float = 1e-7  # [m] Between the two starts whose motions are compared: far below any clearance
    # [1] Samples are compared while the two motions differ by less than this share of the noise; then they add 4 %
    # to its standard deviation
    max_departure_share_of_noise: float = 0.3
    unstated_noise_share: float = 0.02  # [1, of a channel's standard deviation] Noise where it is not stated
    # [m] Local error of a step: from 1e-11 to 1e-7 statistics do not depend on it beyond their scatter, and 1e-9
    # saves a quarter to a half of the time that 1e-10 takes
    tolerance_m: float = 1e-9
    # Simulated in every evaluation, and once to learn how statistics scatter. 180 cycles tell a variance within 10
    # % (experience)
    cycles: int = 18
    # Simulated in every evaluation, and once to learn how statistics scatter. 180 cycles tell a variance within 10
    # % (experience)
    learning_cycles: int = 180
    # Cycles of one simulation that count, and those before that do not. Several short simulations run in parallel
    cycles_per_simulation: int = 9
    # Cycles of one simulation that count, and those before that do not. Several short simulations run in parallel
    settling_cycles: int = 1
    # Cycles of one simulation to learn from: slow changes make a record's mean less sure than its cycles' scatter
    # tells
    remembered_cycles: int = 30
    # Samples of a simulated revolution, at least: what lies between the record's makes a mean surer
    samples_per_revolution: int = 320
    prior_cycles: int = 60  # The simulated scatter counts as much as this many measured cycles (experience)
    # Measured cycles from which on their own scatter is looked at: two tell no variance worth the name
    min_scatter_cycles: int = 3


@dataclass(frozen=True)
class CycleStatisticsSettings:
    """Statistics of chaotic channels over the crank angle's cycles."""

    bins: int = 24  # Bins of the crank angle: 15 deg, as long as a contact's ringing at usual speeds (experience)
    median_angles: int = 144  # Angles of the median course, six in a bin: the course turns little between them
    # [1, mean sizes of a deviation] Scale k of the compression k tanh(u / k): rare spikes would hold nearly all of
    # a mean's scatter
    compression_mean_sizes: float = 3.0
    predicting_bins: int = 2  # Bins before one from which it is predicted: contacts ring no longer (experience)
    # [1, of a bin] Within it a sample lies on its edge and counts for the bin that begins, whichever way it was
    # rounded
    edge_share_of_bin: float = 1e-6


@dataclass(frozen=True)
class SliderCrankSettings:
    """All tuned numbers of the slider-crank model and of the recordings that it is compared with."""

    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    sample_grid: SampleGridSettings = field(default_factory=SampleGridSettings)
    nuisances: NuisanceSettings = field(default_factory=NuisanceSettings)
    chaos: ChaosSettings = field(default_factory=ChaosSettings)
    statistics: CycleStatisticsSettings = field(default_factory=CycleStatisticsSettings)
    recordings: RecordingLimits = field(default_factory=RecordingLimits)


DEFAULT_SETTINGS = SliderCrankSettings()
