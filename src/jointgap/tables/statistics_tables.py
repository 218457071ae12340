"""Tables of statistics over revolutions."""

from jointgap.tables.columns import Column, Table

_JOINT = Column("joint", "", "crank_pin, piston_pin or crank_pivot", "text")
_REVOLUTION = Column("revolution", "1", "number of the revolution, from 1", "int")
_ANGLE = Column("crank_angle", "rad", "crank angle theta2, running on over revolutions")

POINCARE_SECTION = Table(
    "poincare_section",
    "State of the joints at one crank angle of every revolution",
    (
        _JOINT,
        _REVOLUTION,
        _ANGLE,
        Column("x", "m", "clearance vector, x"),
        Column("y", "m", "clearance vector, y"),
        Column("x_dot", "m/s", "first time derivative of x; null where the centres coincide", nullable=True),
        Column("y_dot", "m/s", "first time derivative of y; null where the centres coincide", nullable=True),
    ),
)

JOINT_REVOLUTIONS = Table(
    "joint_revolutions",
    "What each loose joint does in each revolution",
    (
        _REVOLUTION,
        _JOINT,
        Column("share_flight", "1", "share of the revolution's time in flight"),
        Column("share_impact", "1", "share of the time in impacts: contacts whose penetration has one maximum at most"),
        Column("share_contact", "1", "share of the time in lasting contact"),
        Column("contacts", "1", "contacts that begin in the revolution", "int"),
        Column("largest_approach_speed", "m/s", "largest speed of approach of these; null without any", nullable=True),
        Column(
            "largest_impulse", "N*s", "largest impulse of those that end in it too; null without any", nullable=True
        ),
        Column(
            "peak_force",
            "N",
            "largest normal force: at samples, and between them in contacts that begin and end in the revolution",
        ),
    ),
)

IMPACT_DISTRIBUTION = Table(
    "impact_distribution",
    "How speeds, impulses and forces of contacts are distributed over the settled revolutions; null without any "
    "contact",
    (
        _JOINT,
        Column("quantity", "", "approach_speed [m/s], impulse [N s] or peak_force [N]", "text"),
        Column("per_revolution", "1", "contacts with this quantity per revolution"),
        Column("mean", "SI", "mean", nullable=True),
        Column("low", "SI", "5 % quantile", nullable=True),
        Column("median", "SI", "median", nullable=True),
        Column("high", "SI", "95 % quantile", nullable=True),
        Column("largest", "SI", "largest", nullable=True),
    ),
)

ECCENTRICITY = Table(
    "eccentricity",
    "Distance of the centres in each loose joint over the settled revolutions, by crank angle",
    (
        _JOINT,
        Column("crank_angle", "rad", "crank angle theta2 of the first revolution"),
        Column("mean", "m", "mean over the revolutions"),
        Column("low", "m", "5 % quantile"),
        Column("high", "m", "95 % quantile"),
    ),
)
