"""Name what the base model of the EMPS axis lacks: ``python -m examples.emps [FOLDER]``."""

import sys
from dataclasses import dataclass

import numpy as np

from examples.emps.model import HELD_OUT, Emps
from jointgap.discrepancy.calibrate import thresholds
from jointgap.discrepancy.decide import Decision
from jointgap.discrepancy.explain import doubles, singles
from jointgap.discrepancy.fit import Fit
from jointgap.discrepancy.naming import refined, verdict
from jointgap.discrepancy.noise import degrees_of_freedom, estimate_noise
from jointgap.discrepancy.recalibrate import Recalibrated, other_numerics, recalibrate
from jointgap.discrepancy.screen import signatures
from jointgap.errors import InputError


@dataclass(frozen=True)
class Named:
    """The verdict and the fits that it rests on."""

    base: Recalibrated
    decision: Decision
    chosen: Fit

    @property
    def names(self) -> list[str]:
        """The effects named."""
        return [candidate.label for candidate in self.chosen.explanation]


def name(model: Emps) -> Named:
    """All stages from the noise to the verdict."""
    nominal = {p.name: p.nominal for p in model.nuisances}
    missed = {s.key: s.value - model.simulate(s.run, nominal)[s.channel] for s in model.series}
    noise = estimate_noise(model, missed)
    base = recalibrate(model, noise)
    known = signatures(base.problem, base.base, base.differences)
    numerics = other_numerics(base.problem, base.base)
    limits = thresholds(
        base.problem, known, numerics, noise_dof=degrees_of_freedom(noise), rough=base.differences.rough_chi2
    )
    alone, _ = singles(base, known, limits)
    together, _ = doubles(base, known, limits, alone)
    decision = verdict(base, known, [*alone, *together], limits)
    return Named(base, decision, refined(base, decision.chosen))


def force_error(model: Emps, run: str, found: Fit) -> float:
    """norm(f - f_model) / norm(f) of a run's force at every millisecond."""
    values = {p.name: found.mapping.get(p.key, p.nominal) for p in model.nuisances}
    effects = [
        (one, {p.name: found.mapping[f"{one.label}.{p.name}"] for p in one.coordinates}) for one in found.explanation
    ]
    force = model.force[run]
    return float(np.linalg.norm(force - model.simulated_force(run, values, effects)) / np.linalg.norm(force))


def main() -> None:
    """Print the verdict, the parameters and how far the gap shrinks."""
    try:
        model = Emps(*sys.argv[1:2])
    except InputError as error:
        sys.exit(str(error))
    found = name(model)
    print(f"verdict: {found.decision.verdict} ({found.decision.because})")
    print(f"effects: {' + '.join(found.names) or 'none'}")
    for one in found.decision.ranking[:5]:
        print(f"  {one.fit.label}: delta BIC {one.delta_bic:.0f}, explained share {one.share:.3f}")
    for p, value, sd in zip(
        found.chosen.parameters, found.chosen.values, np.sqrt(np.diag(found.chosen.covariance())), strict=True
    ):
        print(f"  {p.key} = {value:.4g} {p.unit}, 90 % interval {value - 1.645 * sd:.4g} to {value + 1.645 * sd:.4g}")
    for run in model.force:
        before, after = force_error(model, run, found.base.base), force_error(model, run, found.chosen)
        aside = " (held out)" if run == HELD_OUT else ""
        print(f"run {run}{aside}: relative force error {before:.3f} before, {after:.3f} after")


if __name__ == "__main__":
    main()
