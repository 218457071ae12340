"""Identify missing effects of the pendulum: ``python -m examples.pendulum [FOLDER]``."""

import sys

import numpy as np

from examples.naming import name, report
from examples.pendulum.model import Pendulum
from jointgap.core.errors import InputError
from jointgap.identification.fit import Fit
from jointgap.identification.problem import values_in_run


def angle_errors(model: Pendulum, found: Fit) -> dict[str, float]:
    """Root mean square of the angle's residual in each run [rad]."""
    errors = {}
    for series in model.series:
        values, effects = values_in_run(model, series.run, found.mapping, found.hypothesis)
        residual = series.value - model.simulate(series.run, values, effects)["position"]
        errors[series.run] = float(np.sqrt(np.mean(residual**2)))
    return errors


def main() -> None:
    """Print the verdict, the parameters and how far the residual shrinks."""
    try:
        model = Pendulum(*sys.argv[1:2])
    except InputError as error:
        sys.exit(str(error))
    found = name(model)
    report(found)
    before, after = angle_errors(model, found.decision.base), angle_errors(model, found.chosen)
    for series in model.series:
        aside = " (held out)" if series.held_out.all() else ""
        change = f"{before[series.run]:.4f} rad before, {after[series.run]:.4f} rad after"
        print(f"run {series.run}{aside}: residual {change}")


if __name__ == "__main__":
    main()
