"""Tables of the search for robust lengths."""

from collections.abc import Iterable

from jointgap.tables.columns import Column, Table

_CRANK, _ROD = Column("crank_length", "m", "L2, nominal"), Column("rod_length", "m", "L3, nominal")
_NAME = Column(
    "lengths",
    "",
    "original; frozen (best where the motion of the original lengths is frozen, as the paper does); nominal (best "
    "simulated where nothing is uncertain); robust",
    "text",
)
_ERROR = "RMS error of the transmission angle (that of the original lengths without clearance, less the simulated one)"
_QUANTITIES = {
    "error": ("rad", _ERROR),
    "force": ("N", "largest force in either pin over the settled revolution"),
    "stroke": ("m", "simulated stroke"),
}
_STATISTICS = {
    "mean": "mean",
    "deviation": "standard deviation",
    "measure": "what is minimised of the error: mean plus standard deviations, or a quantile",
    "quantile_05": "5 % quantile",
    "median": "median",
    "quantile_95": "95 % quantile",
}


def _with_interval(name: str, unit: str, description: str) -> tuple[Column, ...]:
    return (
        Column(name, unit, description),
        Column(f"{name}_low", unit, f"{description}; lower end of the 95 % interval"),
        Column(f"{name}_high", unit, f"{description}; upper end of the 95 % interval"),
    )


ROBUST_LENGTHS = Table(
    "optimise_robust_lengths",
    "Pairs of lengths side by side on fresh draws of what is uncertain; intervals by bootstrap",
    (
        _NAME,
        _CRANK,
        _ROD,
        Column("draws", "1", "fresh draws that were simulated with all lengths", "int"),
        Column("failed", "1", "fresh draws whose simulation failed with these", "int"),
        *(
            column
            for name, (unit, words) in _QUANTITIES.items()
            for statistic, how in _STATISTICS.items()
            for column in _with_interval(f"{name}_{statistic}", unit, f"{words}: {how}")
        ),
    ),
    path="optimise_robust/lengths.parquet",
)

ROBUST_GAINS = Table(
    "optimise_robust_gains",
    "Whether a change of the lengths is a gain, draw by draw on the same fresh draws",
    (
        _NAME,
        Column("beside", "", "the lengths that they are compared with", "text"),
        Column("draws", "1", "fresh draws", "int"),
        *_with_interval("probability", "1", "share of the draws in which the error is smaller (exact interval)"),
        *_with_interval("mean_fall", "1", "by which share the mean of the error falls; negative where it grows"),
        *_with_interval("measure_fall", "1", "by which share what is minimised of the error falls"),
    ),
    path="optimise_robust/gains.parquet",
)

ROBUST_CONSTRAINTS = Table(
    "optimise_robust_constraints",
    "How often each constraint holds on fresh draws",
    (
        _NAME,
        Column("constraint", "", "key in optimise.constraints", "text"),
        Column("asked", "1", "share of the draws in which it is asked to hold"),
        *_with_interval("probability", "1", "share of the draws in which it holds (exact interval)"),
        Column("draws", "1", "fresh draws", "int"),
    ),
    path="optimise_robust/constraints.parquet",
)

ROBUST_CANDIDATES = Table(
    "optimise_robust_candidates",
    "Every pair of lengths that was tried, in the draws of the search, which are the same for all",
    (
        Column("search", "", "robust (in all draws) or nominal (nothing uncertain)", "category"),
        Column("step", "", "grid, one measure (differential evolution) or front (NSGA-II)", "category"),
        Column("generation", "1", "of the step, from 0", "int"),
        _CRANK,
        _ROD,
        Column("error_mean", "rad", f"{_ERROR}: mean over the draws", nullable=True),
        Column("error_deviation", "rad", f"{_ERROR}: standard deviation over the draws", nullable=True),
        Column("error", "rad", f"{_ERROR}: what is minimised of it", nullable=True),
        Column("force", "N", "largest force in either pin: the same number of it", nullable=True),
        Column("stroke_change", "m", "by how much the stroke without clearance differs from the original one"),
        Column("missed", "1", "by how much the constraints are missed, in mm, deg, % of the force, added; 0 = kept"),
        Column("failed", "1", "draws whose simulation failed", "int"),
        Column("on_front", "", "whether no other is better in error, force and change of the stroke at once", "bool"),
    ),
    path="optimise_robust/candidates.parquet",
)


def robust_fresh(uncertain: Iterable[Column]) -> Table:
    """The table of the fresh draws, with a column for each parameter that is uncertain."""
    return Table(
        "optimise_robust_fresh",
        "Fresh draws of what is uncertain, and what each pair of lengths does in them",
        (
            Column("draw", "1", "number of the draw, from 0: the same draw for all lengths", "int"),
            _NAME,
            *uncertain,
            *(Column(name, unit, words, nullable=True) for name, (unit, words) in _QUANTITIES.items()),
            Column("reason", "", "why the simulation failed; null where it did not", "text", nullable=True),
        ),
        path=ROBUST_FRESH_PATH,
    )


ROBUST_FRESH_PATH = "optimise_robust/fresh.parquet"
"""Place of that table in the folder of a scenario."""
