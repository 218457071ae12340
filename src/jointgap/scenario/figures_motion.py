"""Figures of motion and contact."""

from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Joint, Scenario
from jointgap.core.joints import JOINT, JOINT_NUMBERS
from jointgap.core.plot import COLOURS, CRANK_ANGLE, IMPACTS_DWARF, Drawing, Panel, Quantity, Sheet, round_up
from jointgap.core.words import in_words
from jointgap.scenario.figures_base import (
    CONTACT_PART,
    FIGURES,
    MOTION_PART,
    Tables,
    by_source,
    degrees,
    figure,
    first_and_settled,
    loose_joints,
    round_number,
)

_NETWORKS = "networks_paper_form"
"""Source of what the networks predict, which is not there where none were trained."""


def _compare(
    columns: dict[str, str], name: str, unit: str, factor: float, tables: Tables, scenario: Scenario
) -> Drawing:
    """Desired and actual above, their difference below: a column of panels for each of the `columns` of the table
    kinematics, which come with their titles.
    """
    sources = by_source(tables)
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(columns))
    for place, (column, title) in enumerate(columns.items()):
        values = {source: factor * frame[column].to_numpy() for source, frame in sources.items()}
        desired = values["ideal"]
        actual = {"with clearance: simulation": (values["simulation"], "simulation", 0.9)}
        if _NETWORKS in values:  # below the simulation's
            actual = {"with clearance: networks": (values[_NETWORKS], "network", 0.8)} | actual
        above = sheet.panel((0, place), title, CRANK_ANGLE, Quantity(name, unit))
        below = sheet.panel((1, place), "deviation", CRANK_ANGLE, Quantity("actual − desired", unit), below=above)
        for panel, less in ((above, 0.0), (below, desired)):
            for series, (shown, colour, width) in actual.items():
                panel.line(series, angle, shown - less, colour, linewidth=width)
            _spread_scale(panel, desired, np.concatenate([shown - less for shown, _, _ in actual.values()]))
        above.line("without clearance (desired)", angle, desired, "ideal", linestyle="--", linewidth=1.1)
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


def _spread_scale(panel: Panel, desired: np.ndarray, shown: np.ndarray) -> None:
    """A scale linear up to the desired motion's peak and logarithmic beyond, where impacts dwarf the motion."""
    peak = np.max(np.abs(desired))
    if np.nanmax(np.abs(shown)) > IMPACTS_DWARF * peak:
        panel.linear_then_logarithmic(round_up(peak))


_BODIES = {
    "rod": ("rod", {f"rod_{{}}_{axis}": f"rod's mass centre, {axis}" for axis in "xy"}),
    "piston": ("piston", {"slider_{}": "piston"}),
}
_ORDERS = {"position": ("mm", 1e3), "velocity": ("m/s", 1.0), "acceleration": ("m/s²", 1.0)}
_ABOUT = {  # what the figures of positions, velocities and accelerations show besides
    ("rod", "position"): "The deviation stays within about one clearance.",
    ("rod", "velocity"): "Steps are impacts, most of them early in the revolution. The paper's equations take the "
    "clearance as constant, so the networks cannot follow the free flight at the start.",
    ("rod", "acceleration"): "Impacts exceed the desired acceleration many times. In free flight the rod has nearly no "
    "acceleration; the paper's equations, which neglect derivatives of the clearance, differ there.",
    ("piston", "position"): "The deviation reaches plus and minus the sum of all clearances, because they align with "
    "the rod at load reversal.",
    (
        "piston",
        "velocity",
    ): "Deviations are largest at the start, where the piston flies freely, and at load reversals.",
    ("piston", "acceleration"): "Zero acceleration is free flight, spikes are impacts; in contact the journal "
    "oscillates along its bearing's wall.",
}
for _number, ((_body, _order), _about) in enumerate(_ABOUT.items(), 9):
    _columns = {column.format(_order): title for column, title in _BODIES[_body][1].items()}
    FIGURES.figure(
        f"figure_{_number:02}",
        f"{_order.capitalize()} of the {_body} (the paper's figure {_number})",
        MOTION_PART,
        ("kinematics",),
        "First revolution. Top: without clearance (desired, dashed), simulated with clearance, and from the paper's "
        f"equations with the networks. Bottom: deviation from the desired {_order}. {_about}",
        call=f"{_body}_{_order}",
    )(partial(_compare, _columns, _order, *_ORDERS[_order]))

FIGURES.figure(
    "figure_15",
    "Transmission angle (the paper's figure 15)",
    MOTION_PART,
    ("kinematics",),
    "First revolution. Top: angle between the rod and the normal to the slide. Bottom: actual minus desired, the error "
    "that the optimisation minimises; it is small compared with the variation of the angle itself.",
    call="transmission_angles",
)(partial(_compare, {"transmission_angle": "transmission angle"}, "transmission angle", "deg", 180.0 / np.pi))


DEPTH_DRAWN = 0.3  # [1] of the clearance: about as deep the settled orbit's largest penetration is drawn
INNERMOST = 10.0  # [um] the gap to the wall is shown linearly up to here at most, logarithmically beyond
SECTOR = 60.0  # [deg] the figure of impacts ends with a multiple of it
CONSTANT = 1e-4  # [1] a speed that varies by a smaller share is a constant one
SMALLEST_FORCE = 1.0  # [N] where the axis of forces begins
MODES = ("flight", "impact", "contact")


def eccentricity(samples: pd.DataFrame, name: str, joint: Joint | None) -> tuple[np.ndarray, np.ndarray]:
    """Journal's centre relative to its bearing's centre, components along the fixed x and y [m], in `samples` of the
    trajectory; nan where the direction is undefined, because the centres coincide.
    """
    # the table's vector points to the centre of the joint's body, which may carry the journal or the bearing
    sign = 1.0 if joint is not None and joint.journal == JOINT[name].body else -1.0
    r, gamma = (samples[f"{quantity}{JOINT_NUMBERS[name]}"].to_numpy() for quantity in ("r", "gamma"))
    return sign * r * np.cos(gamma), sign * r * np.sin(gamma)


@figure(
    "orbits",
    "Orbits of the journals",
    CONTACT_PART,
    ("trajectory",),
    "Left: path of the journal's centre in the first revolution; the circle is the clearance. Middle: settled "
    "revolution, with the penetration into the wall magnified by the factor in the panel. Right: distance of the "
    "centres minus the clearance; negative values are flight. A settled curve that never falls below zero means "
    "permanent contact.",
)
def orbits(tables: Tables, scenario: Scenario) -> Drawing:
    """Orbit of each journal's centre in its bearing, and how far it goes beyond the clearance."""
    mechanism, drawn = scenario.mechanism.applied(), loose_joints(scenario)
    shown = first_and_settled(tables["trajectory"], scenario)
    sheet = Sheet(2.9 * len(drawn), len(drawn), 3, width_ratios=[1.0, 1.0, 1.25])
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    for row, (name, number) in enumerate(drawn.items()):
        joint: Joint = mechanism.joint(name)
        words, radius = in_words(name), 1e3 * joint.clearance
        depth = sheet.panel((row, 2), f"{words}: depth", CRANK_ANGLE, Quantity("penetration (+), gap (−)", "µm"))
        for column, (series, (colour, samples)) in enumerate(shown.items()):
            panel = sheet.panel(
                (row, column), f"{words}, {colour}", Quantity("journal, x", "mm"), Quantity("journal, y", "mm")
            )
            distance = samples[f"r{number}"].to_numpy()
            beyond = np.clip(distance - joint.clearance, 0.0, None)
            deepest = max(beyond.max(), 1e-9 * joint.clearance)
            magnified = round_number(DEPTH_DRAWN * joint.clearance / deepest) if colour == "settled" else 1.0
            stretch = 1.0 + (magnified - 1.0) * beyond / np.maximum(distance, joint.clearance)
            x, y = eccentricity(samples, name, joint)
            panel.line("clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit", linewidth=0.8)
            panel.line(series, 1e3 * stretch * x, 1e3 * stretch * y, colour, linewidth=0.9)
            panel.square(1.4 * radius)
            if magnified != 1.0:
                panel.axes.text(0, 0, f"depth ×{magnified:g}", ha="center", va="center", color=COLOURS["limit"])
            angle = degrees(samples["crank_angle"])
            depth.line(series, angle, 1e6 * (distance - joint.clearance), colour, linewidth=0.8)
            depth.over_crank_angle(angle[0], angle[-1])
        usual = 1e6 * np.quantile(np.abs(distance - joint.clearance), 0.9)  # of the settled revolution
        depth.linear_then_logarithmic(min(round_number(2.0 * usual), INNERMOST))
    sheet.legend()
    return sheet.drawing()


@figure(
    "contact_forces",
    "Contact forces and modes",
    CONTACT_PART,
    ("trajectory",),
    "Normal force in the loose joints, first and settled revolution; gaps are flight. The bands show the mode of each "
    "joint: flight, impact (the journal hits and rebounds) or contact (it stays and oscillates about its equilibrium).",
)
def contact_forces(tables: Tables, scenario: Scenario) -> Drawing:
    """Normal force in the loose joints over the crank angle, and their modes as bands; first and settled revolution."""
    parts, joints = first_and_settled(tables["trajectory"], scenario), loose_joints(scenario)
    sheet = Sheet(4.4 + 0.5 * len(joints), 4, 1, height_ratios=[2.0, 0.25 * len(joints)] * 2)
    largest = max(tables["trajectory"][f"{name}_normal_force"].max() for name in joints)
    for row, (title, (_, samples)) in enumerate(parts.items()):
        angle = degrees(samples["crank_angle"])
        panel = sheet.panel((2 * row, 0), title, CRANK_ANGLE, Quantity("normal force", "N"))
        below = sheet.panel((2 * row + 1, 0), f"{title}: modes", CRANK_ANGLE, Quantity("joint", ""), below=panel)
        below.axes.set_title("")
        for place, name in zip(range(len(joints))[::-1], joints, strict=True):
            force, words = samples[f"{name}_normal_force"].to_numpy(), in_words(name)
            panel.line(words, angle, np.where(force > 0.0, force, np.nan), words, linewidth=0.9)
            below.bands(place, words, angle, samples[f"{name}_mode"].to_numpy(), MODES)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(SMALLEST_FORCE, 2.0 * max(largest, SMALLEST_FORCE))
        below.rows([in_words(name) for name in reversed(joints)], range(len(joints)))
        below.axes.set_ylabel("")
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


_KINDS = (
    ("hits and rebounds", False, {}),
    ("stays in contact", True, {"markerfacecolor": "white", "marker": "s"}),
)
"""Contacts in words, whether they stay, and how they are marked."""


@figure(
    "impacts",
    "Impacts",
    CONTACT_PART,
    ("trajectory", "events"),
    "Each contact of the simulation at the crank angle where it begins: impulse and maximum of its normal force, and "
    "approach speed. Filled: the journal rebounds; open: it stays in contact, and the impulse is that of the load "
    "until it separates. A contact that has not ended shows its approach speed only. The axis ends after the last "
    "contact that begins.",
)
def impacts(tables: Tables, scenario: Scenario) -> Drawing:
    """Every contact of the simulation at the crank angle where it begins: impulse, peak force, approach speed."""
    events, trajectory = tables["events"], tables["trajectory"]
    turn = degrees(trajectory["crank_angle"])[0] - np.degrees(trajectory["crank_angle"].iloc[0])
    begins = np.degrees(events.loc[events["event"] == "impact", "crank_angle"]) + turn
    first, last = degrees(trajectory["crank_angle"])[[0, -1]]
    last = min(last, first + SECTOR * np.ceil((begins.max() - first) / SECTOR)) if len(begins) else last
    sheet, above = Sheet(6.4, 3, 1), None
    shown = (
        ("impulse", "impulse", "N s"),
        ("peak_force", "peak force", "N"),
        ("approach_speed", "approach speed", "m/s"),
    )
    for row, (column, words, unit) in enumerate(shown):
        panel = sheet.panel((row, 0), f"{words} of each contact", CRANK_ANGLE, Quantity(words, unit), below=above)
        for kind, stays, style in _KINDS:  # so that the legend has a column for each
            for name in loose_joints(scenario):
                contacts = _contacts(events[events["joint"] == name])
                own = contacts[(contacts["maxima"] <= 1) != stays]
                angle = turn + np.degrees(own["crank_angle"].to_numpy(dtype=float))
                if len(own):
                    sizes = own[column].to_numpy(dtype=float)
                    panel.marks(f"{in_words(name)}: {kind}", angle, sizes, in_words(name), markersize=4.0, **style)
        panel.logarithmic()
        panel.over_crank_angle(first, last)
        above = panel
    if sheet.panels[0].axes.get_legend_handles_labels()[0]:
        sheet.legend(columns=len(_KINDS))
    return sheet.drawing()


def _contacts(events: pd.DataFrame) -> pd.DataFrame:
    """One row a contact of a joint: its beginning, with what the table says at its end; null where it goes on."""
    begins = events[events["event"] == "impact"].reset_index(drop=True)
    ends = events[events["event"] == "separation"].reset_index(drop=True)
    return begins[["crank_angle", "approach_speed"]].join(ends[["impulse", "peak_force", "maxima"]])


@figure(
    "drive_and_guide",
    "Drive and guide",
    CONTACT_PART,
    ("trajectory",),
    "Speed of the crank and torque of its drive; force of the guide on the slider, and its moment about the piston "
    "pin, which balances the friction moment in the pin. First and settled revolution. The speed is constant unless "
    "a motor, a measured angle or a fluctuation drives the crank.",
)
def drive_and_guide(tables: Tables, scenario: Scenario) -> Drawing:
    """What drives the crank and what guides the slider: crank speed and torque, force and moment of the guide."""
    parts = first_and_settled(tables["trajectory"], scenario)
    shown = (
        ("crank_speed", "crank's speed", "speed", "rpm", 30.0 / np.pi),
        ("crank_torque", "torque on the crank", "torque", "N m", 1.0),
        ("guide_force", "force of the guide on the slider", "force", "N", 1.0),
        ("guide_moment", "moment of the guide about the pin", "moment", "N m", 1.0),
    )
    sheet = Sheet(5.2, 2, 2)
    for place, (column, title, words, unit, factor) in enumerate(shown):
        panel = sheet.panel(divmod(place, 2), title, CRANK_ANGLE, Quantity(words, unit))
        drawn = []
        for series, (colour, samples) in parts.items():
            angle, values = degrees(samples["crank_angle"]), factor * samples[column].to_numpy()
            panel.line(series, angle, values, colour, linewidth=1.7 if colour == "first" else 0.9)
            panel.over_crank_angle(angle[0], angle[-1])
            drawn.append(values)
        middle, swing = float(np.mean(drawn)), float(np.ptp(drawn))
        if column == "crank_speed" and swing <= CONSTANT * abs(middle):
            panel.axes.set_ylim(0.9 * middle, 1.1 * middle)
            panel.axes.set_yticks([middle], [f"{middle:.4g}"])
            panel.axes.text(0.5, 0.55, "constant", ha="center", va="bottom", transform=panel.axes.transAxes)
        elif column == "crank_speed":
            panel.axes.margins(y=0.15)
        else:
            panel.spread_scale(np.concatenate(drawn))
    sheet.legend()
    return sheet.drawing()
