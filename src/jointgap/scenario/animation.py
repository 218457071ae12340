"""The mechanism in motion over the first revolution, its clearances magnified."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT, JOINT_NUMBERS
from jointgap.core.plot import COLOURS, CRANK_ANGLE, INK, Drawing, Panel, Quantity, Sheet
from jointgap.core.words import in_words
from jointgap.scenario.figures_base import CONTACT_PART, Tables, degrees, figure, loose_joints, revolution, round_number
from jointgap.scenario.figures_motion import SMALLEST_FORCE, eccentricity

OPENING, SHARE = 60.0, 0.5  # [deg] the opening, where the journals fly and hit, gets this share of the frames
FRAME_DURATION = 0.06  # s
WIDTH, HEIGHT, DOTS_PER_INCH = 6.4, 4.9, 100  # [in], [in], [1/in]: a frame fits a front page and beside text
JOURNAL = 14.0  # [mm] drawn radius of a journal
ARROW = 30.0  # [mm] length of a force's arrow for each factor of 10 above SMALLEST_FORCE
FLIGHT = "#DDDDDD"
FORCE = Quantity("normal force", "N")


@dataclass(frozen=True)
class Pin:
    """One joint as drawn: centres magnified about the frame's, the crank's or the slider's, shapes (frames, 2) [mm].

    `end` is the centre of the crank in the crank pivot, of the rod in the pins; `force` (frames,) [N] the normal force,
    `arrow` what is drawn of the force on the journal.
    """

    name: str
    journal: np.ndarray
    bearing: np.ndarray
    end: np.ndarray
    force: np.ndarray
    arrow: np.ndarray


@figure(
    "animation",
    "The mechanism in motion",
    CONTACT_PART,
    ("trajectory",),
    "First revolution. Top: the mechanism with its clearances magnified by the factor in the title; rings are "
    "bearings, dots are journals, grey in flight. Arrows: forces on the journals, 30 mm longer per factor of ten "
    "above 1 N. Bottom: path of each loose joint's journal in its true clearance circle, and the normal forces. The "
    "first 60 deg, where the journals fly and hit, take half of the frames.",
    moving=True,
)
def animation(tables: Tables, scenario: Scenario) -> Drawing:
    """Mechanism with its clearances magnified, the loose joints' journals in their bearings, contact force by arrow and
    curve."""
    first = revolution(tables["trajectory"], scenario, 1)
    chosen = _frames(len(first) - 1, scenario.figures.animation_frames)
    samples = first.iloc[chosen].reset_index(drop=True)
    joints = tuple(loose_joints(scenario))
    shown = joints or tuple(JOINT_NUMBERS)  # of ideal joints the reactions
    ratios, width = [1.0] * len(joints) + [1.5], WIDTH + 1.6 * max(len(joints) - 2, 0)
    sheet = Sheet(HEIGHT, 2, len(ratios), width=width, height_ratios=[1.3, 1.0], width_ratios=ratios)
    moving = [_Mechanism(sheet, samples, scenario)]
    moving += [_Bearing(sheet, column, name, first, samples, scenario) for column, name in enumerate(joints)]
    moving.append(_Forces(sheet, len(joints), shown, first, samples))
    return Drawing(sheet.figure, sheet.drawing().data, _film(sheet, moving, len(samples)), FRAME_DURATION)


def _frames(samples: int, frames: int) -> np.ndarray:
    """Samples of one revolution to show: SHARE of the frames before OPENING, the rest evenly over the remainder."""
    slow = round(SHARE * frames)
    until = OPENING / 360.0 * samples
    chosen = np.concatenate([np.linspace(0.0, until, slow, False), np.linspace(until, samples, frames - slow)])
    return np.unique(np.round(chosen).astype(int))


def _film(sheet: Sheet, moving: list, frames: int) -> tuple[np.ndarray, ...]:
    """Draw what stands still once, and what moves on top of it frame by frame."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(sheet.figure)
    sheet.figure.set_dpi(DOTS_PER_INCH)
    artists = [artist for part in moving for artist in part.artists]
    for artist in artists:
        artist.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(sheet.figure.bbox)
    shots = []
    for frame in range(frames):
        canvas.restore_region(still)
        for part in moving:
            part.move(frame)
            for artist in part.artists:
                artist.axes.draw_artist(artist)
        shots.append(np.asarray(canvas.buffer_rgba())[:, :, :3].copy())
    return tuple(shots)


def magnification(scenario: Scenario) -> float:
    """How much the clearances are magnified: as asked for, or so that the largest is a quarter of the crank at most."""
    if scenario.figures.magnification is not None:
        return scenario.figures.magnification
    mechanism = scenario.mechanism.applied()
    largest = max((mechanism.joint(name).clearance for name in mechanism.loose), default=np.inf)
    return round_number(0.25 * mechanism.crank.length / largest)


def _pin(samples: pd.DataFrame, name: str, centre: np.ndarray, scenario: Scenario) -> Pin:
    """The joint whose partner (frame, crank or slider) has its centre at `centre` (frames, 2) [m]."""
    joint = scenario.mechanism.applied().joint(name)
    outward = joint is not None and joint.journal == JOINT[name].body
    magnified = magnification(scenario) * np.nan_to_num(np.stack(eccentricity(samples, name, joint), axis=-1))
    end = centre + (magnified if outward else -magnified)
    journal, bearing = (end, centre) if outward else (centre, end)
    force = samples[f"{name}_normal_force"].to_numpy()
    vector = (1.0 if outward else -1.0) * samples[[f"{name}_force_x", f"{name}_force_y"]].to_numpy()
    size = np.linalg.norm(vector, axis=-1)
    length = ARROW * np.log10(np.maximum(size / SMALLEST_FORCE, 1.0)) * (force > 0.0)
    arrow = length[:, None] * vector / np.maximum(size, SMALLEST_FORCE)[:, None]
    return Pin(in_words(name), 1e3 * journal, 1e3 * bearing, 1e3 * end, force, arrow)


def _face(words: str, force: float) -> str:
    """Colour of a journal: its joint's in contact."""
    return COLOURS[words] if force > 0.0 else FLIGHT


class _Mechanism:
    """Crank, rod and piston; the rings and journals of the pins, and of the crank pivot where it is loose."""

    def __init__(self, sheet: Sheet, samples: pd.DataFrame, scenario: Scenario):
        from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

        mechanism, times = scenario.mechanism.applied(), magnification(scenario)
        angle = samples["crank_angle"].to_numpy()
        crank = mechanism.crank.length * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        slide = np.full(len(samples), mechanism.slider.offset)
        slider = np.stack([samples["slider_position"].to_numpy(), slide], axis=-1)
        pivot = _pin(samples, "crank_pivot", np.zeros((len(samples), 2)), scenario)
        crank_pin = _pin(samples, "crank_pin", 1e-3 * pivot.end + crank, scenario)
        pins = {"crank_pin": crank_pin, "piston_pin": _pin(samples, "piston_pin", slider, scenario)}
        if "crank_pivot" in mechanism.loose:
            pins["crank_pivot"] = pivot
        self.pins, self.pivot = tuple(pins.values()), pivot.end
        crank = 1e-3 * pivot.end + crank
        self.crank, self.angle, self.time = 1e3 * crank, degrees(samples["crank_angle"]), samples["time"].to_numpy()
        self.slider = 1e3 * slider
        title = (
            f"first revolution; clearances drawn {times:g} times as large\narrows: force on the journal, logarithmic"
        )
        panel = sheet.panel((0, slice(None)), title, Quantity("x", "mm"), Quantity("y", "mm"))
        axes = panel.axes
        for series, pin in zip(("rod's crank end", "rod's piston end"), self.pins, strict=False):
            panel.record(series, *pin.end.T, value=self.angle, value_quantity="crank angle", value_unit="deg")
        radii = [JOURNAL + 1e3 * times * mechanism.clearance(joint) for joint in pins]
        half = 1.35 * max(radii[:2])
        reach = 1e3 * (mechanism.crank.length + mechanism.rod.length)
        margin = 1e3 * mechanism.crank.length + 2.0 * max(radii)
        axes.set_xlim(-margin, reach + 2.6 * half)
        axes.set_ylim(-margin, margin)
        axes.set_aspect("equal")
        axes.grid(False)
        axes.plot(0, 0, marker="^", markersize=9, color=INK, zorder=1)
        offset = 1e3 * mechanism.slider.offset
        for side in (-1.0, 1.0):
            axes.axhline(offset + side * half, color="#999999", linewidth=0.8, xmin=0.45)
        (self.rod,) = axes.plot([], [], color="#56B4E9", linewidth=5, solid_capstyle="round")
        (self.link,) = axes.plot([], [], color=INK, linewidth=5, solid_capstyle="round")
        self.piston = Rectangle((0, 0), 2.2 * half, 2.0 * half, facecolor="#EEEEEE", edgecolor=INK, linewidth=1.2)
        self.half = half
        self.rings = [Circle((0, 0), radius, facecolor="none", edgecolor=INK, linewidth=1.2) for radius in radii]
        self.journals = [Circle((0, 0), JOURNAL, edgecolor=INK, linewidth=0.8) for _ in self.pins]
        look = {
            "arrowstyle": "-|>",
            "mutation_scale": 9.0,
            "linewidth": 1.6,
            "color": INK,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        }
        self.arrows = [FancyArrowPatch((0, 0), (0, 1), **look) for _ in self.pins]
        self.words = axes.text(0.99, 0.97, "", transform=axes.transAxes, ha="right", va="top", fontsize=8.5)
        for patch in (self.piston, *self.rings, *self.journals, *self.arrows):
            axes.add_patch(patch)
        self.artists = (self.piston, self.rod, self.link, *self.rings, *self.journals, *self.arrows, self.words)

    def move(self, frame: int) -> None:
        self.piston.set_xy((self.slider[frame, 0] - 1.1 * self.half, self.slider[frame, 1] - self.half))
        self.rod.set_data(*np.transpose([pin.end[frame] for pin in self.pins[:2]]))
        self.link.set_data(*np.transpose([self.pivot[frame], self.crank[frame]]))
        for ring, journal, arrow, pin in zip(self.rings, self.journals, self.arrows, self.pins, strict=True):
            ring.set_center(pin.bearing[frame])
            journal.set_center(pin.journal[frame])
            journal.set_facecolor(_face(pin.name, pin.force[frame]))
            arrow.set_positions(pin.journal[frame], pin.journal[frame] + pin.arrow[frame])
            arrow.set_visible(bool(pin.arrow[frame].any()))
        nearby = slice(max(frame - 1, 0), max(frame - 1, 0) + 2)
        slowed = FRAME_DURATION / np.diff(self.time[nearby])[0]
        self.words.set_text(
            f"{self.angle[frame]:5.1f} deg, {1e3 * self.time[frame]:6.2f} ms\nslowed {slowed:.0f} times"
        )


class _Bearing:
    """One journal's centre in its bearing, with the way it has come."""

    def __init__(self, sheet, column, name, first, samples, scenario):
        joint, words = scenario.mechanism.applied().joint(name), in_words(name)
        self.name = words
        panel = sheet.panel((1, column), words, Quantity("journal, x", "mm"), Quantity("y", "mm"))
        radius, circle = 1e3 * joint.clearance, np.linspace(0.0, 2.0 * np.pi, 181)
        panel.line("clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit", linewidth=0.8)
        panel.square(1.2 * radius)
        panel.axes.set_title(words, color=COLOURS[words])  # what the curves of the forces are told by
        self.way = 1e3 * np.stack(eccentricity(first, name, joint), axis=-1)
        self.centre = 1e3 * np.nan_to_num(np.stack(eccentricity(samples, name, joint), axis=-1))
        self.force = samples[f"{name}_normal_force"].to_numpy()
        self.row = np.searchsorted(first["crank_angle"].to_numpy(), samples["crank_angle"].to_numpy())
        panel.record(words, *self.centre.T, value=self.force, value_quantity=FORCE.name, value_unit=FORCE.unit)
        (self.trail,) = panel.axes.plot([], [], color="#999999", linewidth=0.7)
        (self.dot,) = panel.axes.plot([], [], marker="o", markersize=9, markeredgecolor=INK)
        self.artists = (self.trail, self.dot)

    def move(self, frame: int) -> None:
        self.trail.set_data(*self.way[: self.row[frame] + 1].T)
        self.dot.set_data(*self.centre[frame][:, None])
        self.dot.set_markerfacecolor(_face(self.name, self.force[frame]))


class _Forces:
    """Normal forces over the crank angle with a cursor."""

    def __init__(self, sheet: Sheet, column: int, joints: tuple[str, ...], first: pd.DataFrame, samples: pd.DataFrame):
        panel: Panel = sheet.panel((1, column), "force in contact", CRANK_ANGLE, FORCE)
        angle = degrees(first["crank_angle"])
        for name in joints:
            force, words = first[f"{name}_normal_force"].to_numpy(), in_words(name)
            panel.line(words, angle, np.where(force > 0.0, force, np.nan), words, linewidth=0.5)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(bottom=SMALLEST_FORCE)
        panel.over_crank_angle(angle[0], angle[-1], step=120.0)
        self.angle = degrees(samples["crank_angle"])
        self.cursor = panel.axes.axvline(angle[0], color=INK, linewidth=1.0)
        self.artists = (self.cursor,)

    def move(self, frame: int) -> None:
        self.cursor.set_xdata([self.angle[frame]] * 2)
