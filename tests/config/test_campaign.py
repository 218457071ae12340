"""A campaign file is read once, checked whole, and refused with key, value and mend."""

import json
import math
import re
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.config import read_yaml
from jointgap.config.campaign import CHANNELS, NUISANCES, SHARED
from jointgap.config.load import campaign_json_schema, load_campaign
from jointgap.config.yaml_files import merge
from jointgap.core.errors import InputError
from tests.config.mechanisms import PAPER, paper

ROOT = Path(__file__).resolve().parents[2]
CAMPAIGN = {
    "name": "rig-a",
    "mechanism": "paper.yaml",
    "drive": "constant_speed",
    "runs": [
        {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "identify", "start": "settled"},
        {"id": "mid", "file": "mid.csv", "speed": "400 rpm", "role": "identify", "start": "settled"},
        {"id": "fast", "file": "fast.parquet", "speed": "600 rpm", "role": "confirm", "start": "settled"},
    ],
    "channels": {
        "time": {"column": "t", "unit": "s"},
        "crank_angle": {"column": "theta", "unit": "deg", "resolution": 0.1},
        "slider_acceleration": {"column": "acc", "unit": "g_n", "noise": 0.4, "bandwidth": "2 kHz"},
        "crank_torque": {"column": "torque", "unit": "N*m", "noise": {"slow": 0.02, "mid": 0.02, "fast": 0.05}},
    },
    "nuisance": {"slider_mass": "5%", "rod_mass": "5%", "restitution": [0.3, 0.9], "speed": "0.1%"},
}
IDEAL = read_yaml(PAPER) | {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}}


def runs(**changes) -> list[dict]:
    """The campaign's runs with `changes` by id; None takes one away."""
    laid = [run | (changes.get(run["id"], {}) or {}) for run in CAMPAIGN["runs"]]
    return [run for run in laid if changes.get(run["id"], {}) is not None]


@pytest.fixture
def write(tmp_path):
    (tmp_path / "paper.yaml").write_text(PAPER.read_text(encoding="utf-8"), encoding="utf-8")

    def written(over: dict) -> Path:
        path = tmp_path / "rig.yaml"
        merged = {key: value for key, value in merge(CAMPAIGN, over).items() if value is not None}
        if isinstance(merged.get("channels"), dict):
            merged["channels"] = {key: value for key, value in merged["channels"].items() if value is not None}
        path.write_text(yaml.safe_dump(merged), encoding="utf-8")
        return path

    return written


def test_a_campaign_file_becomes_sections_in_si(write, tmp_path):
    campaign = load_campaign(write({}))
    assert campaign.mechanism == paper()
    assert campaign.folder == tmp_path
    assert [run.id for run in campaign.runs] == ["slow", "mid", "fast"]
    assert campaign.runs[2].speed == pytest.approx(20 * math.pi, rel=1e-15)
    assert campaign.runs[2].first_angle is None
    assert campaign.channels["slider_acceleration"].bandwidth == 2000.0
    assert campaign.factor("slider_acceleration") == 9.80665
    assert campaign.factor("crank_angle") == pytest.approx(math.pi / 180, rel=1e-15)
    assert campaign.channels["crank_torque"].noise_of("fast") == 0.05
    assert campaign.channels["time"].noise_of("fast") is None


@pytest.fixture
def in_json(tmp_path):
    def read_again(campaign):
        path = tmp_path / "again.json"
        path.write_text(campaign.model_dump_json(), encoding="utf-8")
        return load_campaign(path)

    return read_again


def test_a_campaign_in_json_is_the_campaign_of_the_file(write, in_json):
    campaign = load_campaign(write({}))
    assert in_json(campaign) == campaign


def test_what_is_left_out_of_a_campaign_has_the_documented_meaning(write):
    campaign = load_campaign(write({"drive": None, "nuisance": None}))
    assert campaign.drive == "constant_speed"
    assert campaign.nuisance == {}
    assert campaign.channels["crank_torque"].filter == "zero_phase"
    assert campaign.runs[0].direction == "counter_clockwise"


def test_percentages_are_shares_of_nominal_and_bounds_are_converted(write):
    campaign = load_campaign(write({"nuisance": {"slider_mass": "2.5 %", "rod_length": ["563 mm", 0.565]}}))
    assert campaign.nuisance["slider_mass"] == 0.025
    assert campaign.bounds("slider_mass", 2.0) == pytest.approx((1.95, 2.05), rel=1e-15)
    assert campaign.bounds("rod_length", 0.564) == pytest.approx((0.563, 0.565), rel=1e-15)


@pytest.mark.parametrize("share", ["5%", "0.1 %", "33.3 %", "12.345678901234567 percent"])
def test_a_percentage_survives_json_to_the_last_digit(write, in_json, share):
    campaign = load_campaign(write({"nuisance": {"slider_mass": share}}))
    assert in_json(campaign).nuisance == campaign.nuisance


def test_noise_and_resolution_may_have_units_of_their_own(write):
    channels = {
        "slider_acceleration": {"noise": "0.980665 m/s^2"},
        "crank_angle": {"resolution": "turn/3600"},
        "crank_torque": {"noise": {"slow": "20 N*mm"}},
    }
    campaign = load_campaign(write({"channels": channels}))
    assert campaign.channels["slider_acceleration"].noise == pytest.approx(0.1, rel=1e-12)
    assert campaign.channels["crank_angle"].resolution == pytest.approx(0.1, rel=1e-12)
    assert campaign.channels["crank_torque"].noise_of("slow") == pytest.approx(0.02, rel=1e-12)


def test_a_channel_of_counts_needs_no_unit_and_is_read_in_steps_of_one_count(write, in_json):
    path = write({"channels": {"crank_angle": None, "time": None}})
    data = read_yaml(path)
    data["channels"] |= {
        "time": {"column": "n", "rate": "2 kHz"},
        "crank_angle": {"column": "counts", "counts_per_turn": 4000, "noise": "0.18 deg"},
        "crank_torque": {"column": "I", "unit": "A", "scale": "0.35 N*m/A", "noise": 0.02},
    }
    path.write_text(json.dumps(data), encoding="utf-8")
    campaign = load_campaign(path)
    assert campaign.factor("time") == pytest.approx(5e-4, rel=1e-15)
    assert campaign.factor("crank_angle") == pytest.approx(math.tau / 4000, rel=1e-15)
    assert campaign.channels["crank_angle"].resolution == 1.0
    assert campaign.channels["crank_angle"].noise == pytest.approx(2.0, rel=1e-12)
    assert campaign.factor("crank_torque") == pytest.approx(0.35, rel=1e-15)
    assert campaign.shown_unit("crank_torque") == ("N*m", 1.0)  # pages show the quantity, not the signal
    assert campaign.shown_unit("crank_angle")[0] == "deg"
    assert in_json(campaign) == campaign


@pytest.mark.parametrize(
    ("given", "nominal"), [("180 deg", 0.0), (["170 deg", "190 deg"], math.pi), (["0 deg", "360 deg"], 0.0)]
)
def test_an_encoder_may_be_mounted_the_other_way_round(write, given, nominal):
    campaign = load_campaign(write({"nuisance": {"encoder_zero": given}}))
    assert campaign.nominals("encoder_zero") == pytest.approx((nominal,), rel=1e-15)


def test_a_motors_line_is_a_drive_of_the_simulation(write, in_json):
    motor = {"stall_torque": "12 N*m", "no_load_speed": "60 rpm", "inertia": "1 g*m^2"}
    campaign = load_campaign(write({"drive": "motor", "motor": motor}))
    assert campaign.motor.kind == "motor"
    assert campaign.motor.no_load_speed == pytest.approx(2 * math.pi, rel=1e-15)
    assert in_json(campaign) == campaign


def test_ids_and_columns_may_be_whole_numbers(tmp_path):
    data = merge(CAMPAIGN, {"runs": runs(slow={"id": 1}), "channels": {"crank_torque": {"column": 4, "noise": None}}})
    data["channels"]["crank_torque"]["noise"] = {1: 0.02}
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(data | {"mechanism": json.loads(paper().model_dump_json())}), encoding="utf-8")
    campaign = load_campaign(path)
    assert campaign.runs[0].id == "1"
    assert campaign.channels["crank_torque"].column == "4"
    assert campaign.channels["crank_torque"].noise_of("1") == 0.02


def test_nuisances_that_have_nothing_to_act_on_are_named(write):
    for clock in ("time", "crank_angle"):  # with both the records tell the speed themselves
        assert load_campaign(write({"channels": {clock: None}})).idle_nuisances == ()
    assert load_campaign(write({"mechanism": IDEAL})).idle_nuisances == ("restitution", "speed")


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({"nam": "x"}, ["unknown key 'nam'", "did you mean 'name'"]),
        ({"name": None}, ["key 'name' is missing; add it"]),
        ({"name": "a/b"}, ["name = 'a/b'", "use letters, digits, '_' and '-' only"]),
        ({"mechanism": "nowhere.yaml"}, ["mechanism: no file 'nowhere.yaml'"]),
        ({"mechanism": IDEAL | {"crank": {}}}, ["key 'mechanism.crank.length' is missing"]),
        ({"drive": "constant"}, ["drive = 'constant'", "'constant_speed'"]),
        ({"drive": "motor"}, ["needs the key 'motor'", "stall_torque: 12 N*m"]),
        (
            {"motor": {"stall_torque": 3, "no_load_speed": 3}},
            ["drive is constant_speed", "set 'drive: motor' or remove"],
        ),
        ({"drive": "motor", "motor": {"stall_torque": 3}}, ["key 'motor.no_load_speed' is missing"]),
        ({"runs": []}, ["runs", "at least 1 item"]),
        ({"runs": runs(fast=None)}, ["none is for confirming", "confirm (or split"]),
        ({"runs": runs(slow=None, mid=None)}, ["none is for fitting", "identify (or split"]),
        ({"runs": runs(mid={"id": "slow"})}, ["two have the id 'slow'", "give each its own"]),
        ({"runs": runs(mid={"file": "slow.csv"})}, ["'slow' and 'mid' both read slow.csv", "role split"]),
        ({"runs": runs(mid={"speed": "400 Hz"})}, ["runs.1.speed = '400 Hz'", "rpm, turn/s or rad/s"]),
        (
            {"runs": runs(mid={"speed": -1})},
            ["runs.1: speed -1 rad/s must be greater than 0", "'direction: clockwise'"],
        ),
        ({"runs": runs(mid={"speed": "-150 rpm"})}, ["runs.1: speed -15.708 rad/s", "'direction: clockwise'"]),
        ({"runs": runs(mid={"speed": "0 rpm"})}, ["runs.1: speed 0 rad/s must be greater than 0"]),
        ({"runs": runs(mid={"role": "test"})}, ["runs.1.role = 'test'", "'confirm'"]),
        ({"runs": runs(mid={"start": "warm"})}, ["runs.1.start", "'warm'", "settled, at_rest", "{angle: 40 deg"]),
        ({"runs": runs(mid={"start": {}})}, ["runs.1.start", "says nothing; give angle, turned or ran"]),
        ({"runs": runs(mid={"start": {"turned": 6.3, "ran": "1 s"}})}, ["runs.1.start", "remove turned or ran"]),
        ({"runs": runs(mid={"start": {"angle": "3 mm"}})}, ["runs.1.start", "angle", "mm"]),
        ({"runs": runs(mid={"start": {"turn": 3}})}, ["runs.1.start", "unknown key", "turn"]),
        ({"runs": runs(mid={"stat": "settled"})}, ["unknown key 'runs.1.stat'", "did you mean 'start'"]),
        ({"runs": runs(mid={"first_angle": "10 deg"})}, ["'mid' has a first_angle", "remove it"]),
        ({"channels": {"crank_torq": {"column": "q", "unit": "N*m"}}}, ["'crank_torq'", "did you mean 'crank_torque'"]),
        ({"channels": None}, ["key 'channels' is missing"]),
        ({"channels": 3}, ["channels = 3", "must be a mapping"]),
        ({"channels": {"time": None, "crank_angle": None}}, ["neither time nor crank_angle", "add one"]),
        (
            {"channels": {"slider_acceleration": None, "crank_torque": None}, "drive": "measured_angle"},
            ["nothing to compare"],
        ),
        (
            {"channels": {"crank_angle": None}, "drive": "measured_angle"},
            ["measured_angle needs", "crank_angle; add it"],
        ),
        ({"channels": {"crank_torque": {"unit": "N"}}}, ["crank_torque.unit = 'N'", "needs N*m"]),
        ({"channels": {"crank_torque": {"unit": "A"}}}, ["crank_torque.unit = 'A'", "such as scale: 1 N*m/A"]),
        (
            {"channels": {"crank_torque": {"unit": "A", "scale": "0.35 N*m/V"}}},
            ["crank_torque.scale = '0.35 N*m/V' of a column in A", "such as scale: 1 N*m/A"],
        ),
        ({"channels": {"crank_torque": {"scale": -2}}}, ["crank_torque.scale = -2", "greater than 0", "sign: -1"]),
        ({"channels": {"crank_torque": {"counts_per_turn": 9, "unit": "count"}}}, ["counts_per_turn has no meaning"]),
        ({"channels": {"crank_angle": {"counts_per_turn": 4000}}}, ["unit = 'deg' and counts_per_turn", "remove one"]),
        (
            {"channels": {"crank_angle": {"counts_per_turn": 0, "unit": "count"}}},
            ["crank_angle.counts_per_turn = 0", "greater than 0"],
        ),
        (
            {"channels": {"crank_angle": {"unit": "count"}}},
            ["crank_angle.unit = 'count'", "counts_per_turn of an angle"],
        ),
        ({"channels": {"crank_torque": {"rate": "2 kHz"}}}, ["unit = 'N*m' and rate are both given"]),
        ({"csv": {"skip_rows": -1}}, ["csv.skip_rows = -1", "greater than or equal to 0"]),
        ({"channels": {"crank_torque": {"unit": "newtons per furlongg"}}}, ["is not a unit"]),
        ({"channels": {"slider_acceleration": {"unit": "g"}}}, ["slider_acceleration.unit = 'g'", "g_n"]),
        (
            {"channels": {"crank_speed": {"column": "w", "unit": "Hz"}}},
            ["crank_speed.unit = 'Hz'", "rpm, turn/s or rad/s"],
        ),
        ({"channels": {"crank_angle": {"unit": "percent"}}}, ["crank_angle.unit = 'percent'", "deg, turn or rad"]),
        ({"channels": {"crank_torque": {"unit": "N*m*0"}}}, ["crank_torque.unit = 'N*m*0'", "is not a unit"]),
        ({"channels": {"crank_angle": {"unit": ""}}}, ["crank_angle.unit = ''", "write one such as s, deg"]),
        ({"channels": {"crank_torque": {"unit": " "}}}, ["crank_torque.unit = ' '", "write one such as s, deg"]),
        ({"channels": {"crank_torque": {"unit": "1 000 N*m"}}}, ["crank_torque.unit = '1 000 N*m'", "is not a unit"]),
        (
            {"channels": {"crank_torque": {"noise": "0.1.5 N*m"}}},
            ["noise = '0.1.5 N*m'", "one number, with a decimal point, and one unit"],
        ),
        ({"channels": {"crank_torque": {"column": "acc"}}}, ["both read column 'acc'", "give two columns"]),
        (
            {"channels": {"crank_torque": {"noise": 0}}},
            ["crank_torque.noise = 0", "greater than 0", "leave the key out"],
        ),
        ({"channels": {"crank_torque": {"noise": {"slo": 1}}}}, ["there is no run 'slo'", "did you mean 'slow'"]),
        ({"channels": {"crank_torque": {"noise": "3 mm"}}}, ["crank_torque.noise = '3 mm'", "millimeter"]),
        ({"channels": {"crank_torque": {"noise": [1]}}}, ["crank_torque.noise = [1]", "must be a number"]),
        ({"channels": {"crank_torque": {"bandwidth": "100 rpm"}}}, ["bandwidth = '100 rpm'", "Hz or 1/s"]),
        ({"channels": {"crank_torque": {"filter": "causal"}}}, ["crank_torque.filter", "needs the bandwidth"]),
        ({"channels": {"crank_torque": {"reads_gravity": True}}}, ["crank_torque.reads_gravity", "only accelerations"]),
        ({"channels": {"crank_torque": {"resolution": 0.1}}}, ["crank_torque.resolution", "read in steps"]),
        ({"channels": {"time": {"noise": 0.1}}}, ["time.noise has no meaning", "exact"]),
        ({"channels": {"crank_torque": {"colum": "torque"}}}, ["channels.crank_torque.colum", "did you mean 'column'"]),
        ({"nuisance": {"slider_mas": "5%"}}, ["nuisance.slider_mas", "did you mean 'slider_mass'"]),
        ({"nuisance": {"slider_mass": 0.05}}, ["slider_mass = 0.05", "'5 %' or bounds"]),
        ({"nuisance": {"slider_mass": "5 kg"}}, ["slider_mass = '5 kg'", "a percentage such as '5 %' or bounds"]),
        ({"nuisance": {"slider_offset": "5"}}, ["slider_offset = '5'", "'5 %' or an amount such as '1 mm' or bounds"]),
        (
            {"nuisance": {"encoder_zero": "5 kg"}},
            ["encoder_zero = '5 kg'", "needs rad or a unit that converts to it; give an amount such as '5 deg'"],
        ),
        (
            {"nuisance": {"encoder_zero": "5 dge"}},
            ["encoder_zero = '5 dge'", "no unit 'dge'; give an amount such as '5 deg'"],
        ),
        ({"nuisance": {"encoder_lag": "5 mm"}}, ["encoder_lag = '5 mm'", "give an amount such as '5 ms'"]),
        ({"nuisance": {"slider_mass": "0,5 %"}}, ["is not a number with a unit"]),
        ({"nuisance": {"slider_mass": "1 000 %"}}, ["slider_mass = '1 000 %'", "is not a number with a unit"]),
        ({"nuisance": {"slider_mass": "0_5 %"}}, ["slider_mass = '0_5 %'", "give a percentage"]),
        ({"nuisance": {"slider_offset": "1 500 um"}}, ["slider_offset = '1 500 um'", "is not a number with a unit"]),
        ({"nuisance": {"slider_mass": "120 %"}}, ["less than 100 %"]),
        ({"nuisance": {"slider_mass": "nan %"}}, ["slider_mass"]),
        ({"nuisance": {"slider_mass": [0.5, 0.4]}}, ["upside down", "lower bound first"]),
        ({"nuisance": {"slider_mass": ["400 mm", 0.5]}}, ["slider_mass", "needs kg"]),
        ({"nuisance": {"slider_mass": [0.5, 0.6]}}, ["slider_mass is 0.4482", "outside of [0.5, 0.6]"]),
        ({"nuisance": {"restitution": [0.3, 1.2]}}, ["restitution = [0.3, 1.2]", "must be less than 1"]),
        ({"nuisance": {"restitution_crank_pin": [0.3, 0.9]}}, ["restitution of both pins", "give one of them"]),
        ({"nuisance": {"speed": [20, 21]}}, ["speed is 41", "outside of [20, 21]"]),
        ({"csv": {"separator": ",", "decimal": ","}}, ["csv", "separator ',' cannot part columns"]),
        ({"csv": {"separator": ";;"}}, ["csv.separator = ';;'", "at most 1 character"]),
    ],
)
def test_a_mistake_in_a_campaign_is_named_with_file_key_value_and_mend(write, over, words):
    path = write(over)
    with pytest.raises(InputError) as caught:
        load_campaign(path)
    assert str(caught.value).startswith(f"{path}: ")
    for word in words:
        assert word in str(caught.value)


def test_a_percentage_of_zero_is_refused(write):
    frictionless = merge(read_yaml(PAPER), {"contacts": {"steel": {"friction": 0}}})
    with pytest.raises(InputError, match=r"joint_friction is 0, of which a percentage is no range; give \[low, high\]"):
        load_campaign(write({"mechanism": frictionless, "nuisance": {"joint_friction": "10 %"}}))


def test_pins_of_different_contacts_do_not_share_a_nuisance(write):
    pins = {"piston_pin": {"contact": "smooth"}}
    two = merge(read_yaml(PAPER), {"joints": pins})
    two["contacts"]["smooth"] = two["contacts"]["steel"] | {"friction": 0.01}
    with pytest.raises(
        InputError, match=r"joint_friction of both pins .* 0\.01 in piston_pin; list joint_friction_crank_pin"
    ):
        load_campaign(write({"mechanism": two, "nuisance": {"joint_friction": [0.0, 0.3]}}))
    own = load_campaign(write({"mechanism": two, "nuisance": {"joint_friction_piston_pin": [0.0, 0.3]}}))
    assert own.bounds("joint_friction_piston_pin", 0.01) == (0.0, 0.3)


def test_the_mechanism_is_looked_for_beside_the_campaign_and_nowhere_else(write, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/other.yaml").write_text(PAPER.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"no file 'other\.yaml'"):
        load_campaign(write({"mechanism": "other.yaml"}))


def test_the_campaigns_schema_accepts_both_forms_and_refuses_unknown_keys(write):
    validator = jsonschema.Draft202012Validator(campaign_json_schema())
    validator.validate(CAMPAIGN)
    validator.validate(json.loads(load_campaign(write({})).model_dump_json()))
    motor = {"drive": "motor", "motor": {"stall_torque": "12 N*m", "no_load_speed": "60 rpm"}}
    validator.validate(CAMPAIGN | motor)
    for wrong in (
        {"nam": 1},
        {"channels": {"crank_torq": {"column": "a", "unit": "m"}}},
        {"nuisance": {"slider": "5 %"}},
    ):
        assert not validator.is_valid(CAMPAIGN | wrong)


def test_the_stored_campaign_schema_is_the_one_the_types_give():
    stored = json.loads((ROOT / "workflow/schemas/campaign.schema.json").read_text(encoding="utf-8"))
    assert stored == campaign_json_schema(), (
        "run: jointgap schema --campaign --write workflow/schemas/campaign.schema.json"
    )


def test_every_channel_nuisance_and_key_without_a_description_is_explained_in_the_configurations_readme():
    """The reference has the other keys from the schema."""
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    section = text[text.index("## Campaign file") :]
    schema = campaign_json_schema()
    parts = [schema, *(schema["$defs"][part] for part in ("Channel", "CampaignRun", "Csv", "MotorDrive"))]
    keys = {key for part in parts for key, what in part["properties"].items() if "description" not in what}
    per_pin = {key for key in NUISANCES if key.startswith(tuple(SHARED))}  # a suffix behind a key that is listed
    names = {*(keys - {"kind"}), *CHANNELS, *(NUISANCES.keys() - per_pin), *SHARED}
    assert [name for name in sorted(names) if f"`{name}`" not in section] == []


def test_the_readmes_campaign_is_one(write, tmp_path):
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    shown = re.search(r"## Campaign file.*?```yaml\n(.*?)```", text, re.DOTALL).group(1)
    path = tmp_path / "campaigns/rig.yaml"
    path.parent.mkdir()
    path.write_text(shown, encoding="utf-8")
    (tmp_path / "mechanisms").mkdir()
    (tmp_path / "mechanisms/erkaya2009.yaml").write_text(PAPER.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_campaign(path).name == "rig-a"
