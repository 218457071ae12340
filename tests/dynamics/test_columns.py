"""Each column of a trajectory holds what its name says: computed again from the sampled clearance vectors alone.

Places follow from plain geometry, velocities and accelerations from differences of places over time, forces from
Newton's laws for slider, rod and crank as free bodies. No value comes from the code that fills the columns.
"""

from functools import cache
from itertools import combinations

import numpy as np
import pytest

from jointgap.core.joints import JOINT
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.integrate import EVENT
from jointgap.dynamics.sampling import SAMPLE
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ALL, CENTRE, CRANK, MOTOR, ROD, effect, mechanism, options

OFFSET, FAR = 0.03, 2e-5  # m, of the slide; rad, between the points of a difference
TOLERANCE = 1e-4  # of a column's largest value
CASES = {
    "three loose joints, motor": (mechanism(loose=ALL, friction=0.3, offset=OFFSET, gravity=True), {"drive": MOTOR}),
    "ideal joints": (
        mechanism(effect("pin_friction", "piston_pin", coefficient=0.3), loose=(), offset=OFFSET, gravity=True),
        {"drive": MOTOR},
    ),
    "bending rod": (
        mechanism(effect("rod_flexibility", frequency_Hz=120.0, damping_ratio=0.02), offset=OFFSET, gravity=True),
        {"drive": MOTOR},
    ),
}


def sampled(made, chosen):
    """Five points close to each of many crank angles, none with an event between them."""
    p = parameters(made, options(**chosen))
    middles = np.linspace(0.5, 2 * np.pi, 60)
    angles = np.append(0.0, (middles[:, None] + FAR * np.arange(-2, 3)).ravel())
    result = integrate_to_angles(p, start_state(p), angles, 1e-14)
    at_events = result.events[:, EVENT.index("crank_angle")]
    smooth = ~(np.abs(middles[:, None] - at_events) < 3 * FAR).any(axis=1)

    def at_points(values):
        return values[1:].reshape(-1, 5)[smooth]

    seen = {name: at_points(values) for name, values in result.observed(p).items()}
    states = (
        [at_points(column) for column in result.states.T],
        [at_points(column) for column in result.auxiliary_states.T],
    )
    return p, at_points(result.times), at_points(angles), states, seen


def rates(time, values):
    """First and second time derivative at the middle one of five points: of the quartic through them."""
    tau = (time - time[:, 2:3]) / (time[:, 4:5] - time[:, 2:3])
    terms = np.linalg.solve(tau[:, :, None] ** np.arange(5), (values - values[:, 2:3])[:, :, None])[:, :, 0]
    unit = time[:, 4] - time[:, 2]
    return terms[:, 1] / unit, 2.0 * terms[:, 2] / unit**2


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def expected(made, p, time, angle, states):
    """Columns by name, at the middle points."""
    y, x = states
    found = {"time": time[:, 2], "crank_angle": angle[:, 2], "rod_deflection": x[3][:, 2]}
    vectors = {"r2": (y[0], y[1]), "r3": (y[2], y[3]), "r1": (x[0], x[1])}
    for name, (ex, ey) in vectors.items():
        gamma, direction = name.replace("r", "gamma"), np.unwrap(np.arctan2(ey, ex), axis=1)
        found[name], found[gamma] = np.hypot(ex, ey)[:, 2], direction[:, 2]
        found[f"{name}_dot"], found[f"{name}_ddot"] = rates(time, np.hypot(ex, ey))
        found[f"{gamma}_dot"], found[f"{gamma}_ddot"] = rates(time, direction)
        if not getattr(p, next(joint.name for joint in JOINT.values() if f"r{joint.number}" == name)).loose:
            found |= {f"{gamma}{dots}": np.full(len(time), np.nan) for dots in ("", "_dot", "_ddot")}

    crank_end = np.array([CRANK * np.cos(angle) + x[0] + y[0], CRANK * np.sin(angle) + x[1] + y[1]])
    rod_angle = np.arcsin((OFFSET + y[3] - crank_end[1]) / ROD)
    along = np.array([np.cos(rod_angle), np.sin(rod_angle)])
    rod, slider = crank_end + CENTRE * along, crank_end[0] + ROD * along[0] - y[2]
    found |= {"rod_angle": rod_angle[:, 2], "transmission_angle": np.pi / 2 + rod_angle[:, 2]}
    found |= {"rod_position_x": rod[0][:, 2], "rod_position_y": rod[1][:, 2], "slider_position": slider[:, 2]}
    found["crank_speed"], found["crank_acceleration"] = rates(time, angle)
    found["rod_angular_velocity"], found["rod_angular_acceleration"] = rates(time, rod_angle)
    found["slider_velocity"], found["slider_acceleration"] = rates(time, slider)
    for i, axis in enumerate("xy"):
        found[f"rod_velocity_{axis}"], found[f"rod_acceleration_{axis}"] = rates(time, rod[i])
    return found | (forces(made, p, time, angle, vectors, along, found) if not p.bodies.rod_angular_frequency else {})


def forces(made, p, time, angle, vectors, along, found):
    """Forces in the joints, of drive and guide, by Newton's laws for slider, rod and crank."""
    gravity = made.gravity[:, None]
    accelerated = np.array([found["rod_acceleration_x"], found["rod_acceleration_y"]])
    pull_x = made.slider.mass * (gravity[0] - found["slider_acceleration"])  # of the slider on the rod
    both = made.rod.mass * (accelerated - gravity)
    lever = {}  # from the centre of a joint's body to where the force acts: halfway through the overlap
    for joint in JOINT.values():
        ex, ey = (component[:, 2] for component in vectors[f"r{joint.number}"])
        data, r = getattr(p, joint.name), np.hypot(ex, ey)
        normal = np.array([ex, ey]) / np.where(r > 0, r, 1.0)
        arm = data.side * data.body_radius - 0.5 * (r - data.clearance) if data.loose else 0.0 * r
        lever[joint.name] = normal, arm * normal
    at_pin = lever["crank_pin"][1] - CENTRE * along[:, :, 2]
    at_piston = lever["piston_pin"][1] + (ROD - CENTRE) * along[:, :, 2]
    # Moment about the rod's mass centre: pin force (both - piston force) at its point, piston force at its own.
    rubbing = friction_moment(made, p, found)
    pin_x = both[0] - pull_x
    pull_y = 0.0
    for _ in range(30):  # friction in an ideal pin depends on the force in it
        moment = made.rod.inertia * found["rod_angular_acceleration"] - rubbing(np.hypot(pull_x, pull_y))
        pull_y = (moment - at_pin[0] * both[1] + at_pin[1] * pin_x + at_piston[1] * pull_x) / (at_piston[0] - at_pin[0])
    piston, pin = np.array([pull_x, pull_y]), np.array([pin_x, both[1] - pull_y])

    centre = [vectors["r1"][i] + made.crank.mass_centre * f(angle) for i, f in enumerate((np.cos, np.sin))]
    crank = made.crank.mass * (np.array([rates(time, component)[1] for component in centre]) - gravity)
    pivot = crank + pin
    out = np.array([np.cos(angle[:, 2]), np.sin(angle[:, 2])])
    overlap = np.array([component[:, 2] for component in vectors["r2"]])
    at_pivot = lever["crank_pivot"][1] - made.crank.mass_centre * out
    at_pin = (CRANK - made.crank.mass_centre) * out + overlap + lever["crank_pin"][1]
    torque = made.crank.inertia * found["crank_acceleration"] - cross(at_pivot, pivot) + cross(at_pin, pin)
    at_slider = np.array([component[:, 2] for component in vectors["r3"]]) + lever["piston_pin"][1]
    values = {
        "crank_torque": torque,
        "guide_force": piston[1] - made.slider.mass * gravity[1],
        "guide_moment": cross(at_slider, piston) + rubbing(np.hypot(*piston)),
        "frame_force_x": -pivot[0],
        "frame_force_y": -pivot[1],
    }
    for name, force in (("crank_pin", pin), ("piston_pin", piston), ("crank_pivot", pivot)):
        normal = lever[name][0]
        if getattr(p, name).loose:
            pushing, rubbed = -(force * normal).sum(axis=0), cross(normal, force)
        else:
            pushing, rubbed = np.hypot(*force), np.zeros(len(time))
        values |= {f"{name}_force_x": force[0], f"{name}_force_y": force[1]}
        values |= {f"{name}_normal_force": pushing, f"{name}_friction_force": rubbed}
    return values


def friction_moment(made, p, found):
    """Moment on the rod by friction in an ideal piston pin under a force [N]."""
    effect_of_pin = made.effect("pin_friction", "piston_pin")
    if not effect_of_pin:
        return lambda force: 0.0 * force
    sign = np.tanh(found["rod_angular_velocity"] / p.effects.crank_sign_speed)
    radius = made.joint("piston_pin").journal_radius
    return lambda force: -effect_of_pin.coefficient * radius * np.abs(force) * sign


@cache
def compared(case):
    """Columns as they should be and as they are."""
    made, chosen = CASES[case]
    made = made.applied()
    p, time, angle, states, seen = sampled(made, chosen)
    return expected(made, p, time, angle, states), {name: values[:, 2] for name, values in seen.items()}


def error(name, ours, theirs):
    """Largest difference of two columns over the column's largest value; directions but for whole turns."""
    if np.isnan(theirs).all() or np.isnan(ours).all():
        return 0.0 if np.isnan(theirs).all() and np.isnan(ours).all() else np.inf
    difference = ours - theirs
    if name in ("gamma1", "gamma2", "gamma3"):
        difference = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
    return np.abs(difference).max() / max(np.abs(theirs).max(), 1e-12)


@pytest.mark.parametrize("case", CASES)
def test_every_column_is_what_its_name_says(case):
    wanted, seen = compared(case)
    if case != "bending rod":  # its forces are checked by the whole mechanism's balance: see `test_balance`
        assert set(wanted) == set(SAMPLE.names)
    errors = {name: error(name, seen[name], values) for name, values in wanted.items()}
    assert {name: found for name, found in errors.items() if not found < TOLERANCE} == {}


def test_no_two_columns_could_be_swapped_unseen():
    wanted, seen = compared("three loose joints, motor")
    unseen = [
        (one, other)
        for one, other in combinations(wanted, 2)
        if error(one, seen[other], wanted[one]) < TOLERANCE and error(other, seen[one], wanted[other]) < TOLERANCE
    ]
    assert unseen == []
