"""The mechanism again in plain vectors and scipy, without code of the package. Friction in a joint
acts halfway through the overlap."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import betainc

CRANK, ROD, CENTRE = 0.15, 0.564, 0.282
ROD_MASS, ROD_INERTIA, SLIDER_MASS = 0.773, 2.482e-2, 0.4482
JOURNAL, BEARING = 0.007, 0.008
STIFFNESS = 4 / (6 * (1 - 0.3**2) / 207e9) * np.sqrt(JOURNAL * BEARING / (BEARING - JOURNAL))


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def turn(rate, arm):
    return rate * np.array([-arm[1], arm[0]])


def ends(t, z, speed):
    """Per joint: centres of pin and ring, their velocities, angular velocities of their bodies;
    rod's mass centre."""
    along = np.array([np.cos(z[2]), np.sin(z[2])])
    centre, velocity, rate = z[0:2], z[4:6], z[6]
    crank = CRANK * np.array([np.cos(speed * t), np.sin(speed * t)])
    near, far = -CENTRE * along, (ROD - CENTRE) * along
    slider, slider_velocity = np.array([z[3], 0.0]), np.array([z[7], 0.0])
    first = crank, centre + near, turn(speed, crank), velocity + turn(rate, near), speed, rate
    second = slider, centre + far, slider_velocity, velocity + turn(rate, far), 0.0, rate
    return (first, second), centre


def penetration(joint):
    return np.linalg.norm(joint[1] - joint[0]) - (BEARING - JOURNAL)


def approach_rate(joint):
    gap = joint[1] - joint[0]
    return gap @ (joint[3] - joint[2]) / np.linalg.norm(gap)


def damping_factor(chi, approach, since, memory):
    """chi / d'_0, fading to chi / v_ref; `memory`: time until fading, duration of fading, v_ref."""
    if memory is None:
        return chi / approach
    kept, fading, reference = memory
    return chi / approach + betainc(5, 5, np.clip((since - kept) / fading, 0, 1)) * (
        chi / reference - chi / approach
    )


def force_on_ring(joint, contact, now, chi, friction, friction_speed, memory):
    """Force on the body with the ring (the rod), and the point where it acts."""
    pin, ring, pin_velocity, ring_velocity, pin_rate, ring_rate = joint
    depth = max(penetration(joint), 0.0)
    # from the ring's centre to the place of contact
    outward = (pin - ring) / np.linalg.norm(pin - ring)
    point = ring + (BEARING + depth / 2) * outward
    slip = (ring_velocity + turn(ring_rate, point - ring)) - (
        pin_velocity + turn(pin_rate, point - pin)
    )
    tangent = np.array([-outward[1], outward[0]])
    approach, begin = contact
    damping = damping_factor(chi, approach, now - begin, memory)
    push = STIFFNESS * depth**1.5 * (1 + damping * approach_rate(joint))
    push = max(push, 0.0)
    drag = friction * np.tanh(slip @ tangent / friction_speed) * push
    return push * outward - drag * tangent, point


def slope(t, z, speed, contacts, law):
    joints, centre = ends(t, z, speed)
    total, moment, on_slider = np.zeros(2), 0.0, 0.0
    for joint, contact in zip(joints, contacts, strict=True):
        if contact is not None:
            force, point = force_on_ring(joint, contact, t, *law)
            total = total + force
            moment = moment + cross(point - centre, force)
            on_slider = -force[0]
    if contacts[1] is None:
        on_slider = 0.0
    return np.concatenate(
        (z[4:], total / ROD_MASS, [moment / ROD_INERTIA, on_slider / SLIDER_MASS])
    )


def simulate(angles, speed, chi, friction, friction_speed, tolerance, memory=None):
    """States (n, 8) at crank angles `angles` [rad] from dead centre, and impacts (time, joint,
    approach speed)."""
    times = np.asarray(angles) / speed
    rate = -CRANK * speed / ROD
    z = np.array([CRANK + CENTRE, 0, 0, CRANK + ROD, 0, CRANK * speed + CENTRE * rate, rate, 0.0])
    t, contacts, states, impacts = 0.0, [None, None], [], []
    events = []
    for joint in range(2):

        def touches(t, z, *_, joint=joint):
            return penetration(ends(t, z, speed)[0][joint])

        touches.terminal = True
        events.append(touches)
    scale = np.array([1, 1, 1 / ROD, 1, 1e4, 1e4, 1e4 / ROD, 1e4])
    while t < times[-1]:
        for joint, contact in enumerate(contacts):
            events[joint].direction = 1 if contact is None else -1
        law = (chi, friction, friction_speed, memory)
        part = solve_ivp(
            slope,
            (t, times[-1]),
            z,
            "DOP853",
            events=events,
            args=(speed, contacts, law),
            rtol=1e-13,
            atol=tolerance * scale,
            first_step=1e-7,
            max_step=1e-3,
            dense_output=True,
        )
        inside = times[(times > t if states else times >= t) & (times <= part.t[-1])]
        states += [part.sol(time) for time in inside]
        t, z = part.t[-1], part.y[:, -1]
        if part.status == 1:
            joint = 0 if part.t_events[0].size else 1
            if contacts[joint] is None:
                contacts[joint] = approach_rate(ends(t, z, speed)[0][joint]), t
                impacts.append((t, joint, contacts[joint][0]))
            else:
                contacts[joint] = None
    return np.array(states), np.array(impacts)
