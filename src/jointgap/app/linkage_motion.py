"""The simulated motion of a general linkage, with its figures."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jointgap.app.derivatives import derivatives_of
from jointgap.app.result import Result
from jointgap.config import Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core import parquet
from jointgap.core.facts import Fact
from jointgap.core.plot import COLOURS, CRANK_ANGLE, INK, Drawing, Panel, Quantity, Sheet
from jointgap.core.words import format_name
from jointgap.linkage.assembly import signs_of
from jointgap.linkage.equations import Arithmetic, Crank, Pose
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.topology import FRAME
from jointgap.linkage.transmission import clearance_vector
from jointgap.motion.linkage import linkage_remarks, simulate_linkage
from jointgap.motion.model import corner_names
from jointgap.scenario.animation import FRAME_DURATION, film

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CYCLE = ("simulation", "network", "optimised", "paper", "spline", "sky", "ideal", "other")
_FRAMES, _POSES = 90, 12  # of the animation; poses in the figure `linkage`
_MAGNIFIED = 0.15  # largest clearance in the animation over the crank's length
_WIDTH = 6.4  # [inches]


@dataclass(frozen=True, repr=False)
class LinkageMotion(Result):
    """One simulated motion of a general linkage, made by `jointgap.simulate`.

    Attributes
    ----------
    linkage : LinkageFile
        The simulated linkage.
    options : Simulate
        Drive and sampling.
    samples : pandas.DataFrame
        One row per sample, in SI units (``samples.attrs["units"]`` by column, or `unit`).
    events : pandas.DataFrame
        One row per beginning or end of contact.
    steps : int
        Integration steps, including rejected ones.
    remarks : tuple of str
        Dead points, and derivatives that hold for tiny changes only.
    derivatives : mapping of str to pandas.DataFrame
        By key of `simulate`'s ``derivatives``: rows as of `samples`, at the same crank angles, and
        its columns of numbers; units of these tables in their ``attrs["units"]``.
    """

    linkage: LinkageFile
    options: Simulate
    samples: pd.DataFrame
    events: pd.DataFrame
    steps: int
    remarks: tuple[str, ...] = ()
    derivatives: Mapping[str, pd.DataFrame] = field(default_factory=dict)

    _HEADLINE = "Simulated motion"

    def unit(self, column: str) -> str:
        """The unit of a column of `samples`, for example ``"rad"``; empty for text."""
        return parquet.unit_in(self.samples.attrs["units"], column)

    @property
    def loose(self) -> dict[str, float]:
        """Clearances [m] of the loose joints."""
        return {name: joint.clearance for name, joint in self.linkage.loose_joints.items()}

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        orbits = {"orbits": "Paths of the journals in the last revolution"}
        of_loose = orbits if self.linkage.loose_pins else {}
        return {
            "joint_forces": "Forces in the joints in the last revolution",
            "bodies": "Motion of the bodies in the last revolution",
            "linkage": "Positions of the linkage",
            **of_loose,
            "animation": "The linkage in motion in the first revolution",
        }

    def _draw(self, name: str) -> Drawing:
        draw: dict[str, Callable[[LinkageMotion], Drawing]] = {
            "joint_forces": _joint_forces,
            "bodies": _bodies,
            "linkage": _positions,
            "orbits": _orbits,
            "animation": _animation,
        }
        return draw[name](self)

    def revolution(self, number: int) -> pd.DataFrame:
        """Samples of a revolution, the first is 1, the last -1; both ends included."""
        count = self.options.samples_per_revolution
        first = (number - 1 if number > 0 else self.options.revolutions + number) * count
        return self.samples.iloc[first : first + count + 1].reset_index(drop=True)

    @property
    def joints(self) -> dict[str, np.ndarray]:
        """Forces [N] in all joints: sizes, of a slide those across it with their sign."""
        found = {}
        for column in self.samples:
            name = column.removesuffix("_force_x")
            if name != column and name != "shaking":
                x, y = (self.samples[f"{name}_force_{axis}"].to_numpy() for axis in "xy")
                found[name] = np.hypot(x, y)
            name = column.removesuffix("_force")
            if name in self.linkage.slides:
                found[name] = self.samples[column].to_numpy()
        return found

    @property
    def acts_on(self) -> dict[str, tuple[str, str]]:
        """By joint: the body on which its force acts, and the partner that exerts it. The clearance
        vector points from the partner's centre to the body's."""
        joints = linkage_of_file(self.linkage).joints
        return {name: (joint.body.body, joint.partner.body) for name, joint in joints.items()}

    @property
    def facts(self) -> list[Fact]:
        """Speed, contacts and largest forces."""
        time, last = self.samples["time"].to_numpy(), self.options.samples_per_revolution + 1
        turned = self.samples["crank_angle"].iloc[-1] - self.samples["crank_angle"].iloc[0]
        speed = 30.0 / math.pi * turned / (time[-1] - time[0])
        facts = [
            Fact("crank_speed", speed, "rpm", "mean speed of the crank"),
            Fact("revolutions", self.options.revolutions),
        ]
        begun = self.events[self.events["event"] == "impact"]
        for name, force in self.joints.items():
            words = format_name(name)
            if name in self.loose:
                of_joint = begun["joint"].isin([name, *corner_names(name)])
                impacts = int(of_joint.sum())
                clearance = 1e3 * self.loose[name]
                facts.append(Fact(f"{name}/clearance", clearance, "mm", f"{words}: clearance"))
                label = f"{words}: impacts (beginnings of contact)"
                facts.append(Fact(f"{name}/impacts", impacts, "", label))
            for key, values, text in (
                ("largest_force", force, "largest force, including the start"),
                ("largest_force_last_revolution", force[-last:], "in the last revolution"),
            ):
                largest = float(np.abs(values).max())
                facts.append(Fact(f"{name}/{key}", largest, "N", f"{words}: {text}"))
        return facts


def simulated_linkage(
    file: LinkageFile, options: Simulate, derivatives: Sequence[str] = ()
) -> LinkageMotion:
    """Simulate a general linkage, with derivatives by the numbers at keys."""
    run = simulate_linkage(file, options)
    tables, remarks = derivatives_of(file, options, derivatives)
    remarks = (*linkage_remarks(file, options), *remarks)
    return LinkageMotion(file, options, run.samples, run.events, run.steps, remarks, tables)


# ---- figures


def _angle(samples: pd.DataFrame) -> np.ndarray:
    return np.degrees(samples["crank_angle"].to_numpy())


def _joint_forces(motion: LinkageMotion) -> Drawing:
    """Forces in all joints over the crank angle."""
    sheet = Sheet(3.6, 1, 1)
    panel = sheet.panel((0, 0), "", CRANK_ANGLE, Quantity("force in the joint", "N"))
    last = motion.options.samples_per_revolution + 1
    angle, forces = _angle(motion.revolution(-1)), motion.joints
    for (name, force), colour in zip(forces.items(), _cycle(len(forces)), strict=True):
        panel.line(format_name(name), angle, force[-last:], colour, linewidth=0.9)
    panel.over_crank_angle(*sorted((angle[0], angle[-1])))
    sheet.legend()
    return sheet.drawing()


def _bodies(motion: LinkageMotion) -> Drawing:
    """Speeds of the bodies, and torque of the drive or speed of a free crank, over the crank
    angle."""
    turn, units = motion.revolution(-1), motion.samples.attrs["units"]
    groups = {
        Quantity("angular velocity", "rad/s"): [
            c for c in units if c.endswith("_angular_velocity")
        ],
        Quantity("velocity", "m/s"): [
            c for c in units if c.endswith("_velocity") and units[c] == "m/s"
        ],
    }
    drive = motion.options.drive
    if drive.FREES_CRANK:
        groups[Quantity("speed of the crank", "rad/s")] = ["crank_speed"]
    if drive.kind != "free":
        groups[Quantity("torque of the drive", "N*m")] = ["crank_torque"]
    groups = {quantity: columns for quantity, columns in groups.items() if columns}
    sheet = Sheet(2.4 * len(groups), len(groups), 1)
    angle = _angle(turn)
    for row, (quantity, columns) in enumerate(groups.items()):
        panel = sheet.panel((row, 0), "", CRANK_ANGLE, quantity)
        for column, colour in zip(columns, _cycle(len(columns)), strict=True):
            panel.line(format_name(column), angle, turn[column], colour)
        panel.over_crank_angle(*sorted((angle[0], angle[-1])))
        if columns == ["crank_torque"]:
            panel.spread_scale(turn["crank_torque"].to_numpy())
        panel.axes.legend(fontsize=8)
    return sheet.drawing()


def _orbits(motion: LinkageMotion) -> Drawing:
    """Path of each clearance vector, in the circle in which there is no contact."""
    names = [*motion.linkage.loose_pins]
    columns = min(len(names), 3)
    rows = math.ceil(len(names) / columns)
    sheet = Sheet(3.0 * rows, rows, columns, width=max(2.9 * columns, 3.4))
    turn, circle = motion.revolution(-1), np.linspace(0.0, 2.0 * np.pi, 181)
    for place, name in enumerate(names):
        x, y = (Quantity(f"clearance vector, {axis}", "mm") for axis in "xy")
        panel = sheet.panel(divmod(place, columns), format_name(name), x, y)
        radius = 1e3 * motion.loose[name]
        panel.line("clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit")
        panel.line("path", *(1e3 * clearance_vector(turn, name)), "simulation", linewidth=0.8)
        panel.square(1.2 * radius)
        panel.axes.locator_params(nbins=3)  # labels of a small clearance are long
    sheet.legend()
    return sheet.drawing()


class _Placed:
    """Points of all bodies at samples, with magnified clearances."""

    def __init__(self, motion: LinkageMotion, samples: pd.DataFrame, magnification: float = 1.0):
        self.linkage = linkage_of_file(motion.linkage)
        signs = signs_of(self.linkage, motion.options.start_angle)
        angle = samples["crank_angle"].to_numpy()
        still = np.zeros(len(samples))
        clearances = {
            joint.name: (
                tuple(magnification * clearance_vector(samples, joint.name)),
                (still, still),
            )
            for joint in self.linkage.loose
        }
        arithmetic = Arithmetic(sqrt=np.sqrt, cos_sin=lambda a: (np.cos(a), np.sin(a)))
        crank = Crank(np.cos(angle), np.sin(angle), 0.0, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):  # a magnified clearance may not close
            self.pose = Pose(self.linkage, signs, crank, clearances, arithmetic)
        self.count = len(samples)

    def points(self, body: str) -> np.ndarray:
        """Points of a body in mm, closed to a polygon where there are more than two, (k, 2, n)."""
        names = [*self.linkage.bodies[body].points]
        found = np.array(
            [
                [np.broadcast_to(each, self.count) for each in self.pose.point(body, name)[0]]
                for name in names
            ]
        )
        return 1e3 * (np.concatenate([found, found[:1]]) if len(names) > 2 else found)

    def is_block(self, body: str) -> bool:
        """Whether a body slides and has no length."""
        slides = any(
            j.kind == "slide" and body == j.body.body for j in self.linkage.joints.values()
        )
        points = self.points(body)
        return slides and bool(np.nanmax(np.abs(points - points[:1])) < 1e-6)

    def style(self, body: str) -> dict[str, object]:
        """Marks of a body's points."""
        return {"marker": "s", "markersize": 9.0} if self.is_block(body) else {"marker": "o"}


def _cycle(count: int) -> list[str]:
    return [_CYCLE[i % len(_CYCLE)] for i in range(count)]


def _limits(axes: "Axes", placed: _Placed) -> None:
    """Equal scales that show all positions."""
    every = np.concatenate(
        [placed.points(b).reshape(-1, 2, placed.count) for b in (FRAME, *placed.linkage.moving)]
    )
    low, high = (np.array([f(every[:, i]) for i in (0, 1)]) for f in (np.nanmin, np.nanmax))
    margin = 0.06 * (high - low).max()
    axes.set(
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
        aspect="equal",
    )
    axes.grid(False)
    for joint in placed.linkage.joints.values():
        if joint.kind == "slide" and joint.partner.body == FRAME:
            path = placed.points(joint.body.body)[0]
            along = np.array([math.cos(joint.direction or 0.0), math.sin(joint.direction or 0.0)])
            middle, half = np.nanmean(path, axis=1), 0.6 * np.ptp(path, axis=1).max() + margin
            ends = np.column_stack([middle - half * along, middle + half * along])
            axes.plot(*ends, color=COLOURS["flight"], linewidth=5.0, zorder=0)
    for x, y in _fixed(placed):
        axes.plot(x, y, marker="^", markersize=8, color=INK, zorder=1, linestyle="none")


def _fixed(placed: _Placed) -> np.ndarray:
    """Points of the frame with revolute joints [mm]."""
    names = [
        joint.place(FRAME).point
        for joint in placed.linkage.joints.values()
        if FRAME in joint.bodies and joint.kind == "revolute"
    ]
    every = [*placed.linkage.bodies[FRAME].points]
    points = placed.points(FRAME)[: len(every), :, 0]
    return np.array([points[every.index(name)] for name in names])


def _positions(motion: LinkageMotion) -> Drawing:
    sheet = Sheet(4.6, 1, 1, width=_WIDTH)
    poses(sheet.panel((0, 0), "", Quantity("x", "mm"), Quantity("y", "mm")), motion)
    sheet.legend()
    return sheet.drawing()


def poses(panel: Panel, motion: LinkageMotion) -> None:
    """The linkage at several crank angles of the last revolution, and the paths of its points."""
    turn = motion.revolution(-1)
    placed = _Placed(motion, turn)
    chosen = np.linspace(0, len(turn) - 1, _POSES, endpoint=False).astype(int)
    moving = placed.linkage.moving
    for body, colour in zip(moving, _cycle(len(moving)), strict=True):
        points = placed.points(body)
        for place in chosen:
            look = {"linewidth": 1.5 if place == chosen[0] else 0.7}
            look["alpha"] = 1.0 if place == chosen[0] else 0.45
            series = format_name(body) if place == chosen[0] else "_"
            marks = {"markersize": 3.0} | placed.style(body)
            panel.line(series, *points[:, :, place].T, colour, **marks, **look)
        for path in points:
            panel.axes.plot(*path, color=COLOURS["flight"], linewidth=0.6, zorder=0)
    _limits(panel.axes, placed)
    for name, (body, _) in motion.acts_on.items():
        if name in motion.linkage.shared_by_two:
            x, y = placed.pose.point(body, name)[0]
            place = [1e3 * np.broadcast_to(each, placed.count)[0] for each in (x, y)]
            panel.axes.annotate(name, place, (4, 4), textcoords="offset points", fontsize=8)


def _animation(motion: LinkageMotion) -> Drawing:
    """The linkage in motion, with magnified clearances and the forces in its joints."""
    first = motion.revolution(1)
    chosen = np.unique(np.linspace(0, len(first) - 1, _FRAMES).astype(int))
    samples = first.iloc[chosen].reset_index(drop=True)
    times = _magnification(motion, samples)
    placed = _Placed(motion, samples, times)
    sheet = Sheet(5.4, 2, 1, width=_WIDTH, height_ratios=[2.0, 1.0])
    title = f"first revolution; clearances magnified {times:g} times" if motion.loose else ""
    panel = sheet.panel((0, 0), title, Quantity("x", "mm"), Quantity("y", "mm"))
    _limits(panel.axes, placed)
    moving = placed.linkage.moving
    lines = {}
    for body, colour in zip(moving, _cycle(len(moving)), strict=True):
        points = placed.points(body)
        look = {"color": COLOURS[colour], "linewidth": 3.5, "markersize": 4.0} | placed.style(body)
        (line,) = panel.axes.plot(
            [], [], solid_capstyle="round", alpha=0.9, label=format_name(body), **look
        )
        lines[body] = (line, points)
        panel.record(format_name(body), *points[0])
    below = sheet.panel((1, 0), "", CRANK_ANGLE, Quantity("force in the joint", "N"))
    angle, forces = _angle(first), motion.joints
    for (name, force), colour in zip(forces.items(), _cycle(len(forces)), strict=True):
        size = np.abs(force[: len(first)])
        below.line(
            format_name(name), angle, np.where(size > 0.0, size, np.nan), colour, linewidth=0.7
        )
    below.axes.set_yscale("log")
    below.over_crank_angle(*sorted((angle[0], angle[-1])))
    cursor = below.axes.axvline(angle[0], color=INK, linewidth=1.0)
    panel.axes.legend(fontsize=7, loc="upper right")
    sheet.legend([below])
    shown = _angle(samples)

    def move(frame: int) -> tuple:
        for line, points in lines.values():
            line.set_data(*points[:, :, frame].T)
        cursor.set_xdata([shown[frame]] * 2)
        return (*(line for line, _ in lines.values()), cursor)

    return Drawing(
        sheet.figure, sheet.drawing().data, film(sheet, [move], len(samples)), FRAME_DURATION
    )


def _magnification(motion: LinkageMotion, samples: pd.DataFrame) -> float:
    """Factor of the clearances, at which the linkage still closes."""
    if not motion.loose:
        return 1.0
    linkage = linkage_of_file(motion.linkage)
    ends = [*linkage.bodies[linkage.crank].points.values()]
    length = max(
        math.dist([x or 0.0 for x in a], [x or 0.0 for x in b]) for a in ends for b in ends
    )
    times = float(f"{_MAGNIFIED * length / max(motion.loose.values()):.1g}")
    while times > 1.0:
        placed = _Placed(motion, samples, times)
        if all(np.isfinite(placed.points(body)).all() for body in linkage.moving):
            return times
        times = float(f"{0.5 * times:.1g}")
    return 1.0
