"""Sweeps of linkages other than the slider-crank: measures by rule, paths of keys, failures."""

import math

import numpy as np
import pandas as pd
import pytest

import jointgap as jg
from jointgap.config import Scenario
from jointgap.config.designs import measured
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core.errors import InputError
from jointgap.core.schema import MEASURES, Column
from jointgap.designs.dataset import simulate_designs
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import sensitivity, write_sweep
from tests.command import jointgap
from tests.motion.cases import mechanism

COARSE = {"speed": "120 rpm", "revolutions": 2, "samples_per_revolution": 360}
COARSE = jg.Simulate(**COARSE, tolerance="1e-9 m")
LAST = slice(-361, None)
FOUR_BAR, QUICK_RETURN = map(jg.load_mechanism, ("four_bar", "quick_return"))
WALL = {"law": "exact_restitution", "restitution": 0.5, "friction": 0.1, "stiffness": 1e9}
BLOCK = {"length": "100 mm", "width": "50 mm", "clearance": "0.1 mm"}


def scenario(linkage, parameters: dict, options=COARSE, sections=None, **keys) -> Scenario:
    swept = {"parameters": parameters, **keys}
    return Scenario(mechanism=linkage, simulate=options, sweep=swept, **(sections or {}))


def swept(linkage, parameters: dict, **keys) -> pd.DataFrame:
    designs = designs_of(scenario(linkage, parameters, **{"number": 1} | keys))
    return simulate_designs(designs, 0, designs.number, 1)


def test_a_design_has_the_measures_of_its_simulation():
    clearance = {"joints.B.clearance": [5e-5, 1e-4]}
    row = swept(FOUR_BAR, clearance, design="grid").iloc[1]
    file = jg.change(FOUR_BAR, {"joints.B.clearance": 1e-4})
    alone = jg.simulate(file, COARSE)
    ideal = jg.change(file, {f"joints.{joint}.loose": False for joint in "ABC"})
    last, still = (each.samples[LAST] for each in (alone, jg.simulate(ideal, COARSE)))

    def transmission(samples: pd.DataFrame) -> np.ndarray:
        return (samples["rocker_angle"] - samples["coupler_angle"]).to_numpy()

    error = (transmission(last) - transmission(still))[:-1]
    departure = (last["rocker_angle"] - still["rocker_angle"]).to_numpy()[:-1]
    turning = last["rocker_angular_acceleration"][:-1]
    expected = {
        "angle_error_rms": np.sqrt(np.mean(error**2)),
        "least_transmission_angle": np.arcsin(np.sin(transmission(last))[:-1].min()),
        "departure_rms": np.sqrt(np.mean(departure**2)),
        "departure_peak": np.abs(departure).max(),
        "acceleration_rms": np.sqrt(np.mean(turning**2)),
        "peak_torque": last["crank_torque"].abs().max(),
        "B_rms_force": np.sqrt(np.mean(last["B_normal_force"][:-1] ** 2)),
        "O_peak_force": np.hypot(last["O_force_x"], last["O_force_y"]).max(),
    }
    assert dict(row[list(expected)]) == pytest.approx(expected, rel=1e-6)
    assert row["swing"] == pytest.approx(np.ptp(last["rocker_angle"]), rel=1e-4)
    in_contact = np.mean(last["B_mode"].isin(["impact", "contact"]))
    assert row["B_contact_share"] == pytest.approx(in_contact, abs=5 / 360)
    events = alone.events[alone.events["time"] >= last["time"].iloc[0]]
    assert row["B_impacts"] == len(events.query("joint == 'B' and event == 'impact'"))
    assert row["B_peak_force"] >= last["B_normal_force"].max()
    assert math.isnan(row["O_impacts"])  # ideal


def test_a_slider_crank_written_as_a_linkage_has_the_same_measures():
    own = mechanism(loose=("crank_pin",), friction=0.1, offset=0.03)
    pin = own.joint("crank_pin").model_dump() | {"journal": "wheel"}
    linkage = jg.LinkageFile(
        frame={"points": {"O": [0.0, 0.0]}},
        bodies={
            "wheel": own.crank.model_dump(exclude={"mass_centre_across"}) | {"ends": ["O", "A"]},
            "link": own.rod.model_dump(exclude={"mass_centre_across"}) | {"ends": ["A", "B"]},
            "ram": {"mass": own.slider.mass, "points": {"B": [0.0, 0.0]}},
        },
        joints={"A": pin, "guide": {"slide": ["frame", "ram"], "at": [0.0, 0.03]}},
        drive="O",
    )
    once = jg.change(COARSE, {"revolutions": 1, "speed": "600 rpm"})
    speed = {"speed": {"from": "500 rpm", "to": "600 rpm"}}
    own_row, row = (swept(each, speed, options=once, number=1).iloc[0] for each in (own, linkage))
    names = {"crank_pin": "A", "piston_pin": "B", "crank_pivot": "O"}
    for name in MEASURES.names:
        joint = next((each for each in names if name.startswith(each)), None)
        other = name.replace(joint, names[joint]) if joint else name
        assert row[other] == pytest.approx(own_row[name], rel=1e-4, abs=1e-9, nan_ok=True), name


def columns_of(linkage) -> dict[str, Column]:
    columns = measured(linkage.sites, scenario(linkage, {"speed": [12.0]}).sweep)
    return {column.name: column for column in columns}


def test_labels_and_units_are_those_of_the_output_body():
    columns = columns_of(FOUR_BAR)
    assert columns["swing"].unit == "rad" and "stroke" not in columns
    assert columns["acceleration_rms"].description == "RMS of the rocker's angular acceleration"
    assert columns["B_peak_force"].description == "largest normal force in joint B"
    columns = columns_of(QUICK_RETURN)
    assert columns["stroke"].description == "stroke of the ram"
    assert columns["departure_rms"].unit == "m"
    assert columns["guide_rms_force"].description == "RMS of the normal force in slide guide"


def test_a_body_that_turns_fully_has_no_swing():
    drag_link = {"bodies.crank.length": "300 mm", "frame.points.C.x": "100 mm"}
    drag_link |= {"bodies.rocker.length": "350 mm", "bodies.coupler.length": "300 mm"}
    row = swept(jg.change(FOUR_BAR, drag_link), {"clearance": [1e-4]}).iloc[0]
    assert math.isnan(row["swing"]) and math.isnan(row["outer_dead_centre_angle"])
    assert row["departure_rms"] > 0.0


def loose_slide(stiffness: float):
    guide = {"slide": ["frame", "ram"], "at": ["0 mm", "250 mm"], "contact": "wall", **BLOCK}
    wall = {"wall": WALL | {"stiffness": stiffness}}
    body = {"bodies.ram.inertia": "5e-3 kg*m^2"}
    return jg.change(QUICK_RETURN, body | {"contacts": wall, "joints.guide": guide})


def test_a_loose_slide_is_measured_at_its_corners():
    row = swept(loose_slide(1e9), {"joints.guide.clearance": [5e-5]}).iloc[0]
    file = jg.change(loose_slide(1e9), {"joints.guide.clearance": 5e-5})
    alone = jg.simulate(file, COARSE)
    last = alone.samples[LAST]
    begun = alone.events.query("event == 'impact'")
    begun = begun[begun["joint"].str.startswith("guide") & (begun["time"] >= last["time"].iloc[0])]
    assert row["guide_impacts"] == len(begun) > 0
    touching = (last["guide_contacts"][:-1] > 0).mean()
    assert row["guide_contact_share"] == pytest.approx(touching, abs=1e-6)
    assert row["guide_peak_force"] >= last["guide_force"].abs().max() * (1.0 - 1e-9)


def test_a_slide_that_breaks_through_its_wall_is_a_failed_design():
    row = swept(loose_slide(1e4), {"speed": [12.0]}).iloc[0]
    assert "is 0.0" in row["reason"] and "larger stiffness" in row["reason"] and row["steps"] == 0


def test_a_design_that_cannot_be_assembled_is_a_row_with_its_reason():
    frame = swept(FOUR_BAR, {"bodies.crank.length": {"from": 0.05, "to": 0.25}}, number=8)
    failed = frame["bodies.crank.length"] > 0.15  # Grashof
    assert 0 < failed.sum() < 8
    assert frame.loc[failed, "reason"].str.contains("coupler and rocker do not meet").all()
    assert frame.loc[~failed, "reason"].isna().all()


def test_parameters_are_the_paths_of_change():
    values = {
        "bodies.rocker.length": 0.255,
        "frame.points.C.x": 0.295,
        "contacts.steel.friction": 0.02,
        "joints.B.bearing_radius": 10.02e-3,
    }
    row = swept(FOUR_BAR, {key: [value] for key, value in values.items()}).iloc[0]
    changed = jg.change(FOUR_BAR, values)
    assert changed.bodies["rocker"].mass_centre == pytest.approx(0.125 * 0.255 / 0.25)
    assert changed.joint("A").contact.friction == 0.02
    assert changed.frame.points["C"] == (0.295, 0.0)
    assert row["steps"] == jg.simulate(changed, COARSE).steps


RANGE = {"from": 0.1, "to": 0.2}


@pytest.mark.parametrize(
    "parameters, keys, message",
    [
        ({"bodies.roker.length": RANGE}, {}, "bodies has no 'roker'; did you mean 'rocker'"),
        ({"bodys.rocker.length": RANGE}, {}, "mechanism has no 'bodys'; did you mean 'bodies'"),
        ({"frame.points.C.z": RANGE}, {}, "points.C has no 'z'; known here: x, y"),
        ({"rod_length": RANGE}, {}, "no such word"),
        ({"bodies.crank.length": [0.25]}, {}, "length = 0.25: at crank angle 0 deg coupler and"),
        ({"speed": ["-120 rpm"]}, {}, "clockwise; mirror the linkage"),
        (
            {"friction": RANGE, "contacts.steel.friction": RANGE},
            {},
            "friction and contacts.steel.friction set the same value",
        ),
        ({"speed": [12.0]}, {"best_lengths": True}, "sweep.best_lengths is for slider-cranks"),
        (
            {"speed": [12.0]},
            {"sections": {"sensitivity": {"measures": ["B_peek_force"]}}},
            "B_peek_force is no measure here; did you mean 'B_peak_force'",
        ),
        (
            {"speed": [12.0]},
            {"sections": {"optimise_robust": {"uncertain": {"friction": RANGE}}}},
            "requires optimise_linkage.lengths",
        ),
    ],
)
def test_a_wrong_key_is_an_error_before_any_simulation(parameters, keys, message):
    with pytest.raises(InputError) as error:
        designs_of(scenario(FOUR_BAR, parameters, **keys))
    assert message in str(error.value)


def test_each_start_is_a_row_with_its_trajectory(tmp_path):
    made = scenario(FOUR_BAR, {"speed": [12.0]}, number=1, starts=3, trajectories=[0])
    write_sweep(made, tmp_path, 1)
    assert pd.read_parquet(tmp_path / "designs")["B_peak_force"].nunique() == 3
    first, second = (
        pd.read_parquet(tmp_path / f"trajectories/design_0_start_{start}/trajectory.parquet")
        for start in (0, 1)
    )
    alone = jg.simulate(FOUR_BAR, COARSE, speed=12.0).samples
    pd.testing.assert_frame_equal(first, alone, check_dtype=False)
    assert 0.0 < second["r_B"][0] < 1e-6 and first["r_B"][0] == 0.0


def test_sensitivity_of_a_linkage_names_its_output_body(tmp_path):
    lengths = {"bodies.rocker.length": {"from": "240 mm", "to": "260 mm"}}
    parameters = lengths | {"clearance": {"from": "0.02 mm", "to": "0.1 mm"}}
    once = jg.change(COARSE, {"revolutions": 1, "samples_per_revolution": 180})
    wanted = {"sensitivity": {"measures": ["swing", "departure_rms"]}}
    made = scenario(FOUR_BAR, parameters, once, wanted, number=64)
    write_sweep(made, tmp_path / "sweep", 1)
    page = sensitivity(ScenarioResults(tmp_path, made))
    assert "| swing of the rocker |" in page
    table = pd.read_parquet(tmp_path / "sensitivity/indices.parquet")
    largest = table.loc[table.groupby("measure")["total"].idxmax()].set_index("measure")
    assert dict(largest["parameter"]) == {
        "swing": "bodies.rocker.length",
        "departure_rms": "clearance",
    }
    assert (tmp_path / "sensitivity/figures/main_effects_swing.png").is_file()


def test_commands_of_the_paper_refuse_a_linkage(tmp_path):
    options = tmp_path / "options.json"
    options.write_text(scenario(FOUR_BAR, {"speed": [12.0]}).model_dump_json(by_alias=True))
    refused = jointgap("simulate", "--options", options, "--results", tmp_path)
    assert refused.returncode == 2
    assert f"{options}: mechanism: is a general linkage" in refused.stderr
