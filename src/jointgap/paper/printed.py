"""Numbers printed by Erkaya & Uzmay (2009), from `printed.yaml`, and differences of a mechanism
from theirs."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from jointgap.core.joints import PINS
from jointgap.core.words import format_name, joined

if TYPE_CHECKING:
    from jointgap.config import Mechanism, Simulate


@dataclass(frozen=True)
class PrintedOptimum:
    """An optimum of the paper: lengths in m, reduction as a fraction, evaluations (None: not
    printed)."""

    key: str
    name: str
    crank_length: float
    rod_length: float
    reduction: float
    evaluations: int | None


_PRINTED = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
TRAINING_MSE: dict[str, float] = _PRINTED["training_mse"]
TRAINING_ITERATIONS: int = _PRINTED["training_iterations"]
OPTIMA = tuple(PrintedOptimum(**optimum) for optimum in _PRINTED["optima"])
CLAIMS: dict[str, dict[str, Any]] = _PRINTED["claims"]
NUMBERS: dict[str, dict[str, Any]] = _PRINTED["numbers"]
OTHER_END: str = _PRINTED["other_end"]
CONCLUSIONS: dict[str, str] = _PRINTED["joints"]
CLEARANCE_M, CRANK_M, ROD_M, SPEED_RPM = (
    _PRINTED["mechanism"][key] for key in ("clearance", "crank", "rod", "speed_rpm")
)


def reference_mse(output: str) -> float:
    """The paper's training error of an output; for the crank pivot, ideal in the paper, that of the
    crank pin."""
    return TRAINING_MSE[output.replace("1", "2")]


def departures(mechanism: "Mechanism", simulate: "Simulate") -> tuple[str, ...]:
    """Differences of `mechanism` and `simulate` from the paper's; unreported settings (contact,
    journal body) are no difference.
    """
    applied, differences = mechanism.applied(), []
    if applied.loose != PINS:
        loose = " and ".join(map(format_name, applied.loose)) or "no joint"
        differences.append(f"loose: {loose}, not {joined(map(format_name, PINS))}")
    lengths = {"crank": (applied.crank.length, CRANK_M), "rod": (applied.rod.length, ROD_M)}
    lengths |= {
        f"clearance of the {format_name(pin)}": (applied.clearance(pin), CLEARANCE_M)
        for pin in applied.loose
    }
    lengths["offset"] = (applied.slider.offset, 0.0)
    differences += [
        f"{name}: {1e3 * ours:g} mm, not {1e3 * theirs:g} mm"
        for name, (ours, theirs) in lengths.items()
        if abs(ours - theirs) > 1e-9  # m: more than a change of units
    ]
    speed = simulate.speed * 30.0 / math.pi
    if simulate.drive.kind != "constant" or applied.effect("speed_fluctuation"):
        differences.append("the crank's speed is not constant")
    elif abs(speed / SPEED_RPM - 1.0) > 1e-6:
        differences.append(f"speed: {speed:g} rpm, not {SPEED_RPM:g} rpm")
    return tuple(differences)
