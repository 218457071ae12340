"""Tables of a trend: sizes of effects and clearances over campaigns of one rig on several dates."""

from jointgap.tables.columns import Column, Table

_LABEL = Column("label", "", "effect, with its site where there is a choice; of a nuisance its key", "text")
_PARAMETER = Column("parameter", "", "parameter that is the size; of a nuisance its key", "text")
_UNIT = Column("unit", "", "SI unit of the size", "text")

TREND = Table(
    "trend",
    "Size of what campaigns of one rig found, by date; one row a size and campaign",
    (
        *(_LABEL, _PARAMETER, _UNIT),
        Column("campaign", "", "name of the campaign", "text"),
        Column("date", "", "day of the measurement, ISO 8601", "text"),
        Column("days", "d", "days since the first campaign", "int"),
        Column("source", "", "named, certain (of an ambiguous verdict) or nuisance; empty without a size", "text"),
        Column("value", "SI", "size; null where the campaign found none", nullable=True),
        *(
            Column(f"{end}_{level}", "SI", f"{words} end of the {level} % interval", nullable=True)
            for level in (50, 90, 99)
            for end, words in (("low", "lower"), ("high", "upper"))
        ),
        Column("counts", "", "whether it counts in the growth", "bool"),
        Column("reason", "", "why it does not; else empty", "text"),
        Column(
            "smallest_detectable",
            "SI",
            "where it found none, the size that it would have shown with 90 % probability; null where not known",
            nullable=True,
        ),
    ),
    path="trend.parquet",
)

TREND_GROWTH = Table(
    "trend_growth",
    "How fast each size of a trend grows: a straight line over the dates",
    (
        *(_LABEL, _PARAMETER, _UNIT),
        Column("growth", "", "grew, shrank, no growth or too few dates", "text"),
        Column("dates", "1", "different dates that count", "int"),
        Column("rate", "SI/d", "growth per day; null with too few dates", nullable=True),
        Column("rate_low", "SI/d", "lower end of its 90 % interval", nullable=True),
        Column("rate_high", "SI/d", "upper end of its 90 % interval", nullable=True),
        Column("first_value", "SI", "the line on the day of the first campaign", nullable=True),
        Column("p", "1", "probability of as large a rate, either way, where nothing grows", nullable=True),
        Column(
            "error_scale",
            "1",
            "by how much errors were widened, since sizes scatter about the line more than their intervals say",
            nullable=True,
        ),
    ),
    path="trend_growth.parquet",
)
