"""Symmetries: the mirror image of a mechanism moves as the mirror image; when and on which turn it starts does not
matter.
"""

import numpy as np
import pytest

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ALL, LUGRE, MOTOR, PINS, effect, integrated, mechanism, options, with_numbers

RUB = {"friction": 0.1, "offset": 0.03, "gravity": True}
MIRRORED = {
    "two loose": ([], RUB),
    "three loose": ([effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0)], RUB | {"loose": ALL}),
    "bristles": ([], RUB | LUGRE),
    "film": ([effect("lubricated_joint", pin, viscosity_Pa_s=0.4, length_m=0.02) for pin in PINS], RUB),
    "flexible rod": ([effect("rod_flexibility", frequency_Hz=250.0, damping_ratio=0.02)], RUB),
    "ideal pins with friction": (
        [effect("pin_friction", pin, coefficient=0.1) for pin in PINS],
        RUB | {"loose": ("crank_pivot",)},
    ),
    "forces on the slider": (
        [
            effect("slider_load_friction", coefficient=0.1),
            effect("harmonic_force", force_N=30.0, frequency_Hz=37.0, phase_rad=0.4),
        ],
        RUB,
    ),
}
STATE_SIGNS = np.array([1, -1] * 4)
AUXILIARY_SIGNS = np.array([1, -1, -1, -1, 1, -1, -1, -1, -1, -1, -1])


@pytest.mark.parametrize("case", MIRRORED)
def test_mirrored_in_the_slide_the_mechanism_moves_as_its_mirror_image(case, worst):
    effects, keys = MIRRORED[case]
    p = parameters(mechanism(*effects, **keys), options(start_angle=0.7))
    angles = 0.7 + np.linspace(0, 1.5, 361)
    run = integrate_to_angles(p, start_state(p), angles, 1e-12)
    mirrored = with_numbers(
        p,
        bodies={
            "gravity_y": -p.bodies.gravity_y,
            "slider_offset": -p.bodies.slider_offset,
            "crank_moment_y": -p.bodies.crank_moment_y,
        },
        drive={"speed": -p.drive.speed, "start_angle": -0.7},
    )
    image = integrate_to_angles(mirrored, start_state(mirrored), -angles, 1e-12)
    assert len(run.events) > 3 or case == "film"
    # Reactions of ideal pins are solved for, and rounded otherwise in the mirror.
    bound = 0.0 if p.crank_pin.loose else 1e-10
    worst("mirror image [m]", np.abs(image.states * STATE_SIGNS - run.states)[:, :4].max(), bound)
    worst(
        "mirror image, auxiliary states",
        np.abs(image.auxiliary_states * AUXILIARY_SIGNS - run.auxiliary_states).max(),
        1e3 * bound,
    )
    np.testing.assert_allclose(image.events[:, :5], run.events[:, :5], rtol=1e3 * bound)


SHIFTED = {
    "two loose": ([], {}, {}),
    "three loose, friction": ([], {"loose": ALL, "friction": 0.1}, {}),
    "motor": ([], {"friction": 0.1}, {"drive": MOTOR}),
    "fluctuating speed": ([effect("speed_fluctuation", ratio=0.1, order=2, phase_rad=0.5)], {}, {}),
}


@pytest.mark.parametrize("case", SHIFTED)
def test_a_start_one_turn_later_gives_the_same_motion(case, worst):
    effects, keys, drive = SHIFTED[case]
    made, degrees = mechanism(*effects, **keys), np.arange(0, 46)
    _, run = integrated(made, degrees, 1e-14, start_angle=0.3, **drive)
    _, later = integrated(made, degrees, 1e-14, start_angle=0.3 + 2 * np.pi, **drive)
    worst("start one turn later, 45 deg [m]", np.abs(later.states - run.states)[:, :4].max(), 1e-10)


@pytest.mark.parametrize("case", SHIFTED)
def test_a_start_from_a_state_on_the_way_gives_the_rest_of_the_motion(case, worst):
    effects, keys, drive = SHIFTED[case]
    made, degrees = mechanism(*effects, **keys), np.arange(0, 45.5, 0.5)
    p, run = integrated(made, degrees, 1e-14, start_angle=0.3, **drive)
    between = np.flatnonzero((run.modes == 0).all(axis=1) & (degrees > 12))
    assert between.size
    on_the_way = between[0]
    angles = 0.3 + np.radians(degrees[on_the_way:])
    later = with_numbers(p, drive={"start_angle": angles[0]})
    rest = integrate_to_angles(later, (run.states[on_the_way], run.auxiliary_states[on_the_way]), angles, 1e-14)
    worst("start on the way, 45 deg [m]", np.abs(rest.states - run.states[on_the_way:])[:, :4].max(), 1e-10)
    assert rest.times[-1] == pytest.approx(run.times[-1] - run.times[on_the_way], rel=1e-12)
