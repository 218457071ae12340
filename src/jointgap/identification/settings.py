"""The tuned numbers of naming, by subject: what each means, its unit, and why it has this value.

Many of them trade simulations for certainty. "(experience)" marks those that were set by what worked on development
trials, campaigns with a hidden effect; nothing is derived there, and another value near by may do as well. A problem
carries its settings (`Problem.settings`), so that trials can vary them:
``replace(DEFAULT_SETTINGS, stopping=replace(DEFAULT_SETTINGS.stopping, max_steps=40))``.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class FiniteDifferenceSettings:
    """Steps over which derivatives of the whitened residuals are taken.

    Lengths are Euclidean lengths of a change of all whitened residuals, in standard deviations of the noise.
    """

    # [1] Length of the change over one step, so a step is about five standard errors of its parameter. Smaller
    # steps meet the numerical noise of impacts, larger ones curvature (experience)
    target_length: float = 5.0
    # [1] The target is at least this share of the residual's length: far from the solution, impacts that pass
    # samples make the motion rough on a small scale. With much larger shares the fit of a film does not converge
    # (experience)
    target_share_of_residual: float = 0.05
    # [1] The target is at least this times the root of the number of statistics of chaotic motion: each scatters by
    # about 1, and half as much again keeps the derivative above that
    target_per_statistic: float = 1.5
    # [1] The target is at least this times the numerical noise: an error of a fifth in a derivative still gives a
    # descent
    target_over_numerical_noise: float = 5.0
    # [1, of a parameter's step] A change so small that what it changes in the motion is numerical noise: its true
    # effect is about a millionth of what noise could hide
    probe_step: float = 1e-6
    # How many parameters are changed so; the largest change counts. Two, because a single one may not move any
    # contact
    probed_parameters: int = 2
    # [1] A change within this factor of the target is good enough: another simulation would buy little accuracy
    accepted_factor: float = 4.0
    # [1] A step is shortened or lengthened by at most this factor at once: beyond, the extrapolation says nothing
    min_step_ratio: float = 1e-4
    # [1] A step is shortened or lengthened by at most this factor at once: beyond, the extrapolation says nothing
    max_step_ratio: float = 1e4
    # [1] A new step has to differ from the old one by this factor to be worth a simulation
    min_step_change: float = 1.5
    # [1] A parameter that changes all residuals over its whole range by this length changes nothing: noise changes
    # each of them by 1
    negligible_change: float = 0.01
    # [1] A step is at most this share of a bounded parameter's range, so that one of the two directions always fits
    max_share_of_range: float = 0.5


@dataclass(frozen=True)
class DampingSettings:
    """When a step is accepted, trusted, or damped (Levenberg-Marquardt).

    The gain ratio is the measured decrease of chi2 over the decrease that the linear model predicts.
    """

    # [1] Above it the Jacobian predicts well enough to declare convergence with; half of a perfect prediction
    trusted_gain_ratio: float = 0.5
    # [1] Above it damping is reduced, below it the Jacobian is made anew or damping is raised; the usual quarter
    # (Fletcher 1971)
    good_gain_ratio: float = 0.25
    factor: float = 10.0  # [1] By which damping is raised and lowered; the usual ten (Marquardt 1963)
    first: float = 1e-3  # [1, of the squared column lengths] The first damping after a bad step
    # [1] Damping at or below it becomes 0 at the next good step: it no longer shortens a step noticeably
    negligible: float = 1e-4
    # [1] Steps damped more are so short that a decrease predicted and not found is numerical noise: the fit stops,
    # not converged
    rough: float = 10.0


@dataclass(frozen=True)
class StoppingSettings:
    """When a fit ends."""

    # [chi2] A predicted decrease below this is not worth a step where the fit is good: a two-hundredth of the 10
    # that tell two hypotheses apart in BIC; no parameter is then farther than 0.22 standard errors from the end. It
    # grows with the square of chi2 per sample, because poor fits need less care, up to what one sample leaves: so
    # far no parameter is farther from the end than its standard error, which grows with the misfit
    min_decrease: float = 0.05
    max_steps: int = 80  # Valleys may be long; this is a guard, not the usual end (experience)
    stalled_window: int = 4  # Steps over which progress is measured
    # [1] Above it a fit is poor, and ends where it improves by less than `poor_progress` in the window: it will not
    # be named
    poor_chi2_per_sample: float = 2.0
    # [1, of chi2] As above; at 2 % in four steps it takes more than a hundred to halve chi2
    poor_progress: float = 0.02
    # Steps after which a fit with a corrected Jacobian that creeps has its Jacobian made anew: Broyden's
    # corrections wear out
    creeping_after: int = 10
    # [chi2] A decrease below this over the window is creeping; below what a BIC decides on, above `min_decrease`
    creeping_decrease: float = 2.0
    # [1] A fit whose chi2 is this times that of a sufficient hypothesis is beaten: no rival any more, so it may end
    # early
    beaten_factor: float = 3.0
    # As `stalled_window` and `poor_progress` for beaten fits, which get less patience (experience)
    beaten_window: int = 2
    # As `stalled_window` and `poor_progress` for beaten fits, which get less patience (experience)
    beaten_progress: float = 0.2


@dataclass(frozen=True)
class BaselineSettings:
    """How the model as it stands is fitted."""

    # Drawn values of the shared nuisances that it starts from too where it does not leave noise alone. (Experience;
    # each costs a fit.)
    drawn_starts: int = 2
    # [1, of chi2] Two fits that differ by less, or by less than the numerical noise of chi2, have reached the same
    # minimum
    same_minimum: float = 1e-3
    # [standard deviations of chi2] A fit within this of its degrees of freedom leaves noise alone (one in a
    # thousand by chance)
    noise_sigmas: float = 3.0


@dataclass(frozen=True)
class InitialGuessSettings:
    """From where the fit of a screened hypothesis starts."""

    # [1, of the linear answer] How far an amplitude is doubled: a loose joint answers a small force more than in
    # proportion, so an effect may be several times as large as small steps say
    max_multiple: float = 16.0


@dataclass(frozen=True)
class WindowSettings:
    """The likelihood over states of loose joints in windows of the record."""

    # [rad], [crank's rates] Standard deviations of jumps between windows, one after the other: at the first the misfit
    # is a funnel some 50 % of a clearance wide, at the last a trajectory's, of which no power is lost
    jumps: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.006, 0.001)
    # Windows a turn at most: with 8 the funnel is half as wide, with 2 nothing is left of it
    most_windows: int = 16
    least_windows: int = 4  # And at least, however few the readings are
    # [1] Readings in a window for each number of its state: with fewer, states follow noise and end in other valleys
    readings_per_number: float = 6.0
    # [rad], [crank's rates] Jump down to which the filter looks for better states
    filtered_above: float = 0.05
    # [rad], [crank's rates] Jump above which parameters are held: states alone take up nearly all there
    held_above: float = 0.5
    # [rad], [crank's rates] Standard deviation of the first state about that of the filter: next to nothing is known
    first_state: float = 3.0
    iterations: int = 12  # Gauss-Newton steps at a jump at most; 2 to 5 are usual
    # [1, of the cost] A decrease that is worth another step. Twice that at each jump but the last ends in other
    # valleys and takes more steps in all
    decrease: float = 0.005
    # [1, of what a step promised] By which less makes derivatives by parameters be taken anew
    renewed_below: float = 0.25
    # [1, for each sample] Deviance by which a fit that leads nowhere is behind its best jump, or behind a rival
    far_behind: float = 0.03
    # [rad], [crank's rates] Jump from which on what is so far behind another ends: at larger ones the true effect need
    # not lead yet
    compared_below: float = 0.1
    far_before: float = 1.0  # [1, for each sample] And at those larger ones: as much as noise leaves
    polishes: int = 3  # How often the smaller jumps are gone through again at most, where valleys decide
    worth_polishing: float = 5.0  # [1] Fall of the cost that makes another time worth it: half of what decides
    # [1] Sizes of a clearance that are tried, by this factor: half the width of the funnel
    size_factor: float = 1.4
    tried_sizes: int = 4  # The best of these, which are tried with all shapes
    fitted_sizes: int = 2  # And the best of those, from which a fit starts
    leading: int = 4  # Effects that are fitted in windows, by what slopes say of them
    # [1, of what slopes say of the best] And from which on: the true one promised two thirds of it at least
    leading_share: float = 0.5


@dataclass(frozen=True)
class ModelSelectionSettings:
    """Which hypotheses are worth a fit, and how fits are made comparable before the decision."""

    # Candidates that are fitted alone, and sums of terms of one size where a law is sought (experience)
    max_singles: int = 8
    # [1] Of what derivatives say of gains: a candidate that promises less than this of what is called an effect is not
    # fitted where the base leaves noise alone, and the base is fitted again from the nuisances of a hypothesis whose
    # effects account for less than this of what it gains. Half, since residuals are not linear
    linear_share: float = 0.5
    # [1] Of the signatures of two effects beside the nuisances: what is more alike is fitted before one is named
    alike_cosine: float = 0.7
    # Partners of a sufficient or a leading effect that are fitted, pairs whose signatures explain nearly all, rivals
    # that are fitted again from the best one's nuisances, swaps of each effect of a pair, terms of each effect that may
    # be a law, and single effects that are fitted in any case, so that the best one has rivals to be compared with
    partners: int = 3
    # Single effects beside which pairs are fitted where none is sufficient, those of least chi2, one of each
    # exclusion group; `partners` of each. Two effects that mask each other need not lead alone (experience)
    leading_singles: int = 6
    # Runs that each of these may simulate until no further fit begins: the fits of pairs, the search in windows, that
    # for a formula, that for families. What has begun ends. One to two minutes where joints are loose and dry
    # (experience)
    max_simulations: int = 5000
    # The same of motion that never repeats, of which a run takes as long as four others (experience)
    max_simulations_of_statistics: int = 1500


@dataclass(frozen=True)
class NoiseSettings:
    """How the noise of a channel is estimated from repeated cycles."""

    # [samples] The noise is an autoregressive process of at most this order: sensors and filters need no more
    max_ar_order: int = 4
    min_differences: int = 32  # Differences between cycles; fewer say nothing of a correlation
    # Cycles apart that are compared: phases that neighbours do not have in common may be met again later
    max_cycles_apart: int = 4
    # [1, of the noise's variance] By so much more than noise makes may the squared second difference of a residual
    # be where it is interpolated: a straight line then adds 2 % to the noise, in the middle between two samples 8 %
    max_bend: float = 4.0
    # [1] Variance of the differences' mean over a cycle, over what noise without a memory leaves of it, from which
    # on they drift; a noise with a correlation of 0.96 from sample to sample leaves 49
    least_drift: float = 100.0
    # [1, of what a channel varies by] A noise that is found is no more: what is left of such a channel is a motion
    # that the model does not follow
    max_share_of_channel: float = 0.5
    # [1, of such a noise] A channel that the model says to vary by less stands still: it may hold nothing but noise
    least_motion: float = 0.2
    max_angle_rad: float = 0.1745  # [rad] Nor is that of an angle, 10 deg: no encoder scatters so
    # Sinusoids that are taken out of the differences, as motions out of step with the crank (experience)
    max_lines: int = 24
    line_probability: float = 1e-4  # [1] How often noise alone may leave the sinusoid that is taken out
    # [1] A stated noise that differs from the estimated one by more than this factor is reported
    reported_mismatch: float = 1.3
    # [1] Factors less one by which the variance may be larger where the channel changes fastest: steps of a fifth
    # of the standard deviation
    noise_growths: tuple[float, ...] = tuple(1.5**power for power in range(-2, 20))
    # [-2 log likelihood] By which such a growth must explain the scatter better: a very strong preference, with one
    # parameter more
    min_growth_gain: float = 15.0
    # [1, of what a channel varies by; of an angle, at most of what a turn does] No sensor resolves less, and a
    # noise of 0 would weigh every error infinitely
    min_share_of_channel: float = 1e-4
    # [1, of what a channel varies by] Noise for the first fit, which only has to weigh the channels against each
    # other
    guessed_share: float = 0.02
    # [1, of the noise] What other numerics predict differently counts from here on: less adds 0.1 % to the noise
    negligible_numerics: float = 0.05
    # [samples] Over which that is averaged: an impact that comes a sample earlier differs at single samples
    numerics_window: int = 5


@dataclass(frozen=True)
class ScreeningSettings:
    """Signatures of all candidates, and the thresholds from null campaigns."""

    # At which one candidate is tried: the highest peaks of the periodogram, as noise may make the highest
    # (experience)
    max_frequencies: int = 3
    # Frequencies tried within the width of a spectral line, so that no peak lies between two of them
    frequencies_per_line: int = 4
    # [1] A secant to a finite amplitude is taken to hold from this part of the amplitude to this multiple of it
    secant_factor: float = 2.0
    # [1, of a signature's length] What the nuisances cannot take up counts as rounding below
    negligible_projection: float = 1e-6
    # [1, of a signature's length] What may lie outside another's span for it to be a special case of that
    special_case_distance: float = 0.03
    # [cycles per revolution] A frequency so near an order or half an order of a crank is that order: 1 % of the
    # second
    order_width: float = 0.02
    # Simulated campaigns with nothing hidden; at a rate of 1 % forty of them exceed the threshold, which is known
    # to 16 %
    null_campaigns: int = 4000


@dataclass(frozen=True)
class DetectabilitySettings:
    """What a preflight calls detectable, typical and alike."""

    # [1] Gap after recalibration that a clearly visible effect causes; at this size effects are compared with each
    # other
    typical_gap: float = 1.5
    power: float = 0.9  # [1] Probability with which an effect of the smallest detectable size is found
    # [steps of the parameter] How large an unbounded amplitude may become: one that has to be larger is as good as
    # invisible
    max_steps: float = 1000.0
    # [1, of what a channel varies by] Noise where none is stated: a plain industrial sensor
    assumed_noise_share: float = 0.02
    assumed_angle_noise_deg: float = 0.2  # [deg] Noise of an angle where none is stated: an encoder of 1800 lines
    # [1, of its root mean square] A channel that varies by less is taken to be constant; its size sets the assumed
    # noise
    hardly_varies: float = 1e-3


@dataclass(frozen=True)
class ConfirmationSettings:
    """Held-out data: the bootstrap of their gaps."""

    # Stretches into which a series is cut: neighbours in one miss the measurement alike, so blocks are drawn, not
    # samples
    blocks: int = 20
    draws: int = 1000  # Bootstrap samples; the ends of a 90 % interval are known to a few percent of its width


@dataclass(frozen=True)
class DecisionSettings:
    """What a name asks for (`jointgap.identification.verdict`)."""

    # [BIC] Two explanations whose BIC differ by less are not told apart: odds of 150 to 1 (Kass and Raftery 1995:
    # very strong)
    min_delta_bic: float = 10.0
    # [1, of the misfit] What an explanation has to explain where it leaves more than noise; the rest is a small
    # part of it
    min_explained_share: float = 0.95
    # [standard deviations of the noise] Up to this gap nothing is called missing unless an effect is found; where the
    # 90 % interval of the held-out gap begins above it, more than noise is left there
    noise_gap: float = 1.05
    # [1] What an explanation leaves must be less than this part of what it would leave if the effect most like it were
    # the cause; and of held-out data, where more than noise is left, of what was there before: half way between right
    # and wrong
    max_share_of_wrong_misfit: float = 0.5
    # [1, of the misfit] From here on the fits of other explanations decide, not how alike signatures look: what is
    # left is within a tenth, root mean square, of what is missing. Below, a law that is not on the list explains as
    # much by one that is: the cube of the speed by its square and a force that swings 98.4 %. A force law has to
    # explain as much, as the library of terms can imitate a lot, and laws that differ by no more are one law
    sure_explained_share: float = 0.99
    # [1] An effect whose size chance alone makes more often is not there: outside of a 90 % interval about it lies
    # 0
    max_chance_of_size: float = 0.1
    # [standard deviations of the noise] Up to this gap, root mean square, a channel's rest is small. Right names
    # leave 0.9 to 1.1 in blind trials, up to 1.4 where numerics decide; three can be seen with the naked eye
    max_gap_left: float = 3.0
    # [standard deviations of the noise] The same of all channels of the held-out data together. Of the one real
    # machine of the examples 7 are left, 6 % of the force: it is explained in part
    max_gap_held_out: float = 1.5
    # Nuisances that end at bounds from which on a fit is not believed where noise is large too: they make up for
    # what the model lacks
    many_at_bounds: int = 3
    # [1, of what a channel varies by] Such a noise: an encoder's of 47 deg is half of what an angle varies by
    max_noise_share: float = 0.3
    # [standard deviations of the noise] Gap on held-out data that still counts as noise: another seed of noise, and
    # a run's own speed and angle found from fewer samples, move it by less
    max_gap_of_noise: float = 1.2


@dataclass(frozen=True)
class DisagreementSettings:
    """The map of where and how the model disagrees with the measurement."""

    bins: int = 36  # Bins of the crank angle: 10 deg each, about the width of what an impact leaves
    # [standard deviations of the noise] No window begins or ends where the disagreement is estimated to be smaller,
    # however significant: no one would look for its cause
    min_size: float = 0.1
    # [bins] How wide the spans are that are tested beside single bins: a part of a stroke, a quarter of a turn
    spans: tuple[int, ...] = (3, 9)
    # [1] Probability down to which one bin counts in a wider span, or beside its neighbours: else one impact would
    # make all around it sure. At 0.01 windows of a bump in test data began or ended two bins beyond it
    least_of_one: float = 0.02
    neighbours: int = 5  # [bins] A bin in a sure span is judged together with those around it, so many in all
    # [1] Probability by noise alone up to which it counts then. In 79 blind trials the map missed 19 % of the bins
    # that differ by half of the noise, and 20 % with 0.2; none of its windows was false
    likely: float = 0.3
    likely_end: float = 0.05  # [1] The same of a bin by itself, with which a window may begin or end
    # Lags over which whitened residuals are tested for correlation; the usual ten (Ljung and Box 1978)
    ljung_box_lags: int = 10
    # [cycles per turn] The highest order of the crank in the spectrum; above it motions of a linkage hold little
    highest_order: float = 24.0
    # [cycles per turn] The lowest order that is told by itself: masses, weight and steady forces on the slider make
    # orders one and two
    lowest_standout_order: int = 3
    # [1] An order is told by itself where it holds more than this share of the squared excess over the noise: most
    # of what a channel misses
    standout_share: float = 0.5
    # [standard deviations] By how much a disagreement has to exceed noise to count in the growth with speed: a
    # logarithm is taken of it
    scaling_sigmas: float = 3.0


@dataclass(frozen=True)
class IntervalSettings:
    """Intervals of parameters that their bounds cut off, from draws."""

    # [standard deviations] Bounds that are farther from all values cut nothing off that counts: 6e-5 of a normal
    # number
    far_standard_deviations: float = 4.0
    chains: int = 256  # Chains that are drawn side by side
    # Sweeps over all directions that are dropped, and that are kept: a chain moves along the axes of chi2 and of
    # the distribution, so that it soon forgets its start. The standard error of an interval's end is then about
    # 0.03 standard deviations
    settling_sweeps: int = 15
    # Sweeps over all directions that are dropped, and that are kept: a chain moves along the axes of chi2 and of
    # the distribution, so that it soon forgets its start. The standard error of an interval's end is then about
    # 0.03 standard deviations
    sweeps: int = 30
    # Draws from which the interval of what follows from them is taken: its ends are sure to 1 % of them
    mapped_draws: int = 1000
    # [1, of the largest] A combination of parameters that changes nothing is as uncertain as rounding allows to
    # say, not certain
    least_singular_value: float = 1e-8
    # [1, of a stated range] A parameter whose 90 % interval is wider is not determined: where nothing is known
    # beyond the range, it is 0.9 wide
    determined_share: float = 0.8


@dataclass(frozen=True)
class EnsembleSettings:
    """Regression over simulations of chaotic motion (`jointgap.identification.baseline`)."""

    # [standard errors] About the minimum so far, over which the members of each ensemble are drawn. Narrower than
    # three, slopes are mostly what realisations scatter: with one, errors of parameters came out half as large as
    # they are
    widths: tuple[float, ...] = (4.0, 3.0, 3.0)
    # Simulations of each ensemble for each parameter: with three standard errors, the scatter then makes up less
    # than a sixth of what slopes seem to say (experience)
    members_per_parameter: int = 8
    # [1, of the variance of each parameter] What the last ensemble moved the minimum by, squared, for it to be the
    # last: the errors count it
    settled_share: float = 0.5
    # [1, of the ensemble's standard deviation] How far from the ensemble's mean its minimum is sought: few members
    # lie farther out, and slopes say nothing of what is there
    reach: float = 2.5
    # [1, of the variance of noise] Of a mode of the scatter that counts: what is quieter cannot be told from
    # independent noise
    least_variance: float = 1.0
    draws: int = 2000  # Of the parameters, for intervals: ten of them lie beyond either end of one of 99 %
    realisations: int = 12  # Whose mean is what a fit leaves: the scatter of chi2 falls to a third
    passes: int = 2  # Regressions one after the other at most, of the base (experience)
    # [1, of chi2] By which one has to have lowered it for another: it then ended far from where slopes were taken
    # (experience)
    marked_fall: float = 0.02
    # Explanations that are regressed before one is chosen, at most: each takes some 300 simulations of all runs
    leading: int = 2
    # [1, of what the best explains] That such an explanation has to explain. By regression the right ones came to
    # explain up to a fifth more, and twice from behind
    leading_share: float = 0.5


@dataclass(frozen=True)
class FamilySettings:
    """How the shape of a law is told that was found."""

    # [1] Of the shape, between fits; else one standard error. Below the least no two laws in use differ, above the
    # largest the start of the next fit is too far off
    least_step: float = 0.01
    # [1] Of the shape, between fits; else one standard error. Below the least no two laws in use differ, above the
    # largest the start of the next fit is too far off
    largest_step: float = 0.5
    # [1] Of the interval of the shape: as many wrong names follow as intervals leave out the true law, one in a
    # hundred
    level: float = 0.99
    # [1] Of the misfit that an effect alone has to explain for its family to be tried where nothing is named. With
    # drag by the fifth power hidden, quadratic drag explains 58 %; with other causes it is mostly far less
    least_share: float = 0.4


@dataclass(frozen=True)
class IdentificationSettings:
    """All tuned numbers of naming, by subject."""

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
