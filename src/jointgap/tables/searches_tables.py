"""Tables of networks that know the design, and of the four ways to the best lengths."""

from jointgap.tables.columns import Column, Table

_DESIGN = Column("design", "1", "number of the held-out design, from 0", "int")
_CRANK, _ROD = Column("crank_length", "m", "L2"), Column("rod_length", "m", "L3")

DESIGN_NETWORKS_WEIGHTS = Table(
    "design_networks_weights",
    "Weights of the network from crank angle and design to the motion in the joints",
    (
        Column("layer", "1", "from 0; of the last one neurons are joint, x and y, harmonic", "int"),
        Column("neuron", "1", "from 0", "int"),
        Column("source", "1", "neuron of the layer before; of the first layer the parameter; -1 the bias", "int"),
        Column("weight", "1", "of the last layer in clearances"),
    ),
    path="design_networks/weights.parquet",
)

DESIGN_NETWORKS_ERRORS = Table(
    "design_networks_errors",
    "Held-out designs: errors of the network and of the frozen motion against the simulation",
    (
        _DESIGN,
        Column("output", "", "component of a clearance vector, lift, transmission angle, or RMS error", "category"),
        Column("unit", "", "of the numbers of this output: m or rad", "category"),
        Column("simulated", "1", "RMS over the settled revolution; of the RMS error its value [the output's unit]"),
        Column("network", "1", "RMS of the network less the simulation; of the RMS error the difference"),
        Column("frozen", "1", "the same of the motion that is simulated with the original lengths in this design"),
    ),
    path="design_networks/errors.parquet",
)

DESIGN_NETWORKS_COSTS = Table(
    "design_networks_costs",
    "What the network cost",
    (
        Column("step", "", "simulate or train", "category"),
        Column("designs", "1", "simulated, or trained on", "int"),
        Column("failed", "1", "designs whose simulation failed, which are left out", "int"),
        Column("cpu_time", "s", "of this process, all of its threads"),
    ),
    path="design_networks/costs.parquet",
)

DESIGN_NETWORKS_TRAINING = Table(
    "design_networks_training",
    "How the training went",
    (
        Column("step", "1", "of L-BFGS, from 1", "int"),
        Column("loss", "1", "mean square error of the vectors, in clearances, and of the lift"),
    ),
    path="design_networks/training.parquet",
)

_WAY = Column(
    "way",
    "",
    "frozen (motion of the original lengths), networks, surrogate (of the error), simulation (CMA-ES on it)",
    "category",
)
_BUDGET = Column(
    "budget", "s", "CPU time allowed for each optimum; null where a way takes what it needs", nullable=True
)
_REPETITION = Column("repetition", "1", "from 0", "int")
_OPTIMUM = Column("optimum", "1", "number of the design whose best lengths are wanted, from 0", "int")


def _over_repetitions(name: str, unit: str, description: str) -> tuple[Column, ...]:
    return (
        Column(name, unit, f"{description}: mean over the repetitions"),
        Column(f"{name}_low", unit, f"{description}: smallest of the repetitions"),
        Column(f"{name}_high", unit, f"{description}: largest of the repetitions"),
    )


COMPARE_SEARCHES_OPTIMA = Table(
    "compare_searches_optima",
    "Every optimum that a way found, simulated again",
    (
        _WAY,
        _REPETITION,
        _BUDGET,
        _OPTIMUM,
        _CRANK,
        _ROD,
        Column("search_time", "s", "CPU time of this search"),
        Column(
            "learning_time", "s", "CPU time of simulating what was learned from, and of the training; of all optima"
        ),
        Column("cpu_time", "s", "CPU time for this optimum, the learning shared among all"),
        Column("simulations", "1", "of this search, or of what was learned from for all optima", "int"),
        Column("error", "rad", "simulated RMS error of the transmission angle"),
        Column("original_error", "rad", "the same with the original lengths"),
        Column("gain", "1", "by which share the error falls; negative where it grows"),
    ),
    path="compare_searches/optima.parquet",
)

COMPARE_SEARCHES_WANTED = Table(
    "compare_searches_wanted",
    "The designs whose best lengths are wanted",
    (
        _OPTIMUM,
        Column("parameter", "", "word or path, as in design_networks.parameters", "text"),
        Column("value", "1", "in SI"),
    ),
    path="compare_searches/wanted.parquet",
)

COMPARE_SEARCHES_SUMMARY = Table(
    "compare_searches_summary",
    "The four ways at each budget",
    (
        _WAY,
        _BUDGET,
        *_over_repetitions("gain", "1", "share by which the error falls, mean over the optima"),
        *_over_repetitions("share", "1", "the same as a share of the largest gain that any way found of an optimum"),
        *_over_repetitions("cpu_time", "s", "CPU time for each optimum"),
        *_over_repetitions("missed", "rad", "RMS of predicted less simulated error on held-out designs"),
        Column("simulations", "1", "for each optimum, what was learned from shared among all"),
    ),
    path="compare_searches/summary.parquet",
)

COMPARE_SEARCHES_PROGRESS = Table(
    "compare_searches_progress",
    "Searches by simulation, generation by generation",
    (
        _REPETITION,
        _OPTIMUM,
        Column("simulations", "1", "so far", "int"),
        Column("cpu_time", "s", "so far"),
        Column("error", "rad", "smallest so far"),
        Column("gain", "1", "by which share the error falls"),
    ),
    path="compare_searches/progress.parquet",
)

COMPARE_SEARCHES_BREAK_EVEN = Table(
    "compare_searches_break_even",
    "From which cost of a simulation on networks and surrogates are the cheaper way to the same gain",
    (
        _WAY,
        _BUDGET,
        _REPETITION,
        Column("against", "", "the way that it is held against: simulation or frozen", "category"),
        Column("optima", "1", "how many share what was learned", "int"),
        Column("gain", "1", "mean gain"),
        Column(
            "simulations",
            "1",
            "for each optimum that the other way takes to that gain, or the most it tried; null where it cannot",
            nullable=True,
        ),
        Column("cost", "s", "CPU time of a simulation from which on it pays; 0 at any, null at none", nullable=True),
    ),
    path="compare_searches/break_even.parquet",
)
