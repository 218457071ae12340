"""Other numerics are as good as the usual ones: another smooth form of the same friction, and a tighter tolerance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.core.joints import JOINTS
from jointgap.dynamics.friction import coulomb, threlfall
from jointgap.rig.model import build_model
from jointgap.rig.simulate_run import NUMERICS, channels_read, numerics_for, other_numerics
from tests.slider_crank.rigs import campaign, mechanism, recorded

SPEED = 1e-3  # m/s, of the usual law


def joints(law: str) -> SimpleNamespace:
    """What a simulation holds of the joints, all with the same friction law."""
    made = {name: SimpleNamespace(friction_law=FRICTION_LAWS[law].code, friction_speed=SPEED) for name in JOINTS}
    return SimpleNamespace(**made)


def test_the_other_friction_law_has_the_same_slope_at_zero_speed_and_the_same_end():
    other = joints("coulomb")
    tolerance, change = other_numerics(1)
    change(other)
    assert tolerance == 1.0
    for name in JOINTS:
        joint = getattr(other, name)
        assert joint.friction_law == FRICTION_LAWS["threlfall"].code
        assert joint.friction_speed == pytest.approx(3.0 * SPEED, rel=1e-12)
        slow = 1e-6 * SPEED
        assert threlfall(slow, 0.1, joint.friction_speed) == pytest.approx(coulomb(slow, 0.1, SPEED), rel=1e-5)
        assert threlfall(100.0 * SPEED, 0.1, joint.friction_speed) == coulomb(100.0 * SPEED, 0.1, SPEED)


@pytest.mark.parametrize("law", [name for name in FRICTION_LAWS if name != "coulomb"])
def test_a_law_that_is_stated_stays_as_it_is(law):
    other = joints(law)
    other_numerics(1)[1](other)
    assert other == joints(law)


def test_the_second_numerics_are_a_tenth_of_the_tolerance_with_all_else_the_same():
    other = joints("coulomb")
    tolerance, change = other_numerics(2)
    change(other)
    assert (tolerance, other) == (0.1, joints("coulomb"))


def test_the_usual_numerics_change_nothing():
    other = joints("coulomb")
    tolerance, change = other_numerics(0)
    change(other)
    assert (tolerance, other) == (1.0, joints("coulomb"))


@pytest.mark.parametrize(
    ("loose", "start", "count"),
    [((), "settled", 2), (("piston_pin",), "settled", 3), (("piston_pin",), "dead_centre", 2)],
)
def test_another_start_counts_where_joints_are_loose_and_nobody_knows_it(loose, start, count):
    own = campaign(mechanism(loose), run={"start": start})
    assert numerics_for(own) == NUMERICS[:count]


def test_another_start_begins_earlier_and_changes_a_settled_motion_by_less_than_noise():
    own = campaign(mechanism(("piston_pin",)))
    plan = build_model(own, recorded(own)).plans["slow"]
    usual, other = (channels_read(own, plan, {}, numerics=numerics) for numerics in (0, 3))
    name = "slider_acceleration"
    change = np.sqrt(np.mean((usual[name] - other[name]) ** 2)) / np.std(usual[name])
    assert 0.0 < change < 0.02


def test_a_start_that_is_stated_is_where_the_motion_begins():
    """Those that are the same are simulated alike, and a start just before the record shows how the motion settles."""
    name, read = "slider_acceleration", {}
    for key, start in {
        "dead centre": "dead_centre",
        "at its own angle": {"angle": "0 deg"},
        "two turns": {"turned": "2 turn"},
        "as long": {"ran": 2 * 2 * np.pi / 20.0},
        "near two turns": {"angle": "0 deg", "turned": "1.9 turn"},
    }.items():
        own = campaign(mechanism(("piston_pin",)), run={"start": start})
        plan = build_model(own, recorded(own)).plans["slow"]
        exact = replace(plan, samples=replace(plan.samples, first_angle=0.0, speed=20.0))
        read[key] = channels_read(own, exact, {})[name]
    assert read["at its own angle"] == pytest.approx(read["dead centre"], rel=1e-9)
    assert read["two turns"] == pytest.approx(read["as long"], rel=1e-9)
    assert read["two turns"] == pytest.approx(read["near two turns"], rel=1e-9)
    early = np.abs(read["two turns"] - read["dead centre"])[:20]
    assert early.max() > 0.05 * np.std(read["two turns"])


LOOSE = {
    "change_m": 1.448e-4,
    "contact_restitution": 0.4792,
    "contact_friction": 0.2016,
    "log_stiffness_factor": 0.0,
    "log_friction_speed_factor": 0.0,
    "log_damping_factor": 0.0,
}
"""A crank pin that lasts in one of two steady motions, by where it began."""


def loose_crank_pin(own):
    model = build_model(own, recorded(own))
    (candidate,) = (one for one in model.candidates if one.name == "crank_pin_clearance")
    return model, candidate


def test_a_loose_joint_lasts_in_more_than_one_motion_and_the_start_decides_in_which():
    own = campaign(mechanism())
    model, candidate = loose_crank_pin(own)
    usual, other = (
        channels_read(own, model.plans["slow"], {}, [(candidate, LOOSE)], numerics)["crank_torque"]
        for numerics in (0, len(NUMERICS))
    )
    assert np.sqrt(np.mean((other - usual) ** 2)) / np.std(usual) > 0.1
