"""Warnings about unusual, possibly wrong, data of a mechanism."""

import math
from collections.abc import Iterator

from jointgap.config import Contact, Joint, Mechanism, hertz_stiffness
from jointgap.config.linkage_file import LinkageFile
from jointgap.contact.normal_force import LAWS, delivered_restitution, penalty_restitution
from jointgap.core.joints import JOINT
from jointgap.core.words import format_name, joined, number
from jointgap.effects.force_table import ForceTable

WIDE_CLEARANCE = 0.05
"""Clearance over the journal's radius above which a warning is given."""

UNLIKE_MASSES = 50.0
"""Ratio of the largest to the smallest mass above which a warning is given."""

DENSITIES = (0.1, 7850.0)
"""Smallest and largest mass of a body over the cube of the longest link's length [kg/m^3] without a
warning: the largest is a solid cube of steel; mechanisms have 1 to 500."""

LEAST_GYRATION = 0.02
"""Radius of gyration over the length of a link below which a warning is given; a uniform rod has
0.29."""

FAST_SLIDER = 20.0
"""Mean speed of the slider [m/s] above which a warning is given: pistons of car engines reach 20,
of compressors 5."""


def odd_speed(mechanism: Mechanism, speed: float) -> list[str]:
    """A warning if the crank speed `speed` [rad/s] is so high that another unit was probably
    meant."""
    mean = (
        2.0 * mechanism.applied().crank.length * abs(speed) / math.pi
    )  # two strokes per revolution
    if mean <= FAST_SLIDER:
        return []
    value, rpm = abs(speed), 30.0 / math.pi * abs(speed)
    return [
        f"speed: at {number(rpm)} rpm ({number(value)} rad/s) the slider's mean speed is {mean:.0f}"
        f" m/s, above {FAST_SLIDER:g} m/s as in fast engines. Without a unit a number is in rad/s:"
        f" if you meant {number(value)} rpm, add the unit"
    ]


def odd_data(mechanism: Mechanism | LinkageFile) -> list[str]:
    """Warnings about unusual masses, inertias, clearances and loads, such as
    ``slider.mass: ...``."""
    applied = mechanism.applied()
    at = "bodies." if isinstance(applied, LinkageFile) else ""
    masses = {f"{at}{body}.mass": applied.body(body).mass for body in applied.sites.bodies}
    lengths = {f"{at}{body}.length": applied.body(body).length for body in applied.sites.links}
    light, heavy = min(masses, key=masses.get), max(masses, key=masses.get)
    found = []
    if lengths:
        longest = max(lengths, key=lengths.get)
        least, most = (density * lengths[longest] ** 3 for density in DENSITIES)
        found = [
            f"{key}: {mass:.4g} kg is implausible with {longest} {lengths[longest]:.4g} m (usual:"
            f" {least:.2g} kg to {most:.2g} kg); check the units of both"
            for key, mass in masses.items()
            if not least <= mass <= most
        ]
    if not found and masses[heavy] > UNLIKE_MASSES * masses[light]:
        found.append(
            f"{heavy}: {masses[heavy]:.4g} kg is {masses[heavy] / masses[light]:.4g} times {light},"
            f" {masses[light]:.4g} kg; check the units of both"
        )
    for body in applied.sites.links:
        link = applied.body(body)
        if link.inertia is None:
            continue
        if (gyration := math.sqrt(link.inertia / link.mass)) < LEAST_GYRATION * link.length:
            uniform = link.mass * link.length**2 / 12
            found.append(
                f"{at}{body}.inertia: {link.inertia:.4g} kg*m^2 gives a radius of gyration of"
                f" {1e3 * gyration:.2g} mm on a link of {1e3 * link.length:.4g} mm; a uniform rod"
                f" has {uniform:.2g} kg*m^2: check the units"
            )
    pins = [name for name in applied.loose if isinstance(applied.joint(name), Joint)]
    for name in pins:
        radius, clearance = applied.joint(name).journal_radius, applied.clearance(name)
        if clearance > WIDE_CLEARANCE * radius:
            found.append(
                f"{name}: the radial clearance, {1e3 * clearance:.3g} mm, is"
                f" {100 * clearance / radius:.3g} % of journal_radius, {1e3 * radius:.3g} mm; worn"
                f" joints have less than {100 * WIDE_CLEARANCE:g} %: check both radii"
            )
    tables = (effect for effect in mechanism.effects if isinstance(effect, ForceTable))
    return [*found, *(f"{table.name}: {remark}" for table in tables for remark in table.remarks())]


NEGLIGIBLE_DIFFERENCE = 0.005
"""Difference of effective and configured restitution without a warning: below the accuracy of
measurements."""

PENALTY_SPEEDS = (0.1, 1.0)
"""Approach speeds [m/s] at which the penalty law's restitution is given: impacts in settled and in
starting motion."""


def remarks(mechanism: Mechanism, speed: float = 0.0) -> list[str]:
    """Warnings about unusual data, a high crank `speed` [rad/s] and unexpected behaviour of
    contacts: ``crank_pin: ...``."""
    applied = mechanism.applied()
    return (
        odd_speed(mechanism, speed)
        + odd_data(mechanism)
        + [
            f"{name}: {sentence}"
            for name in applied.loose
            for sentence in _of_contact(applied.joint(name), applied.rod.mass)
        ]
    )


def sentences(mechanism: Mechanism, speed: float = 0.0) -> tuple[str, ...]:
    """The `remarks` as sentences, with joints of equal remarks combined:
    ``Contact of the crank pin: ...``."""
    subjects: dict[str, list[str]] = {}
    for remark in remarks(mechanism, speed):
        subject, _, words = remark.partition(": ")
        subjects.setdefault(words, []).append(subject)
    return tuple(
        (
            f"Contact of the {joined(map(format_name, names))}: {words}."
            if names[0] in JOINT
            else f"`{names[0]}`: {words}."
        )
        for words, names in subjects.items()
    )


def _of_contact(joint: Joint, rod_mass: float) -> Iterator[str]:
    contact = joint.contact
    yield from _of_friction(contact)
    if contact.law == "penalty":
        yield _of_penalty(joint, contact, rod_mass)
        return
    delivered = delivered_restitution(LAWS[contact.law](contact.restitution))
    if abs(delivered - contact.restitution) > NEGLIGIBLE_DIFFERENCE:
        yield (
            f"you asked for a restitution of {contact.restitution:.4g}; {contact.law} effectively"
            f" gives {delivered:.4g}. Use `law: exact_restitution` for {contact.restitution:.4g}"
        )


def _of_friction(contact: Contact) -> Iterator[str]:
    """LuGre friction that is not passive; condition in `jointgap.contact.friction.lugre`."""
    given = contact.friction_parameters()
    excess = given["static_friction"] - contact.friction
    if contact.friction_law != "lugre" or contact.friction == 0 or excess == 0:
        return
    most = given["viscous_friction"] * contact.friction / excess
    if given["bristle_damping"] > most:
        yield (
            "lugre with static_friction above friction can temporarily drive the motion; to"
            f" exclude this, use a bristle_damping of at most {most:.3g} s/m, or more"
            " viscous_friction"
        )


def _of_penalty(joint: Joint, contact: Contact, rod_mass: float) -> str:
    stiffness = hertz_stiffness(joint) if contact.stiffness is None else contact.stiffness
    mass = (
        rod_mass / 2
    )  # approximate effective mass of the rod for an impact at its end; the partner is driven
    found = (
        penalty_restitution(
            stiffness, contact.exponent, contact.penalty_damping, contact.penalty_depth, mass, speed
        )
        for speed in PENALTY_SPEEDS
    )
    values = " and ".join(
        f"{value:.3g} at {speed:g} m/s" for value, speed in zip(found, PENALTY_SPEEDS, strict=True)
    )
    return f"the restitution of law penalty depends on mass and speed: approximately {values}"
