"""Other numerics are as good as the usual ones: another smooth form of the same friction, and a
tighter tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.rig.simulate_run import NUMERICS, channels_read, numerics_for
from tests.rig.rigs import campaign, mechanism, rig


@pytest.mark.parametrize(
    "loose, start, count",
    [((), "settled", 2), (("piston_pin",), "settled", 3), (("piston_pin",), "dead_centre", 2)],
)
def test_another_start_is_a_variant_for_loose_joints_with_unknown_start(loose, start, count):
    rig_campaign = campaign(mechanism(loose), run={"start": start})
    assert numerics_for(rig_campaign) == NUMERICS[:count]


def test_solver_variants_change_a_settled_motion_by_less_than_noise():
    model, name = rig(mechanism(("piston_pin",))), "slider_acceleration"
    usual, *others = (
        channels_read(model.campaign, model.plans["slow"], {}, numerics=i)[name] for i in range(4)
    )
    changes = [np.sqrt(np.mean((second - usual) ** 2)) / np.std(usual) for second in others]
    assert min(changes) > 0.0 and max(changes) < 0.02


def test_the_motion_begins_at_the_stated_start():
    """Those that are the same are simulated alike, and a start just before the record shows how the
    motion settles."""

    def begun(**start):
        model = rig(mechanism(("piston_pin",)), run={"start": start or "dead_centre"})
        plan = model.plans["slow"]
        exact = replace(plan, samples=replace(plan.samples, first_angle=0.0, speed=20.0))
        return channels_read(model.campaign, exact, {})["slider_acceleration"]

    two_turns, dead_centre = begun(turned="2 turn"), begun()
    assert begun(angle="0 deg") == pytest.approx(dead_centre, rel=1e-9)
    assert two_turns == pytest.approx(begun(ran=2 * 2 * np.pi / 20.0), rel=1e-9)
    assert two_turns == pytest.approx(begun(angle="0 deg", turned="1.9 turn"), rel=1e-9)
    assert np.abs(two_turns - dead_centre)[:20].max() > 0.05 * np.std(two_turns)
