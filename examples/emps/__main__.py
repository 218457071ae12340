"""Name what the base model of the EMPS axis lacks: ``python -m examples.emps [FOLDER]``."""

import sys
from dataclasses import dataclass

import numpy as np

from examples.emps.model import HELD_OUT, Emps
from jointgap.campaign.noise_tables import noise as noise_of
from jointgap.campaign.outcome import Outcome, decide
from jointgap.campaign.screening_tables import screen
from jointgap.errors import InputError
from jointgap.identification.baseline import Recalibrated, recalibrate
from jointgap.identification.fit import Fit
from jointgap.identification.hypothesis_fits import doubles, singles
from jointgap.identification.noise_model import degrees_of_freedom

FALSE_ALARMS = 0.01
"""Share of campaigns with nothing hidden in which something is found nevertheless."""


@dataclass(frozen=True)
class Named:
    """The verdict and the fits that it rests on."""

    base: Recalibrated
    decision: Outcome

    @property
    def chosen(self) -> Fit:
        """The model with the effects named."""
        return self.decision.chosen

    @property
    def names(self) -> list[str]:
        """The effects named."""
        return [candidate.label for candidate in self.chosen.explanation]


def name(model: Emps) -> Named:
    """All stages from the noise to the verdict, as docs/own_model.md has them."""
    noise = noise_of(model)
    base = recalibrate(model, noise)
    screened = screen(base, FALSE_ALARMS, degrees_of_freedom(noise))
    alone, _ = singles(base, screened.known, screened.limits)
    together, _ = doubles(base, screened.known, screened.limits, alone)
    return Named(base, decide(base, screened.known, [*alone, *together], {}, screened.limits))


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
    for one in found.decision.ranking.head(5).itertuples():
        print(f"  {one.explanation}: delta BIC {one.delta_bic:.0f}, explained share {one.explained_share:.3f}")
    for p, value, sd in zip(
        found.chosen.parameters, found.chosen.values, np.sqrt(np.diag(found.chosen.covariance())), strict=True
    ):
        print(f"  {p.key} = {value:.4g} {p.unit}, 90 % interval {value - 1.645 * sd:.4g} to {value + 1.645 * sd:.4g}")
    for run in model.force:
        before, after = force_error(model, run, found.decision.base), force_error(model, run, found.chosen)
        aside = " (held out)" if run == HELD_OUT else ""
        print(f"run {run}{aside}: relative force error {before:.3f} before, {after:.3f} after")


if __name__ == "__main__":
    main()
