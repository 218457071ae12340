"""Measures and parameters of a sweep in words, with the units in which people read them."""

from typing import Any

from jointgap.core.plot import Quantity
from jointgap.core.words import in_words, reading_unit, unit_in_words
from jointgap.designs.design_of_experiments import Axis
from jointgap.tables.sweep_tables import ALL_MEASURES

_COLUMNS = {column.name: column for column in ALL_MEASURES}
_SHORTER = {
    "repeat_distance": "distance from repeating, over the smallest clearance",
    "outer_dead_centre_angle": "outer dead centre: crank angle",
    "inner_dead_centre_angle": "inner dead centre: crank angle",
    **{
        f"{name}{suffix}": f"{words}, {span}"
        for suffix, span in {"": "last revolution", "_in_window": "window of the first revolution"}.items()
        for name, words in {
            "best_crank_length": "best crank length by the paper's method",
            "best_ratio": "best ratio of crank to rod by the paper's method",
            "reduction_at_best": "share by which the error's RMS falls at the best lengths",
        }.items()
    },
    "noise_share": "noise share of the slider's acceleration",
}
_WORDS = {
    "speed": "crank speed",
    "window_start": "start of the window",
    "window_end": "end of the window",
    "error_measure": "measure of the error",
    "revolution": "revolution counted",
    "stiffness": "stiffness of the contacts",
}
_VALUES = {"rms": "RMS"}
_UNITS = {"stiffness": "N/mⁿ"}  # it has no SI unit of its own: that depends on the exponent
_LEFT_OUT = ("mechanism", "simulate", "joints", "contact")
"""Parts of a path that say nothing that its other parts do not."""


def measure_in_words(name: str) -> str:
    """``RMS of the normal force in the crank pin``."""
    words = _SHORTER.get(name) or _COLUMNS[name].description.partition(";")[0]
    return words.replace(" (ideal less simulated)", "")


def measure_quantity(name: str) -> tuple[Quantity, float]:
    """What an axis of a measure shows, and how many of its units one SI unit is."""
    return _quantity(measure_in_words(name), _COLUMNS[name].unit)


def parameter_in_words(key: str) -> str:
    """``crank pin journal`` of ``mechanism.joints.crank_pin.journal``."""
    return _WORDS.get(key) or in_words(" ".join(part for part in key.split(".") if part not in _LEFT_OUT))


def parameter_quantity(axis: Axis) -> tuple[Quantity, float]:
    """What an axis of a parameter shows, and how many of its units one SI unit is."""
    unit = _UNITS.get(axis.key, axis.unit)
    return _quantity(parameter_in_words(axis.key), unit if axis.column.kind == "float" else "")


def value_in_words(axis: Axis, value: Any) -> str:
    """A `value` of a parameter of `axis` as people read it: ``70.1 deg``, ``rod``."""
    if isinstance(value, str | bool):
        return _VALUES.get(str(value)) or in_words(str(value))
    unit, factor = reading_unit(axis.unit)
    number = f"{factor * value:.3g}".replace("e+0", "e").replace("e+", "e")
    return f"{number} {unit_in_words(unit)}".strip()


def _quantity(words: str, unit: str) -> tuple[Quantity, float]:
    shown, factor = reading_unit(unit)
    return Quantity(words, unit_in_words(shown)), factor
