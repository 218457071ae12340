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
        Names of the tables it needs.
    """

    title: str
    category: str
    function: str
    tables: tuple[str, ...]


_MOTION, _CONTACT = "Motion", "Contact"

CATALOGUE = {
    "figure_09": FigureSpec("Figure 9: rod, position", _MOTION, "motion:rod_position", ("kinematics",)),
    "figure_10": FigureSpec("Figure 10: rod, velocity", _MOTION, "motion:rod_velocity", ("kinematics",)),
    "figure_11": FigureSpec("Figure 11: rod, acceleration", _MOTION, "motion:rod_acceleration", ("kinematics",)),
    "figure_12": FigureSpec("Figure 12: piston, position", _MOTION, "motion:piston_position", ("kinematics",)),
    "figure_13": FigureSpec("Figure 13: piston, velocity", _MOTION, "motion:piston_velocity", ("kinematics",)),
    "figure_14": FigureSpec("Figure 14: piston, acceleration", _MOTION, "motion:piston_acceleration", ("kinematics",)),
    "figure_15": FigureSpec("Figure 15: transmission angle", _MOTION, "motion:transmission_angle", ("kinematics",)),
    "orbits": FigureSpec("Orbits of the journals", _CONTACT, "contact:orbits", ("trajectory",)),
    "contact_forces": FigureSpec("Contact forces", _CONTACT, "contact:contact_forces", ("trajectory",)),
}
"""The still figures by name: saved as SVG and PNG."""

FIGURES = tuple(CATALOGUE)

ANIMATION = FigureSpec("The mechanism in motion", _CONTACT, "animation:animation", ("trajectory",))
"""The animation of the first revolution, named ``animation``: saved as GIF."""
