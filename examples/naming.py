"""From a model and its data to the verdict, for all examples."""

from dataclasses import dataclass

from jointgap.core.candidates import Model
from jointgap.identification.baseline import Baseline
from jointgap.identification.confirmation import Confirmed
from jointgap.identification.fit import Fit, effect_estimates, nuisance_estimates
from jointgap.identification.identification import Identification
from jointgap.identification.verdict import Decision

FALSE_ALARMS = 0.01
"""Share of campaigns with nothing hidden in which something is found nevertheless."""


@dataclass(frozen=True)
class Named:
    """The verdict, and the fits and the held-out data that it rests on."""

    base: Baseline
    decision: Decision
    confirmed: Confirmed

    @property
    def chosen(self) -> Fit:
        """The model with the effects named, or with those that explain most."""
        return self.decision.proposed or self.decision.chosen

    @property
    def names(self) -> list[str]:
        """Its effects."""
        return [candidate.label for candidate in self.chosen.hypothesis]


def name(model: Model) -> Named:
    """All stages from the noise to the verdict."""
    found = Identification(model, false_alarm_rate=FALSE_ALARMS).fit()
    return Named(found.baseline, found.decision, found.prediction)


def estimates(found: Fit) -> list[str]:
    """A line for each parameter, with the 90 % interval that the data and the bounds leave."""
    named = [(p.key, f" {p.unit}", estimate) for p, estimate in nuisance_estimates(found)]
    for candidate in found.hypothesis:  # the names of their parameters end in the unit
        named += [
            (f"{candidate.label}.{key}", "", one)
            for key, one in effect_estimates(found, candidate).items()
        ]
    lines = []
    for label, unit, estimate in named:
        low, high = ("open" if end is None else f"{end:.4g}" for end in estimate["interval_90"])
        remark = f" ({estimate['remark']})" if "remark" in estimate else ""
        lines.append(
            f"{label} = {estimate['value']:.4g}{unit}, 90 % interval {low} to {high}{remark}"
        )
    return lines


def report(found: Named) -> None:
    """Print the verdict, the best explanations and the estimates."""
    print(f"verdict: {found.decision.verdict} ({found.decision.because})")
    print(f"effects: {' + '.join(found.names) or 'none'}")
    if found.decision.certain:
        print(f"certain, of those tried: {' + '.join(found.decision.certain)}")
    print(f"gap on the held-out data: {found.confirmed.test.summary}")
    for ranked in found.decision.ranking[:5]:
        print(
            f"  {ranked.fit.label}: delta BIC {ranked.delta_bic:.0f}, explained share"
            f" {ranked.share:.3f}"
        )
    for line in estimates(found.chosen):
        print(f"  {line}")
