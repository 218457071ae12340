"""Every tuned number can be varied: the settings given to a model are those that it works with."""

import dataclasses
import math

import numpy as np
import pytest

from jointgap.rig.channels import tolerance_for
from jointgap.rig.checks import angle_outliers, clipped, outliers
from jointgap.rig.model import build_model
from jointgap.rig.sampling import planned_grid, sample_grid
from jointgap.rig.settings import DEFAULT_SETTINGS, RecordingLimits, SliderCrankSettings
from tests.slider_crank.rigs import campaign, mechanism


def varied(group: str, **numbers) -> SliderCrankSettings:
    changed = dataclasses.replace(getattr(DEFAULT_SETTINGS, group), **numbers)
    return dataclasses.replace(DEFAULT_SETTINGS, **{group: changed})


def test_settings_are_frozen():
    assert SliderCrankSettings() == DEFAULT_SETTINGS
    for group in dataclasses.fields(DEFAULT_SETTINGS):
        settings = getattr(DEFAULT_SETTINGS, group.name)
        for number in dataclasses.fields(settings):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(settings, number.name, 0)


def test_a_model_carries_its_settings_into_its_plans_and_nuisances():
    settings = varied("sample_grid", planned_revolutions=2, planned_samples_per_revolution=50)
    settings = dataclasses.replace(
        settings,
        nuisances=dataclasses.replace(
            settings.nuisances, step_share_of_bounds=0.1, friction_speed_factor=2.0, lasting_damping_factor=3.0
        ),
    )
    own = campaign(mechanism(("piston_pin",)), nuisance={"slider_mass": [0.4, 0.5]}, speeds=(30.0, 31.0))
    model = build_model(own, settings=settings)
    assert model.settings is settings
    assert all(plan.settings is settings for plan in model.plans.values())
    assert model.plans["slow"].samples.time.size == 100
    by_name = {p.name: p for p in model.nuisances}
    assert by_name["slider_mass"].step == pytest.approx(0.01, rel=1e-12)
    assert by_name["friction_speed"].high == pytest.approx(2.0 * by_name["friction_speed"].nominal, rel=1e-12)
    assert by_name["friction_speed"].low == pytest.approx(0.5 * by_name["friction_speed"].nominal, rel=1e-12)
    damping = by_name["lasting_damping_piston_pin"]
    assert (damping.low, damping.nominal, damping.high) == pytest.approx((-math.log(3.0), 0.0, math.log(3.0)))
    assert "lasting_damping_crank_pin" not in by_name


def test_a_film_and_a_small_clearance_ask_for_a_smaller_tolerance():
    film = {"name": "lubricated_joint", "site": "piston_pin", "parameters": {"viscosity_Pa_s": 0.1, "length_m": 0.01}}
    dry, wet = (campaign(mechanism(("piston_pin",), effects=effects)).mechanism.applied() for effects in ((), (film,)))
    assert (tolerance_for(dry), tolerance_for(wet)) == (1e-10, 1e-11)
    assert tolerance_for(dry, varied("simulation", tolerance_m=1e-6).simulation) == pytest.approx(1e-4 * 5e-4)


def test_planned_samples_are_even_in_time_and_begin_at_the_first_angle():
    grid = planned_grid(speed=20.0, first_angle=0.3, encoded=True, revolutions=3)
    assert grid.time.size == 3 * 120
    assert grid.time[1] == pytest.approx(2 * math.pi / 20.0 / 120, rel=1e-14)
    assert grid.angle == pytest.approx(0.3 + 20.0 * grid.time, rel=1e-14)
    assert np.array_equal(grid.read, grid.angle) and grid.encoded
    assert (grid.first_angle, grid.speed, grid.first_reach, grid.speed_reach) == (0.3, 20.0, 0.0, 0.0)
    unread = planned_grid(speed=20.0, first_angle=0.3, encoded=False)
    assert np.isnan(unread.read).all() and unread.time.size == 4 * 120 and not unread.encoded


def test_the_reach_of_speed_and_first_angle_is_ten_standard_errors_of_the_line_and_half_a_step():
    rng, n, sd, step = np.random.default_rng(0), 4000, 2e-3, 1e-3
    time = np.linspace(5.0, 7.0, n)
    read = 1.0 + 30.0 * (time - time[0]) + sd * rng.standard_normal(n)
    read[100] += 1.0  # an outlier counts neither for the line nor for its scatter
    grid = sample_grid(time, read, speed=29.0, first_angle=None, resolution=step)
    assert grid.speed == pytest.approx(30.0, abs=5 * math.sqrt(12 / n) * sd / 2.0)
    assert grid.first_angle == pytest.approx(1.0, abs=5 * 2 * sd / math.sqrt(n))
    assert grid.first_reach == pytest.approx(2 * 10 * sd / math.sqrt(n) + step / 2, rel=0.05)
    assert grid.speed_reach == pytest.approx((math.sqrt(12) * 10 * sd / math.sqrt(n) + step / 2) / 2.0, rel=0.05)
    wider = sample_grid(time, read, 29.0, None, settings=varied("sample_grid", reach_standard_errors=10.0).sample_grid)
    narrow = sample_grid(time, read, 29.0, None)
    assert wider.speed_reach == pytest.approx(2.0 * narrow.speed_reach, rel=1e-12)


def test_samples_go_on_evenly_beyond_the_record_and_in_between():
    grid = planned_grid(speed=10.0, first_angle=0.5, encoded=True, revolutions=1)
    longer = grid.extended(4 * math.pi)
    assert longer.time[: grid.time.size] == pytest.approx(grid.time, abs=0.0)
    assert np.diff(longer.time) == pytest.approx(np.full(longer.time.size - 1, grid.time[1]), rel=1e-9)
    assert longer.angle[-1] - longer.angle[0] >= 4 * math.pi - 1e-9
    finer = grid.refined(3)
    assert finer.angle[::3] == pytest.approx(grid.angle, rel=1e-14)
    assert np.diff(finer.angle) == pytest.approx(np.full(finer.angle.size - 1, grid.angle[1] - 0.5) / 3, rel=1e-9)
    half = grid.first(math.pi)
    assert half.angle[-1] < 0.5 + math.pi <= half.angle[-1] + 10.0 * grid.time[1] + 1e-9


def test_limits_of_plausibility_are_those_given():
    wave = np.minimum(np.sin(np.linspace(0.0, 40.0, 1000)), 0.9)
    assert clipped(wave) and clipped(wave, RecordingLimits(clipped_count=1000)) is None
    values = np.append(np.linspace(-1.0, 1.0, 101), [299.0, 310.0])  # quartiles about -0.5 and 0.5
    assert outliers(values).tolist() == [102]
    assert outliers(values, RecordingLimits(outlier_interquartile_ranges=200.0)).tolist() == [101, 102]
    time = np.arange(50.0)
    angle = 0.1 * time
    angle[20] += 0.09
    assert angle_outliers(time, angle).size == 0
    angle[20] += 0.02
    assert angle_outliers(time, angle).tolist() == [20]
    assert angle_outliers(time, angle, RecordingLimits(angle_outlier_rad=0.2)).size == 0
