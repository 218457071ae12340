"""Tables of the stage optimise.

A point is a pair of lengths with a name: ``original``, the paper's ``printed_...``, or ``SOURCE_BOX_METHOD`` for what
the optimisers found.
"""

from jointgap.tables.columns import Column, Table

_SOURCE = Column(
    "source",
    "",
    "where the frozen clearance motion comes from: a surrogate's name, simulation, or simulation_settled",
    "text",
)
_BOX = Column("box", "", "name of the box that bounds the lengths", "text")
_POINT = Column("point", "", "name of a pair of lengths", "text")
_CRANK = Column("crank_length", "m", "L2")
_ROD = Column("rod_length", "m", "L3")
_SQUARES = Column("sum_of_squares", "rad^2", "objective of equation (12), over the evaluation samples")

_MEASURES = (
    Column("rms", "rad", "root mean square of mu_d - mu_a"),
    Column("mean_absolute", "rad", "mean size of mu_d - mu_a"),
    Column("peak", "rad", "largest size of mu_d - mu_a"),
    _SQUARES,
)
_REDUCTIONS = tuple(
    Column(f"{column.name}_reduction", "1", f"by which share {column.name} lies below that of the original lengths")
    for column in _MEASURES
)

OPTIMA = Table(
    "optimise_optima",
    "Every pair of lengths under every source, the clearance motion frozen at the original lengths",
    (
        _SOURCE,
        _POINT,
        Column("box", "", "name of the box; null for points that no search here found", "text", nullable=True),
        Column("method", "", "original, printed, genetic or local (best of six starting points)", "text"),
        _CRANK,
        _ROD,
        Column("ratio", "1", "L2 / L3"),
        Column("active_bounds", "", "bounds and inequality that the point lies at, in words", "text", nullable=True),
        *_MEASURES,
        *_REDUCTIONS,
        Column("rod_tolerance", "m", "width of the tolerance of the rod's length: the one stated, else IT7"),
        Column("rms_rod_off", "rad", "rms with the rod half that tolerance too long or too short, the larger one"),
        Column(
            "rod_deviation_allowed",
            "m",
            "how far off the rod may be until rms is that of the original lengths; at most 1 %",
        ),
        Column("invariant", "m", "(1 - rms_reduction) L3, constant along the valley's floor"),
        Column("evaluations", "1", "calls of the objective (of the best start)", "int", nullable=True),
        Column(
            "evaluations_within_1_percent",
            "1",
            "calls until within 1 % of the lowest value found in this box; null if never",
            "int",
            nullable=True,
        ),
        Column(
            "evaluations_within_0_1_percent",
            "1",
            "calls until within 0.1 % of the lowest value found in this box; null if never",
            "int",
            nullable=True,
        ),
        Column("status", "", "why the search stopped", "text", nullable=True),
    ),
    path="optimise/optima.parquet",
)

POPULATION = Table(
    "optimise_population",
    "Every generation of the genetic algorithm",
    (
        _SOURCE,
        _BOX,
        Column("generation", "1", "0 = the first, drawn at random", "int"),
        Column("individual", "1", "place in the generation; elites come first", "int"),
        Column("origin", "", "first, elite, crossover or mutation", "text"),
        _CRANK,
        _ROD,
        _SQUARES,
        Column("evaluations", "1", "calls of the objective up to the end of this generation", "int"),
    ),
    path="optimise/population.parquet",
)

PATHS = Table(
    "optimise_paths",
    "Every iterate of the local optimiser from each starting point",
    (
        _SOURCE,
        _BOX,
        Column("start", "1", "number of the starting point, from 0", "int"),
        Column("iteration", "1", "0 = the starting point", "int"),
        _CRANK,
        _ROD,
        _SQUARES,
    ),
    path="optimise/paths.parquet",
)

TOLERANCE = Table(
    "optimise_tolerance",
    "Where the six local searches end, by stopping tolerance",
    (
        _SOURCE,
        _BOX,
        Column("tolerance", "1", "change of the objective, as a share of its original value, at which a search stops"),
        Column("start", "1", "number of the starting point, from 0", "int"),
        _CRANK,
        _ROD,
        _SQUARES,
        Column("rms_reduction", "1", "by which share the rms lies below that of the original lengths"),
        Column("evaluations", "1", "calls of the objective", "int"),
        Column("converged", "", "whether the tolerance was met", "bool"),
        Column("active_bounds", "", "bounds and inequality that the end point lies at, in words", "text"),
    ),
    path="optimise/tolerance.parquet",
)

VALLEY = Table(
    "optimise_valley",
    "The objective over the lengths",
    (_SOURCE, _BOX, _CRANK, _ROD, Column("allowed", "", "whether the inequality holds", "bool"), *_MEASURES),
    path="optimise/valley.parquet",
)

FLOOR = Table(
    "optimise_floor",
    "The best crank length for each rod length and measure, bounds of the crank apart",
    (
        _SOURCE,
        _BOX,
        Column("measure", "", "rms, mean_absolute, peak or sum_of_squares", "text"),
        _CRANK,
        _ROD,
        Column("ratio", "1", "L2 / L3"),
        Column("value", "rad, rad^2", "the measure"),
        Column("reduction", "1", "by which share it lies below that of the original lengths"),
        Column("invariant", "m, m^2", "(1 - reduction) L3, for the sum of squares (1 - reduction) L3^2"),
    ),
    path="optimise/floor.parquet",
)


def _spread(name: str, unit: str, description: str, nullable: bool = False) -> tuple[Column, ...]:
    return (
        Column(name, unit, f"{description}, median of the ensemble", nullable=nullable),
        Column(f"{name}_low", unit, f"{description}, 5 % quantile", nullable=nullable),
        Column(f"{name}_high", unit, f"{description}, 95 % quantile", nullable=nullable),
    )


RESIMULATED = Table(
    "optimise_resimulated",
    "The error at each point simulated again with its lengths, beside the frozen one; ensembles of perturbed starts",
    (
        _POINT,
        _CRANK,
        _ROD,
        Column("stretch", "", "window (first revolution, held-out samples) or settled (a whole revolution)", "text"),
        Column("measure", "", "rms, mean_absolute, peak or sum_of_squares", "text"),
        Column("frozen_reduction", "1", "reduction with the simulated clearance motion of the original lengths"),
        *_spread("reduction", "1", "reduction that a pair of single runs shows"),
        Column("share_better", "1", "share of the pairs in which the new lengths have the smaller error"),
        *_spread("original_error", "rad, rad^2", "the measure at the original lengths"),
        *_spread("error", "rad, rad^2", "the measure at the new lengths"),
        Column("members", "1", "simulations for each pair of lengths", "int"),
    ),
    path="optimise/resimulated.parquet",
)

WORTH = Table(
    "optimise_worth",
    "What a pair of lengths means for the machine, without clearance and simulated over a settled revolution",
    (
        _POINT,
        _CRANK,
        _ROD,
        Column("cycle", "", "ideal (without clearance) or simulated (median of the ensemble)", "text"),
        Column("smallest_transmission_angle", "rad", "90 deg less the largest departure"),
        Column("largest_departure", "rad", "largest distance of mu from 90 deg"),
        Column("stroke", "m", "way of the slider between its dead centres"),
        Column("outer_dead_centre", "m", "farthest slider position"),
        Column("inner_dead_centre", "m", "nearest slider position"),
        Column("smallest_transmission_angle_change", "rad", "against the original lengths"),
        Column("stroke_change", "m", "against the original lengths"),
        Column("outer_dead_centre_change", "m", "against the original lengths"),
        Column("inner_dead_centre_change", "m", "against the original lengths"),
    ),
    path="optimise/worth.parquet",
)

LOADS = Table(
    "optimise_loads",
    "What each joint carries at each point, simulated over a settled revolution; ensembles of perturbed starts",
    (
        _POINT,
        _CRANK,
        _ROD,
        Column("joint", "", "crank_pivot, crank_pin or piston_pin", "text"),
        *_spread("peak_force", "N", "largest force between the joint's bodies at the samples"),
        *_spread("rms_force", "N", "root mean square of that force"),
        *_spread("contact_share", "1", "share of the time in contact; null of an ideal joint", nullable=True),
    ),
    path="optimise/loads.parquet",
)
