"""Tables of a campaign: what was measured, how noisy it is, what was fitted, and what came of it."""

from jointgap.tables.columns import Column, Table

_RUN = Column("run", "", "run of the campaign", "text")
_CHANNEL = Column("channel", "", "channel, or statistic of one where samples cannot be compared", "text")
_SAMPLE = Column("sample", "1", "place in the series, counted from 0", "int")
_EXPLANATION = Column(
    "explanation", "", "effects added to the model, 'a + b'; 'base' for the model as it stands", "text"
)
_LABEL = Column("label", "", "effect, with its site where there is a choice", "text")
_KEY = Column("key", "", "what the fit calls the parameter: name, name@run, or effect.coordinate", "text")
_HELD_OUT = Column("held_out", "", "took no part in fitting or choosing", "bool")

MEASURED = Table(
    "measured",
    "Measured data in SI, one row a sample and channel",
    (
        _RUN,
        Column("channel", "", "channel", "text"),
        _SAMPLE,
        Column("time", "s", "time of the sample", nullable=True),
        Column("crank_angle", "rad", "crank angle as measured, running on over revolutions", nullable=True),
        Column("value", "SI", "what the channel reads, in its SI unit; null where there is no datum", nullable=True),
        _HELD_OUT,
    ),
)

NOISE = Table(
    "noise",
    "Noise of every compared sample",
    (
        _RUN,
        _CHANNEL,
        _SAMPLE,
        Column("sd", "SI", "standard deviation of the measurement"),
        Column("numerics", "SI", "standard deviation of what equally good numerics predict otherwise"),
    ),
)

NOISE_MEMORY = Table(
    "noise_memory",
    "Where each series' noise is from, and how long it remembers",
    (
        _RUN,
        _CHANNEL,
        Column("source", "", "where the standard deviation is from, in words", "text"),
        Column("found", "SI", "standard deviation that the data show", nullable=True),
        Column("effective_samples", "1", "how many independent samples would tell a mean as well", nullable=True),
        Column("remarks", "", "what a reader should know, separated by '; '", "text"),
        Column("lag", "1", "samples between two values", "int"),
        Column("autocorrelation", "1", "of the noise at that lag"),
    ),
)

FITS = Table(
    "fits",
    "Every explanation that was fitted, the model as it stands among them",
    (
        _EXPLANATION,
        Column("kind", "", "base, single, pair or formula", "text"),
        Column("status", "", "converged, stopped or failed", "text"),
        Column("reason", "", "why it stopped or failed", "text", nullable=True),
        Column("chi2", "1", "sum of squared whitened residuals", nullable=True),
        Column("samples", "1", "residuals counted", "int"),
        Column("parameters", "1", "parameters fitted", "int"),
        Column("bic", "1", "Bayesian information criterion", nullable=True),
        Column("simulations", "1", "simulated runs that the fit took", "int"),
        Column("seconds", "s", "time that the fit took", nullable=True),
    ),
)

FIT_PARAMETERS = Table(
    "fit_parameters",
    "Fitted parameters of every explanation, nuisances and effects",
    (
        _EXPLANATION,
        _KEY,
        Column("parameter", "", "nuisance, or parameter of an effect as a verdict states it", "text"),
        Column("effect", "", "label of the effect; null for a nuisance", "text", nullable=True),
        Column("run", "", "the one run that it belongs to; null where all share it", "text", nullable=True),
        Column("value", "SI", "fitted value", nullable=True),
        Column("sd", "SI", "its standard error", nullable=True),
        Column("low_90", "SI", "lower end of the 90 % interval", nullable=True),
        Column("high_90", "SI", "upper end of the 90 % interval", nullable=True),
        Column("unit", "", "SI unit", "text"),
    ),
)

FIT_VALUES = Table(
    "fit_values",
    "Fitted values by key, for later stages to start from",
    (_EXPLANATION, _KEY, Column("value", "SI", "fitted value")),
)

FIT_CURVATURE = Table(
    "fit_curvature",
    "Derivatives of the whitened residuals, in as many rows as parameters with the same inner products",
    (_EXPLANATION, _KEY, _SAMPLE, Column("derivative", "1/SI", "of the residuals with respect to the parameter")),
)

SIGNATURES = Table(
    "signatures",
    "What parameters of the base and sizes of candidates change in the whitened residuals, at the recalibrated base",
    (
        Column("label", "", "candidate; 'base' for the nuisances", "text"),
        Column("start", "1", "which start of the candidate's shapes, counted from 0", "int"),
        Column("name", "", "nuisance's key, name of a size, or 'origin': the residuals at zero size", "text"),
        _SAMPLE,
        Column("derivative", "1/SI", "of the whitened residual; of 'origin' its value"),
    ),
)

SIGNATURE_SHAPES = Table(
    "signature_shapes",
    "Shapes of candidates at which their signatures were taken",
    (
        Column("label", "", "candidate", "text"),
        Column("start", "1", "which start of its shapes, counted from 0", "int"),
        Column("name", "", "shape", "text"),
        Column("value", "SI", "its value"),
    ),
)

SCREENED = Table(
    "screened",
    "What the most promising explanations would explain if the motion depended on them linearly",
    (
        _EXPLANATION,
        Column("kind", "", "single or pair; failed where it cannot be simulated", "text"),
        Column("chi2", "1", "sum of squared whitened residuals that would be left", nullable=True),
        Column("bic", "1", "Bayesian information criterion", nullable=True),
        Column("reason", "", "why it cannot be simulated", "text", nullable=True),
    ),
)

THRESHOLDS = Table(
    "thresholds",
    "What campaigns in which nothing is hidden exceed with the stated rate",
    (
        Column("rate", "1", "share of null campaigns that exceed each threshold"),
        Column("omnibus", "1", "chi2 over its degrees of freedom"),
        Column("directed", "1", "largest gain of BIC by one candidate"),
    ),
)

RANKING = Table(
    "ranking",
    "Every explanation that was fitted, best first",
    (
        *FITS.columns,
        Column("delta_bic", "1", "BIC of the base less its own; larger is better", nullable=True),
        Column("explained_share", "1", "share of the base's chi2 beyond noise that is gone", nullable=True),
        Column("passes", "", "leaves no more than null campaigns do", "bool"),
        Column("admissible", "", "all its effects are there, and none is a nuisance within its range", "bool"),
        Column("place", "", "named, equivalent, or empty", "text"),
        Column("remark", "", "why it is not admissible, or what the fit says", "text", nullable=True),
    ),
)

DECISION = Table(
    "decision",
    "The verdict as far as the fits carry it",
    (
        Column("verdict", "", "as in verdict.json", "text"),
        Column("because", "", "the reason in a sentence", "text"),
        Column("nuisances", "", "fit whose nuisances hold: nominal or base", "text"),
    ),
)

FIT_RESIDUALS = Table(
    "fit_residuals",
    "Whitened residuals of every explanation",
    (_EXPLANATION, _SAMPLE, Column("residual", "1", "independent and of variance 1 where the explanation is true")),
)

RESIDUALS = Table(
    "residuals",
    "Every compared sample: measured, and as predicted before and after the effect was added",
    (
        _RUN,
        _CHANNEL,
        _SAMPLE,
        Column("crank_angle", "rad", "crank angle, running on", nullable=True),
        _HELD_OUT,
        Column("measured", "SI", "as measured"),
        Column("base", "SI", "predicted by the recalibrated base"),
        Column("augmented", "SI", "predicted with the effects of the verdict; the base's where there are none"),
        Column("whitened_base", "1", "whitened residual of the base"),
        Column("whitened_augmented", "1", "whitened residual with the effects"),
        Column("spread", "SI", "standard deviation that noise and numerics give the sample"),
    ),
)

MISSING_FORCE = Table(
    "missing_force",
    "What the named effects push the slider and turn the crank with, over one revolution of each run",
    (
        _RUN,
        Column("crank_angle", "rad", "crank angle"),
        Column("slider_position", "m", "position of the slider's pin along x"),
        Column("slider_velocity", "m/s", "its velocity"),
        Column("slider_force", "N", "force on the slider along +x beyond that of the base"),
        Column("crank_torque", "N*m", "torque on the crank beyond that of the base"),
    ),
)

GAPS = Table(
    "gaps",
    "Gap between simulation and measurement by run and channel, before and after: 1 = noise",
    (
        Column("run", "", "run, or 'all'", "text"),
        Column("role", "", "identify or confirm", "text"),
        Column("channel", "", "channel, or 'all'", "text"),
        Column("samples", "1", "residuals counted", "int"),
        Column("before", "1", "root mean square of the whitened residual of the base"),
        Column("after", "1", "the same with the effects of the verdict"),
        *(
            Column(f"{when}_{end}", "1", f"{words} end of the 90 % bootstrap interval of {when}")
            for when in ("before", "after")
            for end, words in (("low", "lower"), ("high", "upper"))
        ),
        Column("closed", "1", "share of the excess closed, 1 - (after^2 - 1) / (before^2 - 1)", nullable=True),
    ),
)

OPTIMUM = Table(
    "campaign_optimum",
    "Optimal link lengths of the model before and after the effects were added",
    (
        Column("model", "", "base or augmented", "text"),
        Column("source", "", "where the search took the motion in the joints from", "text"),
        Column("crank_length", "m", "L2 at the optimum"),
        Column("rod_length", "m", "L3 at the optimum"),
        Column("reduction", "1", "by which share the RMS error of the transmission angle fell, motion frozen"),
        Column("resimulated", "1", "the same, simulated again over a settled revolution", nullable=True),
        Column("rms_before", "rad", "RMS error of the transmission angle at the original lengths"),
        Column("rms_after", "rad", "the same at the optimum"),
    ),
)

TIMES = Table(
    "campaign_times",
    "Time that each stage of an analysis took",
    (Column("stage", "", "stage", "text"), Column("seconds", "s", "time on the clock")),
)
