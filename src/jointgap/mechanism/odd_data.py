"""Data of a mechanism that may be right, but look mistaken."""

from jointgap.config import Mechanism

WIDE_CLEARANCE = 0.05
"""Share of the journal's radius from which on a clearance is worth a remark."""

UNLIKE_MASSES = 50.0
"""Ratio of the heaviest body's mass to the lightest one's from which on it is worth a remark."""


def odd_data(mechanism: Mechanism) -> list[str]:
    """Remarks on masses and clearances that look mistaken, such as ``slider.mass: ...``; empty where none does."""
    applied = mechanism.applied()
    masses = {f"{body}.mass": getattr(applied, body).mass for body in ("crank", "rod", "slider")}
    light, heavy = min(masses, key=masses.get), max(masses, key=masses.get)
    found = []
    if masses[heavy] > UNLIKE_MASSES * masses[light]:
        found.append(
            f"{heavy}: {masses[heavy]:.4g} kg are {masses[heavy] / masses[light]:.4g} times {light}, "
            f"{masses[light]:.4g} kg; check the units of both"
        )
    for name in applied.loose:
        radius, clearance = applied.joint(name).journal_radius, applied.clearance(name)
        if clearance > WIDE_CLEARANCE * radius:
            found.append(
                f"{name}: the radial clearance, {1e3 * clearance:.3g} mm, is {100 * clearance / radius:.3g} % of "
                f"journal_radius, {1e3 * radius:.3g} mm; worn joints have less than {100 * WIDE_CLEARANCE:g} %: check "
                "both radii"
            )
    return found
