"""`optimise`: link lengths for a transmission angle that is what it would be without clearance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.api.result import Result, Row
from jointgap.api.simulated_motion import Motion, checked_mechanism, simulate, simulate_options
from jointgap.config import Mechanism, Optimise, Scenario, Simulate, Surrogate
from jointgap.errors import InputError
from jointgap.figures.catalogue import SPECS
from jointgap.joints import JOINT_NUMBERS
from jointgap.report.plain_words import in_words, joined
from jointgap.stages.scenario_stages import SCENARIO_STAGES
from jointgap.summary.scenario_outcome import Outcome, outcome
from jointgap.summary.scenario_remarks import remarks

_NETWORKS = "networks"
_WRITTEN = SCENARIO_STAGES["optimise"].writes
_MODULE = "optimum_figures:"
_FIGURES = {
    spec.function.removeprefix(_MODULE): name for name, spec in SPECS.items() if spec.function.startswith(_MODULE)
}


@dataclass(frozen=True, repr=False)
class Optimum(Result):
    """The link lengths found, and what they bring once simulated with; made by `jointgap.optimise`.

    Attributes
    ----------
    mechanism : Mechanism
        With the lengths found; effects that only change its data are in these.
    original : Motion
        The motion with the original lengths.
    tables : mapping of str to pandas.DataFrame
        All that the search came to, by name, in SI units (``attrs["units"]``): ``optima``, ``resimulated``, ``worth``,
        ``loads`` and others, as the workflow writes them.
    """

    mechanism: Mechanism
    original: Motion
    tables: Mapping[str, pd.DataFrame]
    _outcome: Outcome

    _HEADLINE = "Link lengths with the smallest error of the transmission angle"

    @property
    def lengths(self) -> tuple[float, float]:
        """Of crank and rod [m]."""
        return self._outcome.lengths

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """The bounds and constraints that the lengths lie at, in words; empty where they lie within."""
        return self._outcome.bounds

    @property
    def gain(self) -> float:
        """By which share the RMS error of the transmission angle falls [1]: simulated again, median.

        Over a whole revolution once the motion has settled; over the window, where one is asked for.
        """
        return self._outcome.gain.reduction

    @property
    def interval(self) -> tuple[float, float]:
        """5 % and 95 % quantile of `gain` over pairs of runs from slightly different starts [1].

        Ends of both signs mean that a single run may show a loss as well.
        """
        return self._outcome.gain.low, self._outcome.gain.high

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before taking the lengths over, in sentences."""
        return remarks(self._outcome)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""
        return {name: SPECS[key].title for name, key in _FIGURES.items()}

    def _draw(self, name: str):
        from jointgap.figures.draw_figures import draw

        frames = {f"optimise_{table}": frame for table, frame in self.tables.items()}
        return draw(_FIGURES[name], frames, self._outcome.scenario)

    def _rows(self) -> list[Row]:
        found, gain = self._outcome, self._outcome.gain
        (old_crank, old_rod), (crank, rod) = found.original, found.lengths
        before, after = found.cycle("simulated")
        (old_force, force) = (max(forces.values()) for forces in found.peak_pin_forces)
        over = f"over {found.stretch_in_words}"
        return [
            ("crank length", 1e3 * crank, "mm"),
            ("changes by", 1e3 * (crank - old_crank), "mm"),
            ("rod length", 1e3 * rod, "mm"),
            ("changes by", 1e3 * (rod - old_rod), "mm"),
            ("lies at a bound", joined(found.bounds) or "no", ""),
            (f"RMS error of the transmission angle {over}, before", float(np.degrees(gain.before)), "deg"),
            (f"RMS error of the transmission angle {over}, after", float(np.degrees(gain.after)), "deg"),
            ("falls by", 100.0 * gain.reduction, "%"),
            ("falls by, 5 % of pairs of runs", 100.0 * gain.low, "%"),
            ("falls by, 95 % of pairs of runs", 100.0 * gain.high, "%"),
            *(
                (f"{in_words(name)} changes by", 1e3 * float(after[name] - before[name]), "mm")
                for name in ("stroke", "outer_dead_centre", "inner_dead_centre")
            ),
            ("largest force in a pin, before", old_force, "N"),
            ("largest force in a pin, after", force, "N"),
        ]


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
    revolution are taken, once the motion has settled (over the window, where one is asked for). Needs pymoo: the extra
    ``learn``.

    Parameters
    ----------
    mechanism : Mechanism
        With the original lengths, at which the desired transmission angle is taken.
    options : Simulate, optional
        Drive and samples; of its revolutions ``ensemble.settled_revolution`` (4 by default) counts.
    networks : bool
        Search too as the paper does, on networks trained on the motion (needs PyTorch: the extra ``learn``). Of all
        lengths found, those are taken that do best once simulated again.
    surrogate : Surrogate, optional
        How the networks are trained.
    **keys
        Keys of `jointgap.Optimise`, with units as text: ``boxes`` (bounds of the lengths by name, the first one counts;
        5 % around the mechanism's own by default), ``constraints`` (stroke, dead centres, space, largest force in a
        pin), ``ratio_limit``, ``window``, ``genetic``, ``ensemble``.

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
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> box = {"crank_length": ("147 mm", "153 mm"), "rod_length": ("555 mm", "564 mm")}
    >>> best = jg.optimise(mechanism, jg.Simulate(speed="600 rpm"), boxes={"near": box})
    >>> best.plot("valley").save("valley.png")
    """
    from jointgap.link_lengths.optimise_stage import optimise as optimised

    simulated_so = simulate_options(options, {})
    sections = {"mechanism": checked_mechanism(mechanism), "simulate": simulated_so, "optimise": Optimise(**keys)}
    if networks or surrogate:
        sections["surrogate"] = surrogate or Surrogate()
    scenario = Scenario(**sections)
    applied = scenario.mechanism.applied()
    if not applied.loose:
        raise InputError("optimise: all joints are ideal, so the transmission angle has no error; make one loose")
    motion = simulate(mechanism, scenario.simulate)
    trained = _trained(motion, scenario.surrogate) if "surrogate" in sections else {}
    fits = {_NETWORKS: {name: one.default.values_and_slopes for name, one in trained.items()}} if trained else {}
    # without networks no samples are kept from them: the points of their grid are the two ends
    points = scenario.surrogate.training_points if trained else 2
    found = optimised(applied, scenario.simulate, scenario.optimise, points, motion.samples, fits)
    frames = {table.name: getattr(found, table.name.removeprefix("optimise_")) for table in _WRITTEN}
    errors = [pd.DataFrame(columns=tables.FIT_ERRORS.names), *(one.errors() for one in trained.values())]
    result = outcome(frames | {"fit_errors": pd.concat(errors) if trained else errors[0]}, scenario)
    return Optimum(
        mechanism=applied.with_lengths(*result.lengths),
        original=motion,
        tables={
            table.name.removeprefix("optimise_"): tables.with_units(table, frames[table.name]) for table in _WRITTEN
        },
        _outcome=result,
    )


def _trained(motion: Motion, options: Surrogate) -> dict[str, Any]:
    """Networks of the clearance vectors, which are all that the search takes of them, by output."""
    from jointgap.surrogate.train import train  # PyTorch takes seconds to start

    numbers = [JOINT_NUMBERS[joint] for joint in motion.mechanism.applied().loose]
    outputs = [f"{name}{number}" for number in numbers for name in ("r", "gamma")]
    return {output: train(motion.samples, output, options) for output in outputs}
