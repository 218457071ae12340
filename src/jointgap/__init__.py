"""Contact, learning, optimisation and diagnosis of mechanisms with clearance in their joints.

Examples
--------
>>> import jointgap as jg
>>> mechanism = jg.load_mechanism("erkaya2009")
>>> run = jg.simulate(mechanism, speed="600 rpm", revolutions=2)
>>> run.plot("orbits").save("orbits.png")
"""

import sys
from importlib import import_module

TYPE_CHECKING = False  # as checkers know it; typing would take longer to load than all else here

__version__ = "0.1.0"

_PUBLIC = {
    "jointgap.app.linkage_motion": ("LinkageMotion",),
    "jointgap.app.linkage_optimum": ("LinkageOptimum",),
    "jointgap.app.motion": (
        "Motion",
        "simulate",
    ),
    "jointgap.app.optimum": (
        "Optimum",
        "optimise",
    ),
    "jointgap.app.preflight": (
        "Preflight",
        "preflight",
    ),
    "jointgap.app.sweep": (
        "SweptDesigns",
        "sweep",
    ),
    "jointgap.app.verdict": (
        "Finding",
        "Verdict",
        "analyse",
        "read_verdict",
    ),
    "jointgap.config": (
        "Box",
        "ConstantDrive",
        "Contact",
        "FreeDrive",
        "Joint",
        "Joints",
        "Link",
        "MeasuredDrive",
        "Mechanism",
        "MotorDrive",
        "Optimise",
        "Simulate",
        "Slider",
        "Surrogate",
        "change",
        "load_mechanism",
    ),
    "jointgap.config.linkage_file": ("LinkageFile",),
    "jointgap.core.errors": ("InputError", "SimulationError"),
    "jointgap.core.plot": ("Drawing",),
    "jointgap.core.parquet": ("read_table",),
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = [
    "Box",
    "ConstantDrive",
    "Contact",
    "Drawing",
    "Finding",
    "FreeDrive",
    "InputError",
    "Joint",
    "Joints",
    "Link",
    "LinkageFile",
    "LinkageMotion",
    "LinkageOptimum",
    "MeasuredDrive",
    "Mechanism",
    "Motion",
    "MotorDrive",
    "Optimise",
    "Optimum",
    "Preflight",
    "Simulate",
    "SimulationError",
    "Slider",
    "Surrogate",
    "SweptDesigns",
    "Verdict",
    "analyse",
    "change",
    "load_mechanism",
    "optimise",
    "preflight",
    "read_table",
    "read_verdict",
    "simulate",
    "sweep",
]

if TYPE_CHECKING:  # what __getattr__ gives, for editors and type checkers
    from jointgap.app.linkage_motion import LinkageMotion
    from jointgap.app.linkage_optimum import LinkageOptimum
    from jointgap.app.motion import Motion, simulate
    from jointgap.app.optimum import Optimum, optimise
    from jointgap.app.preflight import Preflight, preflight
    from jointgap.app.sweep import SweptDesigns, sweep
    from jointgap.app.verdict import Finding, Verdict, analyse, read_verdict
    from jointgap.config import (
        Box,
        ConstantDrive,
        Contact,
        FreeDrive,
        Joint,
        Joints,
        Link,
        MeasuredDrive,
        Mechanism,
        MotorDrive,
        Optimise,
        Simulate,
        Slider,
        Surrogate,
        change,
        load_mechanism,
    )
    from jointgap.config.linkage_file import LinkageFile
    from jointgap.core.errors import InputError, SimulationError
    from jointgap.core.parquet import read_table
    from jointgap.core.plot import Drawing


def __getattr__(name: str) -> object:
    """A public name, whose module is loaded when it is first asked for: ``import jointgap`` loads
    next to nothing."""
    if name == "ensemble":
        raise AttributeError("jointgap.ensemble was removed; use jointgap.sweep with starts=15")
    if name not in _HOME:
        raise AttributeError(
            f"module 'jointgap' has no attribute '{name}'", name=name, obj=sys.modules[__name__]
        )
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    """All public names, loaded or not, for tab completion."""
    return sorted({*globals(), *_HOME})
