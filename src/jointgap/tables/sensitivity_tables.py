"""Tables of what decides: Sobol indices of a sweep's measures, their surrogates, and main effects."""

from jointgap.tables.columns import Column, Table

_MEASURE = Column("measure", "", "column of the sweep's designs", "text")
_PARAMETER = Column("parameter", "", "parameter of the sweep", "text")

SENSITIVITY_SURROGATES = Table(
    "sensitivity_surrogates",
    "Surrogates of a sweep's measures, a row a measure: how well each predicts designs that it was not trained on",
    (
        _MEASURE,
        Column("kind", "", "chaos expansion or Gaussian process; null where none was made", "text", nullable=True),
        Column("terms", "1", "terms that it is written in, the constant included; 0 where none was made", "int"),
        Column("trained", "1", "designs that it was trained on; 0 where none was made", "int"),
        Column("held_out", "1", "designs that it was not trained on, and is judged by", "int"),
        Column("failed", "1", "designs that failed", "int"),
        Column("undefined", "1", "designs that did not fail but have no such measure", "int"),
        Column(
            "q2",
            "1",
            "share of the variance that the surrogate explains on the held-out designs: 1 less the mean squared error "
            "over the variance",
            nullable=True,
        ),
        Column("q2_low", "1", "lower end of its 90 % interval", nullable=True),
        Column("q2_high", "1", "upper end of its 90 % interval", nullable=True),
        Column("mean", "1", "mean of the designs that have the measure, in its unit", nullable=True),
        Column("deviation", "1", "standard deviation of these designs, in its unit", nullable=True),
        Column("unit", "", "SI unit of the measure", "text"),
        Column("reason", "", "why the measure has no indices; null where it has", "text", nullable=True),
    ),
    "sensitivity/surrogates.parquet",
)

SENSITIVITY_INDICES = Table(
    "sensitivity_indices",
    "Sobol indices of a sweep's measures, a row a measure and parameter; measures with a poor surrogate have none",
    (
        _MEASURE,
        _PARAMETER,
        *(
            column
            for name, meaning in {
                "first_order": "share of the measure's variance that the parameter decides alone",
                "total": "share of the variance that it takes part in, alone or together with others",
            }.items()
            for column in (
                Column(name, "1", meaning),
                Column(f"{name}_low", "1", f"{name}: lower end of an interval that holds it in 90 % of cases or more"),
                Column(f"{name}_high", "1", f"{name}: upper end of that interval"),
            )
        ),
    ),
    "sensitivity/indices.parquet",
)

SENSITIVITY_EFFECTS = Table(
    "sensitivity_effects",
    "Main effects: mean of a measure where one parameter has a value and the others vary as in the sweep",
    (
        _MEASURE,
        _PARAMETER,
        Column("value", "1", "the parameter's value in its unit; null where it is a word", nullable=True),
        Column("word", "", "its value where it is a word, true or false", "text", nullable=True),
        Column("value_unit", "", "SI unit of the parameter", "text"),
        Column("effect", "1", "mean of the measure there in its unit, from the surrogate"),
        Column("effect_low", "1", "lower end of its 90 % interval, of the surrogate's training alone"),
        Column("effect_high", "1", "upper end of that interval"),
        Column("unit", "", "SI unit of the measure", "text"),
    ),
    "sensitivity/main_effects.parquet",
)

SENSITIVITY_TABLES = (SENSITIVITY_SURROGATES, SENSITIVITY_INDICES, SENSITIVITY_EFFECTS)
"""All of them."""
