"""`jointgap.optimise` and its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jointgap.app.motion import Motion, checked_mechanism, simulate, simulate_options
from jointgap.app.result import Result
from jointgap.config import Mechanism, Optimise, Scenario, Simulate, Surrogate
from jointgap.core import schema
from jointgap.core.errors import InputError
from jointgap.core.facts import Fact
from jointgap.core.joints import outputs
from jointgap.core.parquet import with_units
from jointgap.core.words import format_name, joined
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.outcome import headline, outcome, remarks
from jointgap.scenario.stages import SCENARIO_STAGES

_WRITTEN = SCENARIO_STAGES["optimise"].writes
_REDUCTIONS = {
    "reduction": "reduction",
    "reduction_low": "reduction, 5 % of pairs of runs",
    "reduction_high": "reduction, 95 % of pairs of runs",
}


@dataclass(frozen=True, repr=False)
class Optimum(Result):
    """Optimised link lengths and their re-simulated effects; made by `jointgap.optimise`.

    Attributes
    ----------
    mechanism : Mechanism
        With the new lengths; effects that only modify its data are applied.
    original : Motion
        The motion with the original lengths.
    tables : mapping of str to pandas.DataFrame
        Results of the search by name, in SI units (``attrs["units"]``): ``optima``,
        ``resimulated``, ``worth``, ``loads`` and others, as in the workflow.
    """

    mechanism: Mechanism
    original: Motion
    tables: Mapping[str, pd.DataFrame]
    _outcome: Any  # jointgap.scenario.outcome.Outcome, which is not in the documentation

    @property
    def _HEADLINE(self) -> str:
        return f"Link lengths with the smallest {self._outcome.goal.words.removeprefix('largest ')}"

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length [m]."""
        return self._outcome.lengths

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        return self._outcome.bounds

    @property
    def gain(self) -> float:
        """Relative reduction of the objective [1]: simulated again, median.

        By default of the RMS error of the transmission angle, over a settled revolution or over the
        configured window.
        """
        return float(self._outcome.gain["reduction"])

    @property
    def interval(self) -> tuple[float, float]:
        """5 % and 95 % quantile of `gain` over pairs of runs from slightly different starts [1].

        An interval that contains 0 means no significant gain.
        """
        return tuple(self._outcome.gain[["reduction_low", "reduction_high"]].astype(float))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and limitations of the lengths found."""
        return remarks(self._outcome)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: FIGURES[name].title for name in ("valley", "resimulation")}

    def _draw(self, name: str):
        frames = {f"optimise_{table}": frame for table, frame in self.tables.items()}
        return FIGURES.draw(name, frames, self._outcome.scenario)

    @property
    def facts(self) -> list[Fact]:
        """Lengths, objective, reduction, dead centres and forces, before and after."""
        outcome, gain = self._outcome, self._outcome.gain
        (old_crank, old_rod), (crank, rod) = outcome.original, outcome.lengths
        before, after = (row for _, row in outcome.pair("optimise_worth", "simulated").iterrows())
        words = f"RMS {outcome.goal.words}" if outcome.is_of_angle else outcome.goal.words
        size = f"{words} over {outcome.stretch_label(outcome.stretch)}"
        facts = [
            Fact("crank_length", 1e3 * crank, "mm"),
            Fact("change_of_the_crank_length", 1e3 * (crank - old_crank), "mm"),
            Fact("rod_length", 1e3 * rod, "mm"),
            Fact("change_of_the_rod_length", 1e3 * (rod - old_rod), "mm"),
            Fact("active_bounds", joined(outcome.bounds) or "none"),
        ]
        for when, value in zip(("before", "after"), outcome.sizes, strict=True):
            facts.append(Fact(f"objective/{when}", value, outcome.goal.unit, f"{size}, {when}"))
        for key, label in _REDUCTIONS.items():
            facts.append(Fact(key, 100.0 * float(gain[key]), "%", label))
        for name in ("stroke", "outer_dead_centre", "inner_dead_centre"):
            label = f"change of the {format_name(name)}"
            facts.append(
                Fact(f"{name}/change", 1e3 * float(after[name] - before[name]), "mm", label)
            )
        for when, force in zip(("before", "after"), outcome.peak_force, strict=True):
            label = f"largest force in a pin, {when}"
            facts.append(Fact(f"largest_pin_force/{when}", float(force), "N", label))
        return facts


def optimise(
    mechanism: Mechanism,
    options: Simulate | None = None,
    *,
    networks: bool = False,
    surrogate: Surrogate | None = None,
    **keys: Any,
) -> Optimum:
    """Optimise the link lengths for the smallest error of the transmission angle, or for another
    objective.

    The mechanism is simulated. A genetic and a local optimiser search crank and rod length: with
    frozen joint motion, or, for a force or torque, on a grid of simulations with and without
    clearance. The optima are simulated again from several slightly perturbed starts. The result has
    the smallest objective over a settled revolution (for the transmission angle: or over the
    configured window). Requires pymoo: the extra ``learn``.

    Parameters
    ----------
    mechanism : Mechanism
        With the original lengths, which define the desired transmission angle.
    options : Simulate, optional
        Drive and sampling; the revolution ``ensemble.settled_revolution`` (4 by default) is used.
    networks : bool
        Whether to search also with networks trained on the motion, as in the paper (requires
        PyTorch: the extra ``learn``). The best re-simulated lengths of all searches are returned.
    surrogate : Surrogate, optional
        Training of the networks.
    **keys
        Keys of `jointgap.Optimise`: ``objective`` (``"transmission_angle"``,
        ``"largest_pin_force"`` or ``"torque_ripple"``), ``boxes`` (bounds of the lengths by name,
        the first for the result; default: 5 % around the mechanism's lengths), ``constraints``
        (stroke, dead centres, space, largest pin force), ``ratio_limit``, ``window``, ``genetic``,
        ``ensemble``. Keys of `jointgap.Simulate` as `jointgap.simulate` takes them, such as
        ``speed``, override `options`.

    Returns
    -------
    Optimum

    Raises
    ------
    InputError
        Unknown key, invalid value, no loose joint, no lengths that satisfy the constraints, or a
        missing package.
    SimulationError
        The simulation failed.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> box = {"crank_length": ("147 mm", "153 mm"), "rod_length": ("555 mm", "564 mm")}
    >>> best = jg.optimise(mechanism, speed="600 rpm", boxes={"near": box})
    >>> best.plot("valley").save("valley.png")
    """
    from jointgap.lengths.optimise import optimise as find_optima

    drive = {key: keys.pop(key) for key in Simulate.model_fields if key in keys}
    sections: dict[str, Any] = {
        "mechanism": checked_mechanism(mechanism),
        "simulate": simulate_options(options, drive),
        "optimise": Optimise(**keys),
    }
    if networks or surrogate:
        sections |= {"surrogate": surrogate or Surrogate(), "networks": True}
    scenario = Scenario(**sections)
    applied = scenario.mechanism.applied()
    if not applied.loose:
        raise InputError(
            "optimise: all joints are ideal, so the optimum cannot be checked with clearance; make"
            " a joint loose"
        )
    motion = simulate(mechanism, scenario.simulate)
    fits, errors = {}, pd.DataFrame(columns=schema.FIT_ERRORS.names)
    training_points = 2  # without networks all samples are used: only both ends are training points
    if scenario.networks:
        from jointgap.networks.train import train  # slow import: PyTorch

        # the search requires the clearance vectors only
        names = [name for name in outputs(applied.loose) if "_" not in name]
        trained = {name: train(motion.samples, name, scenario.surrogate) for name in names}
        functions = {name: seeds[0].network.values_and_slopes for name, seeds in trained.items()}
        fits = {"networks": functions}
        errors = pd.concat([fit.errors() for seeds in trained.values() for fit in seeds])
        training_points = scenario.surrogate.training_points
    tables = find_optima(
        applied, scenario.simulate, scenario.optimise, training_points, motion.samples, fits
    )
    result = outcome(tables | {"fit_errors": errors}, scenario)
    if result.status == "infeasible":
        advice = remarks(result)[0].rstrip(".")
        raise InputError(f"optimise: {headline(result)}; {advice[0].lower()}{advice[1:]}")
    with_their_units = {
        table.name.removeprefix("optimise_"): with_units(table, tables[table.name])
        for table in _WRITTEN
    }
    return Optimum(applied.with_lengths(*result.lengths), motion, with_their_units, result)
