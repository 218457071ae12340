"""Tables of a campaign: what was measured, how noisy it is, where it disagrees with the model, and what came of it."""

from jointgap.tables.columns import Column, Table

_RUN = Column("run", "", "run of the campaign", "text")
_CHANNEL = Column("channel", "", "channel, or statistic of one where samples cannot be compared", "text")
_SAMPLE = Column("sample", "1", "place in the series, counted from 0", "int")
_LABEL = Column("label", "", "effect, with its site where there is a choice", "text")
_HELD_OUT = Column("held_out", "", "took no part in fitting or choosing", "bool")

MEASURED = Table(
    "measured",
    "Measured data in SI, one row a sample and channel",
    (
        _RUN,
        Column("channel", "", "channel", "text"),
        _SAMPLE,
        Column("time", "s", "time of the sample", nullable=True),
        Column(
            "crank_angle",
            "rad",
            "crank angle as measured, running on over revolutions; of a clockwise crank its mirror image",
            nullable=True,
        ),
        Column("value", "SI", "what the channel reads, in its SI unit; null where there is no datum", nullable=True),
        _HELD_OUT,
    ),
    path="measure/measured.parquet",
)

LOOK = Table(
    "look",
    "What measured data are like, by run and channel",
    (
        _RUN,
        Column("channel", "", "channel", "text"),
        Column("unit", "", "SI unit", "text"),
        Column("role", "", "identify, confirm or split", "text"),
        Column("samples", "1", "samples", "int"),
        Column("gaps", "1", "samples without a value", "int"),
        Column("cycles", "1", "whole revolutions", "int"),
        Column("samples_per_revolution", "1", "samples per revolution"),
        Column(
            "mean_speed", "rad/s", "mean speed of the crank; null unless time and angle were measured", nullable=True
        ),
        Column("speed_spread", "rad/s", "standard deviation of the cycles' speeds", nullable=True),
        Column("low", "SI", "smallest value"),
        Column("high", "SI", "largest value"),
        Column("scatter", "SI", "standard deviation of what does not repeat from cycle to cycle", nullable=True),
        Column("stated_noise", "SI", "standard deviation of the noise as stated", nullable=True),
    ),
    path="measure/look.parquet",
)

REMARKS = Table(
    "remarks",
    "What a reader of the results should know of the data",
    (Column("remark", "", "in a sentence", "text"),),
    path="measure/remarks.parquet",
)

CONTRADICTIONS = Table(
    "contradictions",
    "Channels whose readings cannot be those of this mechanism beside the other channels",
    (
        _RUN,
        Column("channel", "", "channel in doubt; time also where it may be the stated speed that is wrong", "text"),
        Column("other", "", "channel that it is swapped with; else empty", "text"),
        Column("kind", "", "sign, scale, phase, swapped, unrelated, clipped, stuck, no_data, time or speed", "text"),
        Column("factor", "1", "measured over expected", nullable=True),
        Column("phase", "rad", "how far the channel is ahead of what is expected", nullable=True),
        Column("doubtful", "", "the channel's readings are in doubt, not only the stated speed", "bool"),
        Column("remark", "", "in a sentence", "text"),
    ),
    path="measure/contradictions.parquet",
)

CONFIG_SNAPSHOT = Table(
    "config_snapshot",
    "What the campaign file stated when its data were read, in the order of the file",
    (
        Column("key", "", "key, with those above it", "text"),
        Column("value", "", "value as JSON, SI", "text"),
    ),
    path="measure/config_snapshot.parquet",
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
    path="{stage}/noise.parquet",
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
    path="{stage}/noise_memory.parquet",
)

NOISE_DRIVE = Table(
    "noise_drive",
    "What the errors of a measured angle that drives the crank change in the channels",
    (
        _RUN,
        _CHANNEL,
        _SAMPLE,
        Column("error", "1", "which of the independent errors, which all channels of the run share", "int"),
        Column("change", "SI", "by one standard deviation of it"),
    ),
    path="{stage}/noise_drive.parquet",
)

NOISE_TABLES = (NOISE, NOISE_MEMORY, NOISE_DRIVE)
"""Tables that together hold the noise."""

_STATISTICS = (
    Column("samples", "1", "residuals counted", "int"),
    Column("mean", "1", "mean residual, in standard deviations of the noise"),
    Column("rms", "1", "root mean square of the residual, in standard deviations of the noise"),
)
_SPAN = (
    Column("start_deg", "deg", "crank angle at which it begins"),
    Column("end_deg", "deg", "crank angle at which it ends; smaller than start_deg where 0 lies between"),
)
_ADJUSTED = Column(
    "p_adjusted", "1", "of the surest span of bins that holds it, adjusted for their number (Benjamini-Hochberg)"
)

MAP_BINS = Table(
    "map_bins",
    "Residual of the recalibrated base by run, channel and crank angle",
    (
        *(_RUN, _CHANNEL, *_SPAN, *_STATISTICS),
        Column("p", "1", "probability by noise alone"),
        _ADJUSTED,
        Column("flagged", "", "more than noise", "bool"),
    ),
    path="locate/bins.parquet",
)

MAP_WINDOWS = Table(
    "map_windows",
    "Where the recalibrated base disagrees with the measurement, the surest first",
    (_RUN, _CHANNEL, *_SPAN, *_STATISTICS[1:], _ADJUSTED),
    path="locate/windows.parquet",
)

MAP_TESTS = Table(
    "map_tests",
    "Residual of the recalibrated base by run and channel",
    (
        *(_RUN, _CHANNEL, _STATISTICS[0]),
        Column("chi2", "1", "sum of squared whitened residuals"),
        Column("p_chi2", "1", "probability of as much by noise alone"),
        Column("p_ljung_box", "1", "probability that independent numbers remember each other as much", nullable=True),
    ),
    path="locate/tests.parquet",
)

MAP_ORDERS = Table(
    "map_orders",
    "Spectrum of the whitened residual over orders of the crank",
    (
        *(_RUN, _CHANNEL),
        Column("order", "1", "cycles per revolution"),
        Column("amplitude", "1", "amplitude of the whitened residual", nullable=True),
        Column("p", "1", "probability by noise alone", nullable=True),
    ),
    path="locate/orders.parquet",
)

MAP_STANDOUT = Table(
    "map_standout",
    "Whole orders of the crank that hold most of what a channel of a run misses",
    (
        *(_RUN, _CHANNEL),
        Column("unit", "", "SI unit of the channel", "text"),
        Column("order", "1", "cycles per revolution", "int"),
        Column("amplitude", "SI", "amplitude, in the channel's unit"),
        Column("share", "1", "of the squared excess over the noise"),
        Column("p", "1", "probability by noise alone"),
    ),
    path="locate/standout.parquet",
)

MAP_SCALING = Table(
    "map_scaling",
    "How the disagreement of each channel grows with speed",
    (
        _CHANNEL,
        Column("exponent", "1", "of the speed", nullable=True),
        Column("low", "1", "lower end of its 90 % interval", nullable=True),
        Column("high", "1", "upper end of its 90 % interval", nullable=True),
        Column("runs", "1", "runs at different speeds", "int"),
    ),
    path="locate/scaling.parquet",
)

DETECTABLE = Table(
    "detectable",
    "Smallest size of every effect that a campaign would show",
    (
        _LABEL,
        Column("parameter", "", "parameter of the effect", "text"),
        Column(
            "smallest_detectable",
            "SI",
            "parameter at the smallest size found with 90 % probability; null if none is",
            nullable=True,
        ),
        Column("unit", "", "SI unit", "text"),
        Column("typical", "SI", "size that makes a whitened gap of 1.5", nullable=True),
        Column(
            "falls", "", "whether the effect shrinks as the parameter grows: it then shows up to that value", "bool"
        ),
        Column("detectable", "", "whether sizes within the bounds are", "bool"),
        Column("failed", "", "why the effect cannot be simulated; null where it can", "text", nullable=True),
        Column(
            "assumed",
            "",
            "noise that was assumed where none is stated, the same in all rows; separated by '; '",
            "text",
        ),
    ),
    path="preflight/detectable.parquet",
)

CONFUSABILITY = Table(
    "confusability",
    "How alike two effects look in the measured channels beside the nuisances",
    (
        Column("first", "", "effect", "text"),
        Column("second", "", "effect", "text"),
        Column("cosine", "1", "largest cosine between what the two can change", nullable=True),
        Column("merged", "", "whether the campaign cannot tell them apart", "bool"),
    ),
    path="preflight/confusability.parquet",
)

ADVICE = Table(
    "advice",
    "Further speeds and channels, the most helpful first",
    (
        Column("change", "", "what is added to the campaign", "text"),
        Column("newly_detectable", "", "effects that then show, separated by ', '", "text"),
        Column("separated", "", "pairs 'a | b' that are then told apart, separated by ', '", "text"),
        Column("gain", "1", "by how much the smallest detectable sizes shrink, median over effects", nullable=True),
    ),
    path="preflight/advice.parquet",
)

LOOK_ALIKES = Table(
    "look_alikes",
    "Joints that could be loose, each taken as true, and whether features of the cycle tell it from the others",
    (
        Column("true", "", "effect that is taken as true", "text"),
        Column("other", "", "effect that is searched beside it", "text"),
        Column("size", "SI", "size of the true one"),
        Column("unit", "", "SI unit", "text"),
        Column("lead_share", "1", "by how much less the other explains, as a part of what the true one does"),
        Column("alike", "", "whether the search would keep both", "bool"),
        Column("parted_by", "", "further channels that part the two, the best first, separated by ', '", "text"),
    ),
    path="preflight/look_alikes.parquet",
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
        Column("base", "SI", "predicted with no effect added, re-fitted unless nominal is enough"),
        Column(
            "augmented",
            "SI",
            "predicted with the effects of the verdict, or with the best explanation known where none is named; the "
            "base's where there is neither; null where they cannot be simulated",
            nullable=True,
        ),
        Column("whitened_base", "1", "whitened residual of the base"),
        Column("whitened_augmented", "1", "whitened residual with the effects", nullable=True),
        Column("spread", "SI", "standard deviation that noise and numerics give the sample"),
    ),
    path="confirm/residuals.parquet",
)

CHANNEL_ERRORS = Table(
    "channel_errors",
    "How far measured and predicted are apart in each channel's own unit, before and after the effect was added",
    (
        _RUN,
        Column("speed", "rad/s", "nominal speed of the crank"),
        _CHANNEL,
        _HELD_OUT,
        Column("samples", "1", "samples compared", "int"),
        Column("unit", "", "unit of the channel as the campaign file states it", "text"),
        Column("si_per_unit", "SI", "how much of the channel's SI unit one of these units is"),
        Column("noise", "as unit says", "root mean square of the noise's standard deviation, that of numerics with it"),
        Column("before", "as unit says", "root mean square of measured less predicted, no effect added"),
        Column(
            "after",
            "as unit says",
            "the same with the effects of the verdict, or with the best explanation known where none is named; before "
            "again where there is neither; null where they cannot be simulated",
            nullable=True,
        ),
    ),
    path="confirm/channel_errors.parquet",
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
    path="augment/force.parquet",
)

GAPS = Table(
    "gaps",
    "Gap between simulation and measurement by run and channel, before and after: 1 = noise",
    (
        Column("run", "", "run, or 'all'", "text"),
        Column("role", "", "identify or confirm", "text"),
        Column("channel", "", "channel, or 'all'", "text"),
        Column("samples", "1", "residuals counted", "int"),
        Column("before", "1", "root mean square of the whitened residual with no effect added"),
        Column(
            "after",
            "1",
            "the same with the effects of the verdict, or with the best explanation known where none is named; null "
            "where they cannot be simulated",
            nullable=True,
        ),
        *(
            Column(
                f"{when}_{end}", "1", f"{words} end of the 90 % bootstrap interval of {when}", nullable=when == "after"
            )
            for when in ("before", "after")
            for end, words in (("low", "lower"), ("high", "upper"))
        ),
        *(
            Column(f"fall_{end}", "1", f"{words} end of that of the fall of the squared gap", nullable=True)
            for end, words in (("low", "lower"), ("high", "upper"))
        ),
        Column(
            "fall_expected", "1", "mean square of what the effects change: the fall if they are true", nullable=True
        ),
        Column("closed", "1", "share of the excess closed, 1 - (after^2 - 1) / (before^2 - 1)", nullable=True),
        *(
            Column(
                f"features_{when}",
                "1",
                f"misfit of the features of the cycle {words} the effects, minus log likelihood: of held-out runs "
                "where a joint became loose, of all runs where features alone told it; else null",
                nullable=True,
            )
            for when, words in (("before", "without"), ("after", "with"))
        ),
        Column("remark", "", "why there is no gap after", "text", nullable=True),
    ),
    path="confirm/gaps.parquet",
)

OPTIMUM = Table(
    "campaign_optimum",
    "Optimal link lengths of the model before and after the effects were added",
    (
        Column("model", "", "base or augmented", "text"),
        Column("source", "", "where the search took the motion in the joints from", "text", nullable=True),
        Column("crank_length", "m", "L2 at the optimum", nullable=True),
        Column("rod_length", "m", "L3 at the optimum", nullable=True),
        Column(
            "at_edge",
            "",
            "whether the optimum lies at the edge of the lengths that were searched",
            "bool",
            nullable=True,
        ),
        Column(
            "reduction",
            "1",
            "by which share the RMS error of the transmission angle fell, motion frozen",
            nullable=True,
        ),
        Column("resimulated", "1", "the same, simulated again over a settled revolution", nullable=True),
        Column("rms_before", "rad", "RMS error of the transmission angle at the original lengths", nullable=True),
        Column("rms_after", "rad", "the same at the optimum", nullable=True),
        Column("failed", "", "why the model could not be optimised; else null", "text", nullable=True),
    ),
    path="reoptimise/optimum.parquet",
)
