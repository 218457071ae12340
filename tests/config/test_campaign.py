"""Campaign files: values, checks and errors."""

import json
import math
import re

import jsonschema
import pytest
import yaml

from jointgap.config import read_yaml
from jointgap.config.campaign import NUISANCES, RESERVED_IDS, SHARED, Campaign
from jointgap.config.channels import CHANNELS
from jointgap.config.load import campaign_json_schema, load_campaign, validate
from jointgap.config.yaml_files import merge
from jointgap.core.errors import InputError
from tests.config.mechanisms import PAPER, ROOT, paper

CAMPAIGN = yaml.safe_load("""
name: rig-a
mechanism: paper.yaml
drive: constant_speed
runs:
- {id: slow, file: slow.csv, speed: 200 rpm, role: identify, start: settled}
- {id: mid, file: mid.csv, speed: 400 rpm, role: identify, start: settled}
- {id: fast, file: fast.parquet, speed: 600 rpm, role: confirm, start: settled}
channels:
  time: {column: t, unit: s}
  crank_angle: {column: theta, unit: deg, resolution: 0.1}
  slider_acceleration: {column: acc, unit: g_n, noise: 0.4, bandwidth: 2 kHz}
  crank_torque: {column: torque, unit: N*m, noise: {slow: 0.02, mid: 0.02, fast: 0.05}}
nuisance: {slider_mass: 5%, rod_mass: 5%, restitution: [0.3, 0.9], speed: 0.1%}
""")
IDEAL = read_yaml(PAPER) | {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}}


def runs(**changes) -> list[dict]:
    """The campaign's runs with `changes` by id; None takes one away."""
    laid = [run | (changes.get(run["id"], {}) or {}) for run in CAMPAIGN["runs"]]
    return [run for run in laid if changes.get(run["id"], {}) is not None]


def cases_of(table: str) -> list[tuple]:
    """Rows `YAML => YAML => message` of a text."""
    rows = [line.split(" => ") for line in table.strip().splitlines()]
    return [(*map(yaml.safe_load, values), message.strip()) for *values, message in rows]


def check_refused(act, cases, start="") -> None:
    """Each case is refused with a message that contains the words between ` ~ `."""
    for *values, words in cases:
        with pytest.raises(InputError) as error:
            act(*values)
        message = str(error.value)
        assert message.startswith(start)
        assert [word for word in words.split(" ~ ") if word not in message] == []


@pytest.fixture
def load(tmp_path):
    """Reads the campaign with other keys from a file; None removes a key or a channel."""
    (tmp_path / "paper.yaml").write_text(PAPER.read_text(encoding="utf-8"), encoding="utf-8")

    def loaded(over: dict, kind: str = "yaml") -> Campaign:
        merged = {key: value for key, value in merge(CAMPAIGN, over).items() if value is not None}
        if isinstance(merged.get("channels"), dict):
            merged["channels"] = {
                key: value for key, value in merged["channels"].items() if value is not None
            }
        path = tmp_path / f"rig.{kind}"
        path.write_text(
            (json.dumps if kind == "json" else yaml.safe_dump)(merged), encoding="utf-8"
        )
        return load_campaign(path)

    return loaded


def again(campaign: Campaign, folder) -> Campaign:
    """The campaign, written as JSON and read again."""
    (folder / "again.json").write_text(campaign.model_dump_json(), encoding="utf-8")
    return load_campaign(folder / "again.json")


def test_a_campaign_file_becomes_sections_in_si(load, tmp_path):
    campaign = load({})
    assert (campaign.mechanism, campaign.folder) == (paper(), tmp_path) and again(
        campaign, tmp_path
    ) == campaign
    assert [run.id for run in campaign.runs] == ["slow", "mid", "fast"] and campaign.runs[
        2
    ].first_angle is None
    assert campaign.runs[2].speed == pytest.approx(20 * math.pi, rel=1e-15)
    assert campaign.channels["slider_acceleration"].bandwidth == 2000.0
    factors = [campaign.factor(name) for name in ("slider_acceleration", "crank_angle")]
    assert factors == pytest.approx([9.80665, math.pi / 180], rel=1e-15)
    assert campaign.channels["crank_torque"].noise_of("fast") == 0.05
    assert campaign.channels["time"].noise_of("fast") is None


def test_runs_stand_by_speed_whatever_their_order_in_the_file(load):
    for order in ((2, 0, 1), (1, 2, 0)):
        campaign = load({"runs": [CAMPAIGN["runs"][place] for place in order]})
        assert [run.id for run in campaign.runs] == ["slow", "mid", "fast"]


def test_what_is_left_out_of_a_campaign_has_the_documented_meaning(load):
    campaign = load({"drive": None, "nuisance": None})
    assert (campaign.drive, campaign.nuisance) == ("constant_speed", {})
    assert (campaign.channels["crank_torque"].filter, campaign.runs[0].direction) == (
        "zero_phase",
        "counter_clockwise",
    )
    for clock in ("time", "crank_angle"):  # with both the speed follows from the records
        assert load({"channels": {clock: None}}).idle_nuisances == ()
    assert load({"mechanism": IDEAL}).idle_nuisances == ("restitution", "speed")


def test_percentages_are_shares_of_nominal_and_bounds_are_converted(load, tmp_path):
    campaign = load({"nuisance": {"slider_mass": "2.5 %", "rod_length": ["563 mm", 0.565]}})
    assert campaign.nuisance["slider_mass"] == 0.025
    assert campaign.bounds("slider_mass", 2.0) == pytest.approx((1.95, 2.05), rel=1e-15)
    assert campaign.bounds("rod_length", 0.564) == pytest.approx((0.563, 0.565), rel=1e-15)
    for share in (
        "5%",
        "0.1 %",
        "33.3 %",
        "12.345678901234567 percent",
    ):  # survives to the last digit
        campaign = load({"nuisance": {"slider_mass": share}})
        assert again(campaign, tmp_path).nuisance == campaign.nuisance
    for given, zero in (
        ("180 deg", 0.0),
        (["170 deg", "190 deg"], math.pi),
        (["0 deg", "360 deg"], 0.0),
    ):
        assert load({"nuisance": {"encoder_zero": given}}).nominals(
            "encoder_zero"
        ) == pytest.approx((zero,), rel=1e-15)


def test_noise_and_resolution_may_have_units_of_their_own(load):
    channels = {
        "slider_acceleration": {"noise": "0.980665 m/s^2"},
        "crank_angle": {"resolution": "turn/3600"},
    }
    found = load({"channels": channels | {"crank_torque": {"noise": {"slow": "20 N*mm"}}}}).channels
    stated = (
        found["slider_acceleration"].noise,
        found["crank_angle"].resolution,
        found["crank_torque"].noise_of("slow"),
    )
    assert stated == pytest.approx((0.1, 0.1, 0.02), rel=1e-12)


def test_a_channel_of_counts_needs_no_unit_and_is_read_in_steps_of_one_count(load, tmp_path):
    channels = {
        "time": {"column": "n", "rate": "2 kHz"},
        "crank_angle": {"column": "counts", "counts_per_turn": 4000, "noise": "0.18 deg"},
        "crank_torque": {"column": "I", "unit": "A", "scale": "0.35 N*m/A", "noise": 0.02},
        "slider_acceleration": CAMPAIGN["channels"]["slider_acceleration"],
    }
    path = tmp_path / "counts.json"
    path.write_text(
        json.dumps(CAMPAIGN | {"mechanism": IDEAL, "nuisance": {}, "channels": channels}),
        encoding="utf-8",
    )
    campaign = load_campaign(path)
    factors = [campaign.factor(name) for name in ("time", "crank_angle", "crank_torque")]
    assert factors == pytest.approx([5e-4, math.tau / 4000, 0.35], rel=1e-15)
    assert campaign.channels["crank_angle"].resolution == 1.0
    assert campaign.channels["crank_angle"].noise == pytest.approx(2.0, rel=1e-12)
    assert campaign.shown_unit("crank_torque") == (
        "N*m",
        1.0,
    )  # pages show the quantity, not the signal
    assert campaign.shown_unit("crank_angle")[0] == "deg"
    assert again(campaign, tmp_path) == campaign


MISTAKES = """
nam: x => unknown key 'nam' ~ did you mean 'name'
name: null => key 'name' is missing; add it
name: a/b => name = 'a/b' ~ use letters, digits, '_' and '-' only
mechanism: nowhere.yaml => mechanism: no file 'nowhere.yaml'
drive: motor => needs the key 'motor' ~ stall_torque: 12 N*m
motor: {stall_torque: 3, no_load_speed: 3} => drive is constant_speed ~ set 'drive: motor' or remove
channels: {crank_torq: {column: q, unit: N*m}} => 'crank_torq' ~ did you mean 'crank_torque'
channels: null => key 'channels' is missing
channels: {time: null, crank_angle: null} => neither time nor crank_angle ~ add one
{channels: {slider_acceleration: null, crank_torque: null}, drive: measured_angle} => no measured
{channels: {crank_angle: null}, drive: measured_angle} => requires ~ crank_angle; add it
channels: {crank_torque: {unit: N}} => crank_torque.unit = 'N' ~ requires N*m
channels: {crank_torque: {unit: A}} => crank_torque.unit = 'A' ~ such as scale: 1 N*m/A
channels: {crank_torque: {unit: A, scale: 0.35 N*m/V}} => scale = '0.35 N*m/V' of a column ~ N*m/A
channels: {crank_torque: {counts_per_turn: 9, unit: count}} => counts_per_turn does not apply
channels: {crank_angle: {counts_per_turn: 4000}} => unit = 'deg' and counts_per_turn ~ remove one
channels: {crank_angle: {unit: count}} => crank_angle.unit = 'count' ~ counts_per_turn of an angle
channels: {crank_torque: {rate: 2 kHz}} => unit = 'N*m' and rate are both given
csv: {separator: ",", decimal: ","} => csv ~ separator ',' cannot separate columns
channels: {slider_acceleration: {unit: g}} => slider_acceleration.unit = 'g' ~ did you mean 'g_n'?
channels: {slider_acceleration: {unit: G}} => slider_acceleration.unit = 'G' ~ did you mean 'g_n'?
channels: {crank_torque: {unit: ft-lb, noise: null}} => crank_torque.unit = 'ft-lb' ~ did you mean
channels: {crank_angle: {unit: CAD}} => crank_angle.unit = 'CAD' ~ did you mean 'deg'?
channels: {crank_torque: {unit: A, scale: 0.35 N-m/A}} => scale = '0.35 N-m/A' ~ '0.35 N*m/A'?
nuisance: {encoder_zero: 0.1 rev} => encoder_zero = '0.1 rev' ~ did you mean '0.1 turn'?
nuisance: {crank_length: [0.1, "0,2 m"]} => crank_length ~ has a decimal comma; write '0.2 m'
channels: {crank_speed: {column: w, unit: Hz}} => crank_speed.unit = 'Hz' ~ rpm, turn/s or rad/s
channels: {crank_angle: {unit: ""}} => crank_angle.unit = '' ~ write one such as s, deg
channels: {crank_torque: {unit: 1 000 N*m}} => crank_torque.unit = '1 000 N*m' ~ is not a unit
channels: {crank_torque: {noise: 0.1.5 N*m}} => noise = '0.1.5 N*m' ~ one number
channels: {crank_torque: {column: acc}} => both read column 'acc' ~ give two columns
channels: {crank_torque: {noise: 0}} => crank_torque.noise = 0 ~ greater than 0 ~ remove the key
channels: {crank_torque: {noise: {slo: 1}}} => there is no run 'slo' ~ did you mean 'slow'
channels: {crank_torque: {noise: 3 mm}} => crank_torque.noise = '3 mm' ~ millimeter
channels: {crank_torque: {bandwidth: 100 rpm}} => bandwidth = '100 rpm' ~ Hz or 1/s
channels: {crank_angle: {average: 50 ms}} => crank_angle.average does not apply
channels: {crank_torque: {filter: causal}} => crank_torque.filter requires bandwidth
channels: {crank_torque: {reads_gravity: true}} => crank_torque.reads_gravity ~ only accelerations
channels: {crank_torque: {resolution: 0.1}} => crank_torque.resolution does not apply
channels: {time: {noise: 0.1}} => time.noise does not apply ~ exact
channels: {time: {sign: -1}} => time.sign does not apply
channels: {crank_torque: {sign: 2}} => sign = 2
channels: {crank_torque: {jitter: 1 ms}} => crank_torque.jitter does not apply
nuisance: {slider_mas: 5%} => nuisance.slider_mas ~ did you mean 'slider_mass'
nuisance: {slider_mass: 0.05} => slider_mass = 0.05 ~ '5 %' or bounds
nuisance: {slider_offset: "5"} => slider_offset = '5' ~ '5 %' or an amount such as '1 mm' or bounds
nuisance: {encoder_zero: -3 deg} => encoder_zero = '-3 deg': must be greater than 0
nuisance: {encoder_zero: 5 kg} => encoder_zero = '5 kg' ~ requires rad or ~ such as '5 deg'
nuisance: {encoder_zero: 5 dge} => encoder_zero = '5 dge' ~ no unit 'dge'; give ~ such as '5 deg'
nuisance: {slider_mass: "0,5 %"} => has a decimal comma; write '0.5 %'
nuisance: {slider_mass: 120 %} => less than 100 %
nuisance: {slider_mass: [0.5, 0.4]} => wrong order ~ lower bound first
nuisance: {slider_mass: [400 mm, 0.5]} => slider_mass ~ requires kg
nuisance: {slider_mass: [0.5, 0.6]} => slider_mass is 0.4482 ~ outside of its bounds [0.5, 0.6]
nuisance: {restitution: [0.3, 1.2]} => restitution = [0.3, 1.2] ~ must be less than 1
nuisance: {restitution_crank_pin: [0.3, 0.9]} => restitution (both pins) ~ give one of them
nuisance: {speed: [20, 21]} => speed is 41 ~ outside of its bounds [20, 21]
"""
RUNS = """
fast: null => none is for validation ~ confirm (or split
{slow: null, mid: null} => none is for fitting ~ identify (or split
mid: {id: slow} => two have the id 'slow' ~ give each its own
mid: {file: slow.csv} => 'slow' and 'mid' both read slow.csv ~ role split
mid: {speed: 400 Hz} => runs.mid.speed = '400 Hz' ~ rpm, turn/s or rad/s
mid: {speed: -150 rpm} => speed -15.708 rad/s must be greater than 0 ~ 'direction: clockwise'
mid: {start: warm} => runs.mid.start ~ 'warm' ~ settled, at_rest ~ {angle: 40 deg
mid: {start: {}} => runs.mid.start ~ is empty; give angle, turned or ran
mid: {start: {turned: 6.3, ran: 1 s}} => runs.mid.start ~ turned and ran ~ remove one
mid: {start: {angle: 3 mm}} => runs.mid.start ~ angle ~ mm
mid: {stat: settled} => unknown key 'runs.mid.stat' ~ did you mean 'start'
mid: {role: fit} => runs.mid.role = 'fit' ~ identify
mid: {first_angle: 10 deg} => 'mid' has first_angle ~ remove first_angle
"""


def test_a_mistake_in_a_campaign_is_named_with_file_key_value_and_mend(load, tmp_path):
    cases = [
        *cases_of(MISTAKES),
        *(({"runs": runs(**changes)}, words) for changes, words in cases_of(RUNS)),
    ]
    cases += [({"mechanism": IDEAL | {"crank": {}}}, "key 'mechanism.crank.length' is missing")]
    unnamed = [
        {key: value for key, value in run.items() if key != "id"} for run in CAMPAIGN["runs"]
    ]
    cases += [({"runs": unnamed}, "key 'runs.0.id' is missing ~ 'runs.2.id'")]
    files = (["a", 5], [["a"], "b"], ["a"], [])
    cases += [
        ({"runs": runs(mid={"file": wrong})}, "must be the name of a file, or a list of two")
        for wrong in files
    ]
    gated = {"time": None, "crank_torque": {"column": "M", "unit": "N*m", "average": "50 ms"}}
    cases += [({"channels": gated}, "crank_torque.average requires the channel time")]
    check_refused(load, cases, f"{tmp_path / 'rig.yaml'}: ")


RUN = {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "split"}
KINDS = """
runs: x => runs = 'x': must be a list
runs: [3] => runs.0 = 3: must be a mapping of keys to values
mechanism: 3 => mechanism = 3: must be the path of a mechanism file, or a mapping of keys to values
folder: null => folder = None: must be a path, written as text
drive: 3 => drive = 3: must be 'constant_speed', 'measured_angle', 'motor' or 'free'
name: 2026-05-01 => name = datetime.date(2026, 5, 1): must be text; write it in quotation marks
name: true => name = True: must be text; write it in quotation marks
name: "" => name = '': must have at least 1 character
"""


def test_a_value_of_the_wrong_kind_is_stated_in_words_and_nothing_is_said_that_is_not_so():
    channels = {
        key: {k: v for k, v in one.items() if k != "noise"}
        for key, one in CAMPAIGN["channels"].items()
    }
    good = CAMPAIGN | {
        "mechanism": read_yaml(PAPER),
        "runs": [RUN],
        "nuisance": {},
        "channels": channels,
    }
    assert validate(Campaign, good, "rig.yaml").runs[0].id == "slow"
    cases = cases_of(KINDS)
    speed = (
        "runs.slow.speed = '3 m': has the unit 'meter' and requires rad/s or a unit that converts"
        " to it"
    )
    cases += [({"runs": [RUN | {"speed": "3 m"}]}, speed)]  # the only run is not called absent
    other = "runs.{}: id '{}' is a reserved name of results; choose another id"
    cases += [({"runs": [RUN | {"id": name}]}, other.format(name, name)) for name in RESERVED_IDS]

    for over, words in cases:
        with pytest.raises(InputError) as error:
            validate(Campaign, good | over, "rig.yaml")
        assert str(error.value) == f"rig.yaml: {words}"


def test_a_nuisance_has_a_nominal_value_to_vary_from(load):
    frictionless = merge(read_yaml(PAPER), {"contacts": {"steel": {"friction": 0}}})
    two = merge(read_yaml(PAPER), {"joints": {"piston_pin": {"contact": "smooth"}}})
    two["contacts"]["smooth"] = two["contacts"]["steel"] | {"friction": 0.01}
    cases = [
        (frictionless, "10 %", "joint_friction is 0 ~ give [low, high]"),
        (
            two,
            [0.0, 0.3],
            "joint_friction requires equal ~ 0.01 in piston_pin; list joint_friction_crank_pin",
        ),
    ]
    check_refused(
        lambda own, given: load({"mechanism": own, "nuisance": {"joint_friction": given}}), cases
    )
    own = load({"mechanism": two, "nuisance": {"joint_friction_piston_pin": [0.0, 0.3]}})
    assert own.bounds("joint_friction_piston_pin", 0.01) == (0.0, 0.3)


def test_the_schema_is_the_stored_one_and_accepts_both_forms_and_no_unknown_keys(load):
    stored = json.loads(
        (ROOT / "workflow/schemas/campaign.schema.json").read_text(encoding="utf-8")
    )
    command = "jointgap schema --campaign --write workflow/schemas/campaign.schema.json"
    assert stored == campaign_json_schema(), f"run: {command}"
    validator = jsonschema.Draft202012Validator(stored)
    validator.validate(CAMPAIGN)
    validator.validate(json.loads(load({}).model_dump_json()))
    validator.validate(
        CAMPAIGN
        | {
            "drive": "motor",
            "motor": {"stall_torque": "12 N*m", "no_load_speed": "60 rpm"},
        }
    )
    unit = {"column": "a", "unit": "m"}
    for wrong in ({"nam": 1}, {"channels": {"crank_torq": unit}}, {"nuisance": {"slider": "5 %"}}):
        assert not validator.is_valid(CAMPAIGN | wrong)


def test_the_readme_names_every_channel_and_nuisance_and_its_campaign_is_one(tmp_path):
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    section = text[text.index("## Campaign file") :]
    per_pin = {
        key for key in NUISANCES if key.startswith(tuple(SHARED))
    }  # a suffix behind a key that is listed
    names = {*CHANNELS, *(NUISANCES.keys() - per_pin), *SHARED}
    assert [name for name in sorted(names) if f"`{name}`" not in section] == []
    for folder, name, content in (
        ("campaigns", "rig.yaml", re.search(r"```yaml\n(.*?)```", section, re.DOTALL)[1]),
        ("mechanisms", "erkaya2009.yaml", PAPER.read_text(encoding="utf-8")),
    ):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text(content, encoding="utf-8")
    assert load_campaign(tmp_path / "campaigns/rig.yaml").name == "rig-a"


def test_a_law_of_the_campaign_file_that_cannot_be_one_is_refused(load, tmp_path):
    slider, c = {"site": "slider", "force": "-c*v^3"}, "0 to 100 N*s^3/m^3"
    cases = [
        (
            slider | {"c": "0 to 9 N*s/m"},
            "force = '-c*v^3' ~ N*m^2/s^2 and must have N ~ give c in N*s^3/m^3",
        ),
        (slider | {"force": "-c*u"}, "unknown name 'u'"),
        (slider | {"d": "0 to 1"}, "does not use the coefficient 'd'"),
        (slider | {"force": "-c*v*t"}, "the time t differs between runs"),
        (slider | {"force": "1 - c*v"}, "not proportional to a parameter"),
        (slider | {"force": "-c*d*v", "d": "0 to 1"}, "only the product of c and d"),
        (slider | {"c": 3}, "my_law.c = 3 ~ is not a range ~ 0 to 100"),
        (slider | {"c": "9 to 100 N*s^3/m^3"}, "c = '9 to 100 N*s^3/m^3' must include 0"),
        (slider | {"c": "1 to 0 N*s^3/m^3"}, "my_law.c = '1 to 0 N*s^3/m^3' ~ wrong order"),
        (slider | {"c": "0 N to 1 m"}, "two units of different dimensions"),
        (slider | {"c": "0 to 1 foo"}, "there is no unit 'foo'"),
        (slider | {"force": "-c*sin(v)", "c": "0 to 1 N"}, "'sin(v)' is of a quantity in m/s"),
        (slider | {"force": "-c*(v + d)", "c": "0 to 1", "d": "0 to 1 m"}, "adds m/s and m"),
        (slider | {"site": "crank"}, "site crank requires the key torque [N*m], and not force"),
        (
            slider | {"site": "rod"},
            "my_law: site = 'rod': there is no such body on a slide or pivot ~ slider",
        ),
        ({"site": "slider", "force": "-v"}, "has 0 parameters; give one"),
    ]
    starts = f"{tmp_path / 'rig.yaml'}: candidates.my_law"
    check_refused(
        lambda law: load(
            {"candidates": {"my_law": {"c": c} | law if "-v" not in law.values() else law}}
        ),
        cases,
    )
    for name in (
        "slider_spring",
        "slider_mass",
        "crank_torque",
        "sensor_gain",
        "encoder_zeros",
        "discovered_law",
    ):
        with pytest.raises(InputError, match=f"{name} is, or begins like, the name of another"):
            load({"candidates": {name: slider | {"c": c}}})
    with pytest.raises(InputError, match=f"^{re.escape(starts)}"):
        load({"candidates": {"my_law": slider | {"c": "0 to 9 N*s/m"}}})
    kept = load({"candidates": {"my_law": slider | {"c": [0, c.partition(" to ")[2]]}}})
    assert again(kept, tmp_path) == kept and kept.candidates["my_law"].spans["c"].high == 100.0
