"""Labels of names, and formatted numbers and units."""

import re
from collections.abc import Iterable
from datetime import date
from math import floor, log10, pi

from jointgap.core.files import package_data


def format_name(name: str) -> str:
    """Label of a name: ``crank pin`` for ``crank_pin``, ``sensor bias: encoder`` for
    ``sensor_bias:encoder``."""
    return re.sub(
        "coulomb|stribeck",
        lambda person: person[0].title(),
        name.replace("_", " ").replace(":", ": "),
    )


def format_run(run: str) -> str:
    """Label of a run of a campaign: ``run slow``, but ``run1`` alone."""
    return run if run.lower().startswith("run") else f"run {run}"


_NUISANCES = package_data("core/nuisances.yaml")


def format_nuisance(key: str) -> str:
    """Label of a nuisance: ``speed@slow`` gives ``crank speed of run slow``."""
    name, _, run = key.partition("@")
    words = _NUISANCES.get(name) or format_name(name)
    for beginning, of_joint in _NUISANCES["of_joints"].items():
        if name.startswith(beginning):
            words = f"{of_joint} {format_name(name.removeprefix(beginning))}"
    return f"{words} of run {run}" if run else words


_READ_IN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / pi), "rad/s": ("rpm", 30.0 / pi)}


def reading_unit(unit: str, value: float | None = None) -> tuple[str, float]:
    """Display unit of a quantity of the SI `unit`, and its number of units per SI unit: mm, deg and
    rpm; with a `value`, a smaller unit for short lengths and times and for small angles.
    """
    if value and unit in _FINER:
        factor, finer = _finer(value, unit)
        if unit != "m" or factor < 1e-3:
            return finer, 1.0 / factor
    return _READ_IN.get(unit, (unit, 1.0))


def format_day(day: date) -> str:
    """``3 November 2026``."""
    return f"{day.day} {day:%B %Y}"


def joined(parts: Iterable[str]) -> str:
    """``a, b and c``."""
    parts = list(parts)
    return (
        parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
    )


def number(value: float | str | None, digits: int = 4) -> str:
    """Four digits, or so many; larger numbers below 10 million are whole; a formula unchanged; a
    dash for None."""
    if isinstance(value, str):
        return value
    if value is None or value != value:
        return "–"
    if 10.0**digits - 0.5 <= abs(value) < 1e7:
        return f"{value:.0f}"
    return f"{value:.{digits}g}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")


def with_error(value: float | str | None, error: float | None) -> tuple[str, str]:
    """A `value` up to the second digit of its standard `error` (at most four digits), and the
    error; four digits without an error."""
    if isinstance(value, str) or not value or not error or error != error:
        return number(value), number(error)
    size = floor(log10(abs(value)))
    digits = min(max(2 + size - floor(log10(error)), 2), 4)
    shown = f"{value:.{max(digits - 1 - size, 0)}f}" if -4 <= size < 7 else f"{value:#.{digits}g}"
    return shown, f"{error:#.2g}".rstrip(".")


_SHOWN_UNITS = {"um": "µm", "us": "µs", "g_n": "g"}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def format_unit(unit: str) -> str:
    """Typographic unit of a pint name: ``N*m`` gives ``N m``, ``m/s^2`` or ``m/s**2`` ``m/s²``,
    ``g_n`` ``g``."""
    shown = []
    for part in re.split(r"([*/ ])", unit.replace("**", "^")):
        name, _, power = part.partition("^")
        shown.append(_SHOWN_UNITS.get(name, name) + power.translate(_RAISED))
    return "".join(shown).replace("*", " ")


_DEGREE = pi / 180.0  # rad
_FINER = {
    "m": ((1.0, "m", 0.1), (1e-3, "mm", 1e-4), (1e-6, "µm", 0.0)),
    "s": ((1.0, "s", 0.1), (1e-3, "ms", 1e-4), (1e-6, "µs", 0.0)),
    "rad": ((_DEGREE, "deg", 1e-3 * _DEGREE), (1e-3 * _DEGREE, "mdeg", 0.0)),
}
"""Display units by SI unit: value, name, and the smallest quantity that is shown in it, both in
SI."""


def _finer(value: float, unit: str) -> tuple[float, str]:
    """SI value and name of the display unit of a `value` of the SI `unit`."""
    return next(
        ((factor, name) for factor, name, least in _FINER[unit] if abs(value) >= least), (1.0, unit)
    )


def format_size(value: float, unit: str) -> str:
    """Two digits in a suitable unit: 0.00011 m gives ``0.11 mm``, 0.01 rad ``0.57 deg``."""
    factor, shown = _finer(value, unit) if value and unit in _FINER else (1.0, format_unit(unit))
    size = (
        f"{value / factor:#.2g}".rstrip(".")
        if abs(value) < 100 * factor
        else f"{value / factor:.0f}"
    )
    return with_unit(size, shown)


def with_unit(value: str, unit: str) -> str:
    """A `value` with its `unit`, unless that is ``1``."""
    return value if unit in ("", "1") else f"{value} {unit}"


def rounded_gap(gap: float) -> str:
    """A gap [standard deviations of the noise] with two decimals, none from 100 on."""
    return f"{gap:.2f}" if gap < 100 else f"{gap:.0f}"


def format_falls(falls: Iterable[float]) -> str:
    """``falls by 3.1 to 5.0 %`` for `falls` [%]; ``changes by −5.0 to +1.2 %`` if not all are
    positive."""
    low, high = min(falls := list(falls)), max(falls)
    if low > 0.0:
        return f"falls by {format_range(f'{low:.1f}', f'{high:.1f}')} %"
    return f"changes by {format_range(f'{-high:+.1f}', f'{-low:+.1f}')} %".replace(
        "-", "\N{MINUS SIGN}"
    )


def format_range(low: str, high: str) -> str:
    """``3.1 to 5.0``; one number if both are equal as shown."""
    return low if low == high else f"{low} to {high}"


def percent(share: float, digits: int = 1) -> str:
    """A `share` in percent, with so many decimals."""
    return f"{100.0 * share:.{digits}f} %"
