"""The mechanism in motion over the first revolution, with magnified clearances."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT, JOINT_NUMBERS
from jointgap.core.plot import COLOURS, CRANK_ANGLE, INK, Drawing, Quantity, Sheet
from jointgap.core.words import format_name
from jointgap.scenario.figure_data import (
    SMALLEST_FORCE,
    degrees,
    eccentricity,
    loose_joints,
    revolution,
)

OPENING, SHARE = (
    60.0,
    0.5,
)  # [deg] first part of the revolution, with flight and impacts, and its share of the frames
FRAME_DURATION = 0.06  # s
WIDTH, HEIGHT, DOTS_PER_INCH = 6.4, 4.9, 100  # [in], [in], [1/in]
JOURNAL = 14.0  # [mm] drawn radius of a journal
ARROW = 30.0  # [mm] length of a force's arrow for each factor of 10 above SMALLEST_FORCE
FORCE = Quantity("normal force", "N")

Move = Callable[[int], tuple]
"""Updates the artists of a frame and returns them."""


def animation(trajectory: pd.DataFrame, scenario: Scenario) -> Drawing:
    """Mechanism with magnified clearances, paths of the journals, and contact forces as arrows and
    curves."""
    first = revolution(trajectory, scenario, 1)
    samples = first.iloc[_frames(len(first) - 1, scenario.figures.animation_frames)].reset_index(
        drop=True
    )
    joints = list(loose_joints(scenario))
    ratios, width = [1.0] * len(joints) + [1.5], WIDTH + 1.6 * max(len(joints) - 2, 0)
    sheet = Sheet(
        HEIGHT, 2, len(ratios), width=width, height_ratios=[1.3, 1.0], width_ratios=ratios
    )
    moves = [_mechanism(sheet, samples, scenario)]
    moves += [
        _bearing(sheet, column, name, first, samples, scenario)
        for column, name in enumerate(joints)
    ]
    moves.append(_forces(sheet, joints, first, samples))
    return Drawing(
        sheet.figure, sheet.drawing().data, film(sheet, moves, len(samples)), FRAME_DURATION
    )


def _frames(samples: int, frames: int) -> np.ndarray:
    """Samples of one revolution to show: SHARE of the frames before OPENING, the rest evenly over
    the remainder."""
    slow, until = round(SHARE * frames), OPENING / 360.0 * samples
    chosen = np.concatenate(
        [np.linspace(0.0, until, slow, False), np.linspace(until, samples, frames - slow)]
    )
    return np.unique(np.round(chosen).astype(int))


def film(sheet: Sheet, moves: list[Move], frames: int) -> tuple[np.ndarray, ...]:
    """Render the static artists once, and the moving ones on top of them in each frame."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(sheet.figure)
    sheet.figure.set_dpi(DOTS_PER_INCH)
    for artist in (artist for move in moves for artist in move(0)):
        artist.set_animated(True)
    canvas.draw()
    still, shots = canvas.copy_from_bbox(sheet.figure.bbox), []
    for frame in range(frames):
        canvas.restore_region(still)
        for artist in (artist for move in moves for artist in move(frame)):
            artist.axes.draw_artist(artist)
        shots.append(np.asarray(canvas.buffer_rgba())[:, :, :3].copy())
    return tuple(shots)


def magnification(scenario: Scenario) -> float:
    """Factor of the clearances, by which the largest is about a quarter of the crank."""
    mechanism = scenario.mechanism.applied()
    largest = max((mechanism.joint(name).clearance for name in mechanism.loose), default=np.inf)
    return float(f"{0.25 * mechanism.crank.length / largest:.1g}")


def _face(joint: str, force: float) -> str:
    """Colour of a journal: grey in flight, its joint's colour in contact."""
    return COLOURS[format_name(joint)] if force > 0.0 else COLOURS["flight"]


def _outward(name: str, scenario: Scenario) -> bool:
    """Whether the joint's body farther from the frame carries the journal."""
    joint = scenario.mechanism.applied().joint(name)
    return joint is not None and joint.journal == JOINT[name].body


def _arrow(samples: pd.DataFrame, name: str, outward: bool) -> np.ndarray:
    """Arrow of the force on the journal, shape (frames, 2) [mm]."""
    vector = samples[[f"{name}_force_x", f"{name}_force_y"]].to_numpy() * (1.0 if outward else -1.0)
    size = np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), SMALLEST_FORCE)
    is_pressed = samples[[f"{name}_normal_force"]].to_numpy() > 0.0
    return is_pressed * ARROW * np.log10(size / SMALLEST_FORCE) * vector / size


def _mechanism(sheet: Sheet, samples: pd.DataFrame, scenario: Scenario) -> Move:
    """Crank, rod and piston; the rings and journals of the pins, and of the crank pivot where it is
    loose."""
    from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

    mechanism, times = scenario.mechanism.applied(), magnification(scenario)
    raw, time = samples["crank_angle"].to_numpy(), samples["time"].to_numpy()
    angle, offset = degrees(samples["crank_angle"]), 1e3 * mechanism.slider.offset

    def apart(name: str) -> np.ndarray:
        """Vector from the inner to the outer body's centre, magnified [mm]."""
        drawn = 1e3 * times * np.nan_to_num(eccentricity(samples, name, mechanism.joint(name)))
        return drawn if _outward(name, scenario) else -drawn

    pivot = apart("crank_pivot")
    crank = pivot + 1e3 * mechanism.crank.length * np.column_stack([np.cos(raw), np.sin(raw)])
    slider = np.column_stack(
        [1e3 * samples["slider_position"].to_numpy(), np.full(len(samples), offset)]
    )
    near = {"crank_pin": crank, "piston_pin": slider} | {"crank_pivot": np.zeros_like(crank)}
    far = {name: centre + apart(name) for name, centre in near.items()}
    pins = [
        "crank_pin",
        "piston_pin",
        *(["crank_pivot"] if "crank_pivot" in mechanism.loose else []),
    ]

    title = (
        f"first revolution; clearances magnified {times:g} times\narrows: force on the journal,"
        " logarithmic"
    )
    panel = sheet.panel((0, slice(None)), title, Quantity("x", "mm"), Quantity("y", "mm"))
    for series, pin in (("rod's crank end", "crank_pin"), ("rod's piston end", "piston_pin")):
        panel.record(
            series, *far[pin].T, value=angle, value_quantity="crank angle", value_unit="deg"
        )
    axes = panel.axes
    radii = [JOURNAL + 1e3 * times * mechanism.clearance(joint) for joint in pins]
    half = 1.35 * max(radii[:2])
    margin = 1e3 * mechanism.crank.length + 2.0 * max(radii)
    reach = 1e3 * (mechanism.crank.length + mechanism.rod.length) + 2.6 * half
    axes.set(xlim=(-margin, reach), ylim=(-margin, margin), aspect="equal")
    axes.grid(False)
    axes.plot(0, 0, marker="^", markersize=9, color=INK, zorder=1)
    for side in (-half, half):
        axes.axhline(offset + side, color="#999999", linewidth=0.8, xmin=0.45)
    (rod,) = axes.plot([], [], color=COLOURS["sky"], linewidth=5, solid_capstyle="round")
    (link,) = axes.plot([], [], color=INK, linewidth=5, solid_capstyle="round")
    piston = Rectangle(
        (0, 0), 2.2 * half, 2.0 * half, facecolor="#EEEEEE", edgecolor=INK, linewidth=1.2
    )
    rings = [
        Circle((0, 0), radius, facecolor="none", edgecolor=INK, linewidth=1.2) for radius in radii
    ]
    journals = [Circle((0, 0), JOURNAL, edgecolor=INK, linewidth=0.8) for _ in pins]
    look = {
        "arrowstyle": "-|>",
        "mutation_scale": 9.0,
        "linewidth": 1.6,
        "color": INK,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    arrows = [FancyArrowPatch((0, 0), (0, 1), **look) for _ in pins]
    words = axes.text(0.99, 0.97, "", transform=axes.transAxes, ha="right", va="top", fontsize=8.5)
    for patch in (piston, *rings, *journals, *arrows):
        axes.add_patch(patch)
    drawn = [_arrow(samples, pin, _outward(pin, scenario)) for pin in pins]
    forces = [samples[f"{pin}_normal_force"].to_numpy() for pin in pins]

    def move(frame: int) -> tuple:
        piston.set_xy(slider[frame] - [1.1 * half, half])
        rod.set_data(*np.transpose([far["crank_pin"][frame], far["piston_pin"][frame]]))
        link.set_data(*np.transpose([pivot[frame], crank[frame]]))
        parts = zip(pins, rings, journals, arrows, drawn, forces, strict=True)
        for pin, ring, journal, arrow, vectors, force in parts:
            bearing, centre = (
                ends[pin][frame]
                for ends in ((near, far) if _outward(pin, scenario) else (far, near))
            )
            ring.set_center(bearing)
            journal.set(center=centre, facecolor=_face(pin, force[frame]))
            arrow.set_positions(centre, centre + vectors[frame])
            arrow.set_visible(bool(vectors[frame].any()))
        slowed = FRAME_DURATION / np.diff(time[max(frame - 1, 0) :])[0]
        words.set_text(
            f"{angle[frame]:5.1f} deg, {1e3 * time[frame]:6.2f} ms\nslowed {slowed:.0f} times"
        )
        return piston, rod, link, *rings, *journals, *arrows, words

    return move


def _bearing(
    sheet: Sheet,
    column: int,
    name: str,
    first: pd.DataFrame,
    samples: pd.DataFrame,
    scenario: Scenario,
) -> Move:
    """One journal's centre in its bearing, with its past path."""
    joint, words = scenario.mechanism.applied().joint(name), format_name(name)
    panel = sheet.panel((1, column), words, Quantity("journal, x", "mm"), Quantity("y", "mm"))
    radius, circle = 1e3 * joint.clearance, np.linspace(0.0, 2.0 * np.pi, 181)
    panel.line(
        "clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit", linewidth=0.8
    )
    panel.square(1.2 * radius)
    panel.axes.locator_params(nbins=3)  # labels of a small clearance are long
    panel.axes.set_title(words, color=COLOURS[words])  # the key to the curves of the forces
    way = 1e3 * eccentricity(first, name, joint)
    centre = 1e3 * np.nan_to_num(eccentricity(samples, name, joint))
    force = samples[f"{name}_normal_force"].to_numpy()
    row = np.searchsorted(first["crank_angle"].to_numpy(), samples["crank_angle"].to_numpy())
    panel.record(words, *centre.T, value=force, value_quantity=FORCE.name, value_unit=FORCE.unit)
    (trail,) = panel.axes.plot([], [], color="#999999", linewidth=0.7)
    (dot,) = panel.axes.plot([], [], marker="o", markersize=9, markeredgecolor=INK)

    def move(frame: int) -> tuple:
        trail.set_data(*way[: row[frame] + 1].T)
        dot.set_data(*centre[frame][:, None])
        dot.set_markerfacecolor(_face(name, force[frame]))
        return trail, dot

    return move


def _forces(sheet: Sheet, joints: list[str], first: pd.DataFrame, samples: pd.DataFrame) -> Move:
    """Normal forces over the crank angle with a cursor; reactions for ideal joints."""
    panel = sheet.panel((1, len(joints)), "force in contact", CRANK_ANGLE, FORCE)
    angle, shown = degrees(first["crank_angle"]), degrees(samples["crank_angle"])
    for name in joints or JOINT_NUMBERS:
        force, words = first[f"{name}_normal_force"].to_numpy(), format_name(name)
        panel.line(words, angle, np.where(force > 0.0, force, np.nan), words, linewidth=0.5)
    panel.axes.set_yscale("log")
    panel.axes.set_ylim(bottom=SMALLEST_FORCE)
    panel.over_crank_angle(angle[0], angle[-1], step=120.0)
    cursor = panel.axes.axvline(angle[0], color=INK, linewidth=1.0)

    def move(frame: int) -> tuple:
        cursor.set_xdata([shown[frame]] * 2)
        return (cursor,)

    return move
