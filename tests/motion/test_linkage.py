"""Positions and their time derivatives of the linkage: against complex steps, the paper's formulae
and textbooks."""

from dataclasses import replace

import numpy as np
import pytest
import sympy

from jointgap.config import load_mechanism
from jointgap.core.errors import InputError
from jointgap.motion.kinematics import (
    ClearanceMotion,
    Motion,
    ideal_cycle,
    linkage_motion,
    rotating_vector,
    transmission_angle,
)

MECHANISM = load_mechanism("config/mechanisms/erkaya2009.yaml")
SPEED = 20 * np.pi


def turning(time):
    """Crank angle, clearance motion and all their derivatives as analytic functions of time,
    complex times included."""
    angle = Motion(0.3 + SPEED * time + 9.0 * time**2, SPEED + 18.0 * time, 18.0 + 0 * time)

    def wave(mean, size, rate, phase):
        argument = rate * time + phase
        return Motion(
            mean + size * np.sin(argument),
            size * rate * np.cos(argument),
            -size * rate**2 * np.sin(argument),
        )

    clearance = ClearanceMotion(
        r2=wave(9e-4, 1e-4, 300.0, 0.1),
        gamma2=angle + wave(0.2, 0.3, 90.0, 0.4),
        r3=wave(7e-4, 3e-4, 170.0, 1.1),
        gamma3=wave(-1.0, 2.0, 60.0, 0.7),
        r1=wave(8e-4, 2e-4, 210.0, 0.9),
        gamma1=angle + wave(0.5, 0.8, 70.0, 0.2),
    )
    return angle, clearance


NAMES = ("crank_x", "crank_y", "rod_x", "rod_y", "slider_x", "slider_y", "rod_angle")
NAMES = (*NAMES, "transmission_angle")


@pytest.mark.parametrize(
    "name, loose", [(name, loose) for name in NAMES for loose in (True, False)]
)
def test_the_exact_form_is_the_time_derivative(name, loose):
    time, step = np.linspace(0.0, 0.1, 201), 1e-40

    def motion(at):
        angle, clearance = turning(at)
        return getattr(linkage_motion(MECHANISM, angle, clearance if loose else None), name)

    ours, shifted = motion(time), motion(time + 1j * step)
    velocity, acceleration = np.imag(shifted.position) / step, np.imag(shifted.velocity) / step
    # The slider's height cancels to nothing: its scale is that of the terms that cancel.
    assert ours.velocity == pytest.approx(velocity, rel=1e-11, abs=1e-13 * SPEED)
    assert ours.acceleration == pytest.approx(acceleration, rel=1e-11, abs=1e-13 * SPEED**2)


def paper_functions():
    """Equations (3)-(10) as the paper writes them, its partial derivatives found symbolically and
    then summed."""
    theta, gamma2, gamma3 = sympy.symbols("theta2 gamma2 gamma3")
    crank, rod, centre, r2, r3 = sympy.symbols("L2 L3 AG3 r2 r3", positive=True)
    w, a, v2, v3, a2, a3 = sympy.symbols("w2 a2 g2d g3d g2dd g3dd")
    height = crank * sympy.sin(theta) + r2 * sympy.sin(gamma2)
    rod_angle = sympy.asin(-(height + r3 * sympy.sin(sympy.pi + gamma3)) / rod)
    along = crank * sympy.cos(theta) + r2 * sympy.cos(gamma2)
    quantities = {
        "rod_x": along + centre * sympy.cos(rod_angle),
        "rod_y": height + centre * sympy.sin(rod_angle),
        "slider_x": along + rod * sympy.cos(rod_angle) + r3 * sympy.cos(sympy.pi + gamma3),
        "slider_y": height + rod * sympy.sin(rod_angle) + r3 * sympy.sin(sympy.pi + gamma3),
        "rod_angle": rod_angle,
        "transmission_angle": sympy.acos((height - r3 * sympy.sin(gamma3)) / rod),
    }

    def velocity(q):
        return w * q.diff(theta) + v2 * q.diff(gamma2) + v3 * q.diff(gamma3)

    def acceleration(q):
        return (
            a * q.diff(theta)
            + w**2 * q.diff(theta, 2)
            + 2 * w * (v2 * q.diff(theta, gamma2) + v3 * q.diff(theta, gamma3))
            + a2 * q.diff(gamma2)
            + a3 * q.diff(gamma3)
            + v2**2 * q.diff(gamma2, 2)
            + v3**2 * q.diff(gamma3, 2)
            + v2 * v3 * q.diff(gamma2, gamma3)
            + v3 * v2 * q.diff(gamma3, gamma2)
        )

    arguments = (crank, rod, centre, r2, r3, theta, gamma2, gamma3, w, a, v2, v3, a2, a3)
    return {
        name: [
            sympy.lambdify(arguments, part, "numpy", cse=True)
            for part in (q, velocity(q), acceleration(q))
        ]
        for name, q in quantities.items()
    }


def test_the_paper_form_is_the_printed_sum_of_partial_derivatives():
    angle, clearance = turning(np.linspace(0.0, 0.1, 101))
    clearance = replace(clearance, r1=Motion.of(0.0))
    ours = linkage_motion(MECHANISM, angle, clearance.paper_form())
    given = (MECHANISM.crank.length, MECHANISM.rod.length, MECHANISM.rod.mass_centre)
    places = (clearance.r2.position, clearance.r3.position, angle.position)
    turns = (clearance.gamma2, clearance.gamma3)
    positions = tuple(one.position for one in turns)
    arguments = (*given, *places, *positions, angle.velocity, angle.acceleration)
    arguments += (*(one.velocity for one in turns), *(one.acceleration for one in turns))
    for name, functions in paper_functions().items():
        motion = getattr(ours, name)
        for mine, function in zip(
            (motion.position, motion.velocity, motion.acceleration), functions, strict=True
        ):
            printed = function(*arguments)
            scale = max(1.0, np.max(np.abs(printed)))
            assert np.max(np.abs(mine - printed)) < 1e-12 * scale, name


def test_without_clearance_the_slider_follows_the_textbook():
    angle = Motion.of(np.linspace(0, 4 * np.pi, 500), np.full(500, SPEED))
    ours = linkage_motion(MECHANISM, angle)
    sine, cosine = np.sin(angle.position), np.cos(angle.position)
    root = np.sqrt(0.564**2 - (0.150 * sine) ** 2)
    speed = -0.150 * SPEED * (sine + 0.150 * sine * cosine / root)
    assert ours.slider_x.position == pytest.approx(0.150 * cosine + root, rel=1e-14)
    assert ours.slider_x.velocity == pytest.approx(speed, rel=1e-12, abs=1e-13)
    assert ours.slider_x.acceleration[0] == pytest.approx(
        -(SPEED**2) * 0.150 * (1 + 0.150 / 0.564), rel=1e-13
    )


def test_a_loose_crank_pivot_moves_the_linkage():
    angle, clearance = turning(np.linspace(0.0, 0.1, 301))
    alone = ClearanceMotion(r1=clearance.r1, gamma1=clearance.gamma1)
    moved, ideal = linkage_motion(MECHANISM, angle, alone), linkage_motion(MECHANISM, angle)
    across = clearance.r1.position * np.cos(clearance.gamma1.position)
    assert moved.crank_x.position - ideal.crank_x.position == pytest.approx(across, abs=1e-15)
    # With the crank on its own radius, a step of the pivot along the slide would carry the slider
    # along unchanged.
    level = ClearanceMotion(r1=Motion.of(1e-3), gamma1=Motion.of(0.0))
    shifted = linkage_motion(MECHANISM, angle, level)
    assert shifted.slider_x.position - ideal.slider_x.position == pytest.approx(
        np.full(301, 1e-3), abs=1e-15
    )
    assert shifted.rod_angle.acceleration == pytest.approx(ideal.rod_angle.acceleration, rel=1e-13)


def test_a_rod_that_is_too_short_is_refused_with_its_crank_angle():
    with pytest.raises(
        InputError, match=r"rod of 100 mm .* crank angle 90 deg: its crank end is 150 mm from"
    ):
        transmission_angle(0.150, 0.100, np.radians([0.0, 45.0, 90.0]))
    short = MECHANISM.model_copy(update={"rod": MECHANISM.rod.with_length(0.1)})
    with pytest.raises(InputError, match="90 deg"):
        linkage_motion(short, Motion.of(np.radians([0.0, 90.0])))


@pytest.mark.parametrize("offset", [0.0, 0.03, -0.05])
def test_the_ideal_cycle_bounds_the_linkage(offset):
    mechanism = MECHANISM.model_copy(
        update={"slider": MECHANISM.slider.model_copy(update={"offset": offset})}
    )
    motion = linkage_motion(mechanism, Motion.of(np.linspace(0, 2 * np.pi, 200_001)))
    cycle = ideal_cycle(0.150, 0.564, offset)
    departure = np.max(np.abs(motion.transmission_angle.position - np.pi / 2))
    assert departure == pytest.approx(cycle.largest_departure, abs=1e-9)
    assert np.pi / 2 - departure == pytest.approx(cycle.smallest_transmission_angle, abs=1e-9)
    assert np.max(motion.slider_x.position) == pytest.approx(cycle.outer_dead_centre, abs=1e-9)
    assert np.min(motion.slider_x.position) == pytest.approx(cycle.inner_dead_centre, abs=1e-9)
    assert cycle.stroke == pytest.approx(np.ptp(motion.slider_x.position), abs=2e-9)


def test_a_zero_vector_has_undefined_derivatives():
    length = Motion.of(np.array([0.0, 1e-3]), np.array([0.1, 0.0]))
    direction = Motion.of(np.array([np.nan, 0.0]), np.array([np.nan, 1.0]))
    x, y = rotating_vector(length, direction)
    assert x.position[0] == 0.0 and y.position[0] == 0.0
    assert np.isnan(x.velocity[0]) and np.isnan(y.acceleration[0])
    assert x.position[1] == 1e-3 and y.velocity[1] == 1e-3
