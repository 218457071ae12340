"""The figures of a scenario. The docstring of a function with the decorator `figure` is the
caption."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core import plot
from jointgap.core.joints import number_of, outputs
from jointgap.core.plot import (
    COLOURS,
    CRANK_ANGLE,
    IMPACTS_DWARF,
    Drawing,
    Figures,
    Panel,
    Quantity,
    Sheet,
    round_up,
)
from jointgap.core.words import format_name
from jointgap.scenario import animation as moving
from jointgap.scenario.figure_data import (
    MODES,
    SMALLEST_FORCE,
    contacts_of,
    degrees,
    eccentricity,
    loose_joints,
    revolution,
    round_number,
)

Tables = Mapping[str, pd.DataFrame]
FIGURES = Figures()
figure, draw = FIGURES.figure, FIGURES.draw

DEGREES = 180.0 / np.pi


def described(name: str, scenario: Scenario) -> plot.FigureSpec:
    """A figure with the title and caption that hold for the `scenario`."""
    loose = bool(scenario.mechanism.applied().loose)
    angle, networks = scenario.optimise.objective == "transmission_angle", scenario.networks
    known = {"angle": angle, "networks": networks, "unsettled": networks or not angle}
    return FIGURES[name].where(paper=scenario.paper, loose=loose, **known)


def by_source(tables: Tables) -> dict[str, pd.DataFrame]:
    """The table kinematics by source."""
    return dict(list(tables["kinematics"].groupby("source")))


def predicted(tables: Tables, output: str) -> pd.DataFrame:
    """The network's prediction of one `output`: rows of the frame ``predictions``."""
    frame = tables["predictions"]
    return frame[(frame["surrogate"] == "networks") & (frame["output"] == output)].reset_index(
        drop=True
    )


def first_and_settled(tables: Tables, scenario: Scenario) -> dict[str, tuple[str, pd.DataFrame]]:
    """Colour and samples of the first and of the settled revolution, by title."""
    settled = scenario.optimise.ensemble.settled_revolution
    return {
        "first revolution": ("first", revolution(tables["trajectory"], scenario, 1)),
        f"settled revolution ({settled})": (
            "settled",
            revolution(tables["trajectory"], scenario, settled),
        ),
    }


def _over_angle(
    sheet: Sheet,
    place: tuple,
    title: str,
    y: Quantity,
    angle: np.ndarray,
    curves: Mapping[str, tuple],
) -> Panel:
    """A panel of curves over the crank `angle` [deg]: values and colour by series."""
    panel = sheet.panel(place, title, CRANK_ANGLE, y)
    for series, (values, colour) in curves.items():
        panel.line(series, angle, values, colour)
    panel.over_crank_angle(angle[0], angle[-1])
    panel.spread_scale(np.concatenate([values for values, _ in curves.values()]))
    return panel


# -- motion

_ACTUAL = (  # series, source in the table kinematics (networks only if trained), colour
    ("with clearance: networks", "networks_paper_form", "network"),
    ("with clearance: simulation", "simulation", "simulation"),
)
_ORDERS = {"position": ("mm", 1e3), "velocity": ("m/s", 1.0), "acceleration": ("m/s²", 1.0)}


def _compare(
    columns: dict[str, str], name: str, unit: str, factor: float, tables: Tables, scenario: Scenario
) -> Drawing:
    """Desired and actual motion above their difference, for each of the `columns` of the table
    kinematics."""
    sources = by_source(tables)
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(columns))
    for place, (column, title) in enumerate(columns.items()):
        desired = factor * sources["ideal"][column].to_numpy()
        above = sheet.panel((0, place), title, CRANK_ANGLE, Quantity(name, unit))
        below = sheet.panel(
            (1, place), "deviation", CRANK_ANGLE, Quantity("actual − desired", unit), below=above
        )
        for panel, less in ((above, 0.0), (below, desired)):
            largest = 0.0
            for series, source, colour in _ACTUAL:
                if source in sources:
                    shown = factor * sources[source][column].to_numpy() - less
                    panel.line(series, angle, shown, colour)
                    largest = max(largest, np.nanmax(np.abs(shown)))
            if largest > IMPACTS_DWARF * (peak := np.max(np.abs(desired))):
                panel.linear_then_logarithmic(round_up(peak))
        above.line("without clearance (desired)", angle, desired, "ideal", linestyle="--")
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


for _number, _body, _order, _about in (
    (9, "rod", "position", "[paper: The deviation stays within about one clearance.]"),
    (
        10,
        "rod",
        "velocity",
        (
            " Steps are impacts.[networks: The paper's equations do not describe the free flight at"
            " the start.]"
        ),
    ),
    (
        11,
        "rod",
        "acceleration",
        " Spikes are impacts[paper:; in free flight the rod has almost no acceleration].",
    ),
    (
        12,
        "piston",
        "position",
        "[paper: At load reversal the clearances align with the rod and add up.]",
    ),
    (
        13,
        "piston",
        "velocity",
        "[paper: Deviations are largest in the free flight at the start and at load reversals.]",
    ),
    (
        14,
        "piston",
        "acceleration",
        "[paper: Zero: free flight.] Spikes: impacts.[paper: In contact the journal oscillates.]",
    ),
):
    _columns = {f"rod_{_order}_{axis}": f"rod's mass centre, {axis}" for axis in "xy"}
    figure(
        f"figure_{_number:02}",
        f"{_order.capitalize()} of the {_body}[paper: (the paper's figure {_number})]",
        "Motion",
        ("kinematics",),
        "First revolution. Top: without clearance (desired, dashed)[networks:,][not networks: and]"
        " simulated with clearance[networks:, and from the paper's equations with the networks]."
        f" Bottom: deviation from the desired {_order}.{_about}",
        call=f"{_body}_{_order}",
    )(
        partial(
            _compare,
            _columns if _body == "rod" else {f"slider_{_order}": "piston"},
            _order,
            *_ORDERS[_order],
        )
    )


@figure(
    "figure_15", "Transmission angle[paper: (the paper's figure 15)]", "Motion", ("kinematics",)
)
def transmission_angles(tables: Tables, scenario: Scenario) -> Drawing:
    """First revolution. Top: angle between the rod and the normal to the slide. Bottom: actual
    minus desired angle, the error that the optimisation minimises. It is small compared with the
    variation of the angle itself.
    """
    angle = {"transmission_angle": "transmission angle"}
    return _compare(angle, "transmission angle", "deg", DEGREES, tables, scenario)


# -- contact

DEPTH_DRAWN = 0.3  # [1] drawn depth of the settled orbit's largest penetration, over the clearance
INNERMOST = 10.0  # [um] largest linear range of the gap's axis; logarithmic beyond
SECTOR = 60.0  # [deg] the axis of the impacts ends at a multiple of it
CONSTANT = 1e-4  # [1] relative variation below which a speed is constant


@figure("orbits", "Orbits of the journals", "Contact", ("trajectory",))
def orbits(tables: Tables, scenario: Scenario) -> Drawing:
    """Left: path of the journal's centre in the first revolution; the circle is the clearance.
    Middle: settled revolution, with the penetration into the wall scaled by the factor in the
    panel. Right: distance of the centres minus the clearance. Negative values are flight; a settled
    curve above zero means permanent contact.
    """
    mechanism, drawn = scenario.mechanism.applied(), loose_joints(scenario)
    sheet = Sheet(2.9 * len(drawn), len(drawn), 3, width_ratios=[1.0, 1.0, 1.25])
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    x, y = (Quantity(f"journal, {axis}", "mm") for axis in "xy")
    for row, (name, number) in enumerate(drawn.items()):
        joint, words = mechanism.joint(name), format_name(name)
        radius = 1e3 * joint.clearance
        depth = sheet.panel(
            (row, 2), f"{words}: depth", CRANK_ANGLE, Quantity("penetration (+), gap (−)", "µm")
        )
        for column, (series, (colour, samples)) in enumerate(
            first_and_settled(tables, scenario).items()
        ):
            panel = sheet.panel((row, column), f"{words}, {colour}", x, y)
            distance = samples[f"r{number}"].to_numpy()
            beyond = np.clip(distance - joint.clearance, 0.0, None)
            deepest = max(beyond.max(), 1e-9 * joint.clearance)
            magnified = (
                round_number(DEPTH_DRAWN * joint.clearance / deepest)
                if colour == "settled"
                else 1.0
            )
            stretch = 1.0 + (magnified - 1.0) * beyond / np.maximum(distance, joint.clearance)
            centre = 1e3 * stretch * eccentricity(samples, name, joint).T
            panel.line(
                "clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit"
            )
            panel.line(series, *centre, colour)
            panel.square(1.4 * radius)
            if colour == "settled":
                panel.axes.text(
                    0, 0, f"depth ×{magnified:g}", ha="center", va="center", color=COLOURS["limit"]
                )
            angle = degrees(samples["crank_angle"])
            depth.line(series, angle, 1e6 * (distance - joint.clearance), colour)
            depth.over_crank_angle(angle[0], angle[-1])
        usual = 1e6 * np.quantile(
            np.abs(distance - joint.clearance), 0.9
        )  # of the settled revolution
        depth.linear_then_logarithmic(min(round_number(2.0 * usual), INNERMOST))
    sheet.legend()
    return sheet.drawing()


@figure("contact_forces", "Contact forces and modes", "Contact", ("trajectory",))
def contact_forces(tables: Tables, scenario: Scenario) -> Drawing:
    """Normal force in the loose joints, first and settled revolution; gaps are flight. Bands: mode
    of each joint. Flight: no contact. Impact: the journal hits and rebounds. Contact: it stays and
    oscillates about equilibrium.
    """
    joints = loose_joints(scenario)
    sheet = Sheet(4.4 + 0.5 * len(joints), 4, 1, height_ratios=[2.0, 0.25 * len(joints)] * 2)
    largest = max(tables["trajectory"][f"{name}_normal_force"].max() for name in joints)
    for row, (title, (_, samples)) in enumerate(first_and_settled(tables, scenario).items()):
        angle = degrees(samples["crank_angle"])
        panel = sheet.panel((2 * row, 0), title, CRANK_ANGLE, Quantity("normal force", "N"))
        below = sheet.panel(
            (2 * row + 1, 0), f"{title}: modes", CRANK_ANGLE, Quantity("joint", ""), below=panel
        )
        for place, name in zip(range(len(joints))[::-1], joints, strict=True):
            force, words = samples[f"{name}_normal_force"].to_numpy(), format_name(name)
            panel.line(words, angle, np.where(force > 0.0, force, np.nan), words)
            below.bands(place, words, angle, samples[f"{name}_mode"].to_numpy(), MODES)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(SMALLEST_FORCE, 2.0 * max(largest, SMALLEST_FORCE))
        below.rows([format_name(name) for name in reversed(joints)], range(len(joints)))
        below.axes.set(title="", ylabel="")
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


_KINDS = (  # label, whether the contact lasts, marker style
    ("hits and rebounds", False, {}),
    ("stays in contact", True, {"markerfacecolor": "white", "marker": "s"}),
)


@figure("impacts", "Impacts", "Contact", ("trajectory", "events"))
def impacts(tables: Tables, scenario: Scenario) -> Drawing:
    """Impulse and peak of the normal force, and approach speed, of each contact at the crank angle
    where it begins. Filled: the journal rebounds. Open: it stays in contact; the impulse includes
    the load until separation. A contact that has not ended shows its approach speed only."""
    raw = tables["trajectory"]["crank_angle"]
    first, last = degrees(raw)[[0, -1]]
    turn = first - np.degrees(raw.iloc[0])
    contacts = {name: contacts_of(tables["events"], name) for name in loose_joints(scenario)}
    begins = [turn + np.degrees(own["crank_angle"].max()) for own in contacts.values() if len(own)]
    last = min(last, first + SECTOR * np.ceil((max(begins) - first) / SECTOR)) if begins else last
    sheet, above = Sheet(6.4, 3, 1), None
    for row, (words, unit) in enumerate(
        (("impulse", "N s"), ("peak force", "N"), ("approach speed", "m/s"))
    ):
        panel = sheet.panel(
            (row, 0), f"{words} of each contact", CRANK_ANGLE, Quantity(words, unit), below=above
        )
        for kind, stays, style in _KINDS:  # outer loop: one legend column per kind
            for name, every in contacts.items():
                own = every[(every["maxima"] <= 1) != stays].astype(float)
                if len(own):
                    angle, sizes = (
                        turn + np.degrees(own["crank_angle"]),
                        own[words.replace(" ", "_")],
                    )
                    panel.marks(
                        f"{format_name(name)}: {kind}",
                        angle,
                        sizes,
                        format_name(name),
                        markersize=4.0,
                        **style,
                    )
        panel.logarithmic()
        panel.over_crank_angle(first, last)
        above = panel
    if begins:
        sheet.legend(columns=len(_KINDS))
    return sheet.drawing()


@figure("drive_and_guide", "Drive and guide", "Contact", ("trajectory",))
def drive_and_guide(tables: Tables, scenario: Scenario) -> Drawing:
    """Top: speed of the crank and torque of its drive. Bottom: force of the guide on the slider,
    and its moment about the piston pin, which balances the pin's friction moment. First and settled
    revolution. The speed varies only with a motor, a measured angle or a speed fluctuation."""
    parts, sheet = first_and_settled(tables, scenario), Sheet(5.2, 2, 2)
    angle = degrees(tables["trajectory"]["crank_angle"])[
        : scenario.simulate.samples_per_revolution + 1
    ]
    for place, (column, title, words, unit, factor) in enumerate(
        (
            ("crank_speed", "crank's speed", "speed", "rpm", 30.0 / np.pi),
            ("crank_torque", "torque on the crank", "torque", "N m", 1.0),
            ("guide_force", "force of the guide on the slider", "force", "N", 1.0),
            ("guide_moment", "moment of the guide about the pin", "moment", "N m", 1.0),
        )
    ):
        curves = {
            series: (factor * samples[column].to_numpy(), colour)
            for series, (colour, samples) in parts.items()
        }
        panel = _over_angle(sheet, divmod(place, 2), title, Quantity(words, unit), angle, curves)
        panel.axes.get_lines()[0].set_linewidth(1.7)  # stays visible below the settled revolution
        values = np.array([values for values, _ in curves.values()])
        middle = float(values.mean())
        if column == "crank_speed" and np.ptp(values) <= CONSTANT * abs(middle):
            panel.axes.set_ylim(0.9 * middle, 1.1 * middle)
            panel.axes.set_yticks([middle], [f"{middle:.4g}"])
            panel.axes.text(
                0.5, 0.55, "constant", ha="center", va="bottom", transform=panel.axes.transAxes
            )
    sheet.legend()
    return sheet.drawing()


@figure("animation", "The mechanism in motion", "Contact", ("trajectory",), moving=True)
def animation(tables: Tables, scenario: Scenario) -> Drawing:
    """First revolution. Top: the mechanism[loose: with its clearances magnified by the factor in
    the title. Rings: bearings; dots: journals, grey in flight]. Arrows: forces on the journals, 30
    mm longer per factor of ten above 1 N. Bottom: [loose:path of each loose joint's journal in its
    true clearance circle, and the normal forces][not loose:the forces in the joints].[loose: The
    first 60 deg, with flight and impacts, take half of the frames.]
    """
    return moving.animation(tables["trajectory"], scenario)


# -- networks

EVERYWHERE, AT_POINTS = "network − simulation, all samples", "network − simulation, training points"
QUANTITIES = {  # by kind of output: name, unit, factor, unit and factor of its error, symbol
    "r": ("clearance", "mm", 1e3, "µm", 1e6, "r_{}"),
    "gamma": ("direction", "deg", DEGREES, "deg", DEGREES, r"\gamma_{}"),
    "gamma_dot": ("rate", "rad/s", 1.0, "rad/s", 1.0, r"\dot\gamma_{}"),
    "gamma_ddot": ("acceleration", "rad/s²", 1.0, "rad/s²", 1.0, r"\ddot\gamma_{}"),
}


def symbol(output: str) -> str:
    """Symbol of an output as mathtext."""
    number = str(number_of(output))
    return f"${QUANTITIES[output.replace(number, '')][-1].format(number)}$"


def _values_and_errors(kinds: tuple[str, ...], tables: Tables, scenario: Scenario) -> Drawing:
    """Values above their errors: a column per joint, a pair of rows per kind of output."""
    samples = revolution(tables["trajectory"], scenario, 1)
    angle = degrees(samples["crank_angle"])
    points = slice(
        None,
        None,
        scenario.simulate.samples_per_revolution // (scenario.surrogate.training_points - 1),
    )
    joints = loose_joints(scenario)
    sheet = Sheet(
        0.6 + 4.2 * len(kinds), 2 * len(kinds), len(joints), width=plot.width_for(len(joints))
    )
    for column, (joint, number) in enumerate(joints.items()):
        name = format_name(joint)
        for row, kind in enumerate(kinds):
            base, _, order = kind.partition("_")
            output = f"{base}{number}_{order}".rstrip("_")
            words, unit, factor, error_unit, error_factor, _ = QUANTITIES[kind]
            simulated, network = (
                samples[output].to_numpy(),
                predicted(tables, output)["value"].to_numpy(),
            )
            value = Quantity(words, unit, symbol(output))
            above = sheet.panel(
                (2 * row, column), f"{name}: {words} {symbol(output)}", CRANK_ANGLE, value
            )
            above.line("simulation", angle, factor * simulated, "simulation")
            above.line("network", angle, factor * network, "network", linestyle=(0, (4, 2)))
            if output == "gamma2":
                above.line("crank angle", angle, angle, "limit", linestyle=":")
            above.spread_scale(factor * np.concatenate([simulated, network]))
            error, place = error_factor * (network - simulated), (2 * row + 1, column)
            below = sheet.panel(
                place, f"{name}: error", CRANK_ANGLE, Quantity("error", error_unit), below=above
            )
            below.line(EVERYWHERE, angle, error, "network")
            below.marks(AT_POINTS, angle[points], error[points], "ideal", markersize=1.6)
            below.over_crank_angle(angle[0], angle[-1])
            below.spread_scale(error)
    sheet.legend()
    return sheet.drawing()


for _number, _title, _kinds, _about in (
    (5, "clearances", ("r",), "distance of the centres in each loose joint"),
    (6, "directions", ("gamma",), "direction of the clearance; dotted: the crank angle"),
    (
        7,
        "derivatives",
        ("gamma_dot", "gamma_ddot"),
        "rate and acceleration of the direction, which oscillates at kHz",
    ),
):
    figure(
        f"figure_{_number:02}",
        f"{_title.capitalize()}[paper: (the paper's figure {_number})]",
        "Networks",
        ("trajectory", "predictions"),
        f"First revolution, simulation and network. Top: {_about}. Bottom: network minus"
        " simulation, at the training points (black) and at all samples. A small training error"
        " does not imply a small error between the points.",
        call=_title,
    )(partial(_values_and_errors, _kinds))


PAPER_ITERATIONS = 20_000  # of every network in the paper
CURVE_POINTS = 300  # per curve, evenly spaced on its logarithmic axis
ITERATION, ERROR = Quantity("iteration", "1"), Quantity("MSE over squared range", "1")


@figure(
    "figure_08",
    "Mean square error over the training[paper: (the paper's figure 8)]",
    "Networks",
    ("fit_history", "fit_errors"),
)
def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error at the training points over the squared range of the output, after each
    Levenberg-Marquardt iteration. Thick: default start; thin: other starts.[paper: Diamonds:
    printed in the paper, after 20 000 iterations. A curve that ends below its diamond reaches the
    paper's training error.]"""
    history, default = (
        tables["fit_history"].query("model == 'network' and iteration > 0"),
        scenario.surrogate.seeds[0],
    )
    paper = tables["fit_errors"].drop_duplicates("output").set_index("output")["paper_mse"]
    learned = outputs(scenario.mechanism.applied().loose)
    rows = len(learned) // 4
    sheet = Sheet((2.9, 4.6, 6.4)[rows - 1], rows, 4)
    for place, output in enumerate(learned):
        column, row = divmod(place, rows)
        above = sheet.panels[-1] if row else None
        panel = sheet.panel(
            (row, column), f"network {symbol(output)}", ITERATION, ERROR, below=above
        )
        curves = history[history["output"] == output]
        for seed in reversed(curves["seed"].unique()):
            curve = curves[curves["seed"] == seed]
            curve = curve.iloc[
                np.unique(np.round(np.geomspace(1, len(curve), CURVE_POINTS)).astype(int)) - 1
            ]
            if seed == default:
                look = {
                    "series": "default start",
                    "colour": "network",
                    "linewidth": 1.4,
                    "zorder": 3,
                }
            else:
                look = {"series": "other starts", "colour": "other", "linewidth": 0.6}
            panel.line(x=curve["iteration"], y=curve["mse"], **look)
        if paper[output] > 0:  # the paper prints one
            panel.marks(
                "paper, after 20 000",
                [PAPER_ITERATIONS],
                [paper[output]],
                "paper",
                marker="D",
                zorder=4,
            )
        if place:
            panel.axes.sharey(sheet.panels[0].axes)
        if column:
            panel.axes.set_ylabel("")
            panel.axes.tick_params(labelleft=False)
        panel.axes.set(xscale="log", yscale="log", xlim=(1, 2 * PAPER_ITERATIONS))
    drawing = sheet.drawing()
    panel.axes.set_ylim(drawing.data["y"].min() / 3, 2 * history["mse"].max())
    sheet.legend()
    return drawing


_MARKS = (  # series, model and column of the table fit_errors, shift, colour, marker
    ("network, training points", "network", "training_mse", -0.32, "network", "s"),
    ("network, held out", "network", "held_out_mse", -0.24, "network", "o"),
    (
        "spline through the same points, held out",
        "network",
        "spline_held_out_mse",
        -0.16,
        "spline",
        "^",
    ),
    ("regularised network, training points", "regularised", "training_mse", -0.06, "local", "s"),
    ("regularised network, held out", "regularised", "held_out_mse", 0.02, "local", "o"),
    (
        "smoothing spline of its points, held out",
        "regularised",
        "smoothing_spline_held_out_mse",
        0.10,
        "spline",
        "v",
    ),
)


@figure("held_out", "Errors between the training points", "Networks", ("fit_errors",))
def held_out(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error over the squared range of each output, for the first revolution and for its
    part past 60 deg. Training points and held-out samples of the paper's networks and the
    regularised networks, with splines through the same points.[paper: Horizontal
    marks: training errors printed in the paper.] Marks: default start; bars: range over all starts.
    A circle far above its square shows overfitting. A triangle below a circle means that a spline
    is more accurate than the network."""
    learned, sheet, above = (
        list(outputs(scenario.mechanism.applied().loose)),
        Sheet(6.6, 2, 1),
        None,
    )
    for row, (region, title) in enumerate(
        (("all", "first revolution"), ("past_60_deg", "its part past 60 deg"))
    ):
        panel = sheet.panel((row, 0), title, Quantity("output", ""), ERROR, below=above)
        errors = tables["fit_errors"]
        _error_marks(
            panel, errors[errors["region"] == region], scenario.surrogate.seeds[0], learned
        )
        panel.axes.set_yscale("log")
        panel.axes.minorticks_off()
        panel.categories([symbol(output) for output in learned])
        above = panel
    drawing = sheet.drawing()
    shown = drawing.data[["y", "low", "high"]].to_numpy()
    for panel in sheet.panels:
        panel.axes.set_ylim(
            np.nanmin(shown) / 3, 3 * np.nanmax(shown)
        )  # the same scale in both panels
    sheet.legend()
    return drawing


def _error_marks(panel: Panel, errors: pd.DataFrame, default: int, learned: list[str]) -> None:
    """Errors of the default start, with the range over all starts as bars."""
    place = np.arange(len(learned))
    for series, model, column, shift, colour, marker in _MARKS:
        rows = errors[errors["model"] == model]
        if rows.empty:
            continue
        lowest = highest = None
        if column in ("training_mse", "held_out_mse") and rows["seed"].nunique() > 1:
            lowest, highest = (
                rows.groupby("output")[column].agg(["min", "max"]).reindex(learned).to_numpy().T
            )
        shown = rows[rows["seed"] == default].set_index("output")[column].reindex(learned)
        panel.marks(
            series, place + shift, shown.to_numpy(), colour, lowest, highest, learned, marker=marker
        )
    paper = errors.groupby("output")["paper_mse"].first().reindex(learned).to_numpy()
    if np.isfinite(paper).any():
        panel.marks(
            "paper, training points",
            place,
            paper,
            "paper",
            labels=learned,
            marker="_",
            markersize=22,
        )


@figure(
    "contradictions",
    "Inconsistency of the networks",
    "Networks",
    ("trajectory", "predictions", "kinematics"),
)
def contradictions(tables: Tables, scenario: Scenario) -> Drawing:
    """First revolution. Top: derivative of the network of the direction minus the network of its
    rate; zero if they are consistent. Bottom: resulting error of the piston's motion. Each output
    from its own network (the paper's method), or one output derived from another: position from
    integrated rates, acceleration from differentiated directions. Independent fits do not describe
    one motion."""
    joints, sources = loose_joints(scenario), by_source(tables)
    shares = 2 * len(joints)  # grid columns: half of the width per piston panel, 1/n per joint
    sheet = Sheet(5.6, 2, shares, width=plot.width_for(len(joints)))
    angle = degrees(sources["simulation"]["crank_angle"])
    rate = Quantity("contradiction", "rad/s")
    for place, (joint, number) in enumerate(joints.items()):
        name = f"gamma{number}"
        difference = (
            predicted(tables, name)["rate"] - predicted(tables, f"{name}_dot")["value"]
        ).to_numpy()
        curves = {"derivative of one network − the other network": (difference, "ideal")}
        title = f"{format_name(joint)}: d{symbol(name)}/dt − {symbol(f'{name}_dot')}"
        _over_angle(sheet, (0, slice(2 * place, 2 * place + 2)), title, rate, angle, curves)
    for half, (quantity, title, unit, factor, form) in enumerate(
        (
            ("slider_position", r"piston: position, $\gamma$ integrated", "mm", 1e3, "integrated"),
            (
                "slider_acceleration",
                r"piston: acceleration, $\gamma$ differentiated",
                "m/s²",
                1.0,
                "own_rates",
            ),
        )
    ):
        true = sources["simulation"][quantity].to_numpy()
        curves = {
            series: (factor * (sources[f"networks_{source}"][quantity].to_numpy() - true), colour)
            for series, source, colour in (
                ("one output derived from another network", form, "spline"),
                ("each output from its own network", "paper_form", "network"),
            )
        }
        place = slice(half * shares // 2, (half + 1) * shares // 2)
        _over_angle(
            sheet, (1, place), title, Quantity("networks − simulation", unit), angle, curves
        )
    sheet.legend()
    return sheet.drawing()


# -- optimum

CRANK, ROD = Quantity("crank length", "mm", "$L_2$"), Quantity("rod length", "mm", "$L_3$")
REDUCTION = Quantity("reduction of the error", "%")
MEASURES = {  # label and colour
    "rms": ("RMS", "simulation"),
    "mean_absolute": ("mean absolute", "optimised"),
    "peak": ("peak", "spline"),
    "sum_of_squares": ("sum of squares", "limit"),
}
_APART = 0.07  # vertical offset between frozen and simulated again, which may coincide
LENGTHS = {  # labels of printed points, and of the sources searched by the genetic algorithm
    "printed_genetic": "paper, genetic",
    "printed_local": "paper, best local",
    "printed_local_other": "paper, another local",
    "networks": "networks",
    "simulation": "simulation",
    "simulation_settled": "simulation, settled",
    "ideal_joints": "ideal joints",
    "with_clearance": "with clearance",
}


@figure(
    "figure_16",
    "Errors of the transmission angle[paper: (the paper's figure 16)]",
    "Optimum",
    ("trajectory", "predictions", "optimise_optima"),
)
def transmission_errors(tables: Tables, scenario: Scenario) -> Drawing:
    """First revolution, frozen joint motion: desired minus actual angle at the original lengths,
    and desired minus optimised angle at the lengths of the genetic algorithm. Top: motion from the
    networks (as in the paper); bottom: from the simulation. Other lengths mainly add a multiple of
    the sine of the crank angle, so they cannot remove the journals' oscillation."""
    from jointgap.dynamics.kinematics import clearance_lift, transmission_angle

    samples = revolution(tables["trajectory"], scenario, 1)
    crank_angle, angle = samples["crank_angle"].to_numpy(), degrees(samples["crank_angle"])
    learned = [
        f"{name}{number}" for number in loose_joints(scenario).values() for name in ("r", "gamma")
    ]
    mechanism = scenario.mechanism.applied()
    original, offset = (mechanism.crank.length, mechanism.rod.length), mechanism.slider.offset
    desired = transmission_angle(*original, crank_angle, 0.0, offset)
    optima = tables["optimise_optima"].query("method == 'genetic'").set_index("point")
    if (lacking := _without_optimum("figure_16", tables["optimise_optima"], scenario)) is not None:
        return lacking
    error, sheet, above = Quantity("error of the angle", "deg", r"$\mu$"), Sheet(5.4, 2, 1), None
    for row, (source, motion) in enumerate(
        (
            ("networks", {name: predicted(tables, name)["value"].to_numpy() for name in learned}),
            ("simulation", {name: samples[name].to_numpy() for name in learned}),
        )
    ):
        lift = clearance_lift(motion)
        best = optima.loc[f"{source}_{next(iter(scenario.optimise.boxes))}_genetic"]
        found = best["crank_length"], best["rod_length"]
        title = (
            f"{source}: $L_2$ = {1e3 * found[0]:.3f} mm, $L_3$ = {1e3 * found[1]:.3f} mm, "
            f"RMS in the window {-100 * best['rms_reduction']:+.1f} %"
        ).replace("-", "−")
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, error, below=above)
        for series, lengths, colour in (
            ("desired − actual", original, "simulation"),
            ("desired − optimised", found, "genetic"),
        ):
            actual = transmission_angle(*lengths, crank_angle, lift, offset)
            panel.line(series, angle, np.degrees(desired - actual), colour)
        panel.horizontal_line("zero", 0.0)
        for edge in np.degrees(scenario.optimise.window):
            if 0.0 < edge < 359.99:
                panel.vertical_line("edge of the window", angle[0] + edge)
        panel.over_crank_angle(angle[0], angle[-1])
        above = panel
    sheet.legend()
    return sheet.drawing()


def _without_optimum(name: str, optima: pd.DataFrame, scenario: Scenario) -> Drawing | None:
    """The reason as a figure where the main box has no optimum."""
    from jointgap.lengths.region import LEAST_FORCE  # loads scipy

    if (optima["point"] == f"{LEAST_FORCE}_{next(iter(scenario.optimise.boxes))}").any():
        sentence = "no optimum: no lengths found that keep the largest pin force"
        return plot.message_sheet(described(name, scenario).title, sentence)
    return None


@figure(
    "valley",
    "Objective over both lengths",
    "Optimum",
    (
        "optimise_valley",
        "optimise_floor",
        "optimise_paths",
        "optimise_population",
        "optimise_optima",
    ),
)
def valley(tables: Tables, scenario: Scenario) -> Drawing:
    """[networks:Frozen joint motion from the networks. ][not unsettled:Frozen joint motion from a
    settled revolution of the simulation. ][not angle:Simulated with clearance. ]Left: [angle:RMS
    error][not angle:objective] over both lengths in the main box, with bounds, constraint, starts
    and paths of the local optimiser, the best of each generation of the genetic algorithm, [not
    paper:and ]both optima[paper: and the paper's three points]. [angle:The error depends
    almost only on the ratio of the lengths: one flat valley, not many minima. ]Right: reduction of
    the [angle:error along the valley's floor, for each measure at its best crank length][not
    angle:objective for each rod length, at the best crank length that the constraints allow]."""
    if (lacking := _without_optimum("valley", tables["optimise_optima"], scenario)) is not None:
        return lacking
    from jointgap.lengths.objective import GOALS  # loads scipy

    box, sources = next(iter(scenario.optimise.boxes)), set(tables["optimise_optima"]["source"])
    source = next(
        name for name in ("networks", "with_clearance", "simulation_settled") if name in sources
    )
    shown = {
        name.removeprefix("optimise_"): (
            frame[
                (frame["source"] == source) & (frame["box"].isna() | (frame["box"] == box))
            ].assign(crank_length=1e3 * frame["crank_length"], rod_length=1e3 * frame["rod_length"])
        )
        for name, frame in tables.items()
        if name in FIGURES["valley"].tables
    }
    sheet = Sheet(4.9, 1, 2, width_ratios=[1.35, 1.0])
    _map(sheet, shown, scenario, box)
    goal = GOALS[scenario.optimise.objective]
    reduced, title, measures = REDUCTION, "along the valley's floor", MEASURES
    if source == "with_clearance":
        reduced, title = Quantity(f"reduction of the {goal.words}", "%"), "best crank for each rod"
        measures = {goal.measure: (goal.words, "simulation")}
    panel = sheet.panel((0, 1), title, ROD, reduced)
    for measure, (words, colour) in measures.items():
        part = shown["floor"][shown["floor"]["measure"] == measure]
        dashes = "--" if measure == "mean_absolute" else "-"  # may coincide with the RMS
        panel.line(
            words,
            part["rod_length"],
            100 * part["reduction"],
            colour,
            linewidth=1.3,
            linestyle=dashes,
        )
    lines = panel.axes.get_lines()
    gain = "objective_reduction" if source == "with_clearance" else "rms_reduction"
    gained = shown["optima"].assign(reduction=100 * shown["optima"][gain])
    _points(panel, gained, "rod_length", "reduction")
    bottom, top = panel.axes.get_ylim()
    panel.axes.set_ylim(bottom, top + 0.5 * (top - bottom))  # room for the legend
    panel.axes.legend(handles=lines, loc="upper left")
    sheet.legend(sheet.panels[:1])
    return sheet.drawing()


def _map(sheet: Sheet, shown: dict[str, pd.DataFrame], scenario: Scenario, box: str) -> None:
    """The objective over both lengths [mm], with the paths of the optimisers."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import MaxNLocator

    from jointgap.lengths.objective import GOALS  # loads scipy

    goal, is_angle = (
        GOALS[scenario.optimise.objective],
        scenario.optimise.objective == "transmission_angle",
    )
    size, title = ("RMS error of μ", "error") if is_angle else (goal.words,) * 2
    size, values = Quantity(size, goal.unit), "rms" if is_angle else "objective"
    panel = sheet.panel((0, 0), f"{title} over both lengths, box '{box}'", CRANK, ROD)
    grid = goal.factor * shown["valley"].pivot(
        index="rod_length", columns="crank_length", values=values
    )
    low, high = grid.min(axis=None), grid.max(axis=None)
    look = {"levels": np.geomspace(low, high, 15), "cmap": "Blues_r", "norm": LogNorm()}
    if not is_angle:
        look = {"levels": MaxNLocator(15).tick_values(low, high), "cmap": "Blues_r"}
    drawn = panel.contours(
        "objective", grid.columns.to_numpy(), grid.index.to_numpy(), grid.to_numpy(), size, **look
    )
    bar = sheet.figure.colorbar(
        drawn, ax=panel.axes, label=size.label, location="bottom", shrink=0.9, aspect=30
    )
    if is_angle:
        ticks = [tick for tick in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if low <= tick <= high]
        bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        bar.minorticks_off()

    bounds = scenario.optimise.boxes[box]
    (left, right), (low, high) = (
        1e3 * np.array(edges) for edges in (bounds.crank_length, bounds.rod_length)
    )
    panel.line("bounds", [left, right, right, left, left], [low, low, high, high, low], "ideal")
    if (ratio := scenario.optimise.ratio_limit) is not None:
        limit = np.array([low, high])
        panel.line(f"$L_2$ = {ratio:g} $L_3$", ratio * limit, limit, "ideal", linestyle=":")
    floor = shown["floor"][shown["floor"]["measure"] == goal.measure]
    floor_words = "valley's floor" if is_angle else "best crank for each rod"
    panel.line(floor_words, floor["crank_length"], floor["rod_length"], "optimised", linewidth=2.2)
    for number, path in shown["paths"].groupby("start"):
        x, y = path["crank_length"], path["rod_length"]
        panel.line("local paths", x, y, "local")
        panel.marks(
            "starting points",
            x.iloc[:1],
            y.iloc[:1],
            "local",
            markerfacecolor="white",
            labels=[str(number)],
        )
    best = shown["population"].loc[shown["population"].groupby("generation")["objective"].idxmin()]
    generations, mark = "genetic, generations' best", {"marker": "+", "zorder": 4}
    panel.marks(generations, best["crank_length"], best["rod_length"], "genetic", **mark)
    _points(panel, shown["optima"], "crank_length", "rod_length")
    margin = 0.03 * np.array([right - left, high - low])
    panel.axes.set_xlim(left - margin[0], right + margin[0])
    panel.axes.set_ylim(low - margin[1], high + margin[1])


def _points(panel: Panel, optima: pd.DataFrame, x: str, y: str) -> None:
    """Optima found and, for the paper's mechanism, the printed ones."""
    for method, series, colour, style in (
        (
            "genetic",
            "genetic optimum",
            "genetic",
            {"marker": "*", "markersize": 11, "markeredgecolor": "white"},
        ),
        ("local", "local optimum", "local", {"marker": "s", "markersize": 4}),
        (
            "printed",
            "paper's three points",
            "paper",
            {"marker": "D", "markersize": 5.5, "markeredgecolor": "black"},
        ),
    ):
        rows = optima[optima["method"] == method]
        if len(rows):
            panel.marks(
                series, rows[x], rows[y], colour, labels=list(rows["point"]), zorder=5, **style
            )


@figure(
    "resimulation",
    "Reductions, estimated and simulated again",
    "Optimum",
    ("optimise_resimulated",),
)
def resimulation(tables: Tables, scenario: Scenario) -> Drawing:
    """Reduction of the [angle:error of the transmission angle][not angle:objective] for the lengths
    listed on the left ([paper:from the paper, and ]from the genetic algorithm on each source). Open
    diamonds: estimate [angle:with unchanged joint motion (frozen)][not angle:of the search]. Dots:
    simulated again, median of an ensemble of perturbed starts; bars: 5 to 95 %. [angle:Left: window
    of the first revolution. Right: a settled revolution. ][not angle:Left: the objective. Right:
    error of the transmission angle, a side effect. ]A bar that crosses zero means no significant
    gain."""
    from jointgap.lengths.objective import GOALS  # loads scipy

    table, box = tables["optimise_resimulated"], next(iter(scenario.optimise.boxes))
    if (lacking := _without_optimum("resimulation", table, scenario)) is not None:
        return lacking
    origin = {
        name if name.startswith("printed_") else f"{name}_{box}_genetic": words
        for name, words in LENGTHS.items()
    }
    wanted = [point for point in table["point"].unique() if point in origin]
    place = np.arange(len(wanted))[::-1]
    sheet = Sheet(1.6 + 0.72 * len(wanted), 1, 2)
    numbers = ["reduction", "reduction_low", "reduction_high", "frozen_reduction"]
    goal, apart = GOALS[scenario.optimise.objective], (0.3, 0.0, -0.3)
    columns = [
        ("window", "window of the first revolution", REDUCTION, MEASURES),
        ("settled", "whole settled revolution", REDUCTION, MEASURES),
    ]
    if scenario.optimise.objective != "transmission_angle":
        size = Quantity(f"reduction of the {goal.words}", "%")
        columns[0] = ("settled", goal.words, size, {goal.measure: (goal.words, "limit")})
        columns[1] = ("settled", "error of the transmission angle", REDUCTION, MEASURES)
    for column, (stretch, title, reduced, measures) in enumerate(columns):
        panel = sheet.panel((0, column), title, reduced, Quantity("lengths from", ""))
        for lengths in place[::2]:
            panel.axes.axhspan(lengths - 0.5, lengths + 0.5, color="#F4F4F4", zorder=0)
        shown = [
            (measure, *look) for measure, look in measures.items() if measure != "sum_of_squares"
        ]
        for shift, (measure, words, colour) in zip(
            apart if len(shown) > 1 else (0.0,), shown, strict=True
        ):
            rows = table[(table["stretch"] == stretch) & (table["measure"] == measure)].set_index(
                "point"
            )
            again, low, high, frozen = 100 * rows.loc[wanted, numbers].to_numpy().T
            more = {"labels": wanted, "along": "x"}
            panel.marks(
                f"{words}, simulated again",
                again,
                place + shift - _APART,
                colour,
                low,
                high,
                **more,
            )
            look = {"labels": wanted, "marker": "D", "markerfacecolor": "white"}
            estimate = "motion frozen" if measure in MEASURES else "search"
            panel.marks(f"{words}, {estimate}", frozen, place + shift + _APART, colour, **look)
        panel.vertical_line("no change", 0.0, named=False)
        panel.rows(["" if column else origin[point] for point in wanted], place)
        panel.axes.set_ylim(-0.5, len(wanted) - 0.5)
        if column:
            panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()
