"""Table of the stage figures: what a figure shows, point by point."""

from jointgap.tables.columns import Column, Table

PLOTTED = Table(
    "plotted",
    "What a figure shows, one row a point, in the units of its axes",
    (
        Column("panel", "", "title of the panel", "text"),
        Column("series", "", "name of the curve, the marks or the line in the legend", "text"),
        Column("x", "as x_unit says", "abscissa; null for a level across the panel", nullable=True),
        Column(
            "y",
            "as y_unit says",
            "ordinate; null where undefined (a gap in the curve) and for an upright line",
            nullable=True,
        ),
        Column("low", "as its axis says", "lower end of a bar of spread; null without one", nullable=True),
        Column("high", "as its axis says", "upper end of a bar of spread; null without one", nullable=True),
        Column("value", "as value_unit says", "what colours or contour lines show; null without", nullable=True),
        Column("label", "", "name of a category or of a point; null without", "text", nullable=True),
        Column("x_quantity", "", "quantity of the abscissa", "text"),
        Column("x_unit", "", "its unit", "text"),
        Column("y_quantity", "", "quantity of the ordinate", "text"),
        Column("y_unit", "", "its unit", "text"),
        Column("value_quantity", "", "quantity of the column value; null without", "text", nullable=True),
        Column("value_unit", "", "its unit; null without", "text", nullable=True),
    ),
)
