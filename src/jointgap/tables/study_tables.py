"""Table of the study of clearance, speed and friction."""

from jointgap.tables.columns import Column, Table

ORDERS = 20
"""Orders of the slider's acceleration that are kept one by one."""

NOISE_ORDER = 10
"""Order from which on the slider's acceleration counts as noise: the ideal mechanism's has died away far below it."""

MEASURES = {
    "peak_force": ("N", "largest normal force in any loose joint"),
    "angle_error_rms": ("rad", "RMS of the ideal transmission angle less the simulated one"),
    "contact_share": ("1", "share of the time in which a journal touches its bearing, mean over the loose joints"),
    "acceleration_rms": ("m/s^2", "RMS of the slider's acceleration"),
    "noise_share": ("1", f"RMS of the slider's acceleration above order {NOISE_ORDER}, over its whole RMS"),
    "jerk_rms": ("m/s^3", "RMS of the slider's jerk"),
}
"""What is measured at each point, over the settled revolutions: unit and meaning."""

STUDY = Table(
    "study",
    "Map of clearance, speed and friction: what the settled motion comes to, from several starts",
    (
        Column("clearance", "m", "radial clearance of every loose joint"),
        Column("speed", "rad/s", "crank speed"),
        Column("friction", "1", "friction coefficient of every loose joint"),
        *(
            Column(name + suffix, unit, f"{meaning}; {which} over the starts", nullable=True)
            for name, (unit, meaning) in MEASURES.items()
            for suffix, which in (("", "median"), ("_low", "smallest"), ("_high", "largest"))
        ),
        *(
            Column(f"order_{k}", "m/s^2", f"amplitude of the slider's acceleration at order {k}; median", nullable=True)
            for k in range(1, ORDERS + 1)
        ),
        Column(
            "growth",
            "1",
            "factor by which a small change of the start has grown in the last revolution (RMS; median over the "
            "starts)",
            nullable=True,
        ),
        Column(
            "sensitive",
            "",
            "the small change has grown beyond a thousandth of the clearance (chaos, or not yet settled): only "
            "statistics hold",
            "bool",
        ),
        Column("failed", "1", "starts whose simulation failed", "int"),
        Column("reason", "", "why the first of them failed", "text", nullable=True),
    ),
)
