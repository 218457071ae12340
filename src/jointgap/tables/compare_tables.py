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
            "training errors: reached (at or below the paper's) or missed; other numbers: agrees or differs; claims: "
            "holds, does not hold, cannot be told",
            "text",
        ),
        Column("sentence", "", "what the number is, and where it differs why", "text"),
    ),
    path="comparison.parquet",
)

OVERVIEW = Table(
    "overview",
    "The scenarios side by side: what they assume, the optimum, and what it is worth simulated again",
    (
        Column("scenario", "", "name of the scenario", "text"),
        Column(
            "loose",
            "",
            "loose joints from the frame to the slider, each with the body that carries its journal",
            "text",
        ),
        Column("drive", "", "what turns the crank: constant, measured or motor", "text"),
        Column("friction", "1", "coefficient of friction in the loose joints, the largest"),
        Column("window_start", "rad", "crank angle after the start from which the error counts"),
        Column("window_end", "rad", "crank angle after the start up to which the error counts"),
        Column("judged", "1", "outputs for which the paper has a training MSE", "int"),
        Column("training_reached", "1", "networks of these whose training MSE is at or below the paper's", "int"),
        Column("held_out_reached", "1", "networks of these whose held-out MSE is at or below the paper's", "int"),
        Column("second_reached", "1", "of these, outputs whose held-out MSE, second surrogate, is so", "int"),
        Column("printed", "1", "numbers besides that the paper prints and that are held against ours", "int"),
        Column("printed_agree", "1", "of these, how many agree", "int"),
        Column("crank_length", "m", "L2 that the genetic algorithm finds on the networks, main box"),
        Column("rod_length", "m", "L3 there"),
        Column("networks_reduction", "1", "RMS reduction over the window, clearance motion frozen, from the networks"),
        Column("simulation_reduction", "1", "RMS reduction there, frozen, from the simulation"),
        *(
            Column(f"{stretch}_reduction{end}", "1", f"RMS reduction simulated again over {words}, {what}")
            for stretch, words in (("window", "the window"), ("settled", "a whole settled revolution"))
            for end, what in (("", "median"), ("_low", "5 % quantile"), ("_high", "95 % quantile"))
        ),
        Column(
            "family",
            "",
            "first of the scenarios that differ from this one in their loose joints alone, if at all",
            "text",
        ),
        Column("loose_joints", "1", "how many joints are loose", "int"),
        *(
            Column(
                f"found_{name}", unit, f"{words}, at the lengths found on the simulation's own motion, simulated again"
            )
            for name, unit, words in (
                ("reduction", "1", "RMS reduction over the window, median"),
                ("low", "1", "RMS reduction over the window, 5 % quantile"),
                ("high", "1", "RMS reduction over the window, 95 % quantile"),
                ("settled", "1", "RMS reduction over a whole settled revolution, median"),
                ("original_error", "rad", "RMS error over the window at the original lengths"),
                ("error", "rad", "RMS error over the window"),
            )
        ),
    ),
    path="overview.parquet",
)
