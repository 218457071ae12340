"""Tables of the naming of effects: signatures, fits, and how they are weighed."""

from jointgap.tables.columns import Column, Table

_SAMPLE = Column("sample", "1", "place in the series, counted from 0", "int")
_EXPLANATION = Column(
    "explanation", "", "effects added to the model, 'a + b'; 'base' for the model as it stands", "text"
)
_KEY = Column("key", "", "what the fit calls the parameter: name, name@run, or effect.coordinate", "text")

FITS = Table(
    "fits",
    "Every explanation that was fitted, the model as it stands among them",
    (
        _EXPLANATION,
        Column("kind", "", "base, single, pair or formula", "text"),
        Column("status", "", "converged, stopped, failed, or matched: to features of the cycle", "text"),
        Column("reason", "", "why it stopped or failed", "text", nullable=True),
        Column("chi2", "1", "sum of squared whitened residuals", nullable=True),
        Column("samples", "1", "residuals counted", "int"),
        Column("parameters", "1", "parameters fitted", "int"),
        Column("bic", "1", "Bayesian information criterion", nullable=True),
        Column("simulations", "1", "simulated runs that the fit took", "int"),
        Column("seconds", "s", "time that the fit took", nullable=True),
        Column("gap_left", "1", "gap on held-out data, by which errors are multiplied at least; 1 where not predicted"),
    ),
    path="{stage}/fits.parquet",
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
        Column("sd", "SI", "its standard error; null where there is none, see remark", nullable=True),
        Column("low_90", "SI", "lower end of the 90 % interval", nullable=True),
        Column("high_90", "SI", "upper end of the 90 % interval", nullable=True),
        Column("remark", "", "why there is no standard error: at its bound, or not estimated", "text", nullable=True),
        Column("unit", "", "SI unit", "text"),
    ),
    path="{stage}/parameters.parquet",
)

FIT_VALUES = Table(
    "fit_values",
    "Fitted values by key, for later stages to start from",
    (
        _EXPLANATION,
        _KEY,
        Column("value", "SI", "fitted value"),
        Column("slope", "1/SI", "half the derivative of chi2; null where the fit failed", nullable=True),
    ),
    path="{stage}/values.parquet",
)

FIT_SHIFTS = Table(
    "fit_shifts",
    "What other numerics and other starts change in fitted values; of what a verdict states",
    (
        _EXPLANATION,
        Column("numerics", "1", "which of the model's other numerics, counted from 1", "int"),
        _KEY,
        Column("shift", "SI", "change of the fitted value"),
    ),
    path="{stage}/shifts.parquet",
)

FIT_DRAWS = Table(
    "fit_draws",
    "Draws of fitted values where chi2 is not quadratic, from which intervals are taken; of what a verdict states",
    (
        _EXPLANATION,
        Column("draw", "1", "which draw, counted from 0", "int"),
        _KEY,
        Column("value", "SI", "as drawn"),
    ),
    path="{stage}/draws.parquet",
)

FIT_CURVATURE = Table(
    "fit_curvature",
    "Derivatives of the whitened residuals; of the base, singles and pairs all rows, else as many as parameters, with "
    "the same inner products",
    (_EXPLANATION, _KEY, _SAMPLE, Column("derivative", "1/SI", "of the residuals with respect to the parameter")),
    path="{stage}/curvature.parquet",
)

SIGNATURES = Table(
    "signatures",
    "What sizes of candidates change in the whitened residuals, at the recalibrated base",
    (
        Column("label", "", "candidate", "text"),
        Column("start", "1", "which start of the candidate's shapes, counted from 0", "int"),
        Column("name", "", "name of a size, or 'origin': the residuals at zero size", "text"),
        _SAMPLE,
        Column("derivative", "1/SI", "of the whitened residual; of 'origin' its value"),
    ),
    path="screen/signatures.parquet",
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
    path="screen/shapes.parquet",
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
    path="screen/screened.parquet",
)

THRESHOLDS = Table(
    "thresholds",
    "What campaigns in which nothing is hidden exceed with the stated rate",
    (
        Column("rate", "1", "share of null campaigns that exceed each threshold"),
        Column("omnibus", "1", "chi2 over its degrees of freedom"),
        Column("max_gain_threshold", "1", "largest gain of BIC by one candidate"),
        Column("numerical_noise", "1", "chi2 that a fit may gain by numerical noise"),
    ),
    path="screen/thresholds.parquet",
)

RANKING = Table(
    "ranking",
    "Every explanation that was fitted, best first",
    (
        *FITS.columns,
        Column("delta_bic", "1", "BIC of the base less its own; larger is better", nullable=True),
        Column("explained_share", "1", "share of the base's chi2 beyond noise that is gone", nullable=True),
        Column("feature_gain", "1", "log likelihood of the features of the cycle above the base's", nullable=True),
        Column("passes", "", "leaves no more than null campaigns do", "bool"),
        Column("admissible", "", "all its effects are there, and none is a nuisance within its range", "bool"),
        Column("place", "", "named, equivalent, best_known, or empty", "text"),
        Column("remark", "", "why it is not admissible, or what the fit says", "text", nullable=True),
    ),
    path="{stage}/ranking.parquet",
)

DECISION = Table(
    "decision",
    "The verdict as far as the fits carry it",
    (
        Column("verdict", "", "as in verdict.json", "text"),
        Column("because", "", "the reason in a sentence", "text"),
        Column("nuisances", "", "fit whose nuisances hold: nominal or base", "text"),
    ),
    path="{stage}/decision.parquet",
)

LAW_FAMILIES = Table(
    "law_families",
    "What the data leave of the families of the laws that were found",
    (
        Column("effect", "", "label of the effect of the list that was found", "text"),
        Column("law", "", "label of the law of its family", "text"),
        Column("shape", "", "parameter in which members of the family differ", "text"),
        Column("value", "1", "of the shape, as fitted"),
        Column("low", "1", "lower end of its 99 % interval"),
        Column("high", "1", "upper end"),
        Column("fits", "", "the interval holds the shape of the effect", "bool"),
        Column("alone", "", "and no other shape in use: the effect is named, not the family", "bool"),
    ),
    path="decide/law_families.parquet",
)

FIT_RESIDUALS = Table(
    "fit_residuals",
    "Whitened residuals of every explanation",
    (_EXPLANATION, _SAMPLE, Column("residual", "1", "independent and of variance 1 where the explanation is true")),
    path="{stage}/residuals.parquet",
)

FIT_TABLES = (FITS, FIT_VALUES, FIT_CURVATURE, FIT_RESIDUALS, FIT_SHIFTS, FIT_DRAWS)
"""Tables that together hold fits."""

OUTCOME_TABLES = (*FIT_TABLES, RANKING, DECISION, FIT_PARAMETERS)
"""Tables of a verdict as far as the fits carry it."""
