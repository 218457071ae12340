"""The figures of a scenario; their titles, captions and quantities are in `figures.yaml`."""

from collections.abc import Mapping
from pathlib import Path

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
FIGURES = Figures(Path(__file__).with_suffix(".yaml"))
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


def predicted(tables: Tables, output: str, column: str = "value") -> np.ndarray:
    """The network's prediction of one `output`, from the frame ``predictions``."""
    frame = tables["predictions"]
    is_output = (frame["surrogate"] == "networks") & (frame["output"] == output)
    return frame.loc[is_output, column].to_numpy()


def first_and_settled(tables: Tables, scenario: Scenario) -> dict[str, tuple[str, pd.DataFrame]]:
    """Colour and samples of the first and of the settled revolution, by title."""
    settled = scenario.optimise.ensemble.settled_revolution
    first, last = (revolution(tables["trajectory"], scenario, number) for number in (1, settled))
    title = f"settled revolution ({settled})"
    return {"first revolution": ("first", first), title: ("settled", last)}


def _over_angle(
    sheet: Sheet,
    place: tuple,
    title: str,
    y: Quantity,
    angle: np.ndarray,
    curves: Mapping[str, tuple],
    above: Panel | None = None,
) -> Panel:
    """A panel of curves over the crank `angle` [deg]: values, colour and optional line style by
    series; it shares the abscissa of the panel `above`."""
    panel = sheet.panel(place, title, CRANK_ANGLE, y, below=above)
    for series, (values, colour, *style) in curves.items():
        panel.line(series, angle, values, colour, linestyle=style[0] if style else "-")
    panel.over_crank_angle(angle[0], angle[-1])
    return panel


def _spread(panel: Panel, curves: Mapping[str, tuple]) -> None:
    panel.spread_scale(np.concatenate([values for values, *_ in curves.values()]))


# -- motion

_ACTUAL = {  # series and colour by source in the table kinematics (networks only if trained)
    "networks_paper_form": ("with clearance: networks", "network"),
    "simulation": ("with clearance: simulation", "simulation"),
}


@figure
def motion(
    tables: Tables,
    scenario: Scenario,
    columns: Mapping[str, str],
    name: str,
    unit: str,
    factor: float,
) -> Drawing:
    """Desired and actual motion above their difference, for each of the `columns` of the table
    kinematics."""
    sources = by_source(tables)
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(columns))
    for column, (key, title) in enumerate(columns.items()):
        desired = factor * sources["ideal"][key].to_numpy()
        actual = {
            series: (factor * sources[source][key].to_numpy(), colour)
            for source, (series, colour) in _ACTUAL.items()
            if source in sources
        }
        deviation = {
            series: (values - desired, *look) for series, (values, *look) in actual.items()
        }
        both = actual | {"without clearance (desired)": (desired, "ideal", "--")}
        above = _over_angle(sheet, (0, column), title, Quantity(name, unit), angle, both)
        less = Quantity("actual − desired", unit)
        below = _over_angle(sheet, (1, column), "deviation", less, angle, deviation, above)
        peak = np.max(np.abs(desired))
        for panel, curves in ((above, actual), (below, deviation)):
            if np.nanmax(np.abs([values for values, _ in curves.values()])) > IMPACTS_DWARF * peak:
                panel.linear_then_logarithmic(round_up(peak))
    sheet.legend()
    return sheet.drawing()


# -- contact

DEPTH_DRAWN = 0.3  # [1] drawn depth of the settled orbit's largest penetration, over the clearance
INNERMOST = 10.0  # [um] largest linear range of the gap's axis; logarithmic beyond
SECTOR = 60.0  # [deg] the axis of the impacts ends at a multiple of it
CONSTANT = 1e-4  # [1] relative variation below which a speed is constant


@figure
def orbits(tables: Tables, scenario: Scenario) -> Drawing:
    """Paths of the journals, and distances of the centres minus the clearances."""
    mechanism, joints = scenario.mechanism.applied(), loose_joints(scenario)
    sheet = Sheet(2.9 * len(joints), len(joints), 3, width_ratios=[1.0, 1.0, 1.25])
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    x, y = (Quantity(f"journal, {axis}", "mm") for axis in "xy")
    gap_axis = Quantity("penetration (+), gap (−)", "µm")
    for row, (name, number) in enumerate(joints.items()):
        joint, label = mechanism.joint(name), format_name(name)
        clearance = joint.clearance
        depth = sheet.panel((row, 2), f"{label}: depth", CRANK_ANGLE, gap_axis)
        revolutions = first_and_settled(tables, scenario)
        for column, (series, (colour, samples)) in enumerate(revolutions.items()):
            panel = sheet.panel((row, column), f"{label}, {colour}", x, y)
            distance = samples[f"r{number}"].to_numpy()
            gap = distance - clearance
            penetration = np.clip(gap, 0.0, None)
            magnification = 1.0
            if colour == "settled":
                deepest = max(penetration.max(), 1e-9 * clearance)
                magnification = round_number(DEPTH_DRAWN * clearance / deepest)
                look = {"ha": "center", "va": "center", "color": COLOURS["limit"]}
                panel.axes.text(0, 0, f"depth ×{magnification:g}", **look)
            drawn = penetration / np.maximum(distance, clearance)
            stretch = 1.0 + (magnification - 1.0) * drawn
            radius = 1e3 * clearance
            panel.line("clearance circle", radius * np.cos(turn), radius * np.sin(turn), "limit")
            panel.line(series, *(1e3 * stretch * eccentricity(samples, name, joint).T), colour)
            panel.square(1.4 * radius)
            angle = degrees(samples["crank_angle"])
            depth.line(series, angle, 1e6 * gap, colour)
            depth.over_crank_angle(angle[0], angle[-1])
        usual = 1e6 * np.quantile(np.abs(gap), 0.9)  # of the settled revolution
        depth.linear_then_logarithmic(min(round_number(2.0 * usual), INNERMOST))
    sheet.legend()
    return sheet.drawing()


@figure
def contact_forces(tables: Tables, scenario: Scenario) -> Drawing:
    """Normal forces and modes of the loose joints."""
    joints = {name: format_name(name) for name in loose_joints(scenario)}
    rows = range(len(joints))[::-1]
    sheet = Sheet(4.4 + 0.5 * len(joints), 4, 1, height_ratios=[2.0, 0.25 * len(joints)] * 2)
    peak = max(tables["trajectory"][f"{name}_normal_force"].max() for name in joints)
    for row, (title, (_, samples)) in enumerate(first_and_settled(tables, scenario).items()):
        angle = degrees(samples["crank_angle"])
        forces = {
            label: (samples[f"{name}_normal_force"].where(lambda force: force > 0.0), label)
            for name, label in joints.items()
        }
        size = Quantity("normal force", "N")
        panel = _over_angle(sheet, (2 * row, 0), title, size, angle, forces)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(SMALLEST_FORCE, 2.0 * max(peak, SMALLEST_FORCE))
        modes = Quantity("joint", "")
        place = 2 * row + 1, 0
        below = _over_angle(sheet, place, f"{title}: modes", modes, angle, {}, panel)
        for height, (name, label) in zip(rows, joints.items(), strict=True):
            below.bands(height, label, angle, samples[f"{name}_mode"].to_numpy(), MODES)
        below.rows(list(joints.values()), rows)
        below.axes.set(title="", ylabel="")
    sheet.legend()
    return sheet.drawing()


_OPEN = {"markerfacecolor": "white", "marker": "s"}


@figure
def impacts(tables: Tables, scenario: Scenario, sizes: Mapping[str, str]) -> Drawing:
    """Impulse, peak force and approach speed of each contact where it begins."""
    crank_angle = tables["trajectory"]["crank_angle"]
    start, end = degrees(crank_angle)[[0, -1]]
    turn = start - np.degrees(crank_angle.iloc[0])
    contacts = {name: contacts_of(tables["events"], name) for name in loose_joints(scenario)}
    begins = turn + np.degrees(pd.concat(contacts)["crank_angle"])
    if len(begins):
        end = min(end, start + SECTOR * np.ceil((begins.max() - start) / SECTOR))
    sheet, panel = Sheet(6.4, 3, 1), None
    for row, (label, unit) in enumerate(sizes.items()):
        title, size = f"{label} of each contact", Quantity(label, unit)
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, size, below=panel)
        # outer loop: one legend column per kind
        for kind, lasts, style in (
            ("hits and rebounds", False, {}),
            ("stays in contact", True, _OPEN),
        ):
            for name, events in contacts.items():
                joint = format_name(name)
                shown = events[(events["maxima"] <= 1) != lasts].astype(float)
                if len(shown):
                    angle = turn + np.degrees(shown["crank_angle"])
                    y = shown[label.replace(" ", "_")]
                    panel.marks(f"{joint}: {kind}", angle, y, joint, markersize=4.0, **style)
        panel.logarithmic()
        panel.over_crank_angle(start, end)
    if len(begins):
        sheet.legend(columns=2)
    return sheet.drawing()


@figure
def drive_and_guide(tables: Tables, scenario: Scenario, panels: Mapping[str, dict]) -> Drawing:
    """Speed and torque of the crank, force and moment of the guide."""
    revolutions, sheet = first_and_settled(tables, scenario), Sheet(5.2, 2, 2)
    angle = degrees(revolution(tables["trajectory"], scenario, 1)["crank_angle"])
    for place, (column, shown) in enumerate(panels.items()):
        curves = {
            series: (shown["factor"] * samples[column].to_numpy(), colour)
            for series, (colour, samples) in revolutions.items()
        }
        quantity = Quantity(shown["name"], shown["unit"])
        panel = _over_angle(sheet, divmod(place, 2), shown["title"], quantity, angle, curves)
        _spread(panel, curves)
        panel.axes.get_lines()[0].set_linewidth(1.7)  # stays visible below the settled revolution
        values = np.array([values for values, _ in curves.values()])
        middle = float(values.mean())
        if column == "crank_speed" and np.ptp(values) <= CONSTANT * abs(middle):
            panel.axes.set_ylim(0.9 * middle, 1.1 * middle)
    sheet.legend()
    return sheet.drawing()


@figure
def animation(tables: Tables, scenario: Scenario) -> Drawing:
    """The mechanism with magnified clearances."""
    return moving.animation(tables["trajectory"], scenario)


# -- networks

EVERYWHERE, AT_POINTS = "network − simulation, all samples", "network − simulation, training points"
SYMBOLS = {"r": "r", "gamma": r"\gamma", "gamma_dot": r"\dot\gamma", "gamma_ddot": r"\ddot\gamma"}


def symbol(output: str) -> str:
    """Symbol of an output as mathtext."""
    number = str(number_of(output))
    return f"${SYMBOLS[output.replace(number, '')]}_{number}$"


@figure
def values_and_errors(tables: Tables, scenario: Scenario, kinds: Mapping[str, dict]) -> Drawing:
    """Values above their errors: a column per joint, a pair of rows per kind of output."""
    samples = revolution(tables["trajectory"], scenario, 1)
    angle = degrees(samples["crank_angle"])
    step = scenario.simulate.samples_per_revolution // (scenario.surrogate.training_points - 1)
    joints, rows = loose_joints(scenario), 2 * len(kinds)
    width = plot.width_for(len(joints))
    sheet = Sheet(0.6 + 2.1 * rows, rows, len(joints), width=width)
    for column, (joint, number) in enumerate(joints.items()):
        for row, (kind, shown) in enumerate(kinds.items()):
            base, _, order = kind.partition("_")
            output = f"{base}{number}_{order}".rstrip("_")
            simulated, network = samples[output].to_numpy(), predicted(tables, output)
            curves = {
                "simulation": (shown["factor"] * simulated, "simulation"),
                "network": (shown["factor"] * network, "network", (0, (4, 2))),
            }
            crank = {"crank angle": (angle, "limit", ":")} if output == "gamma2" else {}
            title = f"{format_name(joint)}: {shown['label']} {symbol(output)}"
            value = Quantity(shown["label"], shown["unit"], symbol(output))
            above = _over_angle(sheet, (2 * row, column), title, value, angle, curves | crank)
            _spread(above, curves)
            error = shown["error_factor"] * (network - simulated)
            curves = {EVERYWHERE: (error, "network")}
            title, value = f"{format_name(joint)}: error", Quantity("error", shown["error_unit"])
            place = 2 * row + 1, column
            below = _over_angle(sheet, place, title, value, angle, curves, above)
            below.marks(AT_POINTS, angle[::step], error[::step], "ideal", markersize=1.6)
            _spread(below, curves)
    sheet.legend()
    return sheet.drawing()


PAPER_ITERATIONS = 20_000  # of every network in the paper
CURVE_POINTS = 300  # per curve, evenly spaced on its logarithmic axis
ITERATION, ERROR = Quantity("iteration", "1"), Quantity("MSE over squared range", "1")


@figure
def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Error of each network over the iterations, of all starts."""
    history = tables["fit_history"].query("model == 'network' and iteration > 0")
    default = scenario.surrogate.seeds[0]
    paper = tables["fit_errors"].drop_duplicates("output").set_index("output")["paper_mse"]
    learned = outputs(scenario.mechanism.applied().loose)
    rows = len(learned) // 4
    sheet = Sheet((2.9, 4.6, 6.4)[rows - 1], rows, 4)
    for place, output in enumerate(learned):
        column, row = divmod(place, rows)
        above = sheet.panels[-1] if row else None
        title = f"network {symbol(output)}"
        panel = sheet.panel((row, column), title, ITERATION, ERROR, below=above)
        curves = history[history["output"] == output]
        for seed in reversed(curves["seed"].unique()):
            curve = curves[curves["seed"] == seed]
            points = np.round(np.geomspace(1, len(curve), CURVE_POINTS)).astype(int)
            curve = curve.iloc[np.unique(points) - 1]
            series, colour, look = "other starts", "other", {"linewidth": 0.6}
            if seed == default:
                series, colour = "default start", "network"
                look = {"linewidth": 1.4, "zorder": 3}
            panel.line(series, curve["iteration"], curve["mse"], colour, **look)
        if paper[output] > 0:  # the paper prints one
            point = [PAPER_ITERATIONS], [paper[output]]
            panel.marks("paper, after 20 000", *point, "paper", marker="D", zorder=4)
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


@figure
def held_out(
    tables: Tables, scenario: Scenario, marks: Mapping[str, dict], regions: Mapping[str, str]
) -> Drawing:
    """Errors of all models at the training points and between them."""
    learned = list(outputs(scenario.mechanism.applied().loose))
    sheet, panel = Sheet(6.6, 2, 1), None
    for row, (region, title) in enumerate(regions.items()):
        panel = sheet.panel((row, 0), title, Quantity("output", ""), ERROR, below=panel)
        errors = tables["fit_errors"].query(f"region == {region!r}")
        _error_marks(panel, errors, scenario.surrogate.seeds[0], learned, marks)
        panel.axes.set_yscale("log")
        panel.axes.minorticks_off()
        panel.categories([symbol(output) for output in learned])
    panel.axes.sharey(sheet.panels[0].axes)
    panel.axes.autoscale(axis="y")
    sheet.legend()
    return sheet.drawing()


def _error_marks(
    panel: Panel,
    errors: pd.DataFrame,
    default: int,
    learned: list[str],
    marks: Mapping[str, dict],
) -> None:
    """Errors of the default start, with the range over all starts as bars."""
    place = np.arange(len(learned))
    for series, shown in marks.items():
        rows, column = errors[errors["model"] == shown["model"]], shown["column"]
        if rows.empty:
            continue
        low = high = None
        if column in ("training_mse", "held_out_mse") and rows["seed"].nunique() > 1:
            by_output = rows.groupby("output")[column]
            low, high = by_output.agg(["min", "max"]).reindex(learned).to_numpy().T
        error = rows[rows["seed"] == default].set_index("output")[column].reindex(learned)
        points = place + shown["shift"], error.to_numpy(), shown["colour"]
        panel.marks(series, *points, low, high, learned, marker=shown["marker"])
    paper = errors.groupby("output")["paper_mse"].first().reindex(learned).to_numpy()
    if np.isfinite(paper).any():
        look = {"labels": learned, "marker": "_", "markersize": 22}
        panel.marks("paper, training points", place, paper, "paper", **look)


@figure
def contradictions(tables: Tables, scenario: Scenario, derived: Mapping[str, dict]) -> Drawing:
    """Derivatives of networks minus the networks of the derivatives, and their effects."""
    joints, sources = loose_joints(scenario), by_source(tables)
    shares = 2 * len(joints)  # grid columns: half of the width per piston panel, 1/n per joint
    sheet = Sheet(5.6, 2, shares, width=plot.width_for(len(joints)))
    angle = degrees(sources["simulation"]["crank_angle"])
    rate = Quantity("contradiction", "rad/s")
    for column, (joint, number) in enumerate(joints.items()):
        name = f"gamma{number}"
        difference = predicted(tables, name, "rate") - predicted(tables, f"{name}_dot")
        curves = {"derivative of one network − the other network": (difference, "ideal")}
        title = f"{format_name(joint)}: d{symbol(name)}/dt − {symbol(f'{name}_dot')}"
        place = 0, slice(2 * column, 2 * column + 2)
        _spread(_over_angle(sheet, place, title, rate, angle, curves), curves)
    for half, (order, shown) in enumerate(derived.items()):
        motion = {name: frame[f"slider_{order}"].to_numpy() for name, frame in sources.items()}
        curves = {
            series: (shown["factor"] * (motion[f"networks_{form}"] - motion["simulation"]), colour)
            for series, form, colour in (
                ("one output derived from another network", shown["form"], "spline"),
                ("each output from its own network", "paper_form", "network"),
            )
        }
        place = 1, slice(half * shares // 2, (half + 1) * shares // 2)
        title = rf"piston: {order}, $\gamma$ {shown['change']}"
        error = Quantity("networks − simulation", shown["unit"])
        _spread(_over_angle(sheet, place, title, error, angle, curves), curves)
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


@figure
def transmission_errors(tables: Tables, scenario: Scenario) -> Drawing:
    """Error of the angle at the original and at the optimised lengths."""
    from jointgap.motion.kinematics import clearance_lift, transmission_angle

    optima = tables["optimise_optima"]
    if (message := _without_optimum("figure_16", optima, scenario)) is not None:
        return message
    mechanism, samples = scenario.mechanism.applied(), revolution(tables["trajectory"], scenario, 1)
    crank_angle, angle = samples["crank_angle"].to_numpy(), degrees(samples["crank_angle"])
    original, offset = (mechanism.crank.length, mechanism.rod.length), mechanism.slider.offset
    desired = transmission_angle(*original, crank_angle, 0.0, offset)
    numbers = loose_joints(scenario).values()
    names = [f"{name}{number}" for number in numbers for name in ("r", "gamma")]
    error, sheet, panel = Quantity("error of the angle", "deg", r"$\mu$"), Sheet(5.4, 2, 1), None
    for row, source in enumerate(("networks", "simulation")):
        point = f"{source}_{next(iter(scenario.optimise.boxes))}_genetic"
        optimum = optima.set_index("point").loc[point]
        lengths = optimum["crank_length"], optimum["rod_length"]
        title = (
            f"{source}: $L_2$ = {1e3 * lengths[0]:.3f} mm, $L_3$ = {1e3 * lengths[1]:.3f} mm, "
            f"RMS in the window {-100 * optimum['rms_reduction']:+.1f} %"
        ).replace("-", "−")
        is_learned = source == "networks"
        motion = {name: predicted(tables, name) if is_learned else samples[name] for name in names}
        lift = clearance_lift({name: np.asarray(values) for name, values in motion.items()})
        curves = {
            series: (
                np.degrees(desired - transmission_angle(*pair, crank_angle, lift, offset)),
                colour,
            )
            for series, pair, colour in (
                ("desired − actual", original, "simulation"),
                ("desired − optimised", lengths, "genetic"),
            )
        }
        panel = _over_angle(sheet, (row, 0), title, error, angle, curves, panel)
        panel.horizontal_line("zero", 0.0)
        for edge in np.degrees(scenario.optimise.window):
            if 0.0 < edge < 359.99:
                panel.vertical_line("edge of the window", angle[0] + edge)
    sheet.legend()
    return sheet.drawing()


def _without_optimum(name: str, optima: pd.DataFrame, scenario: Scenario) -> Drawing | None:
    """The reason as a figure where the main box has no optimum."""
    from jointgap.lengths.region import LEAST_FORCE  # loads scipy

    if (optima["point"] == f"{LEAST_FORCE}_{next(iter(scenario.optimise.boxes))}").any():
        sentence = "no optimum: no lengths found that keep the largest pin force"
        return plot.message_sheet(described(name, scenario).title, sentence)
    return None


@figure
def valley(tables: Tables, scenario: Scenario, points: Mapping[str, dict]) -> Drawing:
    """The objective over both lengths, and its reduction along the floor of the valley."""
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
    _map(sheet, shown, scenario, box, points)
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
    _points(panel, points, gained, "rod_length", "reduction")
    bottom, top = panel.axes.get_ylim()
    panel.axes.set_ylim(bottom, top + 0.5 * (top - bottom))  # room for the legend
    panel.axes.legend(handles=lines, loc="upper left")
    sheet.legend(sheet.panels[:1])
    return sheet.drawing()


def _map(sheet: Sheet, shown: Tables, scenario: Scenario, box: str, points: dict) -> None:
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
        plot.label_log_ticks(bar.ax.xaxis, low, high)

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
    _points(panel, points, shown["optima"], "crank_length", "rod_length")
    margin = 0.03 * np.array([right - left, high - low])
    panel.axes.set_xlim(left - margin[0], right + margin[0])
    panel.axes.set_ylim(low - margin[1], high + margin[1])


def _points(panel: Panel, points: dict, optima: pd.DataFrame, x: str, y: str) -> None:
    """Optima found and, for the paper's mechanism, the printed ones."""
    for method, shown in points.items():
        rows = optima[optima["method"] == method]
        if len(rows):
            labels, place = list(rows["point"]), (rows[x], rows[y])
            panel.marks(shown["series"], *place, shown["colour"], labels=labels, **shown["style"])


@figure
def resimulation(tables: Tables, scenario: Scenario, origins: Mapping[str, str]) -> Drawing:
    """Reductions of the lengths found and printed, estimated and simulated again."""
    from jointgap.lengths.objective import GOALS  # loads scipy

    table, box = tables["optimise_resimulated"], next(iter(scenario.optimise.boxes))
    if (lacking := _without_optimum("resimulation", table, scenario)) is not None:
        return lacking
    origins = {
        name if name.startswith("printed_") else f"{name}_{box}_genetic": words
        for name, words in origins.items()
    }
    wanted = [point for point in table["point"].unique() if point in origins]
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
        panel.rows(["" if column else origins[point] for point in wanted], place)
        panel.axes.set_ylim(-0.5, len(wanted) - 0.5)
        if column:
            panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()
