"""The mirrored mechanism turning counter-clockwise moves as the mirror image of a clockwise one."""

import numpy as np
import pytest

from jointgap.config.channels import channel_kinds
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINTS
from jointgap.core.sites import SLIDER_CRANK
from jointgap.effects import EFFECTS
from jointgap.effects.base import example
from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, simulate, start_state
from tests.motion.cases import SPEED, effect, mechanism, options

ACROSS = {"mass_centre_across": 0.01}
ANGLES = 0.7 + np.linspace(0.0, 1.5, 91)
MIRRORED = [name for name, kind in channel_kinds(SLIDER_CRANK).items() if kind.mirrored]
READ = ("slider_position", "slider_acceleration", "rod_acceleration_x", "frame_force_x", *MIRRORED)
OWN = {
    "crank_unbalance": effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=1.0),
    "lubricated_joint": effect("lubricated_joint", "crank_pin", viscosity_Pa_s=0.4, length_m=0.02),
    "discovered_slider_force": effect(
        "discovered_slider_force", formula="20*sin(theta) + 0.1*w*v + 5*x"
    ),
    "discovered_crank_torque": effect(
        "discovered_crank_torque", formula="0.3*cos(theta) - 0.01*w + 0.2*v"
    ),
}


def turned_backwards(model, start_angle):
    """A model whose crank turns clockwise."""
    model.drive.speed, model.drive.start_angle = -model.drive.speed, start_angle
    return model


def motion(model, angles):
    return observed(model, integrate_to_angles(model, start_state(model), angles, 1e-12))


def loose_joints(name):
    return ("crank_pin",) if name == "lubricated_joint" else ()


@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "speed_fluctuation"])
def test_the_mirrored_mechanism_moves_as_the_mirror_image_of_the_clockwise_one(name):
    weight = [] if name == "gravity" else [effect("gravity")]
    effects = (*weight, OWN.get(name, example(EFFECTS[name])))
    made = mechanism(*effects, loose=loose_joints(name), offset=0.03, crank=ACROSS)
    front = motion(turned_backwards(model_of(made, options()), -ANGLES[0]), -ANGLES)
    seen = model_of(made.applied().mirrored(), options(start_angle=ANGLES[0]))
    behind = motion(seen, ANGLES)
    # The reactions of an ideal pin are solved for, and rounded otherwise in the mirror; a stiff
    # film amplifies that.
    bound = 1e-4 if name == "lubricated_joint" else 1e-7
    for column in READ:
        sign = -1.0 if column in MIRRORED else 1.0
        size = max(np.abs(front[column]).max(), 1e-6)
        assert np.abs(sign * behind[column] - front[column]).max() < bound * size, column


@pytest.mark.parametrize("loose", [(), ("crank_pin", "piston_pin"), ("crank_pivot",)])
def test_a_clockwise_speed_gives_the_columns_of_an_integration_backwards(
    loose,
):
    made = mechanism(effect("gravity"), loose=loose, offset=0.03)
    asked = options(speed=-SPEED, start_angle=0.7, revolutions=1, samples_per_revolution=240)
    own = simulate(made, asked)
    angles = 0.7 - np.arange(60) * (2 * np.pi / 240)
    forwards = model_of(made, asked.model_copy(update={"speed": SPEED}))
    plain = motion(turned_backwards(forwards, 0.7), angles)
    modes = [f"{joint}_mode" for joint in JOINTS]
    for name in own.samples.columns.difference(modes):
        values = plain[name]
        found, same = own.samples[name].to_numpy()[:60], np.isfinite(values)
        assert (np.isfinite(found) == same).all(), name
        size = max(np.abs(values[same]).max(initial=0.0), 1e-9)
        assert np.abs(found - values)[same].max(initial=0.0) < 1e-5 * size, name
    assert (own.events["crank_angle"] <= 0.7).all()


def test_a_motor_starts_from_rest_in_either_direction():
    motor = {"kind": "motor", "stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
    still = options(speed=0.0, drive=motor, revolutions=1, samples_per_revolution=90)
    made = mechanism(loose=())
    samples = simulate(made, still).samples
    assert samples.crank_speed[0] == 0.0 and (np.diff(samples.time) > 0).all()
    almost = simulate(made, still.model_copy(update={"speed": 1e-6})).samples
    np.testing.assert_allclose(samples.crank_speed[1:], almost.crank_speed[1:], rtol=1e-5)
    turning = options(speed=20.0, drive=motor, revolutions=1, samples_per_revolution=90)
    forth, back = (
        simulate(made, turning.model_copy(update={"speed": speed})).samples
        for speed in (20.0, -20.0)
    )
    np.testing.assert_allclose(back.crank_speed, -forth.crank_speed, rtol=1e-9)
    np.testing.assert_allclose(back.slider_position, forth.slider_position, atol=1e-9)


def test_a_crank_without_speed_is_an_error():
    with pytest.raises(
        ValueError, match="speed 0: the crank does not turn; give a speed, or a motor"
    ):
        options(speed=0.0)
    with pytest.raises(InputError, match="clockwise, which only single simulations support"):
        model_of(mechanism(), options(speed=-1.0))
