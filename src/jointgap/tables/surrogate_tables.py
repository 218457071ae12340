"""Tables of the stage surrogate: weights of the fits, their errors, and how the errors fell."""

from jointgap.tables.columns import Column, Table

_SCALING = (
    Column("input_min", "rad", "crank angle that is 0 at the network's input"),
    Column("input_max", "rad", "crank angle that is 1 at the network's input"),
)

_MODEL = Column("model", "", "network (the paper's) or regularised (whose errors hold between its points)", "text")

FIT = Table(
    "fit",
    "Weights of the networks of one output, one row a weight; the paper's come first, of these the default seed",
    (
        _MODEL,
        Column("seed", "1", "seed of the start", "int"),
        Column("layer", "1", "layer, from 0; the last one is linear, the others tansig", "int"),
        Column("neuron", "1", "neuron that the weight belongs to, from 0", "int"),
        Column("source", "1", "neuron of the layer before (the input of layer 0) that is weighted; -1: bias", "int"),
        Column("weight", "1", "weight or bias, on data scaled to [0, 1]"),
        *_SCALING,
        Column("output_min", "as the output", "value of the output where the network gives 0"),
        Column("output_max", "as the output", "value of the output where the network gives 1"),
    ),
    path="surrogate/{output}/fit.parquet",
)

FIT_HISTORY = Table(
    "fit_history",
    "Mean square error at the training points after every Levenberg-Marquardt iteration",
    (
        _MODEL,
        Column("seed", "1", "seed of the start", "int"),
        Column("iteration", "1", "iterations done; 0: the start", "int"),
        Column("mse", "1", "mean square error at the training points, on data scaled to [0, 1]"),
        Column(
            "held_out_mse",
            "1",
            "the same at the samples held out, looked at afterwards; of the paper's networks null but for some "
            "iterations, and the last",
            nullable=True,
        ),
    ),
    path="surrogate/{output}/history.parquet",
)

FIT_ERRORS = Table(
    "fit_errors",
    "Errors of the fits of one output; every mean square error is scaled by the range of the 361 (or configured) "
    "training points of the network",
    (
        Column("output", "", "output", "text"),
        Column("unit", "", "its unit", "text"),
        Column(
            "model",
            "",
            "network (the paper's), regularised (whose errors hold between its points), clearance (the consistent set)",
            "text",
        ),
        Column("seed", "1", "seed of the start; null for a fit without chance", "int", nullable=True),
        Column("region", "", "all (first revolution) or past_60_deg (its part past 60 deg)", "text"),
        Column("weights", "1", "weights that were trained", "int"),
        Column("training_points", "1", "points trained at, in the region", "int"),
        Column("held_out_points", "1", "samples held out, in the region", "int"),
        Column("undefined_points", "1", "samples of the region left out because the output is undefined there", "int"),
        Column("range", "as unit", "largest minus smallest value at the network's training points: scales the errors"),
        Column(
            "training_mse",
            "1",
            "mean square error over the training points of the region (clearance: dense where motion is quick; "
            "regularised: each point counts for the part of the revolution it stands for, held out too)",
        ),
        Column("held_out_mse", "1", "mean square error over the samples held out"),
        Column("paper_mse", "1", "the paper's, at its training points; null where it has none", nullable=True),
        Column("spline_held_out_mse", "1", "as held_out_mse, of the cubic spline through the same training points"),
        Column(
            "smoothing_spline_held_out_mse",
            "1",
            "as held_out_mse, of the smoothing spline of the same training points, its strength by cross-validation; "
            "null where there are few, and for clearance",
            nullable=True,
        ),
        Column("held_out_peak", "1", "largest error over the samples held out, over the range"),
        Column("training_rms", "as unit", "root mean square error over the training points"),
        Column("held_out_rms", "as unit", "root mean square error over the samples held out"),
        Column("spline_held_out_rms", "as unit", "as held_out_rms, of the spline"),
        Column("training_mse_over_variance", "1", "mean square error over the variance, training points"),
        Column("held_out_mse_over_variance", "1", "mean square error over the variance, samples held out"),
        Column("spline_held_out_mse_over_variance", "1", "as held_out_mse_over_variance, of the spline"),
        Column("iterations", "1", "iterations done", "int"),
        Column("stop", "", "why training stopped, and what to do", "text"),
        Column(
            "iterations_to_paper",
            "1",
            "iterations until the training error was the paper's; null if it never was",
            "int",
            nullable=True,
        ),
        Column("held_out_mse_at_paper", "1", "held_out_mse of the network as it was then", nullable=True),
    ),
    path="surrogate/{output}/errors.parquet",
)

CLEARANCE_FIT = Table(
    "clearance_fit",
    "Second surrogate: one layer of tansig neurons per joint with the clearance vector as its output, one row a neuron",
    (
        Column("joint", "1", "1 crank pivot, 2 crank pin, 3 piston pin", "int"),
        Column("neuron", "1", "neuron, from 0 along the crank angle; -1: bias of the output", "int"),
        Column("centre", "rad", "crank angle at which the neuron gives 0; null for the bias", nullable=True),
        Column("width", "rad", "1 / input weight; null for the bias", nullable=True),
        Column("weight_x", "m", "output weight, x"),
        Column("weight_y", "m", "output weight, y"),
        Column("start_angle", "rad", "crank angle at the start of the motion"),
        Column(
            "settling",
            "rad",
            "width of the factor tanh^2((angle - start_angle) / settling) that the output is multiplied by; null for "
            "none",
            nullable=True,
        ),
        Column(
            "speed",
            "rad/s",
            "speed of the crank, that turns derivatives by the angle into time derivatives; null where it is not "
            "constant: see the trajectory",
            nullable=True,
        ),
        Column("turns", "1", "whole turns to add to gamma", "int"),
    ),
    path="surrogate/clearance/fit.parquet",
)
