"""Every figure: its title, where the report files it, and which tables it needs. Imports nothing heavy."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FigureSpec:
    """One figure of a scenario.

    Attributes
    ----------
    title : str
        For lists of figures.
    category : str
        Section of the report.
    function : str
        ``module:function`` within `jointgap.figures`, tables and scenario in, `Drawing` out.
    tables : tuple of str
        Names of the tables it needs; ``predictions`` is the frame that `jointgap.figures.figure_data.predictions` makes of the
        fits, ``fit_history`` and ``fit_errors`` are those of all outputs below each other, with a column ``output``.
    """

    title: str
    category: str
    function: str
    tables: tuple[str, ...]


_NETWORKS, _MOTION, _CONTACT, _OPTIMUM = "Networks", "Motion", "Contact", "Optimum"
_LEARNED = ("trajectory", "predictions")

CATALOGUE = {
    "figure_05": FigureSpec("Figure 5: clearances", _NETWORKS, "output_figures:clearances", _LEARNED),
    "figure_06": FigureSpec("Figure 6: directions", _NETWORKS, "output_figures:directions", _LEARNED),
    "figure_07": FigureSpec("Figure 7: derivatives", _NETWORKS, "output_figures:derivatives", _LEARNED),
    "figure_08": FigureSpec("Figure 8: MSE", _NETWORKS, "training_figures:mse_curves", ("fit_history", "fit_errors")),
    "figure_09": FigureSpec("Figure 9: rod, position", _MOTION, "motion_figures:rod_position", ("kinematics",)),
    "figure_10": FigureSpec("Figure 10: rod, velocity", _MOTION, "motion_figures:rod_velocity", ("kinematics",)),
    "figure_11": FigureSpec(
        "Figure 11: rod, acceleration", _MOTION, "motion_figures:rod_acceleration", ("kinematics",)
    ),
    "figure_12": FigureSpec("Figure 12: piston, position", _MOTION, "motion_figures:piston_position", ("kinematics",)),
    "figure_13": FigureSpec("Figure 13: piston, velocity", _MOTION, "motion_figures:piston_velocity", ("kinematics",)),
    "figure_14": FigureSpec(
        "Figure 14: piston, acceleration", _MOTION, "motion_figures:piston_acceleration", ("kinematics",)
    ),
    "figure_15": FigureSpec(
        "Figure 15: transmission angle", _MOTION, "motion_figures:transmission_angle", ("kinematics",)
    ),
    "figure_16": FigureSpec(
        "Figure 16: errors of the transmission angle",
        _OPTIMUM,
        "transmission_figures:transmission_errors",
        (*_LEARNED, "optimise_optima"),
    ),
    "held_out": FigureSpec(
        "Errors between the training points", _NETWORKS, "training_figures:held_out", ("fit_errors",)
    ),
    "contradictions": FigureSpec(
        "Networks that contradict each other",
        _NETWORKS,
        "contradiction_figures:contradictions",
        (*_LEARNED, "kinematics"),
    ),
    "valley": FigureSpec(
        "The valley of the objective",
        _OPTIMUM,
        "optimum_figures:valley",
        ("optimise_valley", "optimise_floor", "optimise_paths", "optimise_population", "optimise_optima"),
    ),
    "resimulation": FigureSpec(
        "Frozen and true reductions", _OPTIMUM, "optimum_figures:resimulation", ("optimise_resimulated",)
    ),
    "orbits": FigureSpec("Orbits of the journals", _CONTACT, "contact_figures:orbits", ("trajectory",)),
    "contact_forces": FigureSpec(
        "Contact forces and modes", _CONTACT, "contact_figures:contact_forces", ("trajectory",)
    ),
    "impacts": FigureSpec("Impacts", _CONTACT, "contact_figures:impacts", ("trajectory", "events")),
    "drive_and_guide": FigureSpec("Drive and guide", _CONTACT, "contact_figures:drive_and_guide", ("trajectory",)),
}
"""The still figures by name: saved as SVG and PNG."""

FIGURES = tuple(CATALOGUE)

ANIMATION = FigureSpec("The mechanism in motion", _CONTACT, "animation:animation", ("trajectory",))
"""The animation of the first revolution, named ``animation``: saved as GIF."""
