"""Optimised lengths of a general linkage, with figures."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap.app.linkage_motion import LinkageMotion, poses, simulated_linkage
from jointgap.app.result import Result
from jointgap.config import OptimiseLinkage, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.facts import Fact
from jointgap.core.plot import CRANK_ANGLE, Drawing, Quantity, Sheet
from jointgap.core.words import format_name, format_range, format_size
from jointgap.lengths.linkages import (
    DEPARTURE,
    LengthsFound,
    LinkageEnsemble,
    LinkageProblem,
    find_lengths,
)
from jointgap.lengths.objective import Goal
from jointgap.lengths.region import FORCE_TOLERANCE

_REMARKABLE = 0.05  # relative growth of the largest force that causes a remark
_LOOKS = {  # the line of before stays visible below an equal one
    "before": {"colour": "ideal", "linewidth": 2.2},
    "after": {"colour": "optimised", "linewidth": 0.9},
}


@dataclass(frozen=True, repr=False)
class LinkageOptimum(Result):
    """Optimised lengths of a general linkage and their re-simulated effects; made by
    `jointgap.optimise`.

    Attributes
    ----------
    linkage : LinkageFile
        With the new lengths.
    original, optimised : LinkageMotion
        The motion with the original and with the new lengths.
    """

    linkage: LinkageFile
    original: LinkageMotion
    optimised: LinkageMotion
    _found: LengthsFound

    @property
    def _HEADLINE(self) -> str:
        return f"Lengths with the smallest {self._goal.words}"

    @property
    def _goal(self) -> Goal:
        return self._found.problem.goal

    @property
    def lengths(self) -> dict[str, float]:
        """The new lengths [m] by name."""
        return dict(zip(self._found.problem.names, self._found.lengths, strict=True))

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        active = self._found.search.region.active(np.array(self._found.lengths))
        return () if active == "none" else tuple(active.split("; "))

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """``population`` of the genetic algorithm, ``paths`` of the local searches (lengths in m),
        ``gains`` (SI: rad, N or N m) and ``loads`` (N) before and after."""
        found = self._found
        paths = [one.history.assign(start=n) for n, one in enumerate(found.search.local)]
        return {
            "population": found.search.genetic.history,
            "paths": pd.concat(paths, ignore_index=True),
            "gains": found.gains,
            "loads": found.loads,
        }

    @property
    def _gain(self) -> pd.Series:
        return self._found.gains.loc[self._goal.measure]

    @property
    def gain(self) -> float:
        """Relative reduction of the objective [1]: simulated again, median."""
        return float(self._gain["reduction"])

    @property
    def interval(self) -> tuple[float, float]:
        """5 % and 95 % quantile of `gain` over pairs of runs from slightly different starts [1].

        An interval that contains 0 means no significant gain.
        """
        return float(self._gain["reduction_low"]), float(self._gain["reduction_high"])

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and limitations of the lengths found."""
        return (*self._remarks(), *self.optimised.remarks)

    def _remarks(self) -> Iterator[str]:
        (low, high), words = self.interval, self._goal.words
        changes, over = f"{-100 * high:+.1f}", ""
        if self._found.problem.file.loose:
            changes = format_range(changes, f"{-100 * low:+.1f}")
            over = " over perturbed starts"
        excess = self._found.problem.excess(self._found.before)
        if exceeds := excess > FORCE_TOLERANCE:
            share = f"{100 * excess - 100:.0f} %"
            yield f"The original lengths exceed a limit of the forces by {share}."
        if high < 0.0:
            advice = "" if exceeds else ": keep the original lengths"
            yield f"Simulated again, the {words} increases ({changes} %){advice}."
        elif low <= 0.0:
            yield (
                "The gain is not significant: simulated again from perturbed starts, the"
                f" {words} changes by {changes} %."
            )
        else:
            unit = "rad" if self._goal.unit == "deg" else self._goal.unit
            size = format_size(self._gain["original"] - self._gain["size"], unit)
            yield f"The gain is {size} ({changes} %{over})."
        for bound in self.at_bounds:
            yield f"A limit is reached: {bound}."
        for joint, load in self._found.loads.iterrows():
            growth = load["peak_force"] / load["original"] - 1.0
            if growth > _REMARKABLE and load["peak_force_low"] > load["original_high"]:
                yield (f"The largest force in {format_name(joint)} grows by {100 * growth:.0f} %.")

    @property
    def facts(self) -> list[Fact]:
        """Lengths, objective, transmission angle and forces, before and after."""
        return [*self._facts()]

    def _facts(self) -> Iterator[Fact]:
        found, problem = self._found, self._found.problem
        pairs = zip(problem.names, problem.original, found.lengths, strict=True)
        for name, before, after in pairs:
            yield Fact(f"lengths/{name}", 1e3 * after, "mm", name, before=1e3 * before)
        goal, gains = self._goal, found.gains.astype(float)
        over = "over a settled revolution"
        if goal.measure != DEPARTURE:
            row = goal.factor * gains.loc[goal.measure]
            label, unit = f"{goal.words} {over}", goal.unit
            yield Fact(goal.measure, row["size"], unit, label, before=row["original"])
        row = 90.0 - np.degrees(gains.loc[DEPARTURE])
        label = f"smallest transmission angle {over}"
        yield Fact(DEPARTURE, row["size"], "deg", label, before=row["original"])
        low, high = self.interval
        words = f"reduction of the {goal.words}"
        ends = {"low": 100 * low, "high": 100 * high} if problem.file.loose else {}
        yield Fact("reduction_percent", 100 * self.gain, "%", words, **ends)
        words += ", in the search (ideal joints)" if goal.load else ", as searched"
        yield Fact("estimate_percent", 100 * found.estimate, "%", words)
        for key, factor, unit in (("stroke", 1e3, "mm"), ("swing", math.degrees(1.0), "deg")):
            for body in getattr(problem.options, key):
                before, after = (
                    factor * float(problem.turn.range(body, lengths)[0])
                    for lengths in (problem.original, found.lengths)
                )
                words = f"{key} of {format_name(body)}"
                yield Fact(f"{key}/{body}", after, unit, words, before=before)
        for joint, load in found.loads.iterrows():
            words = f"{format_name(joint)}: largest force"
            force, before = float(load["peak_force"]), float(load["original"])
            yield Fact(f"largest_force_N/{joint}", force, "N", words, before=before)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        load = self._goal.load
        first = ("torque" if load.names == ("crank_torque",) else "joint_forces") if load else ""
        figures = {
            "transmission": "Transmission angle over a settled revolution",
            "linkage": "Positions of the linkage before and after",
            "search": "Convergence of the search",
            "joint_forces": "Forces in the joints over a settled revolution",
            "torque": "Torque of the drive over a settled revolution",
        }
        return {name: figures[name] for name in sorted(figures, key=lambda name: name != first)}

    def _draw(self, name: str) -> Drawing:
        return _DRAW[name](self)

    @property
    def _pair(self) -> dict[str, LinkageEnsemble]:
        return {"before": self._found.before, "after": self._found.after}


def optimised_linkage(
    file: LinkageFile, simulate: Simulate, keys: Mapping[str, Any]
) -> LinkageOptimum:
    """Optimise the lengths of a general linkage."""
    problem = LinkageProblem(file, simulate, OptimiseLinkage(**keys))
    problem.check()
    original = simulated_linkage(file, simulate)
    found = find_lengths(problem, original.samples)
    linkage = problem.with_lengths(found.lengths)
    return LinkageOptimum(linkage, original, simulated_linkage(linkage, simulate), found)


# ---- figures


def _turned(ensemble: LinkageEnsemble) -> np.ndarray:
    """Crank angle [deg] from the start of the turn."""
    start = math.floor(ensemble.crank_angle[0] / (2.0 * math.pi)) * 2.0 * math.pi
    return np.degrees(ensemble.crank_angle - start)


def _transmission(optimum: LinkageOptimum) -> Drawing:
    """Transmission angle; where its error is the objective, also the difference from that without
    clearance at the original lengths."""
    is_of_error = optimum._goal.measure == "rms"
    rows = 2 if is_of_error else 1
    sheet = Sheet(0.4 + 2.3 * rows, rows, 1)
    panel = sheet.panel((0, 0), "", CRANK_ANGLE, Quantity("transmission angle", "deg"))
    if is_of_error:
        below = sheet.panel((1, 0), "", CRANK_ANGLE, Quantity("desired − actual", "deg"))
    for when, ensemble in optimum._pair.items():
        angle, look = _turned(ensemble), _LOOKS[when]
        panel.line(when, angle, np.degrees(ensemble.angle[0]), **look)
        if is_of_error:
            below.line(when, angle, np.degrees(ensemble.error[0]), **look)
    for each in sheet.panels:
        each.over_crank_angle(angle[0], angle[0] + 360.0)
    panel.horizontal_line("90 deg", 90.0)
    sheet.legend([panel])
    return sheet.drawing()


def _linkage(optimum: LinkageOptimum) -> Drawing:
    sheet = Sheet(3.2, 1, 2)
    motions = {"before": optimum.original, "after": optimum.optimised}
    for column, (when, motion) in enumerate(motions.items()):
        panel = sheet.panel((0, column), when, Quantity("x", "mm"), Quantity("y", "mm"))
        poses(panel, motion)
    first, second = (panel.axes for panel in sheet.panels)
    for ends in ("xlim", "ylim"):  # the same scale in both
        each = np.array([getattr(axes, f"get_{ends}")() for axes in (first, second)])
        for axes in (first, second):
            low, high = each[:, 0].min(), each[:, 1].max()
            axes.set(**{ends: (low, high + 0.08 * (high - low))})  # room for names of joints
    width, height = (np.ptp(getattr(first, f"get_{ends}")()) for ends in ("xlim", "ylim"))
    sheet.figure.set_figheight(1.5 + 3.1 * height / width)
    sheet.legend(sheet.panels[:1])
    return sheet.drawing()


def _search(optimum: LinkageOptimum) -> Drawing:
    """Best value so far over the evaluations, relative to the original one."""
    search = optimum._found.search
    original = float(search.objective.value(search.objective.original))
    sheet = Sheet(3.2, 1, 1)
    size = Quantity("best over the original", "%")
    panel = sheet.panel((0, 0), optimum._goal.words, Quantity("evaluations", ""), size)
    shown = [("genetic", "genetic algorithm", search.genetic)]
    shown += [("local", "local, from several starts", result) for result in search.local]
    for colour, words, result in shown:
        best = np.minimum.accumulate(result.values / original)
        if optimum._goal.measure == "rms":
            best = np.sqrt(best)
        panel.line(words, 1 + np.arange(best.size), 100.0 * best, colour)
    panel.axes.set_xscale("log")
    panel.logarithmic()
    sheet.legend()
    return sheet.drawing()


def _joint_forces(optimum: LinkageOptimum) -> Drawing:
    """Force in each joint before and after, one panel for each."""
    names = [*optimum._found.before.forces]
    rows = math.ceil(len(names) / 2)
    sheet = Sheet(1.9 * rows + 0.4, rows, 2)
    for place, name in enumerate(names):
        force = Quantity("force", "N")
        panel = sheet.panel(divmod(place, 2), format_name(name), CRANK_ANGLE, force)
        for when, ensemble in optimum._pair.items():
            angle, size = _turned(ensemble), ensemble.forces[name][0]
            shown = np.where(size > 0.0, size, np.nan)
            panel.line(when, angle, shown, **_LOOKS[when])
            panel.over_crank_angle(angle[0], angle[0] + 360.0)
        panel.logarithmic()
    sheet.legend()
    return sheet.drawing()


def _torque(optimum: LinkageOptimum) -> Drawing:
    sheet = Sheet(2.7, 1, 1)
    panel = sheet.panel((0, 0), "", CRANK_ANGLE, Quantity("torque", "N m"))
    for when, ensemble in optimum._pair.items():
        angle = _turned(ensemble)
        panel.line(when, angle, ensemble.torque[0], **_LOOKS[when])
    panel.over_crank_angle(angle[0], angle[0] + 360.0)
    sheet.legend()
    return sheet.drawing()


_DRAW = {
    "transmission": _transmission,
    "linkage": _linkage,
    "search": _search,
    "joint_forces": _joint_forces,
    "torque": _torque,
}
