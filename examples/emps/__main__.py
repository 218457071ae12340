"""Identify missing effects of the EMPS axis: ``python -m examples.emps [FOLDER]``."""

import sys

import numpy as np

from examples.emps.model import HELD_OUT, Emps
from examples.naming import name, report
from jointgap.core.errors import InputError
from jointgap.identification.fit import Fit
from jointgap.identification.problem import values_in_run


def force_error(model: Emps, run: str, found: Fit) -> float:
    """norm(f - f_model) / norm(f) of a run's force at every millisecond."""
    force, (values, effects) = (
        model.force[run],
        values_in_run(model, run, found.mapping, found.hypothesis),
    )
    return float(
        np.linalg.norm(force - model.simulated_force(run, values, effects)) / np.linalg.norm(force)
    )


def main() -> None:
    """Print the verdict, the parameters and how far the gap shrinks."""
    try:
        model = Emps(*sys.argv[1:2])
    except InputError as error:
        sys.exit(str(error))
    found = name(model)
    report(found)
    for run in model.force:
        before, after = (
            force_error(model, run, found.decision.base),
            force_error(model, run, found.chosen),
        )
        aside = " (held out)" if run == HELD_OUT else ""
        print(f"run {run}{aside}: relative force error {before:.3f} before, {after:.3f} after")


if __name__ == "__main__":
    main()
