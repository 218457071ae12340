"""`jointgap.optimise` and its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from jointgap.app.motion import Motion, checked_mechanism, simulate, simulate_options
from jointgap.app.result import Result
from jointgap.config import Mechanism, Optimise, Scenario, Simulate, Surrogate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core import schema
from jointgap.core.errors import InputError
from jointgap.core.facts import Fact
from jointgap.core.joints import outputs
from jointgap.core.parquet import with_units
from jointgap.core.words import joined
from jointgap.scenario.chosen_lengths import (
    ChosenLengths,
    choose_lengths,
    facts,
    headline,
    remarks,
)
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.stages import SCENARIO_STAGES

if TYPE_CHECKING:
    from jointgap.app.linkage_optimum import LinkageOptimum

_WRITTEN = SCENARIO_STAGES["optimise"].writes


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
    _chosen: ChosenLengths

    @property
    def _HEADLINE(self) -> str:
        return f"Link lengths with the smallest {self._chosen.goal.words.removeprefix('largest ')}"

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length [m]."""
        return self._chosen.lengths

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        return self._chosen.bounds

    @property
    def gain(self) -> float:
        """Relative reduction of the objective [1]: simulated again, median.

        By default of the RMS error of the transmission angle, over a settled revolution or over the
        configured window.
        """
        return float(self._chosen.gain["reduction"])

    @property
    def interval(self) -> tuple[float, float]:
        """5 % and 95 % quantile of `gain` over pairs of runs from slightly different starts [1].

        An interval that contains 0 means no significant gain.
        """
        return tuple(self._chosen.gain[["reduction_low", "reduction_high"]].astype(float))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and limitations of the lengths found."""
        return remarks(self._chosen)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: FIGURES[name].title for name in ("valley", "resimulation")}

    def _draw(self, name: str):
        frames = {f"optimise_{table}": frame for table, frame in self.tables.items()}
        return FIGURES.draw(name, frames, self._chosen.scenario)

    @property
    def facts(self) -> list[Fact]:
        """Lengths, objective, reductions and side effects, before and after."""
        return [*facts(self._chosen), Fact("active_bounds", joined(self.at_bounds) or "none")]


def optimise(
    mechanism: Mechanism | LinkageFile,
    options: Simulate | None = None,
    *,
    networks: bool = False,
    surrogate: Surrogate | None = None,
    **keys: Any,
) -> "Optimum | LinkageOptimum":
    """Optimise the link lengths for the smallest error of the transmission angle, or for another
    objective.

    The mechanism is simulated. A genetic and a local optimiser search crank and rod length: with
    frozen joint motion, or, for a force or torque, on a grid of simulations with and without
    clearance; of a general linkage with the forces of ideal joints. The optima are simulated again
    from several slightly perturbed starts. The result has the smallest objective over a settled
    revolution (for the transmission angle: or over the configured window). Requires pymoo: the
    extra ``learn``.

    Parameters
    ----------
    mechanism : Mechanism or LinkageFile
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
        ``speed``, override `options`. Of a general linkage the keys are ``lengths`` (bounds of
        ``BODY.length``, ``frame.POINT.x`` or ``.y``, by name), ``objective``
        (``"transmission_angle"``, ``"least_transmission_angle"``, ``"largest_pin_force"``,
        ``"JOINT_peak_force"``, ``"JOINT_rms_force"``, ``"peak_torque"``, ``"rms_torque"`` or
        ``"torque_ripple"``), ``transmission`` (inner joint of the two bodies whose angle counts; by
        default the last), ``least_angle``, ``dead_point_margin``, ``stroke`` and ``swing`` (ranges
        by body), ``largest_force`` (limits by joint), ``genetic``, ``ensemble``.

    Returns
    -------
    Optimum or LinkageOptimum

    Raises
    ------
    InputError
        Unknown key, invalid value, no loose joint where the transmission angle counts, no lengths
        that satisfy the constraints, or a missing package.
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
    drive = {key: keys.pop(key) for key in Simulate.model_fields if key in keys}
    if isinstance(mechanism, LinkageFile):
        from jointgap.app.linkage_optimum import optimised_linkage

        if networks or surrogate:
            raise InputError("networks: only of slider-cranks; leave them out")
        return optimised_linkage(mechanism, simulate_options(options, drive), keys)
    from jointgap.lengths.optimise import optimise as find_optima

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
    result = choose_lengths(tables | {"fit_errors": errors}, scenario)
    if result.status == "infeasible":
        advice = remarks(result)[0].rstrip(".")
        raise InputError(f"optimise: {headline(result)}; {advice[0].lower()}{advice[1:]}")
    with_their_units = {
        table.name.removeprefix("optimise_"): with_units(table, tables[table.name])
        for table in _WRITTEN
    }
    return Optimum(applied.with_lengths(*result.lengths), motion, with_their_units, result)
