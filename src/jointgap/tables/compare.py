"""The table of the stage compare."""

from jointgap.tables.columns import Column, Table

COMPARISON = Table(
    "comparison",
    "Every number that the paper prints and every claim it makes, beside ours",
    (
        Column("kind", "", "number or claim", "text"),
        Column("item", "", "what is compared", "text"),
        Column("unit", "", "unit of paper and ours; empty where there is no number", "text"),
        Column("paper", "see unit", "the paper's value; null where it gives none", nullable=True),
        Column("ours", "see unit", "ours; null where it cannot be told", nullable=True),
        Column("ratio", "1", "ours / paper", nullable=True),
        Column(
            "verdict",
            "",
            "training errors: reached (at or below the paper's) or missed; other numbers: agrees or differs; claims: holds, does not hold, cannot be told",
            "text",
        ),
        Column("sentence", "", "what the number is, and where it differs why", "text"),
    ),
)
