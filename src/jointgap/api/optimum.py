"""`optimise`: link lengths for a transmission angle that is what it would be without clearance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.api.motion import Motion, checked_mechanism, simulate
from jointgap.api.result import Result, Row
from jointgap.config import Mechanism, Optimise, Scenario, Simulate, Surrogate, change
from jointgap.errors import InputError
from jointgap.figures.catalogue import SPECS
from jointgap.joints import JOINT_NUMBERS
from jointgap.mechanism import Fit
from jointgap.report.plain_words import in_words
from jointgap.stages.scenario_stages import SCENARIO_STAGES

NETWORKS, SIMULATION = "networks", "simulation_settled"
"""Sources of the motion in the joints that lengths are chosen by: the paper's networks, or a settled revolution."""

_WRITTEN = SCENARIO_STAGES["optimise"].writes
_FIGURES = {
    spec.function.partition(":")[2]: name for name, spec in SPECS.items() if spec.function.startswith("optimum_")
}
_FOUND = ("genetic", "local")


@dataclass(frozen=True, repr=False)
class Optimum(Result):
    """The link lengths found, and what they bring once simulated with; made by `jointgap.optimise`.

    Attributes
    ----------
    mechanism : Mechanism
        With the lengths found.
    original : Motion
        The motion with the original lengths.
    lengths : tuple of float
        Of crank and rod [m].
    at_bound : str
        The bounds that the lengths lie at, in words; ``"none"`` where they lie within.
    gain : float
        By which share the error of the transmission angle (root mean square over a revolution, once the motion has
        settled) falls, simulated again with the lengths found: median over slightly perturbed starts [1].
    interval : tuple of float
        Its 5 % and 95 % quantile [1]; both signs mean that a single run can show a loss as well.
    tables : mapping of str to pandas.DataFrame
        All that the search came to, by name, in SI units (``attrs["units"]``): ``optima``, ``resimulated``, ``worth``
        and others, as the workflow writes them.
    remarks : tuple of str
        Where contacts do otherwise than one may think.
    """

    mechanism: Mechanism
    original: Motion
    lengths: tuple[float, float]
    at_bound: str
    gain: float
    interval: tuple[float, float]
    tables: Mapping[str, pd.DataFrame]
    remarks: tuple[str, ...]
    _scenario: Scenario
    _point: str

    _HEADLINE = "Link lengths with the smallest error of the transmission angle"

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""
        return {name: SPECS[key].title for name, key in _FIGURES.items()}

    def _draw(self, name: str):
        from jointgap.figures.draw_figures import draw

        return draw(
            _FIGURES[name], {f"optimise_{table}": frame for table, frame in self.tables.items()}, self._scenario
        )

    def _rows(self) -> list[Row]:
        old, (crank, rod) = self.original.mechanism.applied(), self.lengths
        errors = settled_errors(self.tables["resimulated"], self._point)
        worth = self.tables["worth"].query("cycle == 'simulated'").set_index("point").loc[self._point]
        rows: list[Row] = [
            ("crank length", 1e3 * crank, "mm"),
            ("changed by", 1e3 * (crank - old.crank.length), "mm"),
            ("rod length", 1e3 * rod, "mm"),
            ("changed by", 1e3 * (rod - old.rod.length), "mm"),
            ("at a bound", "no" if self.at_bound == "none" else self.at_bound, ""),
            ("RMS error of the transmission angle before", float(np.degrees(errors["original_error"])), "deg"),
            ("RMS error of the transmission angle after", float(np.degrees(errors["error"])), "deg"),
            ("the error falls by", 100.0 * self.gain, "%"),
            ("from (5 % of pairs of runs)", 100.0 * self.interval[0], "%"),
            ("to (95 % of pairs of runs)", 100.0 * self.interval[1], "%"),
        ]
        units = {"stroke_change": (1e3, "mm"), "smallest_transmission_angle_change": (180.0 / np.pi, "deg")}
        units |= {f"{end}_dead_centre_change": (1e3, "mm") for end in ("outer", "inner")}
        rows += [
            (f"{in_words(name.removesuffix('_change'))} changes by", factor * float(worth[name]), unit)
            for name, (factor, unit) in units.items()
        ]
        return rows


def settled_errors(resimulated: pd.DataFrame, point: str) -> pd.Series:
    """The row of the table ``optimise_resimulated`` on the root mean square over a settled revolution at a `point`."""
    return resimulated.query("stretch == 'settled' and measure == 'rms'").set_index("point").loc[point]


def optimise(
    mechanism: Mechanism,
    options: Simulate | None = None,
    *,
    networks: bool = False,
    surrogate: Surrogate | None = None,
    **keys: Any,
) -> Optimum:
    """Search link lengths that bring the transmission angle near what it would be without clearance.

    The mechanism is simulated; with the motion in its joints frozen, a genetic and a local optimiser search crank and
    rod length; what they find is simulated again, from several slightly perturbed starts. The best lengths for a whole
    revolution are taken, once the motion has settled.

    Parameters
    ----------
    mechanism : Mechanism
        With the original lengths, at which the desired transmission angle is taken.
    options : Simulate, optional
        Drive and samples; of its revolutions ``ensemble.settled_revolution`` (4 by default) counts.
    networks : bool
        Search too as the paper does, with networks trained on the motion (needs PyTorch: the extra ``learn``). The
        lengths are then those found with the networks.
    surrogate : Surrogate, optional
        How the networks are trained.
    **keys
        Keys of `jointgap.Optimise`: ``boxes`` (bounds of the lengths by name, the first one counts), ``ratio_limit``,
        ``window``, ``genetic``, ``ensemble`` and so on, with units as text.

    Returns
    -------
    Optimum

    Raises
    ------
    InputError
        An unknown key or an impossible value, no joint that is loose, or a package that is missing.
    SimulationError
        The mechanism cannot be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("config/mechanisms/erkaya2009.yaml")
    >>> box = {"crank_length": ("147 mm", "153 mm"), "rod_length": ("555 mm", "564 mm")}
    >>> best = jg.optimise(mechanism, jg.Simulate(speed="600 rpm"), boxes={"near": box})
    >>> best.plot("valley").save("valley.png")
    """
    from jointgap.link_lengths.optimise_stage import optimise as optimised

    sections = {
        "mechanism": checked_mechanism(mechanism),
        "simulate": options or Simulate(),
        "optimise": Optimise(**keys),
    }
    if networks or surrogate:
        sections["surrogate"] = surrogate or Surrogate()
    scenario = Scenario(**sections)
    if not mechanism.applied().loose:
        raise InputError("optimise: all joints are ideal, so the transmission angle has no error; make one loose")
    motion = simulate(mechanism, scenario.simulate)
    fits = {NETWORKS: _trained(motion, scenario.surrogate)} if "surrogate" in sections else {}
    # without networks no samples are kept from them: their grid is taken as the two ends
    points = scenario.surrogate.training_points if fits else 2
    applied = mechanism.applied()
    found = optimised(applied, scenario.simulate, scenario.optimise, points, motion.samples, fits)
    frames = {}
    for table in _WRITTEN:
        name = table.name.removeprefix("optimise_")
        frames[name] = tables.with_units(table, getattr(found, name))
    best = _best(frames["optima"], NETWORKS if fits else SIMULATION, next(iter(scenario.optimise.boxes)))
    errors = settled_errors(frames["resimulated"], best["point"])
    lengths = float(best["crank_length"]), float(best["rod_length"])
    return Optimum(
        mechanism=change(applied, _with_lengths(applied, lengths)),
        original=motion,
        lengths=lengths,
        at_bound=best["active_bounds"],
        gain=float(errors["reduction"]),
        interval=(float(errors["reduction_low"]), float(errors["reduction_high"])),
        tables=frames,
        remarks=motion.remarks,
        _scenario=scenario,
        _point=best["point"],
    )


def _best(optima: pd.DataFrame, source: str, box: str) -> pd.Series:
    """The lengths with the lowest objective that either optimiser found."""
    found = optima[(optima["source"] == source) & (optima["box"] == box) & optima["method"].isin(_FOUND)]
    return found.loc[found["sum_of_squares"].idxmin()]


def _with_lengths(mechanism: Mechanism, lengths: tuple[float, float]) -> dict[str, Any]:
    links = mechanism.with_lengths(*lengths)
    return {name: getattr(links, name).model_dump() for name in ("crank", "rod")}


def _trained(motion: Motion, options: Surrogate) -> dict[str, Fit]:
    """Networks of the clearance vectors, which are all that the search takes of them."""
    from jointgap.surrogate.train import train  # PyTorch takes seconds to start

    numbers = [JOINT_NUMBERS[joint] for joint in motion.mechanism.applied().loose]
    return {
        output: train(motion.samples, output, options).default.values_and_slopes
        for number in numbers
        for output in (f"r{number}", f"gamma{number}")
    }
