"""What Erkaya & Uzmay (2009) print, and how a number or a claim of theirs is judged against ours."""

import math
from dataclasses import dataclass

from jointgap.config import Mechanism, Simulate
from jointgap.core.joints import PINS

ROUNDING_M = 1e-9  # [m] lengths that differ by less, as by a change of units, are the same

TRAINING_MSE = {
    "r2": 1.1980e-5,
    "r3": 7.6899e-6,
    "gamma2": 3.918e-7,
    "gamma3": 3.3382e-7,
    "gamma2_dot": 4.6977e-6,
    "gamma3_dot": 1.3006e-6,
    "gamma2_ddot": 2.5555e-5,
    "gamma3_ddot": 1.1352e-6,
}
"""Mean square error of each network after training, on data normalised to [0, 1] (text beside figure 8)."""


def reference_mse(output: str) -> float:
    """The paper's training error of an output; for the crank pivot, which is ideal there, that of its crank pin."""
    return TRAINING_MSE[output.replace("1", "2")]


TRAINING_ITERATIONS = 20_000  # that the paper trains each network for


LOOSE = PINS
CLEARANCE_M, CRANK_M, ROD_M, SPEED_RAD_S = 0.001, 0.150, 0.564, 20.0 * math.pi


def departures(mechanism: Mechanism, simulate: Simulate) -> tuple[str, ...]:
    """In which ways `mechanism` and `simulate` differ from the paper's, in words; none where its printed numbers speak
    of them.

    What the paper does not print (the contact, and which body carries the journals) is no departure.
    """
    applied, differences = mechanism.applied(), []
    if applied.loose != LOOSE:
        differences.append(
            f"loose: {' and '.join(applied.loose).replace('_', ' ') or 'no joint'}, not crank pin and piston pin"
        )
    lengths = {"crank": (applied.crank.length, CRANK_M), "rod": (applied.rod.length, ROD_M)}
    lengths |= {
        f"clearance of the {name.replace('_', ' ')}": (applied.clearance(name), CLEARANCE_M) for name in applied.loose
    }
    lengths["offset"] = (applied.slider.offset, 0.0)
    for name, (ours, theirs) in lengths.items():
        if abs(ours - theirs) > ROUNDING_M:
            differences.append(f"{name}: {1e3 * ours:g} mm, not {1e3 * theirs:g} mm")
    if simulate.drive.kind != "constant" or applied.effect("speed_fluctuation"):
        differences.append("the crank's speed is not constant")
    elif abs(simulate.speed / SPEED_RAD_S - 1.0) > 1e-6:
        differences.append(f"speed: {simulate.speed * 30.0 / math.pi:g} rpm, not 600 rpm")
    return tuple(differences)


@dataclass(frozen=True)
class PrintedOptimum:
    """One optimum of the paper: lengths in m, reduction as a fraction, evaluations (None: not printed)."""

    key: str
    name: str
    crank_length: float
    rod_length: float
    reduction: float
    evaluations: int | None


OPTIMA = (
    PrintedOptimum("printed_genetic", "genetic algorithm", 0.149465, 0.563196, 0.14980, 32),
    PrintedOptimum("printed_local", "local, best start", 0.149170, 0.562083, 0.14804, 17),
    PrintedOptimum("printed_local_other", "local, another start", 0.147287, 0.555001, 0.13716, None),
)

UNSTABLE_UNTIL_DEG = 30.0  # [deg] crank angle up to which the paper calls the contact unstable
ROD_DEVIATION_M = 0.001  # [m] deviation of the rod from the ideal mechanism that the paper states
PISTON_DEVIATION_M = 0.002  # [m] the same of the piston

AGREES = 0.01  # share of the paper's value within which a number agrees
LENGTH_AGREES = 0.001  # the same for optimum lengths: any point of the box would agree within 1 %

HOLDS, FAILS, UNKNOWN = "holds", "does not hold", "cannot be told"
REACHED, MISSED = "reached", "missed"


@dataclass(frozen=True)
class Row:
    """A number or a claim of the paper and ours beside it."""

    kind: str  # ``'number'`` or ``'claim'``
    item: str
    unit: str
    paper: float | None  # In `unit`; None where there is none
    ours: float | None  # In `unit`; None where there is none
    sentence: str
    verdict: str = ""  # Empty for numbers that agree or differ
    agrees: float = AGREES  # For numbers: share of the paper's value within which ours agrees

    def record(self) -> dict:
        """The row of the table comparison."""
        both = self.paper is not None and self.ours is not None and self.paper != 0
        ratio = self.ours / self.paper if both else None
        verdict = self.verdict
        if not verdict:
            verdict = UNKNOWN if ratio is None else "agrees" if abs(ratio - 1) <= self.agrees else "differs"
        return {
            "kind": self.kind,
            "item": self.item,
            "unit": self.unit,
            "paper": self.paper,
            "ours": self.ours,
            "ratio": ratio,
            "verdict": verdict,
            "sentence": self.sentence,
        }


def claim(item: str, paper: float | None, ours: float | None, unit: str, holds: bool | None, sentence: str) -> Row:
    """The claim `item`: `paper` and `ours` in `unit`, the evidence in a `sentence`; where `holds` is None it cannot be
    told.
    """
    verdict = UNKNOWN if holds is None else HOLDS if holds else FAILS
    return Row("claim", item, unit, paper, ours, sentence, verdict)
