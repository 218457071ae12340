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
