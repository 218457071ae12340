"""Figures of motion and contact."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Joint, Scenario
from jointgap.core.joints import JOINT, JOINT_NUMBERS
from jointgap.core.plot import COLOURS, CRANK_ANGLE, IMPACTS_DWARF, Drawing, Panel, Quantity, Sheet, round_up
from jointgap.core.words import in_words
from jointgap.dynamics.kinematics import clearance_lift, transmission_angle
from jointgap.scenario.figures import (
    NETWORKS,
    degrees,
    loose_joints,
    predicted,
    revolution,
    round_number,
    settled_revolution,
)

Tables = Mapping[str, pd.DataFrame]
_SIMULATED, _PREDICTED, _DESIRED = (
    "with clearance: simulation",
    "with clearance: networks",
    "without clearance (desired)",
)


_NETWORKS = "networks_paper_form"
"""Source of what the networks say, which is not there where none were trained."""


@dataclass(frozen=True)
class Curve:
    """A column of the table kinematics as figures show it."""

    column: str
    title: str
    name: str
    unit: str
    factor: float = 1.0


def _orders(body: str, axis: str, words: str) -> dict[str, Curve]:
    shown = (("position", "mm", 1e3), ("velocity", "m/s", 1.0), ("acceleration", "m/s²", 1.0))
    return {order: Curve(f"{body}_{order}{axis}", words, order, unit, factor) for order, unit, factor in shown}


ROD = [_orders("rod", f"_{axis}", f"rod's mass centre, {axis}") for axis in "xy"]
PISTON = [_orders("slider", "", "piston")]
TRANSMISSION = Curve("transmission_angle", "transmission angle", "transmission angle", "deg", 180.0 / np.pi)


def _compare(curves: list[Curve], tables: Tables, scenario: Scenario) -> Drawing:
    """Desired and actual above, their difference below, a column for each curve."""
    sources = dict(list(tables["kinematics"].groupby("source")))
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(curves))
    for column, curve in enumerate(curves):
        desired, simulated = (
            curve.factor * sources[source][curve.column].to_numpy() for source in ("ideal", "simulation")
        )
        actual = {_SIMULATED: (simulated, "simulation", 0.9)}
        if _NETWORKS in sources:  # below the simulation's
            networks = curve.factor * sources[_NETWORKS][curve.column].to_numpy()
            actual = {_PREDICTED: (networks, "network", 0.8)} | actual
        above = sheet.panel((0, column), curve.title, CRANK_ANGLE, Quantity(curve.name, curve.unit))
        below = sheet.panel(
            (1, column), "deviation", CRANK_ANGLE, Quantity("actual − desired", curve.unit), below=above
        )
        for panel, less in ((above, 0.0), (below, desired)):
            for series, (values, colour, width) in actual.items():
                panel.line(series, angle, values - less, colour, linewidth=width)
            _spread_scale(panel, desired, np.concatenate([values - less for values, _, _ in actual.values()]))
        above.line(_DESIRED, angle, desired, "ideal", linestyle="--", linewidth=1.1)
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


def _spread_scale(panel: Panel, desired: np.ndarray, shown: np.ndarray) -> None:
    """A scale linear up to the desired motion's peak and logarithmic beyond, where impacts dwarf the motion."""
    peak = np.max(np.abs(desired))
    if np.nanmax(np.abs(shown)) > IMPACTS_DWARF * peak:
        panel.linear_then_logarithmic(round_up(peak))


rod_position, rod_velocity, rod_acceleration = (
    partial(_compare, [axis[order] for axis in ROD]) for order in ("position", "velocity", "acceleration")
)
"""Rod's mass centre, figures 9-11: both axes."""

piston_position, piston_velocity, piston_acceleration = (
    partial(_compare, [axis[order] for axis in PISTON]) for order in ("position", "velocity", "acceleration")
)
"""Piston, figures 12-14."""

transmission_angles = partial(_compare, [TRANSMISSION])
"""Transmission angle with and without clearance, figure 15."""


ACTUAL, OPTIMISED = "desired − actual", "desired − optimised"


def transmission_errors(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors of the transmission angle before and after the optimisation, clearance motion frozen (figure 16).

    Arguments as in `draw`.
    """
    samples = revolution(tables["trajectory"], scenario, 1)
    crank_angle, angle = samples["crank_angle"].to_numpy(), degrees(samples["crank_angle"])
    coordinates = [f"{name}{number}" for number in loose_joints(scenario).values() for name in ("r", "gamma")]
    motions = {
        NETWORKS: {name: predicted(tables, NETWORKS, name)["value"].to_numpy() for name in coordinates},
        "simulation": {name: samples[name].to_numpy() for name in coordinates},
    }
    mechanism = scenario.mechanism.applied()
    crank, rod, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset
    desired = transmission_angle(crank, rod, crank_angle, 0.0, offset)
    optima = tables["optimise_optima"]
    box = next(iter(scenario.optimise.boxes))
    sheet = Sheet(5.4, 2, 1)
    above: Panel | None = None
    for row, (source, motion) in enumerate(motions.items()):
        lift = clearance_lift(motion)
        best = optima[(optima["source"] == source) & (optima["box"] == box) & (optima["method"] == "genetic")].iloc[0]
        pairs = {
            ACTUAL: (crank, rod, "simulation"),
            OPTIMISED: (best["crank_length"], best["rod_length"], "genetic"),
        }
        title = (
            f"{source}: $L_2$ = {1e3 * best['crank_length']:.3f} mm, $L_3$ = {1e3 * best['rod_length']:.3f} mm, "
            f"RMS in the window {-100 * best['rms_reduction']:+.1f} %"
        ).replace("-", "−")
        error = Quantity("error of the angle", "deg", r"$\mu$")
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, error, below=above)
        for series, (crank_length, rod_length, colour) in pairs.items():
            actual = transmission_angle(crank_length, rod_length, crank_angle, lift, offset)
            panel.line(series, angle, np.degrees(desired - actual), colour, linewidth=1.0)
        panel.horizontal_line("zero", 0.0)
        for edge in np.degrees(scenario.optimise.window):
            if 0.0 < edge < 359.99:
                panel.vertical_line("edge of the window", angle[0] + edge)
        panel.over_crank_angle(angle[0], angle[-1])
        above = panel
    sheet.legend()
    return sheet.drawing()


DEPTH_DRAWN = 0.3  # [1] of the clearance: about as deep the settled orbit's largest penetration is drawn
INNERMOST = 10.0  # [um] the gap to the wall is shown linearly up to here at most, logarithmically beyond
SECTOR = 60.0  # [deg] the figure of impacts ends with a multiple of it
CONSTANT = 1e-4  # [1] a speed that varies by a smaller share is a constant one
SMALLEST_FORCE = 1.0  # [N] where the axis of forces begins
MODES = ("flight", "impact", "contact")


def eccentricity(samples: pd.DataFrame, name: str, joint: Joint | None) -> tuple[np.ndarray, np.ndarray]:
    """Journal's centre seen from its bearing's centre, components along the fixed x and y [m].

    `samples` are rows of table `TRAJECTORY`, `name` is that of the `joint`. The table's vector points to the centre of
    the joint's body (`jointgap.core.joints`), so it is turned round where this body carries the bearing. Undefined
    directions (centres
    coincide, as always in an ideal joint) give nan.
    """
    sign = 1.0 if joint is not None and joint.journal == JOINT[name].body else -1.0
    r, gamma = (samples[f"{quantity}{JOINT_NUMBERS[name]}"].to_numpy() for quantity in ("r", "gamma"))
    return sign * r * np.cos(gamma), sign * r * np.sin(gamma)


def orbits(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Orbit of each journal's centre in its bearing, and how far it goes beyond the clearance.

    Arguments as in `draw`.
    """
    trajectory, number_settled = tables["trajectory"], scenario.optimise.ensemble.settled_revolution
    mechanism = scenario.mechanism.applied()
    drawn = loose_joints(scenario)
    shown = (
        ("first revolution", "first", revolution(trajectory, scenario, 1)),
        (f"settled revolution ({number_settled})", "settled", settled_revolution(trajectory, scenario)),
    )
    sheet = Sheet(2.9 * len(drawn), len(drawn), 3, width_ratios=[1.0, 1.0, 1.25])
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    for row, (name, number) in enumerate(drawn.items()):
        joint: Joint = mechanism.joint(name)
        words, radius = in_words(name), 1e3 * joint.clearance
        depth = sheet.panel((row, 2), f"{words}: depth", CRANK_ANGLE, Quantity("beyond clearance", "µm", "$r - r_c$"))
        for column, (series, colour, samples) in enumerate(shown):
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


def contact_forces(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Normal force in the loose joints over the crank angle, and their modes as bands; first and settled revolution.

    Arguments as in `draw`.
    """
    settled, joints = scenario.optimise.ensemble.settled_revolution, loose_joints(scenario)
    parts = {"first revolution": 1, f"settled revolution ({settled})": settled}
    sheet = Sheet(4.4 + 0.5 * len(joints), 4, 1, height_ratios=[2.0, 0.25 * len(joints)] * 2)
    largest = max(tables["trajectory"][f"{name}_normal_force"].max() for name in joints)
    for row, (title, number) in enumerate(parts.items()):
        samples = revolution(tables["trajectory"], scenario, number)
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


def impacts(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Every contact of the simulation at the crank angle where it begins: impulse, peak force, approach speed.

    Arguments as in `draw`.
    """
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


def drive_and_guide(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """What drives the crank and what guides the slider: crank speed and torque, force and moment of the guide.

    Arguments as in `draw`.
    """
    settled = scenario.optimise.ensemble.settled_revolution
    parts = {"first revolution": (1, "first"), f"settled revolution ({settled})": (settled, "settled")}
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
        for series, (number, colour) in parts.items():
            samples = revolution(tables["trajectory"], scenario, number)
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
