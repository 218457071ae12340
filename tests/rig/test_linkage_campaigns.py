"""Campaigns of any planar linkage are read, checked and simulated as those of a slider-crank."""

import json

import jsonschema
import numpy as np
import pytest
import yaml

import jointgap as jg
from jointgap.config.campaign import Campaign, nuisances_of
from jointgap.config.channels import CHANNELS, channel_kinds
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import campaign_json_schema, load_campaign
from jointgap.core.errors import InputError
from jointgap.core.sites import SLIDER_CRANK
from jointgap.motion.ideal import ideal_channels
from jointgap.motion.mechanism_warnings import odd_data
from jointgap.rig.guess import new_rig
from jointgap.rig.inspection import inspect
from jointgap.rig.model import _recorded, build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.simulate_run import channels_read, with_nuisances
from jointgap.rig.windows import run_in_windows
from tests.rig.rigs import worst

SPEEDS = {"slow": 200.0, "fast": 400.0}  # rpm
READ = (
    "time crank_angle coupler_angular_velocity rocker_angle rocker_acceleration_x"
    " rocker_acceleration_y crank_torque frame_force_y"
).split()
PER_TURN = 120


def linkage(name="four_bar", loose=(), **changes) -> LinkageFile:
    """A shipped linkage with these joints loose only."""
    file = jg.load_mechanism(name)
    joints = {
        name: joint.model_copy(update={"loose": name in loose})
        if name not in file.slides
        else joint
        for name, joint in file.joints.items()
    }
    return file.model_copy(update={"joints": joints, **changes})


def content(file: LinkageFile) -> dict:
    """What the file of a linkage contains."""
    return json.loads(file.model_dump_json(exclude_none=True))


def simulated(file: LinkageFile, rpm: float, turns=4, dropped=2, per_turn=PER_TURN, **options):
    """Samples of a linkage, with the forces on the frame, as a logger writes them."""
    asked = {"speed": f"{rpm} rpm", "revolutions": dropped + turns}
    table = jg.simulate(file, **asked, samples_per_revolution=per_turn, **options).samples
    for axis in "xy":
        table[f"frame_force_{axis}"] = -table[f"{file.drive}_force_{axis}"]
    table = table.iloc[dropped * per_turn :]
    return table.assign(time=table["time"] - table["time"].iloc[0])


def written(folder, file, tables=None, channels=READ, noise=0.01, sensors=None, run=None, **keys):
    """A campaign file with a noisy table of each run; `sensors` are keys of channels, `run` of all
    runs."""
    kinds, rng = channel_kinds(file.sites, file.loose), np.random.default_rng(7)
    listed = []
    for id, rpm in SPEEDS.items():
        table = (tables or {}).get(id)
        table = (simulated(file, rpm) if table is None else table)[list(channels)].copy()
        for name in channels:
            if name != "time":
                sd = 1e-3 if name == "crank_angle" else noise * table[name].std()
                table[name] += sd * rng.standard_normal(len(table))
        table.to_csv(folder / f"{id}.csv", index=False)
        role = "confirm" if id == "fast" else "identify"
        entry = {"id": id, "file": f"{id}.csv", "speed": f"{rpm} rpm", "role": role}
        listed.append(entry | (run or {}))
    (folder / "linkage.yaml").write_text(yaml.safe_dump(content(file)), encoding="utf-8")
    given = {
        name: {"column": name, "unit": kinds[name].unit} | (sensors or {}).get(name, {})
        for name in channels
    }
    own = {"name": "rig", "mechanism": "linkage.yaml", "runs": listed, "channels": given}
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(own | keys), encoding="utf-8")
    return path


def planned(path):
    """A campaign and the plan of its slow run, without the statistics of a whole model of chaotic
    runs, which take a minute."""
    own = load_campaign(path)
    return own, _recorded(own, own.runs[0], read_measurements(own).runs["slow"]).plan


def measured(path):
    return read_measurements(load_campaign(path))


def model_of(path):
    own = load_campaign(path)
    return build_model(own, read_measurements(own))


def found(measurements) -> set[tuple[str, str]]:
    return {(item.channel, item.kind) for item in measurements.contradictions}


def differences(model, run="slow", **values) -> dict[str, float]:
    """Root mean square of each channel's residual, over its standard deviation."""
    read = model.simulate(run, model.nominal(run) | values)
    series = [one for one in model.series if one.run == run]
    return {
        one.channel: float(np.std(one.value - read[one.channel]) / np.std(one.value))
        for one in series
    }


@pytest.mark.parametrize(
    "name, channels",
    [
        ("four_bar", READ),
        (
            "quick_return",
            (
                "time crank_angle ram_position ram_acceleration rocker_angle block_acceleration_x"
                " rod_angular_velocity guide_force crank_torque"
            ).split(),
        ),
        ("six_bar", "time crank_angle output_angle link_acceleration_y crank_torque".split()),
    ],
)
def test_a_campaign_of_a_linkage_is_read_without_contradictions_and_simulated_to_its_noise(
    tmp_path, name, channels
):
    file = linkage(name)
    path = written(tmp_path, file, channels=channels)
    measurements = measured(path)
    assert (measurements.remarks, measurements.contradictions) == ((), ())
    assert odd_data(file) == []
    table, figures = inspect(load_campaign(path), measurements)
    units = {kind: of.unit for kind, of in channel_kinds(file.sites).items()}
    assert [*figures] == [*SPEEDS] and {*table["channel"]} == {*channels} - {"time"}
    assert [units[name] for name in table["channel"]] == [*table["unit"]]
    for run in SPEEDS:
        away = differences(model_of(path), run)
        assert {*away} == {*channels} - {"time"}
        assert all(value < 0.013 for value in away.values()), away


def test_a_loose_joint_rings_as_measured_in_settled_motion(tmp_path):
    file = linkage(loose=("B",))
    table = {run: simulated(file, rpm) for run, rpm in SPEEDS.items()}
    model = model_of(written(tmp_path, file, table, noise=1e-3))
    angle = float(table["slow"]["crank_angle"].iloc[0])
    away = differences(model, first_angle=angle, speed=SPEEDS["slow"] * np.pi / 30)
    assert all(value < 1.3e-3 for value in away.values()), away


def test_a_body_on_a_loose_slide_is_measured_as_one_that_turns(tmp_path):
    play = {"length": 0.05, "width": 0.05, "clearance": 1e-3}
    loose = content(linkage("quick_return"))
    contact = loose["joints"]["D"]["contact"] | {"stiffness": 1e8}
    loose["joints"]["guide"] |= play | {"contact": contact}
    loose["bodies"]["ram"]["inertia"] = 2e-3
    file = LinkageFile.model_validate(loose)
    channels = "time crank_angle ram_angle ram_acceleration_x guide_force crank_torque".split()
    tables = {run: simulated(file, rpm, dropped=0) for run, rpm in SPEEDS.items()}
    path = written(tmp_path, file, tables, channels, 1e-3, run={"start": "dead_centre"})
    own, plan = planned(path)
    known = {"first_angle": 0.0, "speed": SPEEDS["slow"] * np.pi / 30}
    assert run_in_windows(own, plan, known, (), {}) is None
    read = channels_read(own, plan, known)
    exact = tables["slow"]["ram_acceleration_x"].to_numpy()
    early = slice(PER_TURN // 2)  # before impacts make it chaotic
    assert read["ram_acceleration_x"][early] == pytest.approx(exact[early], rel=1e-4, abs=1e-3)


def test_directions_of_four_loose_joints_are_tried_one_joint_after_the_other(tmp_path):
    file = linkage("six_bar")
    bearing = content(file)["joints"]["D"] | {"loose": True}
    carriers = {"A": "crank", "B": "coupler", "D": "coupler", "F": "link"}
    joints = {name: bearing | {"journal": body} for name, body in carriers.items()}
    file = LinkageFile.model_validate(content(file) | {"joints": joints})
    channels = "time crank_angle output_angular_velocity crank_torque".split()
    run = run_in_windows(*planned(written(tmp_path, file, channels=channels)), {}, (), {})
    guesses = run._guesses(run._edges(6, np.inf))
    assert run.size == 8 and guesses.shape == (16, 8)
    turned = guesses[:4] - guesses[0]
    assert turned[:, 0] == pytest.approx(np.arange(4) * np.pi / 2) and not turned[:, 1:].any()


def test_swapped_columns_a_wrong_sign_and_a_wrong_unit_are_reported(tmp_path):
    file = linkage()
    exchanged = {"crank_torque": "rocker_acceleration_x", "rocker_acceleration_x": "crank_torque"}
    sensors = {name: {"column": column} for name, column in exchanged.items()}
    swapped = measured(written(tmp_path, file, sensors=sensors))
    assert found(swapped) == {(name, "swapped") for name in exchanged}
    opposite = measured(written(tmp_path, file, sensors={"rocker_acceleration_y": {"sign": -1}}))
    assert found(opposite) == {("rocker_acceleration_y", "sign")}
    in_g = measured(written(tmp_path, file, sensors={"rocker_acceleration_x": {"unit": "g_n"}}))
    assert found(in_g) == {("rocker_acceleration_x", "scale")}
    assert "did you mean 'm/s^2'" in in_g.remarks[0]


def test_nuisances_shift_readings_as_a_changed_file_does(tmp_path):
    file = linkage(loose=("B",))
    ranges = {
        "coupler_mass": "20 %",
        "rocker_inertia": "20 %",
        "rocker_length": "5 %",
        "B_clearance": "50 %",
        "joint_friction_B": [0.0, 0.3],
        "restitution": [0.1, 0.9],
    }
    values = {
        "coupler_mass": 1.1,
        "rocker_inertia": 5.8e-3,
        "rocker_length": 0.252,
        "B_clearance": 7e-5,
        "joint_friction_B": 0.1,
        "restitution": 0.6,
    }
    changed = with_nuisances(file, values)
    by_hand = content(file)
    by_hand["bodies"]["coupler"]["mass"] = 1.1
    by_hand["bodies"]["rocker"] |= {"inertia": 5.8e-3, "length": 0.252, "mass_centre": 0.126}
    by_hand["joints"]["B"]["bearing_radius"] = 9.95e-3 + 7e-5
    by_hand["joints"]["B"]["contact"] |= {"friction": 0.1, "restitution": 0.6}
    loose = content(changed)["joints"]["B"]
    assert loose["bearing_radius"] == pytest.approx(by_hand["joints"]["B"]["bearing_radius"])
    by_hand["joints"]["B"]["bearing_radius"] = loose["bearing_radius"]
    assert content(changed)["bodies"] == by_hand["bodies"] and loose == by_hand["joints"]["B"]
    table = {run: simulated(file, rpm) for run, rpm in SPEEDS.items()}
    own = model_of(written(tmp_path, file, table, nuisance=ranges))
    assert {*ranges} <= {p.key for p in own.nuisances}
    other = model_of(written(tmp_path, LinkageFile.model_validate(by_hand), table))
    seen, expected = (
        model.simulate("slow", model.nominal("slow") | changes)
        for model, changes in ((own, values), (other, {}))
    )
    assert worst(seen, expected) < 1e-6


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"nuisance": {"roker_mass": "5 %"}}, "'nuisance.roker_mass'; did you mean 'rocker_mass'?"),
        (
            {"nuisance": {"crank_pin_clearance": "5 %"}},
            "unknown key 'nuisance.crank_pin_clearance'",
        ),
        ({"nuisance": {"pressure_zero": "1 bar"}}, "unknown key 'nuisance.pressure_zero'"),
        ({"nuisance": {"joint_friction": [0, 0.2], "joint_friction_B": [0, 0.2]}}, "(all pins)"),
    ],
)
def test_a_wrong_key_of_a_linkages_campaign_is_one_clear_error(tmp_path, keys, words):
    path = written(tmp_path, linkage(loose=("A", "B")), **keys)
    with pytest.raises(InputError) as error:
        load_campaign(path)
    assert words in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_channel_that_the_linkage_has_not_is_one_error_with_the_near_name(tmp_path):
    path = written(tmp_path, linkage())
    text = path.read_text(encoding="utf-8").replace("  rocker_angle:", "  rocker_angel:")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        InputError, match=r"channels.rocker_angel = 'rocker_angel': .*'rocker_angle'"
    ):
        load_campaign(path)
    path.write_text(text.replace("  rocker_angel:", "  slider_position:"), encoding="utf-8")
    with pytest.raises(InputError, match=r"channels.slider_position = 'slider_position'"):
        load_campaign(path)


def test_a_contact_that_is_too_soft_for_the_loads_of_a_linkage_is_one_error(tmp_path):
    file = linkage(loose=("B",))
    table = {run: simulated(file, rpm) for run, rpm in SPEEDS.items()}
    soft = content(file)
    soft["joints"]["B"]["contact"]["youngs_modulus"] = 1e4
    path = written(tmp_path, LinkageFile.model_validate(soft), table)
    with pytest.raises(InputError, match=r"mechanism.joints.B: contact.youngs_modulus .* too soft"):
        load_campaign(path)


def test_a_campaign_of_a_linkage_is_the_same_after_it_was_written_and_read(tmp_path):
    own = load_campaign(
        written(tmp_path, linkage("quick_return"), channels=("time", "crank_torque"))
    )
    assert Campaign.model_validate(json.loads(own.model_dump_json())) == own
    schema = campaign_json_schema()
    own_content = yaml.safe_load((tmp_path / "campaign.yaml").read_text(encoding="utf-8"))
    jsonschema.validate(own_content | {"mechanism": content(own.mechanism)}, schema)


def test_a_linkage_that_cannot_turn_is_one_error_with_its_campaign(tmp_path):
    path = written(tmp_path, linkage(), nuisance={"crank_length": [0.05, 0.2]})
    with pytest.raises(
        InputError, match=r"rig, nuisance, at the bound crank_length = 0.2 m: .*meet"
    ):
        model_of(path)
    short = content(linkage())
    short["bodies"]["coupler"]["length"] = 0.1
    (tmp_path / "linkage.yaml").write_text(yaml.safe_dump(short), encoding="utf-8")
    with pytest.raises(InputError, match=r"campaign rig, mechanism: at crank angle .* do not meet"):
        measured(path)


def test_a_clockwise_run_is_the_mirror_image(tmp_path):
    weight = {"effects": ({"name": "gravity"},)}
    file = LinkageFile.model_validate(content(linkage()) | weight)
    tables = {run: simulated(file, -rpm) for run, rpm in SPEEDS.items()}
    path = written(tmp_path, file, tables, run={"direction": "clockwise"})
    assert measured(path).remarks == ()
    away = differences(model_of(path))
    assert all(value < 0.013 for value in away.values()), away


def test_an_accelerometer_on_an_inclined_slide_reads_gravity_along_it(tmp_path):
    inclined = content(linkage("quick_return"))
    inclined["joints"]["guide"]["direction"] = 0.1
    file = LinkageFile.model_validate(inclined | {"effects": [{"name": "gravity"}]})
    tables = {run: simulated(file, rpm) for run, rpm in SPEEDS.items()}
    for table in tables.values():
        table["ram_acceleration"] += 9.80665 * np.sin(0.1)
        table["rod_acceleration_y"] += 9.80665
    channels = ["time", "crank_angle", "ram_acceleration", "rod_acceleration_y"]
    sensors = {name: {"reads_gravity": True} for name in channels[2:]}
    model = model_of(written(tmp_path, file, tables, channels, noise=1e-4, sensors=sensors))
    read = model.simulate("slow", model.nominal("slow"))
    for one in model.series:
        if one.run == "slow" and one.channel != "crank_angle":
            assert abs(np.mean(one.value - read[one.channel])) < 1e-3 * np.std(one.value)


def test_an_angle_is_read_whatever_turn_it_was_counted_in(tmp_path):
    file = linkage()
    tables = {run: simulated(file, rpm) for run, rpm in SPEEDS.items()}
    for table in tables.values():
        table["rocker_angle"] += 4 * np.pi
    away = differences(model_of(written(tmp_path, file, tables)))
    assert away["rocker_angle"] < 0.013


MOTOR = {"stall_torque": "1 N*m", "no_load_speed": "800 rpm", "inertia": "0.1 kg*m^2"}


def test_a_measured_angle_or_a_motor_drives_a_linkage(tmp_path):
    file = linkage()
    channels = ("time", "crank_angle", "rocker_acceleration_x", "crank_torque")
    motor = {"kind": "motor", **MOTOR}
    table = {run: simulated(file, rpm, dropped=0, drive=motor) for run, rpm in SPEEDS.items()}
    path = written(
        tmp_path, file, table, channels, 1e-3, drive="measured_angle", run={"start": "dead_centre"}
    )
    away = differences(model_of(path))
    assert {*away} == {*channels[2:]} and all(value < 0.05 for value in away.values()), away
    path = written(
        tmp_path,
        file,
        table,
        channels,
        1e-3,
        run={"start": "dead_centre"},
        drive="motor",
        motor=MOTOR,
    )
    start = {"speed": SPEEDS["slow"] * np.pi / 30, "first_angle": 0.0}
    away = differences(model_of(path), **start)
    assert all(value < 1.3e-3 for value in away.values()), away


def coasting(folder, file, **keys):
    """A campaign of a linkage that coasts down."""
    tables = {run: simulated(file, rpm, drive={"kind": "free"}) for run, rpm in SPEEDS.items()}
    channels = ("time", "crank_angle", "crank_speed")
    return written(folder, file, tables, channels, noise=2e-3, drive="free", **keys), tables


def test_a_free_crank_moves_on_with_its_energy_from_the_angle_and_speed_at_the_first_sample(
    tmp_path,
):
    heavy = content(linkage())
    heavy["bodies"]["crank"]["inertia"] = 0.1
    file = LinkageFile.model_validate(heavy)
    path, tables = coasting(tmp_path, file)
    assert measured(path).remarks == ()
    model = model_of(path)
    for run, table in tables.items():
        (start,) = (p for p in model.nuisances if p.key == f"speed@{run}")
        true = float(table["crank_speed"].iloc[0])
        assert start.low < true < start.high
        angle = float(table["crank_angle"].iloc[0])
        read = model.simulate(run, model.nominal(run) | {"speed": true, "first_angle": angle})
        assert read["crank_speed"] == pytest.approx(table["crank_speed"].to_numpy(), rel=1e-5)
        # energy: half the generalised inertia, from the ideal motion, times the speed squared
        at = read["crank_angle"]
        energy = 0.5 * inertia(file, at) * read["crank_speed"] ** 2
        assert np.ptp(energy) < 1e-4 * energy.mean()


def test_a_coast_down_with_a_loose_joint_arrives_at_the_first_sample_with_its_speed(tmp_path):
    heavy = content(linkage(loose=("B",)))
    heavy["bodies"]["crank"]["inertia"] = 0.1
    path, _ = coasting(tmp_path, LinkageFile.model_validate(heavy))
    own, plan = planned(path)
    read = channels_read(own, plan, {"speed": 21.0, "first_angle": 0.3})
    assert read["crank_speed"][0] == pytest.approx(21.0, rel=1e-6)
    assert read["crank_angle"][0] == pytest.approx(0.3, abs=1e-9)


def inertia(file: LinkageFile, angle: np.ndarray) -> np.ndarray:
    """Generalised moment of inertia [kg m^2] of the four-bar, from velocities at unit speed."""
    lengths = {name: body.length for name, body in file.bodies.items()}
    step = 1e-5
    ahead, behind = (ideal_channels(file, angle + side, 1.0) for side in (step, -step))
    turning = {
        name: (np.unwrap(ahead[f"{name}_angle"]) - np.unwrap(behind[f"{name}_angle"])) / (2 * step)
        for name in ("coupler", "rocker")
    }
    crank, coupler, rocker = (file.bodies[name] for name in ("crank", "coupler", "rocker"))
    direction = 0.5 * (np.unwrap(ahead["coupler_angle"]) + np.unwrap(behind["coupler_angle"]))
    apart = lengths["crank"] * coupler.mass_centre * np.cos(direction - angle)
    swing = turning["coupler"]
    moved = lengths["crank"] ** 2 + (coupler.mass_centre * swing) ** 2 + 2 * apart * swing
    total = crank.inertia + crank.mass * crank.mass_centre**2
    total = total + coupler.mass * moved + coupler.inertia * swing**2
    about_pivot = rocker.inertia + rocker.mass * rocker.mass_centre**2
    return total + about_pivot * turning["rocker"] ** 2


def test_a_free_crank_needs_its_motion_at_the_first_sample(tmp_path):
    file = linkage()
    with pytest.raises(InputError, match="drive free requires the channel crank_angle, or"):
        load_campaign(written(tmp_path, file, channels=("time", "rocker_angle"), drive="free"))
    path, _ = coasting(tmp_path, file, run={"start": {"angle": "40 deg", "turned": "1 turn"}})
    with pytest.raises(InputError, match="with drive free the motion starts at it; remove start"):
        load_campaign(path)


def test_columns_of_a_linkage_are_guessed_by_the_names_of_its_bodies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    headings = {
        "time": "t [s]",
        "crank_angle": "crank angle [rad]",
        "rocker_acceleration_x": "rocker acc x [m/s^2]",
        "coupler_angular_velocity": "gyro coupler [rad/s]",
        "crank_torque": "torque [N*m]",
    }
    (tmp_path / "four.yaml").write_text(yaml.safe_dump(content(linkage())), encoding="utf-8")
    table = simulated(linkage(), 200.0)[[*headings]].rename(columns=headings)
    table.to_csv("slow.csv", index=False)
    said = new_rig([tmp_path / "slow.csv"], "guessed", "four.yaml")
    assert "four.yaml: fill in" not in said and not (tmp_path / "guessed_mechanism.yaml").exists()
    own = load_campaign("guessed.yaml")
    assert {name: channel.column for name, channel in own.channels.items()} == headings
    assert {*own.nuisance} == {"coupler_mass", "rocker_mass"}


def test_the_channels_and_nuisances_of_a_slider_crank_follow_from_the_same_rules():
    file = linkage("quick_return")
    kinds = channel_kinds(file.sites)
    assert {"ram_position", "guide_force", "rocker_angle", "rod_acceleration_y"} <= {*kinds}
    assert "ram_angle" not in kinds and "cylinder_pressure" not in kinds
    assert list(CHANNELS)[3:7] == [
        "slider_position",
        "slider_velocity",
        "slider_acceleration",
        "rod_angle",
    ]
    loose = channel_kinds(file.sites, ["guide"])
    assert "ram_acceleration_x" in loose and "ram_position" not in loose
    nuisances = nuisances_of(file.sites)
    assert {"ram_mass", "rod_length", "ram_position_zero", "D_clearance"} <= {*nuisances}
    assert {"ram_inertia", "O_clearance", "crank_mass"}.isdisjoint(nuisances)
    assert "slider_offset" in nuisances_of(SLIDER_CRANK)
