"""Energy, momenta, powers and forces of the mechanism, each from its definition."""

import math

import numpy as np

from jointgap.effects.base import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED
from tests.motion.quadrature import Motion

SHARE = 2 / math.pi  # mean of the bending mode sin(pi s / l); its mean square is 1/2
NUMBERS = {"crank_pin": 2, "piston_pin": 3, "crank_pivot": 1}


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def turned(vector):
    return np.array([-vector[1], vector[0]])


def rod_centre(moved: Motion) -> np.ndarray:
    """Place and velocity of the rod's mass centre, (2, 2, panels, nodes)."""
    return np.array(
        [[moved[f"rod_{what}_{axis}"] for axis in "xy"] for what in ("position", "velocity")]
    )


def bodies(moved: Motion) -> list[tuple]:
    """Crank, unbalance, rod, slider: mass, position, velocity, inertia, angular velocity."""
    made = moved.made
    angle, speed = moved.angles, moved["crank_speed"]
    pivot, pivot_rate = moved.vector("crank_pivot")

    def on_crank(distance, ahead):
        arm = distance * np.array([np.cos(angle + ahead), np.sin(angle + ahead)])
        return pivot + arm, pivot_rate + speed * turned(arm)

    crank, rod, slider = made.crank, made.rod, made.slider
    arm = crank.mass_centre + 1j * crank.mass_centre_across
    found = [(crank.mass, *on_crank(abs(arm), np.angle(arm)), crank.inertia, speed)]
    if unbalance := made.effect("crank_unbalance"):
        mass = unbalance.unbalance_kg_m / crank.length
        found.append((mass, *on_crank(crank.length, unbalance.angle_rad), 0.0, speed))
    found.append((rod.mass, *rod_centre(moved), rod.inertia, moved["rod_angular_velocity"]))
    place = np.array([moved["slider_position"], np.full_like(angle, slider.offset)])
    velocity = np.array([moved["slider_velocity"], np.zeros_like(angle)])
    return [*found, (slider.mass, place, velocity, 0.0, np.zeros_like(angle))]


def bending(moved: Motion) -> dict[str, np.ndarray]:
    """Contribution of the bending rod: a uniform beam with the deflection q sin(pi s / l)."""
    effect, rod = moved.made.effect("rod_flexibility"), moved.made.rod
    if not effect:
        names = ("kinetic", "strain", "potential", "spin", "loss", "moment")
        return dict.fromkeys(names, np.zeros_like(moved.angles)) | {
            "momentum": np.zeros((2, *moved.angles.shape))
        }
    m, beyond = rod.mass, 0.5 * rod.length - rod.mass_centre
    (q, rate), turn = moved.bend(), moved["rod_angular_velocity"]
    along = np.array([np.cos(moved["rod_angle"]), np.sin(moved["rod_angle"])])
    across = turned(along)
    place, velocity = rod_centre(moved)
    forward, sideways = (velocity * along).sum(0), (velocity * across).sum(0) + turn * beyond
    kinetic = m * (
        0.25 * rate**2 + 0.25 * (q * turn) ** 2 + SHARE * (rate * sideways - q * turn * forward)
    )
    momentum = m * SHARE * (rate * across - q * turn * along)
    spin = (
        cross(place, momentum)
        + m * SHARE * (q * cross(across, velocity) + rate * beyond)
        + 0.5 * m * q**2 * turn
    )
    angular_frequency = 2 * math.pi * effect.frequency_Hz
    return {
        "kinetic": kinetic,
        "strain": 0.25 * m * angular_frequency**2 * q**2,
        "potential": -m * SHARE * q * (moved.made.gravity[:, None, None] * across).sum(0),
        "momentum": momentum,
        "spin": spin,
        "moment": m * SHARE * q * cross(across, moved.made.gravity),
        "loss": m * effect.damping_ratio * angular_frequency * rate**2,
    }


def slider_effects(moved: Motion) -> np.ndarray:
    """Force [N] on the slider by its effects."""
    v, x, force = moved["slider_velocity"], moved["slider_position"], np.zeros_like(moved.angles)
    made, sign, time = moved.made, np.tanh(v / SLIDER_SIGN_SPEED), moved.sampled(moved.run.times)
    if e := made.effect("slider_coulomb_friction"):
        force = force - e.force_N * sign
    if e := made.effect("slider_viscous_friction"):
        force = force - e.damping_N_s_m * v
    if e := made.effect("slider_quadratic_drag"):
        force = force - e.drag_N_s2_m2 * v * np.abs(v)
    if e := made.effect("slider_stribeck_friction"):
        lasting = 1 - e.stribeck_share
        falling = e.stribeck_share * np.exp(-np.abs(v) / e.stribeck_speed_m_s)
        force = force - e.force_N * (lasting + falling) * sign
    if e := made.effect("slider_position_friction"):
        wave = np.cos(math.pi * (x - e.tightest_position_m) / e.length_m) ** 2
        force = force - e.force_N * (1 - e.varying_share + e.varying_share * wave) * sign
    if e := made.effect("slider_power_drag"):
        force = force - e.force_N * np.abs(v / e.speed_m_s) ** e.exponent * sign
    if e := made.effect("slider_load_friction"):
        force = force - e.coefficient * np.abs(moved["guide_force"]) * sign
    if e := made.effect("slider_constant_force"):
        force = force + e.force_N
    if e := made.effect("slider_spring"):
        force = force - e.stiffness_N_m * (x - e.rest_position_m)
    if e := made.effect("slider_nonlinear_spring"):
        stretch, c = x - e.rest_position_m, e.cubic_share
        force = force - e.stiffness_N_m * ((1 - c) * stretch + c * stretch**3 / e.length_m**2)
    if e := made.effect("gas_pressure"):
        outermost = math.sqrt((made.crank.length + made.rod.length) ** 2 - made.slider.offset**2)
        force = (
            force - e.force_N * (e.dead_length_m / (e.dead_length_m + outermost - x)) ** e.exponent
        )
    if e := made.effect("harmonic_force"):
        force = force + e.force_N * np.cos(2 * math.pi * e.frequency_Hz * time + e.phase_rad)
    if made.effect(
        "discovered_slider_force"
    ):  # the one of the tests: see `tests.motion.test_balance`
        force = force - 2.0 * v * np.abs(v) + 3.0 * np.sin(moved.angles)
    return force


def crank_losses(moved: Motion) -> np.ndarray:
    """Moment [N m] on the crank by friction in its bearings and by a formula."""
    w, moment = moved["crank_speed"], np.zeros_like(moved.angles)
    if e := moved.made.effect("crank_coulomb_friction"):
        moment = moment - e.torque_N_m * np.tanh(w / CRANK_SIGN_SPEED)
    if e := moved.made.effect("crank_angle_friction"):
        wave = np.cos((moved.angles - e.tightest_angle_rad) / 2) ** 2
        moment = moment - e.torque_N_m * (1 - e.varying_share + e.varying_share * wave) * np.tanh(
            w / CRANK_SIGN_SPEED
        )
    if e := moved.made.effect("crank_viscous_friction"):
        moment = moment - e.damping_N_m_s * w
    if e := moved.made.effect("crank_brake"):
        rise = np.abs(w / e.reference_speed_rad_s) ** e.exponent
        moment = moment - e.torque_N_m * rise * np.tanh(w / CRANK_SIGN_SPEED)
    if e := moved.made.effect("crank_periodic_torque"):
        moment = moment + e.torque_N_m * np.cos(e.order * moved.angles - e.phase_rad)
    if moved.made.effect("discovered_crank_torque"):
        moment = moment - 0.3 * np.cos(moved.angles) ** 2
    return moment


def joint_powers(moved: Motion, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Elastic energy [J] of a joint and power [W] that it turns into heat."""
    joint, rod, crank = (
        moved.model.bearings[name],
        moved["rod_angular_velocity"],
        moved["crank_speed"],
    )
    pairs = {"crank_pin": (rod, crank), "piston_pin": (rod, 0 * rod)}
    pairs["crank_pivot"] = (crank, 0 * crank)
    body, partner = pairs[name]
    push, drag = moved[f"{name}_normal_force"], moved[f"{name}_friction_force"]
    if not joint.loose:
        rubbing = moved.made.effect("pin_friction", name)
        moment = 0.0 * push
        if rubbing:
            moment = rubbing.coefficient * moved.made.joint(name).journal_radius * push
        return 0.0 * push, moment * np.tanh((body - partner) / CRANK_SIGN_SPEED) * (body - partner)
    number = NUMBERS[name]
    r, parting = moved[f"r{number}"], moved[f"r{number}_dot"]
    around = np.nan_to_num(r * moved[f"gamma{number}_dot"])
    depth = np.where(moved.mode(name) == 0, 0.0, np.maximum(r - joint.clearance, 0.0))
    elastic = joint.stiffness * depth**joint.exponent
    body_arm = joint.side * joint.body_radius - 0.5 * depth
    partner_arm = joint.side * joint.partner_radius + 0.5 * depth
    sliding = around + body_arm * body - partner_arm * partner
    loss = -elastic * parting
    film = moved.made.effect("lubricated_joint", name)
    if film:
        thinnest, gap, data = film.least_film_m, moved.made.clearance(name), moved.made.joint(name)
        dry = np.maximum(elastic * (1 + moved.damping_factor(name) * parting), 0.0)
        rubbed = -dry * joint.friction * np.tanh(sliding / joint.friction_speed)
        loss = loss + dry * parting - rubbed * sliding
        push, drag = push - dry, drag - rubbed
        filled = np.sqrt(1 - np.minimum(r / gap, 1 - thinnest / gap) ** 2)
        filled_gap = gap * filled
        shear = (
            2 * math.pi * film.viscosity_Pa_s * data.journal_radius**3 * film.length_m / filled_gap
        )
        couple = -0.5 * r * drag  # the pair of forces acts halfway between the centres
        loss = loss + push * parting - drag * around - couple * (body + partner)
        loss = loss + shear * (body - partner) ** 2
    else:
        loss = loss + push * parting - drag * sliding
    return elastic * depth / (joint.exponent + 1), loss


def frame_moment(moved: Motion) -> np.ndarray:
    """Moment [N m] about the origin of the frame's force on the crank in a loose crank pivot."""
    pivot = moved.model.bearings["crank_pivot"]
    if not pivot.loose:
        return np.zeros_like(moved.angles)
    depth = np.maximum(moved["r1"] - pivot.clearance, 0.0)
    return (pivot.side * pivot.partner_radius + 0.5 * depth) * moved["crank_pivot_friction_force"]
