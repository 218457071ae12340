"""Effects on which motion depends roughly are compared before anything is measured, in the features that name them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.identification.look_alikes import look_alikes
from tests.identification.toy import RINGING, SPEEDS, Toy, ringing, stated_noise, toy

ECHO, LATE = (replace(RINGING, name=name) for name in ("echo", "late"))


class Rattling(Toy):
    """`echo` rings as `ringing` does, and in the acceleration besides; `late` rings half a turn later."""

    def simulate(self, run, values, effects=(), numerics=0):
        here = next(series for series in self.series if series.run == run)
        angle, force, read = here.angle, np.zeros(here.angle.size), dict(super().simulate(run, values))
        for candidate, at in effects:
            force += ringing(at["size"], angle - (np.pi if candidate.name == "late" else 0.0))
            if candidate.name == "echo" and "acceleration" in read:
                read["acceleration"] = read["acceleration"] + 5.0 * force
        for channel, share in (("torque", 0.1), ("guide_force", 0.2)):
            if channel in read:
                read[channel] = read[channel] + share * force
        return read


def rattling(candidates=(RINGING, ECHO, LATE)) -> Rattling:
    plain = toy(planned=True, speeds={"slow": SPEEDS["slow"]}, held_out=(), samples=360, cycles=2.0)
    return Rattling(plain.series, plain.nuisances, candidates, plain.speeds)


def compared(channels=("torque",), candidates=(RINGING, ECHO, LATE)) -> pd.DataFrame:
    model = rattling(candidates)
    return look_alikes(model, [("slow", channel) for channel in channels], stated_noise(model))


@pytest.fixture(scope="module")
def by_torque() -> pd.DataFrame:
    return compared()


def test_effects_that_ring_alike_in_what_is_planned_are_told_and_one_that_rings_elsewhere_is_not(by_torque):
    pairs = by_torque.groupby(["true", "other"])["alike"]
    assert set(pairs.groups) == {
        (a, b) for a in ("ringing", "echo", "late") for b in ("ringing", "echo", "late") if a != b
    }
    assert pairs.all()["ringing", "echo"] and pairs.all()["echo", "ringing"]
    assert not by_torque[(by_torque["true"] == "late") | (by_torque["other"] == "late")]["alike"].any()


def test_the_further_channel_that_parts_them_is_named_and_does_so_once_it_is_planned(by_torque):
    alike = by_torque[by_torque["alike"]]
    assert set(map(tuple, alike["parted_by"])) == {("acceleration",)}
    assert not compared(("torque", "acceleration"))["alike"].any()


def test_the_same_comparison_finds_the_same(by_torque):
    pd.testing.assert_frame_equal(by_torque, compared())


def test_one_such_effect_alone_is_compared_with_nothing():
    assert compared(candidates=(RINGING,)).empty


def test_channels_that_could_be_had_do_not_change_what_is_taken_as_true(by_torque):
    def taken_as_true(found):
        return {*zip(found["true"], found["size"], strict=True)}

    model = rattling()
    model = replace(model, series=tuple(one for one in model.series if one.channel == "torque"))
    alone = look_alikes(model, [("slow", "torque")], stated_noise(model))
    assert taken_as_true(alone) == taken_as_true(by_torque)


def test_an_effect_that_nothing_planned_shows_is_not_taken_as_true():
    found = compared(("acceleration",))
    assert set(found["true"]) == {"echo"}
    assert not found["alike"].any()


def test_statistics_over_cycles_are_not_compared():
    model = rattling()
    statistics = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    assert look_alikes(statistics, [("slow", "torque")], stated_noise(statistics)).empty
