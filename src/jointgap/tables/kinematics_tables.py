"""Tables of the stage kinematics."""

from jointgap.tables.columns import Column, Table

_UNDEFINED = "; null where the source leaves it undefined"

# Quantities that the equations deliver, named as in the trajectory: (column, unit, description).
QUANTITIES = (
    ("rod_position_x", "m", "mass centre of the rod, x, equation (3)"),
    ("rod_position_y", "m", "mass centre of the rod, y, equation (3)"),
    ("rod_velocity_x", "m/s", "velocity of the rod's mass centre, x, equation (6)"),
    ("rod_velocity_y", "m/s", "velocity of the rod's mass centre, y, equation (6)"),
    ("rod_acceleration_x", "m/s^2", "acceleration of the rod's mass centre, x, equation (7)"),
    ("rod_acceleration_y", "m/s^2", "acceleration of the rod's mass centre, y, equation (7)"),
    ("rod_angle", "rad", "angle theta3 of the rod, equation (5)"),
    ("rod_angular_velocity", "rad/s", "first time derivative of the rod angle, equation (8)"),
    ("rod_angular_acceleration", "rad/s^2", "second time derivative of the rod angle, equation (9)"),
    ("slider_position", "m", "position of the slider's pin along x, equation (4)"),
    ("slider_velocity", "m/s", "velocity of the slider, equation (6)"),
    ("slider_acceleration", "m/s^2", "acceleration of the slider, equation (7)"),
    ("transmission_angle", "rad", "transmission angle mu, equation (10)"),
)

_REGION = Column("region", "", "first_revolution, or past_60_deg of it", "text")

KINEMATICS = Table(
    "kinematics",
    "Motion of rod and slider over the first revolution, from the equations and from the simulation itself",
    (
        Column(
            "source",
            "",
            "simulation (its own values), ideal (no clearance), simulation_exact and simulation_paper_form (equations "
            "fed by "
            "the simulation, with the derivatives of r and without), NAME_paper_form, NAME_exact (fed by a surrogate), "
            "NAME_own_rates, NAME_integrated (rates of gamma as derivatives, gamma as integrals of its fits)",
            "text",
        ),
        Column("crank_angle", "rad", "crank angle theta2"),
        *(Column(name, unit, f"{description}{_UNDEFINED}", nullable=True) for name, unit, description in QUANTITIES),
    ),
    path="kinematics/motion.parquet",
)

KINEMATICS_ERRORS = Table(
    "kinematics_errors",
    "How far each source is from the simulation, over held-out samples of the first revolution",
    (
        Column("source", "", "source of the table kinematics", "text"),
        Column("quantity", "", "column of the table kinematics", "text"),
        Column("unit", "", "unit of rms, peak and range", "text"),
        _REGION,
        Column("rms", "see unit", "root mean square difference from the simulation"),
        Column("peak", "see unit", "largest difference from the simulation"),
        Column("range", "see unit", "largest less smallest value of the simulation in the region"),
        Column("rms_over_range", "1", "rms / range"),
        Column("rms_over_ideal", "1", "rms over that of the mechanism without clearance: below 1 the source helps"),
        Column("samples", "1", "samples compared", "int"),
    ),
    path="kinematics/errors.parquet",
)

KINEMATICS_CONTRADICTIONS = Table(
    "kinematics_contradictions",
    "How far independently learned outputs contradict each other, and what that does to the slider",
    (
        Column("surrogate", "", "which fits", "text"),
        Column("quantity", "", "quantity on which the two ways differ", "text"),
        Column("unit", "", "unit of rms, peak and range", "text"),
        Column("one_way", "", "first way to get it", "text"),
        Column("other_way", "", "second way to get it", "text"),
        _REGION,
        Column("rms", "see unit", "root mean square difference of the two"),
        Column("peak", "see unit", "largest difference of the two"),
        Column("range", "see unit", "largest less smallest value of the simulation in the region"),
        Column("rms_over_range", "1", "rms / range"),
        Column("samples", "1", "samples compared", "int"),
    ),
    path="kinematics/contradictions.parquet",
)
