"""Newton-Euler equations of all bodies with constraints, solved as one system."""

import numpy as np
import pytest

from jointgap.motion.slider_crank import simulate
from tests.motion.cases import CENTRE, CRANK, MOTOR, PINS, ROD, SPEED, effect, mechanism, options

WEIGHED = {"mass_centre": -0.02, "mass_centre_across": 0.03}
COULOMB = effect("slider_coulomb_friction", force_N=4.0)
IN_GUIDE = effect("slider_load_friction", coefficient=0.2)
IN_PINS = [effect("pin_friction", pin, coefficient=0.3) for pin in PINS]
MIXES = (
    (("crank_pin",), [], {}, {}),
    (("piston_pin",), [COULOMB], {}, {}),
    (("crank_pivot",), [], WEIGHED, {}),
    (("crank_pivot", "crank_pin"), [], WEIGHED, {"drive": MOTOR}),
    (("crank_pivot", "piston_pin"), [IN_PINS[0], IN_GUIDE], {}, {}),
    ((), [*IN_PINS, IN_GUIDE], {}, {"drive": MOTOR}),
)


def point(rows, unknown, lever):
    """Acceleration x, y of a point at `lever` (n, 2) from the mass centre, by the body's x'', y'',
    angle''."""
    jacobian = np.zeros((rows, 2, 8))
    jacobian[:, 0, unknown] = jacobian[:, 1, unknown + 1] = 1.0
    jacobian[:, 0, unknown + 2], jacobian[:, 1, unknown + 2] = -lever[:, 1], lever[:, 0]
    return jacobian


def solved(mechanism, loose, t, motor):
    """Accelerations (n, 8) of crank, rod (x, y, angle each) and slider (x, y), and the constraints'
    forces by name."""
    crank, rod, piston = mechanism.crank, mechanism.rod, mechanism.slider
    n = len(t)
    toward = np.stack([np.cos(t.crank_angle), np.sin(t.crank_angle)], 1)
    along = np.stack([np.cos(t.rod_angle), np.sin(t.rod_angle)], 1)
    centre = crank.mass_centre * toward + crank.mass_centre_across * np.stack(
        [-toward[:, 1], toward[:, 0]], 1
    )
    to_pivot, to_pin = -centre, CRANK * toward - centre
    near, far = -CENTRE * along, (ROD - CENTRE) * along
    w, turn = t.crank_speed.to_numpy()[:, None], t.rod_angular_velocity.to_numpy()[:, None]
    inertia = crank.inertia + (MOTOR["inertia"] if motor else 0.0)
    masses = np.array(
        [crank.mass, crank.mass, inertia, rod.mass, rod.mass, rod.inertia, piston.mass, piston.mass]
    )
    push = np.zeros((n, 8))
    push[:, [0, 1]], push[:, [3, 4]], push[:, [6, 7]] = (
        body.mass * mechanism.gravity for body in (crank, rod, piston)
    )
    against = -np.tanh(t.slider_velocity.to_numpy() / 0.01)
    if coulomb := mechanism.effect("slider_coulomb_friction"):
        push[:, 6] += coulomb.force_N * against
    if guide := mechanism.effect("slider_load_friction"):
        push[:, 6] += guide.coefficient * np.abs(t.guide_force) * against
    if motor:
        push[:, 2] += MOTOR["stall_torque"] * (1 - w[:, 0] / MOTOR["no_load_speed"])
    slides = np.zeros((n, 2, 8))
    slides[:, 0, 6] = slides[:, 1, 7] = 1.0
    of_crank, of_rod = point(n, 0, to_pin), point(n, 3, near)
    ends = {
        "crank_pivot": (point(n, 0, to_pivot), w**2 * to_pivot),
        "crank_pin": (of_rod - of_crank, turn**2 * near - w**2 * to_pin),
        "piston_pin": (point(n, 3, far) - slides, turn**2 * far),
    }
    held = {"guide": 7} if motor else {"guide": 7, "drive": 2}
    rows, names = [np.eye(8)[None, [*held.values()]].repeat(n, 0)], [*held]
    right = [np.zeros((n, len(held)))]
    for name, (jacobian, centripetal) in ends.items():
        force = t[[f"{name}_force_x", f"{name}_force_y"]].to_numpy()
        if name in loose:
            push += np.einsum("nij,ni->nj", jacobian, force)
            continue
        rows.append(jacobian)
        right.append(centripetal)
        names += [f"{name}_force_x", f"{name}_force_y"]
        if rubbing := mechanism.effect("pin_friction", name):
            relative = turn[:, 0] - (w[:, 0] if name == "crank_pin" else 0.0)
            moment = -rubbing.coefficient * 0.007 * np.hypot(*force.T) * np.tanh(relative / 0.1)
            push[:, 5] += moment
            push[:, 2] -= moment if name == "crank_pin" else 0.0
    jacobian, right = np.concatenate(rows, 1), np.concatenate(right, 1)
    count = len(names)
    system = np.zeros((n, 8 + count, 8 + count))
    system[:, range(8), range(8)] = masses
    system[:, :8, 8:], system[:, 8:, :8] = -jacobian.transpose(0, 2, 1), jacobian
    found = np.linalg.solve(system, np.concatenate([push, right], 1)[:, :, None])[:, :, 0]
    return found[:, :8], dict(zip(names, found[:, 8:].T, strict=True))


@pytest.mark.parametrize("loose, effects, crank, drive", MIXES)
def test_the_motion_solves_the_constrained_equations(loose, effects, crank, drive, worst):
    made = mechanism(*effects, loose=loose, offset=0.03, gravity=True, crank=crank)
    t = simulate(made, options(samples_per_revolution=90, tolerance=1e-10, **drive)).samples
    a, forces = solved(made.applied(), loose, t, bool(drive))
    seen = {
        "rod_acceleration_x": 3,
        "rod_acceleration_y": 4,
        "rod_angular_acceleration": 5,
        "slider_acceleration": 6,
    }
    expected = {name: a[:, column] for name, column in seen.items()}
    expected |= {"crank_acceleration": a[:, 2]} if drive else {}
    expected |= {name: force for name, force in forces.items() if name in t} | {
        "guide_force": forces["guide"]
    }
    for name, values in expected.items():
        off = np.abs(t[name] - values).max() / np.abs(values).max()
        worst("constrained equations of motion", off, 1e-11)
    assert np.abs(a).max() > SPEED
