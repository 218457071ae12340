"""Settings of the identification by subject, with unit and reason.

"(experience)": chosen on development trials with a hidden effect, not derived. `Problem.settings`
can be varied:
``replace(DEFAULT_SETTINGS, stopping=replace(DEFAULT_SETTINGS.stopping, max_steps=40))``.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class FiniteDifferenceSettings:
    """Steps of the derivatives of the whitened residuals.

    Lengths are Euclidean norms of the change of all whitened residuals, in standard deviations of
    the noise.
    """

    # [1] Target change over one step, about five standard errors of the parameter: a compromise
    # between numerical noise of impacts and curvature (experience)
    target_length: float = 5.0
    # [1] Least target over the norm of the residual, as the residual is nonsmooth far from the
    # solution; with much larger shares the fit of a film does not converge (experience)
    target_share_of_residual: float = 0.05
    # [1] Least target over the root of the number of statistics, each of which scatters by about 1
    target_per_statistic: float = 1.5
    # [1] Least target over the numerical noise: errors of derivatives up to a fifth
    target_over_numerical_noise: float = 5.0
    # [1, of a parameter's step] Change of the parameters of linearised equations, which have no
    # numerical noise
    linearised_step: float = 1e-5
    probe_step: float = 1e-6  # [1, of a parameter's step] Change that only causes numerical noise
    probed_parameters: int = (
        2  # Parameters changed so; the largest change counts, as one may not influence contacts
    )
    accepted_factor: float = 4.0  # [1] Tolerated factor between change and target
    min_step_ratio: float = 1e-4  # [1] Largest shortening of a step at once
    max_step_ratio: float = 1e4  # [1] Largest lengthening of a step at once
    min_step_change: float = (
        1.5  # [1] Least factor between old and new step for a further simulation
    )
    # [1] A parameter with a smaller change of all residuals over its range is inactive
    negligible_change: float = 0.01
    # [1] Largest step over a parameter's range, so that one direction is always within bounds
    max_share_of_range: float = 0.5


@dataclass(frozen=True)
class DampingSettings:
    """Levenberg-Marquardt damping.

    The gain ratio is the measured over the predicted decrease of chi2.
    """

    trusted_gain_ratio: float = 0.5  # [1] Above, the Jacobian may be used to declare convergence
    # [1] Above, damping is reduced; below, the Jacobian is recomputed or damping is increased
    # (Fletcher 1971)
    good_gain_ratio: float = 0.25
    factor: float = 10.0  # [1] Of an increase or reduction (Marquardt 1963)
    first: float = 1e-3  # [1, of the squared column lengths] Damping after the first bad step
    negligible: float = 1e-4  # [1] Damping up to this becomes 0 at the next good step
    # [1] With more damping a missing decrease is numerical noise: the fit stops without convergence
    rough: float = 10.0


@dataclass(frozen=True)
class StoppingSettings:
    """End of a fit."""

    # [chi2] Least predicted decrease for a step: 1/200 of the BIC limit, so that parameters are
    # within 0.22 standard errors of the minimum. It increases with the square of chi2 per sample,
    # up to chi2 per sample
    min_decrease: float = 0.05
    max_steps: int = 80  # Only a safeguard (experience)
    max_renewals: int = 6  # New Jacobians of a fit with effects with loose joints (experience)
    stalled_window: int = 4  # Steps over which progress is measured
    # [1] Above, a fit is poor and ends if it improves by less than `poor_progress` in the window
    poor_chi2_per_sample: float = 2.0
    poor_progress: float = 0.02  # [1, of chi2]
    stalled_after: int = (
        10  # Steps after which a stalled fit gets a new Jacobian instead of Broyden's updates
    )
    # [chi2] A smaller decrease over the window is stalled; below the BIC limit, above
    # `min_decrease`
    stalled_decrease: float = 2.0
    # [1] A fit whose chi2 is this times that of a sufficient hypothesis is dominated and may end
    # early
    dominated_factor: float = 3.0
    # [chi2] A fit is also dominated if its predicted minimum exceeds that of a sufficient
    # hypothesis by so much: ten times the BIC limit
    dominated_excess: float = 100.0
    dominated_window: int = 2  # As `stalled_window` for dominated fits (experience)
    dominated_progress: float = 0.2  # As `poor_progress` for dominated fits (experience)


@dataclass(frozen=True)
class BaselineSettings:
    """Fit of the current model."""

    # [standard deviations of chi2] Limit for noise (one in a thousand by chance)
    noise_sigmas: float = 3.0


@dataclass(frozen=True)
class InitialGuessSettings:
    """Start of the fit of a screened hypothesis."""

    # [1, of the linear estimate] Largest tried multiple, as loose joints respond more than
    # proportionally
    max_multiple: float = 16.0


@dataclass(frozen=True)
class WindowSettings:
    """Likelihood with a clearance, over states in windows of the record (jumps in rad and crank
    speeds)."""

    # Standard deviations of jumps between windows, decreasing: at the first the basin of attraction
    # is about 50 % of a clearance wide, the last is practically one trajectory
    jumps: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.006, 0.001)
    most_windows: int = 16  # Per revolution: with 8 the basin is half as wide, with 2 it vanishes
    least_windows: int = 4  # Per revolution
    # [1] Readings in a window per state variable: with fewer, states follow noise
    readings_per_number: float = 6.0
    filtered_above: float = 0.05  # Least jump at which the filter searches states
    held_above: float = 0.5  # Jump above which parameters are fixed, as states compensate for them
    first_state: float = 3.0  # Standard deviation of the first state about that of the filter
    # [1] Whitened residual above which it counts by its size, not its square: where an impact comes
    # half a sample later, a residual is a hundred
    large: float = 5.0
    iterations: int = 12  # Largest number of Gauss-Newton steps at a jump; 2 to 5 are usual
    # [1, of the cost] Least decrease for another step; twice that ends in other minima
    decrease: float = 0.005
    renewed_below: float = (
        0.25  # [1] Gain ratio below which derivatives by parameters are recomputed
    )
    # [1, per sample] Deviance above the best jump, or above a rival, at which a fit ends
    far_behind: float = 0.03
    compared_below: float = 0.1  # Largest jump at which rivals are compared by `far_behind`
    far_before: float = 1.0  # [1, per sample] The same limit at larger jumps
    size_factor: float = 1.4  # [1] Factor between tried clearances: half the width of the basin
    # Improvement of the start of each of these by the filter: largest number of evaluations,
    # revolutions, least gain [1, per sample], and first steps: of the effect [its steps] and of
    # nuisances [1, of their bounds]
    refinements: int = 200
    refined_turns: float = 2.0
    refined_to: float = 0.002
    first_steps: float = 2.0
    first_share: float = 0.1
    fitted_sizes: int = 2  # Best clearances that are tried with all shapes and fitted
    leading: int = 4  # Largest number of effects fitted in windows
    # [1, of the largest gain] Least gain of a fitted clearance by the filter, and least predicted
    # gain of a second effect
    leading_share: float = 0.5


@dataclass(frozen=True)
class ModelSelectionSettings:
    """Selection and comparison of hypotheses."""

    max_singles: int = (
        8  # Candidates fitted alone, and sums of terms of one size for a law (experience)
    )
    # [1] Predicted share of the misfit above which an effect is fitted with loose joints,
    # whatever explains more (experience)
    least_explained_share: float = 0.01
    # [1] Share of a predicted change that counts as real, as residuals are nonlinear
    linear_share: float = 0.5
    fits_per_round: int = 4  # Fits that are made before their proposals join the queue
    # Number of: leading fits of a size that propose partners, partners that each proposes, masked
    # pairs, slow effects, terms of each effect for a law, listed effects fitted in place of a law
    partners: int = 3
    # Of each leading effect, ranked about the base and linearised about its fit (experience)
    linearised_partners: int = 12
    # Simulated runs after which no further fit begins, for each of: search, formula, families; one
    # to two minutes with loose joints (experience)
    max_simulations: int = 2000
    # The same for non-periodic motion, whose runs take four times as long (experience)
    max_simulations_of_statistics: int = 1500


@dataclass(frozen=True)
class NoiseSettings:
    """Estimation of channel noise from repeated cycles."""

    max_ar_order: int = 4  # [samples] Largest order of the autoregressive process
    min_differences: int = 32  # Least number of differences between cycles
    max_cycles_apart: int = (
        4  # Largest distance of compared cycles, for phases that do not repeat in the next one
    )
    # [1, of the noise variance] Largest squared second difference of a residual for interpolation;
    # it adds 2 % to the noise, at most 8 % in the middle between samples
    max_bend: float = 4.0
    # [1] Variance of the differences' mean over a cycle, over that of white noise, that counts as
    # drift (noise with an autocorrelation of 0.96: 49)
    least_drift: float = 100.0
    # [1, of the channel's variation] Largest estimated noise; beyond, the model does not follow the
    # motion
    max_share_of_channel: float = 0.5
    least_motion: float = (
        0.2  # [1, of such a noise] Variation of the model below which a channel is constant
    )
    max_angle_rad: float = 0.1745  # [rad] Largest noise of an angle (10 deg)
    max_lines: int = (
        24  # Largest number of sinusoids removed as motion out of step with the crank (experience)
    )
    line_probability: float = 1e-4  # [1] Probability of a removed sinusoid in noise
    reported_mismatch: float = 1.3  # [1] Reported factor between stated and estimated noise
    # [1] Tried relative growths of the variance at the largest rate: steps of a fifth of the
    # standard deviation
    noise_growths: tuple[float, ...] = tuple(1.5**power for power in range(-2, 20))
    min_growth_gain: float = (
        15.0  # [-2 log likelihood] Required gain of such a growth: very strong evidence
    )
    # [1, of the channel's variation; for an angle at most of that of a turn] Least noise
    min_share_of_channel: float = 1e-4
    guessed_share: float = 0.02  # [1, of the channel's variation] Noise for the first fit
    negligible_numerics: float = (
        0.05  # [1, of the noise] Least solver error that counts; it adds 0.1 % to the noise
    )
    numerics_window: int = (
        5  # [samples] Averaging of solver error, as shifted impacts differ at single samples
    )


@dataclass(frozen=True)
class ScreeningSettings:
    """Sensitivities of all candidates, and thresholds from null campaigns."""

    max_frequencies: int = 3  # Highest peaks of the periodogram that are tried (experience)
    frequencies_per_line: int = 4  # Tried frequencies within the width of a spectral line
    secant_factor: float = (
        2.0  # [1] Factor on the amplitude within which a secant is valid, either way
    )
    # [1, of the norm] Part beyond the nuisances that counts as rounding; also the change by a
    # typical step of an effect [standard deviations of the noise]
    negligible_projection: float = 1e-6
    special_case_distance: float = (
        0.03  # [1, of the norm] Part outside the span of a more general hypothesis
    )
    order_width: float = (
        0.02  # [cycles per revolution] Distance within which a frequency is a crank order
    )
    # Simulated null campaigns; at a rate of 1 % forty exceed the threshold, which is accurate to 16
    # %
    null_campaigns: int = 4000


@dataclass(frozen=True)
class DetectabilitySettings:
    """Limits of the preflight."""

    typical_gap: float = (
        1.5  # [1] Gap after recalibration by an effect of typical size, for comparisons
    )
    power: float = 0.9  # [1] Probability of finding an effect of the smallest detectable size
    max_steps: float = 1000.0  # [steps of the parameter] Largest size of an unbounded amplitude
    assumed_noise_share: float = (
        0.02  # [1, of the channel's variation] Assumed noise: an industrial sensor
    )
    assumed_angle_noise_deg: float = (
        0.2  # [deg] Assumed noise of an angle: an encoder with 1800 lines
    )
    # [1, of its root mean square] Variation below which a channel is constant, with noise from its
    # root mean square
    hardly_varies: float = 1e-3


@dataclass(frozen=True)
class ConfirmationSettings:
    """Bootstrap of the gaps."""

    blocks: int = 20  # Of a series: a block bootstrap, as neighbouring residuals are correlated
    # Bootstrap samples; ends of a 90 % interval are accurate to a few percent of its width
    draws: int = 1000


@dataclass(frozen=True)
class DecisionSettings:
    """Limits of the verdict (`jointgap.identification.verdict`)."""

    # [BIC] Explanations with a smaller difference are equivalent: odds of 150 to 1 (Kass and
    # Raftery 1995: very strong)
    min_delta_bic: float = 10.0
    # [1, of the misfit] Least explained share if the residual exceeds noise
    min_explained_share: float = 0.95
    # [standard deviations of the noise] Up to this gap no effect is missing unless one is found; a
    # held-out gap whose 90 % interval begins above it exceeds noise
    noise_gap: float = 1.05
    # [1] Largest misfit over that if the most similar effect were the cause; and largest held-out
    # excess over that before: half way between right and wrong
    max_share_of_wrong_misfit: float = 0.5
    # [1, of the misfit] From here on the similarity of effects does not matter; the residual is
    # less than a tenth of the effect. Listed laws can imitate others up to 98.4 % (the cube of the
    # speed by its square and a harmonic force). Also required of a force law, and the limit of
    # equivalent laws
    sure_explained_share: float = 0.99
    max_chance_of_size: float = (
        0.1  # [1] Largest probability of an effect's size by chance (90 % interval without 0)
    )
    # [standard deviations of the noise] Largest gap of a channel. Correct verdicts of blind trials:
    # 0.9 to 1.1, with large solver error up to 1.4
    max_gap_left: float = 3.0
    # [standard deviations of the noise] Largest gap of all held-out data. The real machine of the
    # examples: 7, which is 6 % of the force
    max_gap_held_out: float = 1.5
    # Nuisances at bounds from which a fit is rejected if noise is large too: they compensate for
    # missing effects
    many_at_bounds: int = 3
    max_noise_share: float = 0.3  # [1, of the channel's variation] Such a noise
    # [standard deviations of the noise] Held-out gap that counts as noise, including random
    # variation of the noise and of run-specific values
    max_gap_of_noise: float = 1.2


@dataclass(frozen=True)
class DisagreementSettings:
    """Map of the residual."""

    bins: int = 36  # Of the crank angle: 10 deg, about the width of an impact's residual
    min_size: float = (
        0.1  # [standard deviations of the noise] Least residual at the begin or end of a window
    )
    spans: tuple[int, ...] = (3, 9)  # [bins] Widths of tested spans besides single bins
    # [1] Least probability of one bin that counts in a span, so that one impact does not flag its
    # surroundings
    least_of_one: float = 0.02
    neighbours: int = 5  # [bins] Number of bins that are judged together in a significant span
    # [1] Largest probability by noise of these. In 79 blind trials the map missed 19 % of the bins
    # with a residual of half of the noise; no window was false
    likely: float = 0.3
    likely_end: float = 0.05  # [1] The same for a single bin at the begin or end of a window
    ljung_box_lags: int = 10  # Lags of the test for autocorrelation (Ljung and Box 1978)
    highest_order: float = 24.0  # [cycles per revolution] Highest crank order of the spectrum
    # [cycles per revolution] Lowest reported order: masses, weight and steady slider forces cause
    # orders one and two
    lowest_dominant_order: int = 3
    dominant_share: float = (
        0.5  # [1] Least share of the squared residual beyond noise for a dominant order
    )
    # [standard deviations] Least excess of the residual over noise for the growth with speed
    scaling_sigmas: float = 3.0


@dataclass(frozen=True)
class IntervalSettings:
    """Intervals truncated by bounds, from draws."""

    far_standard_deviations: float = (
        4.0  # [standard deviations] Distance of bounds that do not matter (6e-5)
    )
    chains: int = 256  # Parallel chains
    settling_sweeps: int = (
        15  # Dropped sweeps over all directions (axes of chi2 and of the distribution)
    )
    sweeps: int = (
        30  # Kept sweeps; the standard error of an interval's end is about 0.03 standard deviations
    )
    mapped_draws: int = 1000  # Draws for the interval of a derived parameter
    starts: int = 2  # Fits from draws, whose other ends widen intervals (experience)
    least_singular_value: float = (
        1e-8  # [1, of the largest] Limits the uncertainty of inactive combinations
    )
    # [1, of the range] Largest 90 % interval of a determined parameter; without information it is
    # 0.9
    determined_share: float = 0.8


@dataclass(frozen=True)
class EnsembleSettings:
    """Regression over simulations of chaotic motion (`jointgap.identification.baseline`)."""

    # [standard errors] Widths of the ensembles about the minimum; with less than three, slopes are
    # dominated by the scatter of realisations
    widths: tuple[float, ...] = (4.0, 3.0, 3.0)
    members_per_parameter: int = (
        8  # Simulations: scatter is then less than a sixth of the slopes (experience)
    )
    settled_share: float = (
        0.5  # [1, of each parameter's variance] Squared change of the minimum by the last ensemble
    )
    # [1, of the ensemble's standard deviation] Largest distance of the minimum from the mean
    reach: float = 2.5
    least_variance: float = 1.0  # [1, of the noise variance] Of a mode of the scatter
    draws: int = 2000  # Of the parameters, for intervals
    realisations: int = 12  # Of the mean residual of a fit: reduces the scatter of chi2 to a third
    passes: int = 2  # Largest number of regressions of the base (experience)
    marked_fall: float = 0.02  # [1, of chi2] Decrease for another regression (experience)
    leading: int = (
        2  # Largest number of regressed explanations; each takes about 300 simulations of all runs
    )
    # [1, of the best explained misfit] Least of a regressed explanation; regression may increase it
    # by a fifth
    leading_share: float = 0.5


@dataclass(frozen=True)
class FamilySettings:
    """Profile over the shape of a law family."""

    tried_starts: int = 2  # Fits of a law, from the most promising shapes (experience)
    least_step: float = 0.01  # [1] Of the shape: common laws differ by more
    largest_step: float = 0.5  # [1] Of the shape: limit of the first step, doubled at each
    overshoot: float = (
        1.2  # [1] Step over the predicted end of the interval, which is then interpolated
    )
    level: float = 0.99  # [1] Of the interval: one wrong name in a hundred
    # [1] Explained share of a single effect for its family to be tried if nothing is named:
    # quadratic drag explains 58 % of drag with the fifth power, other effects mostly far less
    least_share: float = 0.4


@dataclass(frozen=True)
class IdentificationSettings:
    """All settings of the identification."""

    differences: FiniteDifferenceSettings = field(default_factory=FiniteDifferenceSettings)
    damping: DampingSettings = field(default_factory=DampingSettings)
    stopping: StoppingSettings = field(default_factory=StoppingSettings)
    baseline: BaselineSettings = field(default_factory=BaselineSettings)
    initial_guess: InitialGuessSettings = field(default_factory=InitialGuessSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    selection: ModelSelectionSettings = field(default_factory=ModelSelectionSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    screening: ScreeningSettings = field(default_factory=ScreeningSettings)
    detectability: DetectabilitySettings = field(default_factory=DetectabilitySettings)
    confirmation: ConfirmationSettings = field(default_factory=ConfirmationSettings)
    decision: DecisionSettings = field(default_factory=DecisionSettings)
    disagreement: DisagreementSettings = field(default_factory=DisagreementSettings)
    intervals: IntervalSettings = field(default_factory=IntervalSettings)
    ensemble: EnsembleSettings = field(default_factory=EnsembleSettings)
    family: FamilySettings = field(default_factory=FamilySettings)


DEFAULT_SETTINGS = IdentificationSettings()
