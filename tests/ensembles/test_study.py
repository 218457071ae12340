"""The map of clearance, speed and friction, against what is known of the motion."""

import json
import math
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from jointgap import tables
from jointgap.cli import cli
from jointgap.config import Scenario, Study
from jointgap.ensembles.orders import high_order_rms, orders
from jointgap.ensembles.study_catalogue import FIGURES
from jointgap.ensembles.study_figures import draw_study, ideal_orders
from jointgap.ensembles.study_page import page
from jointgap.ensembles.study_points import join_points, samples_per_revolution, simulate_points
from jointgap.errors import InputError
from jointgap.report.page import to_markdown
from jointgap.tables.study_tables import MEASURES, ORDERS
from tests.dynamics.cases import CRANK, MOTOR, ROD, SPEED, effect, mechanism, options

SMALL = {"transient_revolutions": 3, "settled_revolutions": 1, "members": 2, "tolerance": 1e-5}


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    values = {"clearance": ["0.1 mm", "0.4 mm"], "speed": ["400 rpm", "800 rpm"], "friction": [0, 0.1]}
    return Scenario(mechanism=mechanism(), study=Study(**values, **SMALL))


@pytest.fixture(scope="module")
def found(scenario):
    return simulate_points(scenario)


def test_orders_are_the_amplitudes_at_multiples_of_the_crank_speed():
    turned = np.arange(3 * 400) * (2 * math.pi / 400)
    signal = 7.0 + 5.0 * np.cos(turned) + 2.0 * np.sin(4 * turned) + 0.5 * np.cos(13 * turned + 1.0)
    expected = np.zeros(ORDERS + 1)
    expected[[0, 1, 4, 13]] = 7.0, 5.0, 2.0, 0.5
    np.testing.assert_allclose(orders(signal, 3), expected, atol=1e-13)


def test_noise_is_the_rms_of_what_lies_above_the_tenth_order_on_an_order_or_between():
    turned = np.arange(3 * 400) * (2 * math.pi / 400)
    quiet = 7.0 + 5.0 * np.cos(turned) + 2.0 * np.sin(10 * turned)
    assert high_order_rms(quiet, 3) < 1e-13
    loud = quiet + 3.0 * np.cos(31 / 3 * turned) + 4.0 * np.sin(50 * turned)
    assert high_order_rms(loud, 3) == pytest.approx(math.sqrt((3.0**2 + 4.0**2) / 2))


def test_orders_of_the_ideal_mechanism_are_those_of_its_series():
    amplitudes = ideal_orders(Scenario(mechanism=mechanism()), SPEED)
    ratio = CRANK / ROD  # x = r (cos + (L/r) sqrt(1 - (r/L)^2 sin^2)), expanded to the sixth power of r/L
    second = ratio + ratio**3 / 4 + 15 * ratio**5 / 128
    fourth = ratio**3 / 4 + 3 * ratio**5 / 16
    assert amplitudes[0] == pytest.approx(CRANK * SPEED**2, rel=1e-12)
    assert amplitudes[1] == pytest.approx(CRANK * SPEED**2 * second, rel=1e-4)
    assert amplitudes[3] == pytest.approx(CRANK * SPEED**2 * fourth, rel=1e-2)
    assert amplitudes[[2, 4, 6]].max() < 1e-9


def test_the_first_orders_are_the_ideal_ones_where_the_clearance_is_small(scenario, found):
    small = found[(found["clearance"] == 1e-4) & (found["friction"] == 0.1)]
    for _, row in small.iterrows():
        ideal = ideal_orders(scenario, row["speed"])
        assert [row["order_1"], row["order_2"]] == pytest.approx(ideal[:2], rel=0.02)


def test_what_scales_with_the_square_of_the_speed_does_so(found):
    settled = found[(found["friction"] == 0.1) & (found["clearance"] == 1e-4)].sort_values("speed")
    slow, fast = settled["peak_force"]
    assert fast / slow == pytest.approx(4.0, rel=0.1)
    slow, fast = settled["acceleration_rms"]
    assert fast / slow == pytest.approx(4.0, rel=0.02)


def test_the_error_of_the_transmission_angle_grows_with_the_clearance_and_not_with_the_speed(found):
    error = (
        found[found["friction"] == 0.1].pivot(index="speed", columns="clearance", values="angle_error_rms").to_numpy()
    )
    assert error[:, 1] / error[:, 0] == pytest.approx(4.0, rel=0.3)
    assert error[1] / error[0] == pytest.approx(1.0, rel=0.1)
    # Both clearance vectors together cannot turn the rod by more than twice the clearance over its length.
    assert np.all(error < 2 * np.array([1e-4, 4e-4]) / ROD)


def test_without_friction_the_journals_fly_and_only_statistics_hold(found):
    loud, rubbing = (found[(found["friction"] == mu) & (found["clearance"] == 4e-4)] for mu in (0, 0.1))
    assert rubbing["contact_share"].min() > 0.999 > loud["contact_share"].max()
    assert loud["sensitive"].all() and not rubbing["sensitive"].any()
    assert loud["growth"].min() > 10 > rubbing["growth"].max()
    assert (loud["noise_share"].to_numpy() > rubbing["noise_share"].to_numpy()).all()


def test_every_spread_holds_its_median_and_closes_where_motions_repeat(found):
    for name in MEASURES:
        assert (found[f"{name}_low"] <= found[name]).all() and (found[name] <= found[f"{name}_high"]).all()
    settled = found[~found["sensitive"]]
    assert ((settled["peak_force_high"] - settled["peak_force_low"]) / settled["peak_force"]).max() < 0.01


def test_samples_resolve_the_ringing_of_the_contact():
    slow, fast = (samples_per_revolution(mechanism(), speed) for speed in (SPEED / 2, SPEED))
    assert slow / fast == pytest.approx(2 / 2 ** (1 / 3), rel=0.01)  # frequency grows with the cube root of the speed
    assert fast > 5 * 350  # periods in a revolution at 600 rpm


def test_the_map_is_the_same_from_parts_and_a_missing_part_is_told(scenario, found):
    parts = [simulate_points(scenario, first, count, workers=1) for first, count in ((3, 5), (0, 3))]
    whole = join_points(parts, scenario.study)
    np.testing.assert_array_equal(whole["peak_force"], join_points([found], scenario.study)["peak_force"])
    with pytest.raises(InputError, match="3 of the 8 wanted ones are missing"):
        join_points(parts[:1], scenario.study)
    with pytest.raises(InputError, match="points 6 to 8 are asked for, but there are 8, from 0 on"):
        simulate_points(scenario, 6, 3)


def test_a_point_whose_starts_all_fail_is_empty_and_says_why(scenario, monkeypatch):
    monkeypatch.setattr(sys.modules["jointgap.dynamics.simulation"], "STEPS_PER_REVOLUTION", 10)
    one = scenario.study.model_copy(update={"clearance": (1e-4,), "speed": (SPEED,), "friction": (0.1,)})
    failed = simulate_points(scenario.model_copy(update={"study": one}))
    assert failed["peak_force"].isna().all() and list(failed["failed"]) == [2]
    assert "needs more than" in failed["reason"][0]


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"mechanism": mechanism(loose=())}, "no loose joint"),
        ({"simulate": options(drive=MOTOR)}, "drive.kind is motor"),
        ({"mechanism": mechanism(effect("speed_fluctuation", ratio=0.02, order=2))}, "no effect speed_fluctuation"),
        ({"study": Study(clearance=["500 mm"], **SMALL)}, "the crank cannot turn"),
    ],
)
def test_a_study_that_makes_no_sense_is_refused(changed, says):
    with pytest.raises(InputError, match=says):
        simulate_points(Scenario(**({"mechanism": mechanism()} | changed)))


def test_a_value_listed_twice_is_refused():
    with pytest.raises(ValueError, match="lists a value twice"):
        Study(clearance=["1 mm", 0.001])


def test_the_figures_show_every_point(scenario, found):
    drawings = draw_study(found, scenario)
    assert set(drawings) == set(FIGURES)
    forces = drawings["study_peak_force"].data
    shown = forces[forces["series"] == "peak force in the joints"]
    assert sorted(shown["value"]) == pytest.approx(sorted(found["peak_force"]))
    assert len(forces[forces["series"] == "only statistics"]) == found["sensitive"].sum()
    lines = drawings["study_orders"].data
    assert set(lines["series"]) == {"clearance 0.1 mm", "clearance 0.4 mm", "no clearance"}


def test_orders_are_shown_at_a_speed_that_has_some_and_none_where_all_failed(scenario, found):
    numbers = [f"order_{k}" for k in range(1, ORDERS + 1)]
    numbers += [name + end for name in MEASURES for end in ("", "_low", "_high")]
    middle = found["speed"].max()  # the middle one of two
    failed = found.copy()
    failed.loc[found["speed"] == middle, numbers] = math.nan
    lines = draw_study(failed, scenario)["study_orders"].data
    kept = found[found["speed"] != middle]
    firsts = lines[(lines["x"] == 1) & (lines["series"] != "no clearance")]["y"]
    assert sorted(firsts) == pytest.approx(sorted(kept["order_1"]))
    failed[numbers] = math.nan
    assert set(draw_study(failed, scenario)["study_orders"].data["series"]) == {"no clearance"}


def test_the_summary_names_ranges_and_where_only_statistics_hold(scenario, found):
    text = to_markdown(page(found, scenario))
    assert "clearance 0.1 mm to 0.4 mm" in text and "speed 400 rpm to 800 rpm" in text
    assert f"At {found['sensitive'].sum()} of 8 points" in text
    settled = to_markdown(page(found[~found["sensitive"]], scenario))
    assert "At no point" in settled and "nan" not in settled


def test_where_too_many_starts_fail_nothing_is_said_of_a_small_change(scenario, found):
    lonely = found.assign(growth=math.nan, sensitive=False)
    text = to_markdown(page(lonely, scenario))
    assert "Too many starts failed" in text and "At no point" not in text and "Spread" not in text
    partly = found.assign(growth=found["growth"].mask(found.index == found.index[found["sensitive"]][0]))
    assert f"At {found['sensitive'].sum() - 1} of 7 points" in to_markdown(page(partly, scenario))


def test_the_command_writes_the_map_its_figures_and_its_words(tmp_path):
    study = {"clearance": [2e-4], "speed": [60.0, 80.0], "friction": [0.1], **SMALL}
    text = json.dumps({"mechanism": mechanism().model_dump(), "study": study})
    common = ["--options", text, "--workers", "1"]
    parts = [str(tmp_path / f"{number}.parquet") for number in range(2)]
    for number, part in enumerate(parts):
        arguments = ["study-points", *common, "--first", str(number), "--number", "1", "--points", part]
        assert CliRunner().invoke(cli, arguments, catch_exceptions=False).exit_code == 0
    given = [word for part in parts for word in ("--points", part)]
    done = CliRunner().invoke(
        cli, ["study", *common, *given, "--folder", str(tmp_path / "map")], catch_exceptions=False
    )
    assert done.exit_code == 0 and "# Clearance, speed and friction" in done.output
    assert len(tables.read(tables.STUDY, tmp_path / "map/points.parquet")) == 2
    written = {path.name for path in (tmp_path / "map").iterdir()}
    assert {f"{name}.{ending}" for name in FIGURES for ending in ("svg", "png", "parquet")} <= written
    assert "summary.md" in written
