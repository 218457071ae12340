"""The tuned numbers of the slider-crank model, by subject: what each means, its unit, and why it has this value.

"(experience)" marks those that were set by what worked on development trials; nothing is derived there. A model carries
its settings (`SliderCrankModel.settings`), so that trials can vary them:
``build_model(campaign, measurements, settings=replace(DEFAULT_SETTINGS, chaos=replace(DEFAULT_SETTINGS.chaos,
prior_cycles=30)))``.
"""

import math
from dataclasses import dataclass, field

from jointgap.recordings.limits import RecordingLimits


@dataclass(frozen=True)
class SimulationSettings:
    """How accurately and for how long the motion is simulated.

    Attributes
    ----------
    tolerance_m : float
        [m] Local error of a step. Whitened channels of loose pins with friction are then rough by some hundredths in
        length, over all samples; 1e-9 saves a sixth of the time and is ten to thirty times as rough, so that fits do
        not converge.
    fast_tolerance_m : float
        [m] The same for a search, which needs the energy of impacts, not their phase.
    fast_steps_per_revolution : int
        Most steps of a search: plain motions take 1000 to 4000. Where friction makes a journal whirl, with forces far
        beyond any reading, there are ten times as many. With 6000 the truth itself was given up from some starts in
        four of seven trials with a hidden clearance, three of them of 2 um, in which journals stick and chatter.
    film_tolerance_m : float
        [m] The same where a joint is lubricated: films are stiff, so that steps are short anyway, and thin; 1e-11 costs
        no more.
    settling_revolutions : int
        Revolutions simulated before the first sample, so that the transient of the start decays in contacts with
        restitution.
    max_settling_revolutions : int
        The most, for slow transients (a bending rod, a motor): a guard against simulations without end.
    settling_time_constants : float
        [1] Length of a slow transient: exp(-7) is a thousandth.
    settled_length : float
        [1] A revolution stands for all later ones if what is read changed by less than this from the one before it, and
        is less than this away from what the last two changes tend to: lengths, over all samples and channels, over the
        noise. A parameter is then off by a standard error at most, and by much less as a rule, for each change is a
        small part of the one before.
    settled_after : tuple of two int
        Least and most revolutions dropped before the one that is kept, the least at least two; never fewer than are
        simulated before the first sample. After three or four most motions of loose pins have settled; with a loose
        crank pivot some take ten. What has not settled after the most is simulated as long as the record, from there.
    fast_settled_after : tuple of two int
        The same for a search. A third of the points of two searches did not settle and took 52 and 60 % of the time
        with twelve revolutions dropped; of those that did, 87 and 92 % did so with six. The record is simulated from
        there all the same: in 234 such points of a loose mechanism the features of the truth were not met in 36 % by
        the last revolution alone, in 26 % by the record, each by the numerics of the search.
    compared_samples : int
        Samples of a revolution by which it is compared with the one before, spread over the crank angle: each costs
        about as much as a step. Of 33 drawn rigs all settled in as many revolutions as by all samples.
    fast_settled : float
        [1, of the noise] As `settled_length`, in a search, for the root of the mean square of the changes: less
        hardly changes the energy of a residual beside that of the noise.
    other_start_revolutions : float
        [revolutions] How much earlier the motion begins for each further start: one, and the part of the next that
        meets no symmetry of a slider-crank (the golden section), so that starts lie evenly over the crank angle.
    most_start_revolutions : float
        [revolutions] From which they count from the usual start on again: motions that repeat after two revolutions
        come in two phases.
    starts : int
        From so many starts the motion of a run is simulated of which nobody knows where it began. In blind trials a
        motion that lasts came from one start in two to one in five.
    transient_revolutions : float
        A record that begins earlier than this after the start is simulated in full: its user wants to see how the
        motion settles.
    motor_samples_per_revolution : int
        Samples through which a motor's angle over time is a cubic spline: six degrees of a motion with a flywheel's
        inertia.
    rest_speed_rad_s : float
        [rad/s] Speed that stands for rest, at which a drive that is parametrised by the crank angle cannot start.
    """

    tolerance_m: float = 1e-10
    fast_tolerance_m: float = 1e-8
    fast_steps_per_revolution: int = 12_000
    film_tolerance_m: float = 1e-11
    settling_revolutions: int = 2
    max_settling_revolutions: int = 30
    settling_time_constants: float = 7.0
    settled_length: float = 1.0
    settled_after: tuple[int, int] = (3, 12)
    fast_settled_after: tuple[int, int] = (3, 6)
    compared_samples: int = 120
    fast_settled: float = 0.3
    other_start_revolutions: float = 1.382
    most_start_revolutions: float = 2.0
    starts: int = 8
    transient_revolutions: float = 1.5
    motor_samples_per_revolution: int = 60
    rest_speed_rad_s: float = 1e-3


@dataclass(frozen=True)
class SensorSettings:
    """Filters and lags of sensors.

    Attributes
    ----------
    samples_per_corner_period : float
        Samples per period of a low-pass filter's corner frequency: the frequencies that the
        digital filter warps lie above the corner then, where little passes.
    samples_per_revolution : int
        Samples of a revolution, at least, on which filters and lags are computed: half a degree, short of most impacts'
        ringing.
    padding_revolutions : float
        Revolutions before and after the samples that filters and lags see, for their transients to decay.
    """

    samples_per_corner_period: float = 10.0
    samples_per_revolution: int = 720
    padding_revolutions: float = 0.25


@dataclass(frozen=True)
class SampleGridSettings:
    """Where samples lie in time and crank angle, as far as the record tells, and what is planned without one.

    Attributes
    ----------
    planned_revolutions, planned_samples_per_revolution : int
        A run yet to be measured. Four cycles tell what repeats from what does not; 120 samples resolve the orders that
        effects have.
    max_planned_revolutions : int
        Of a chaotic run that is planned as long as it was recorded: beyond, the simulated cycles limit what is told.
    planned_force_order : float
        [1, of the crank's speed] Frequency of a force that swings by itself, before data tell it: near no harmonic of
        the crank.
    outlier_standard_deviations : float
        [1, robust standard deviations] A reading of the crank angle farther from its straight line is an outlier;
        usual.
    even_rows_rad : float
        [rad] Angles without times that keep this near a line over their rows were sampled evenly in time.
    reach_standard_errors : float
        [1] An estimated speed or phase may be off by this many standard errors: bounds that no fit should meet.
    error_inflation : float
        [1] Standard errors are larger by this than those of independent readings: errors of an encoder repeat
        (experience).
    speed_harmonics : int
        Orders of the Fourier series whose misfit tells the speed of a crank without encoder: what is smooth in a
        slider-crank's motion.
    speed_step_revolutions : float
        [revolutions over the whole record] Between the speeds tried: an eighth of the period of the sixth harmonic.
    first_angles_tried : int
        Crank angles per revolution at which an unknown first angle is tried: half a degree; the fit goes on from there.
    hardly_noisy : float
        [1, of the scatter by rounding alone] Up to this scatter of its readings an encoder's step tells how smooth a
        driving angle is; beyond, a spline that keeps to the step would follow noise.
    """

    planned_revolutions: int = 4
    planned_samples_per_revolution: int = 120
    max_planned_revolutions: int = 60
    planned_force_order: float = 1.37
    outlier_standard_deviations: float = 5.0
    even_rows_rad: float = math.radians(0.5)
    reach_standard_errors: float = 5.0
    error_inflation: float = 2.0
    speed_harmonics: int = 6
    speed_step_revolutions: float = 0.02
    first_angles_tried: int = 720
    hardly_noisy: float = 1.15


@dataclass(frozen=True)
class NuisanceSettings:
    """Nuisances as parameters of a fit.

    Attributes
    ----------
    step_share_of_bounds : float
        [1] Typical change of a nuisance, as a share of the width of its bounds (experience).
    friction_speed_factor : float
        [1] Friction may be regularised over a sliding speed lower or higher by this factor than the contact says:
        nobody measures it.
    lasting_damping_factor : float
        [1] A contact that lasts may be damped less or more by this factor than it says. Nobody measures it; the last
        impacts before pins stay in contact, whose damping the published laws keep, come at 0.02 to 0.22 m/s beside
        the 0.05 m/s of the default.
    first_angle_reach_rad : float
        [rad] A first angle found by a search may be off by this: 30 deg, for the model as it stands may lack an effect.
    """

    step_share_of_bounds: float = 0.02
    friction_speed_factor: float = 4.0
    lasting_damping_factor: float = 4.0
    first_angle_reach_rad: float = math.pi / 6


@dataclass(frozen=True)
class ChaosSettings:
    """When a channel is chaotic, and how many cycles are simulated then.

    Attributes
    ----------
    start_distance_m : float
        [m] Between the two starts whose motions are compared: far below any clearance.
    max_departure_share_of_noise : float
        [1] Samples are compared while the two motions differ by less than this share of the noise; then they add 4 % to
        its standard deviation.
    unstated_noise_share : float
        [1, of a channel's standard deviation] Noise where it is not stated.
    tolerance_m : float
        [m] Local error of a step: from 1e-11 to 1e-7 statistics do not depend on it beyond their scatter, and 1e-9
        saves a quarter to a half of the time that 1e-10 takes.
    cycles, learning_cycles : int
        Simulated in every evaluation, and once to learn how statistics scatter. 180 cycles tell a variance within 10 %
        (experience).
    cycles_per_simulation, settling_cycles : int
        Cycles of one simulation that count, and those before that do not. Several short simulations run in parallel.
    remembered_cycles : int
        Cycles of one simulation to learn from: slow changes make a record's mean less sure than its cycles' scatter
        tells.
    samples_per_revolution : int
        Samples of a simulated revolution, at least: what lies between the record's makes a mean surer.
    prior_cycles : int
        The simulated scatter counts as much as this many measured cycles (experience).
    min_scatter_cycles : int
        Measured cycles from which on their own scatter is looked at: two tell no variance worth the name.
    """

    start_distance_m: float = 1e-7
    max_departure_share_of_noise: float = 0.3
    unstated_noise_share: float = 0.02
    tolerance_m: float = 1e-9
    cycles: int = 18
    learning_cycles: int = 180
    cycles_per_simulation: int = 9
    settling_cycles: int = 1
    remembered_cycles: int = 30
    samples_per_revolution: int = 320
    prior_cycles: int = 60
    min_scatter_cycles: int = 3


@dataclass(frozen=True)
class CycleStatisticsSettings:
    """Statistics of chaotic channels over the crank angle's cycles.

    Attributes
    ----------
    bins : int
        Bins of the crank angle: 15 deg, as long as a contact's ringing at usual speeds (experience).
    median_angles : int
        Angles of the median course, six in a bin: the course turns little between them.
    compression_mean_sizes : float
        [1, mean sizes of a deviation] Scale k of the compression k tanh(u / k): rare spikes would hold nearly all of a
        mean's scatter.
    predicting_bins : int
        Bins before one from which it is predicted: contacts ring no longer (experience).
    edge_share_of_bin : float
        [1, of a bin] Within it a sample lies on its edge and counts for the bin that begins, whichever way it was
        rounded.
    """

    bins: int = 24
    median_angles: int = 144
    compression_mean_sizes: float = 3.0
    predicting_bins: int = 2
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
