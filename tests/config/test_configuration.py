"""A configuration is read once, checked whole, and refused with key, value and mend."""

import json
import math
import re
from pathlib import Path

import jsonschema
import pytest
import yaml
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.config import (
    Box,
    Scenario,
    check_whole,
    load_mechanism,
    parse_options,
    resolve,
    stands_alone,
)
from jointgap.config.load import json_schema, sources_of
from jointgap.config.yaml_files import Layer, merge, merged, sources
from jointgap.core.errors import InputError
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES

STAGES = SCENARIO_STAGES | DESIGN_STAGES

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def resolved(over):
    """The scenario `paper` with other keys; those of its mechanism are laid over the shipped one."""
    if isinstance(over.get("mechanism"), dict):
        over = over | {"mechanism": {"base": SHIPPED["mechanism"]} | over["mechanism"]}
    return resolve(merge(SHIPPED, {"run": ["paper"], "scenarios": {"paper": over}}), (ROOT,))["paper"]


def test_quantities_with_units_become_si():
    scenario = resolved({"simulate": {"speed": "600 rpm", "start_angle": "90 deg", "tolerance": "1e-9 mm"}})
    assert scenario.simulate.speed == pytest.approx(20 * math.pi, rel=1e-15)
    assert scenario.simulate.start_angle == pytest.approx(math.pi / 2, rel=1e-15)
    assert scenario.simulate.tolerance == pytest.approx(1e-12, rel=1e-15)


def test_plain_numbers_and_numbers_that_yaml_reads_as_text_are_si():
    assert resolved({"simulate": {"speed": 60}}).simulate.speed == 60.0
    # YAML 1.1 reads 2e11 as text
    assert (
        resolved({"mechanism": {"contacts": {"steel": {"youngs_modulus": "2e11"}}}})
        .mechanism.joint("crank_pin")
        .contact
    )
    assert yaml.safe_load("2e11") == "2e11"


def test_the_papers_mechanism_has_a_millimetre_of_clearance_and_no_gravity():
    mechanism = load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml")
    assert mechanism.clearance("crank_pin") == pytest.approx(1e-3)
    assert mechanism.gravity.tolist() == [0.0, 0.0]


def test_gravity_is_an_effect_that_acts_along_its_direction():
    gravity = resolved({"mechanism": {"effects": [{"name": "gravity"}]}}).mechanism.gravity
    assert gravity == pytest.approx([0.0, -9.80665], abs=1e-14)


def test_a_scenario_changes_only_the_keys_it_names():
    changed = resolved({"mechanism": {"contacts": {"steel": {"friction": 0.2}}}})
    plain = resolved({})
    assert (
        changed.mechanism.joint("crank_pin").contact.friction
        == changed.mechanism.joint("piston_pin").contact.friction
        == 0.2
    )
    assert (
        changed.mechanism.joint("crank_pin").contact.restitution
        == plain.mechanism.joint("crank_pin").contact.restitution
    )
    assert changed.simulate == plain.simulate


OTHER = """
crank: {length: 50 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 20 mm}
rod: {length: 200 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 60 mm}
slider: {mass: 2 kg}
joints: {crank_pin: ideal, piston_pin: ideal}
"""
HOLDING_IT = {"boxes": {"own": {"crank_length": ["49 mm", "51 mm"], "rod_length": ["198 mm", "202 mm"]}}}


def test_a_scenarios_mechanism_file_is_the_whole_mechanism(tmp_path):
    """Nothing of the mechanism beside the scenarios is left in it: offset, looseness, contacts, effects."""
    (tmp_path / "other.yaml").write_text(OTHER, encoding="utf-8")
    base = {"base": SHIPPED["mechanism"], "slider": {"offset": "20 mm"}, "effects": [{"name": "gravity"}]}
    config = SHIPPED | {"mechanism": base, "run": ["own"]}
    for mechanism in ("other.yaml", yaml.safe_load(OTHER), {"base": "other.yaml"}):
        scenarios = {"own": {"mechanism": mechanism, "optimise": HOLDING_IT}}
        own = resolve(config | {"scenarios": scenarios}, (ROOT, tmp_path))["own"].mechanism
        assert own == load_mechanism(tmp_path / "other.yaml")
        assert (own.loose, own.contacts, own.effects, own.slider.offset) == ((), {}, (), 0.0)


def test_a_mechanism_file_may_be_laid_over_the_one_beside_it(tmp_path):
    (tmp_path / "lower").mkdir()
    (tmp_path / "lower/other.yaml").write_text(OTHER, encoding="utf-8")
    (tmp_path / "lower/heavy.yaml").write_text("base: other.yaml\nslider: {mass: 5 kg}\n", encoding="utf-8")
    (tmp_path / "both.yaml").write_text("base: lower/heavy.yaml\nrod: {mass: 3 kg}\n", encoding="utf-8")
    lowest, both = load_mechanism(tmp_path / "lower/other.yaml"), load_mechanism(tmp_path / "both.yaml")
    assert (both.slider.mass, both.rod.mass) == (5.0, 3.0)
    assert (both.crank, both.rod.length, both.joints) == (lowest.crank, lowest.rod.length, lowest.joints)


@pytest.mark.parametrize(
    ("mechanism", "words"),
    [
        ({"slider": {"mass": 1}}, "key 'mechanism.crank' is missing; add it, or the key base, the path of"),
        ({"base": "nowhere.yaml"}, r"scenario own: mechanism\.base: no file 'nowhere\.yaml'"),
        ({"base": {"slider": {}}}, r"mechanism\.base = .*must be the path of a mechanism file"),
        ({"base": None}, r"mechanism\.base = None: must be the path of a mechanism file"),
        ("one.yaml", r"two\.yaml: base: 'one\.yaml' is laid over itself"),
    ],
)
def test_a_base_that_is_none_is_refused(tmp_path, mechanism, words):
    (tmp_path / "one.yaml").write_text("base: two.yaml", encoding="utf-8")
    (tmp_path / "two.yaml").write_text("base: one.yaml", encoding="utf-8")
    with pytest.raises(InputError, match=words):
        resolve(SHIPPED | {"run": ["own"], "scenarios": {"own": {"mechanism": mechanism}}}, (ROOT, tmp_path))


def test_each_value_is_told_with_the_file_that_it_is_written_in(tmp_path):
    (tmp_path / "other.yaml").write_text(OTHER, encoding="utf-8")
    own = {"mechanism": {"base": "other.yaml", "slider": {"offset": "1 mm"}}, "simulate": {"speed": "9 rpm"}}
    lower = Layer("lower.yaml", SHIPPED | {"figures": {"magnification": 3}})
    files = [lower, Layer("mine.yaml", {"run": ["own"], "scenarios": {"own": own | {"optimise": HOLDING_IT}}})]
    scenario = resolve(merged(files), (ROOT, tmp_path))["own"]
    told = {key: (source, value) for key, source, value in sources_of(scenario, "own", files, (ROOT, tmp_path))}
    other = str(tmp_path / "other.yaml")
    assert told["mechanism.slider.mass"] == (other, '"2 kg"')
    assert told["mechanism.slider.offset"] == ("mine.yaml, scenario own", '"1 mm"')
    assert told["simulate.speed"] == ("mine.yaml, scenario own", '"9 rpm"')
    assert told["simulate.revolutions"] == ("lower.yaml", "4")
    assert told["figures.magnification"] == ("lower.yaml", "3")
    assert told["mechanism.gravity_direction"] == ("default", str(-math.pi / 2))
    assert told["mechanism.joints.crank_pin"] == (other, '"ideal"')


def test_what_is_laid_over_a_mapping_by_a_plain_value_leaves_nothing_of_it():
    layers = [Layer("low", {"a": {"b": 1, "c": {"d": 2}}}), Layer("high", {"a": {"c": 3}})]
    assert sources(layers) == {("a", "b"): (1, "low"), ("a", "c"): (3, "high")}
    assert merged(layers) == {"a": {"b": 1, "c": 3}}


def test_a_crank_may_carry_a_counterweight():
    crank = {"mass_centre": "-20 mm", "mass_centre_across": "5 mm"}
    made = resolved({"mechanism": {"crank": crank}}).mechanism.crank
    assert (made.mass_centre, made.mass_centre_across) == pytest.approx((-0.02, 0.005))


def test_other_lengths_keep_the_mass_centres_share():
    longer = load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml").with_lengths(0.12, 0.6)
    assert (longer.crank.mass_centre, longer.rod.mass_centre) == pytest.approx((0.06, 0.3))
    assert (longer.crank.length, longer.rod.mass) == (0.12, 0.773)


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({"simulate": {"sped": 3}}, ["unknown key 'simulate.sped'", "did you mean 'speed'"]),
        ({"simulat": {}}, ["unknown key 'simulat'", "did you mean 'simulate'"]),
        (
            {"mechanism": {"contacts": {"steel": {"frictoin": 0.1}}}},
            ["mechanism.contacts.steel.frictoin", "did you mean 'friction'"],
        ),
        ({"mechanism": {"crank": {"mass": -1}}}, ["mechanism.crank.mass = -1", "greater than 0"]),
        ({"mechanism": {"crank": {"mass_centre": "-0.2 m"}}}, ["mass_centre -0.2 m", "beyond the link's length"]),
        ({"mechanism": {"rod": {"mass_centre_across": "1 mm"}}}, ["rod.mass_centre_across", "only a crank's"]),
        (
            {"mechanism": {"crank": {"mass": "-350 g"}}},
            ["mechanism.crank.mass = '-350 g', -0.35 in SI", "greater than 0"],
        ),
        (
            {
                "mechanism": {
                    "effects": [
                        {"name": "slider_spring", "parameters": {"stiffness_N_m": "-2 N/mm", "rest_position_m": 0}}
                    ]
                }
            },
            ["stiffness_N_m = '-2 N/mm', -2000 in SI", "greater than or equal to 0"],
        ),
        ({"mechanism": {"crank": {"length": "0.6 m"}}}, ["crank.length 0.6 m", "cannot turn", "shorten the crank"]),
        (
            {"mechanism": {"joints": {"crank_pin": {"journal_radius": "9 mm"}}}},
            ["mechanism.joints.crank_pin", "journal_radius 0.009 m is not smaller than bearing_radius 0.008 m"],
        ),
        ({"mechanism": {"joints": {"crank_pin": {"contact": "steal"}}}}, ["'steal'", "did you mean 'steel'"]),
        ({"mechanism": {"contacts": 7}}, ["mechanism.contacts = 7: must be a mapping"]),
        ({"mechanism": {"joints": {"crank_pin": {"journal": "slider"}}}}, ["journal must be 'crank' or 'rod'"]),
        ({"mechanism": {"contacts": {"steel": {"law": "hertz"}}}}, ["contacts.steel.law = 'hertz'"]),
        ({"mechanism": {"contacts": {"steel": {"restitution": 1.4}}}}, ["contacts.steel.restitution = 1.4"]),
        ({"optimise": {"boxes": {"paper": {"crank_length": ["153 mm", "147 mm"]}}}}, ["crank_length", "upside down"]),
        ({"optimise": {"rod_tolerance": 3}}, ["optimise.rod_tolerance 3000 mm", "tenth of the rod, 564 mm", "35 um"]),
        (
            {"mechanism": {"crank": {"length": "100 mm"}}},
            ["optimise.boxes (paper, wide)", "crank 100 mm and rod 564 mm", "give bounds around them"],
        ),
        ({"optimise": {"window": ["60 deg", "400 deg"]}}, ["leaves the first revolution"]),
        ({"simulate": {"speed": "600 mm"}}, ["simulate.speed = '600 mm'", "millimeter", "rad/s"]),
        ({"simulate": {"speed": "fast"}}, ["simulate.speed = 'fast'", "not a number"]),
        ({"simulate": {"speed": True}}, ["simulate.speed = True", "must be a number"]),
        ({"simulate": {"speed": ".nan"}}, ["simulate.speed = '.nan'"]),
        ({"simulate": {"speed": float("inf")}}, ["simulate.speed = inf", "finite"]),
        ({"simulate": {"speed": 10**400}}, ["simulate.speed = 1000", "too large for a number"]),
        ({"simulate": {"speed": "1e400"}}, ["simulate.speed = '1e400'", "finite"]),
        ({"simulate": {"speed": "10 Hz"}}, ["simulate.speed = '10 Hz'", "write rpm, turn/s or rad/s"]),
        ({"simulate": {"start_angle": 2e4}}, ["simulate.start_angle = 20000", "10000"]),
        ({"simulate": {"tolerance": 2e-7}}, ["simulate.tolerance = 2e-07", "0.0000001"]),
        (
            {"simulate": {"tolerance": 6e-8}, "mechanism": {"joints": {"piston_pin": {"bearing_radius": "7.5 mm"}}}},
            ["simulate.tolerance 6e-08 m", "0.0001 of the clearance 0.0005 m of piston_pin", "give 5e-08 m at most"],
        ),
        ({"simulate": {"revolutions": 6000}}, ["revolutions 6000 times samples_per_revolution 3600", "2e+07 samples"]),
        ({"simulate": {"revolutions": 10**400}}, ["simulate.revolutions = 1000", "20000000"]),
        ({"study": {"members": 4}}, ["key 'study' is gone", "design: grid"]),
        ({"ensemble": {"vary": {"speed": {"from": "0,1 rpm", "to": 9, "number": 3}}}}, ["is not a number with a unit"]),
        ({"ensemble": {"vary": {"speed": {"from": 1, "to": "1e999", "number": 3}}}}, ["to = '1e999' must be"]),
        (
            {
                "ensemble": {
                    "vary": {"speed": {"from": 1, "to": 2, "number": 501}, "friction": [i / 100 for i in range(20)]}
                }
            },
            ["501 of speed x 20 of friction are 10020 combinations"],
        ),
        ({"ensemble": {"members": 10**9}}, ["ensemble.members = 1000000000", "must be less than or equal to 10000"]),
        ({"ensemble": {"seed": 2**32}}, ["ensemble.seed = 4294967296", "must be less than or equal to 4294967295"]),
        (
            {"ensemble": {"vary": {key: {"from": 0, "to": 1, "number": 200} for key in ("speed", "friction")}}},
            ["ensemble", "200 of speed x 200 of friction are 40000 combinations, more than 10000"],
        ),
        ({"ensemble": {"vary": {"speed": {"from": 1, "to": 2, "number": 10**8}}}}, ["number = 100000000: must be"]),
        (
            {"optimise": {"ensemble": {"members": 10**9}}},
            ["optimise.ensemble.members", "must be less than or equal to 10000"],
        ),
        (
            {"optimise": {"ensemble": {"seed": 10**300}}},
            ["optimise.ensemble.seed", "must be less than or equal to 4294967295"],
        ),
        ({"optimise": {"genetic": {"population": 10**9}}}, ["genetic.population", "equal to 10000"]),
        (
            {"optimise": {"genetic": {"generations": 10**9}}},
            ["genetic.generations", "equal to 10000"],
        ),
        ({"surrogate": {"hidden": [10**9]}}, ["surrogate.hidden.0 = 1000000000", "equal to 5000"]),
        ({"surrogate": {"hidden": [100, 100]}}, ["surrogate", "hidden [100, 100] makes 10401 weights, more than 5000"]),
        ({"surrogate": {"hidden": [1] * 5000}}, ["surrogate", "makes 10002 weights, more than 5000"]),
        ({"surrogate": {"seeds": list(range(101))}}, ["surrogate.seeds", "at most 100 items"]),
        ({"surrogate": {"seeds": [2**63]}}, ["surrogate.seeds.0", "must be less than or equal to 4294967295"]),
        ({"surrogate": {"iterations": 10**12}}, ["surrogate.iterations", "equal to 10000000"]),
        ({"surrogate": {"training_points": 10**9}}, ["surrogate.training_points", "equal to 10001"]),
        ({"surrogate": {"clearance_sampling": 10**6}}, ["surrogate.clearance_sampling 1000000 times", "2e+07 samples"]),
        ({"figures": {"animation_frames": 10**9}}, ["figures.animation_frames", "equal to 600"]),
        ({"ensemble": {"seed": True}}, ["ensemble.seed = True", "must be a whole number, not true or false"]),
        ({"simulate": {"revolutions": True}}, ["simulate.revolutions = True", "not true or false"]),
        ({"simulate": {"revolutions": "many"}}, ["simulate.revolutions = 'many'", "must be a whole number"]),
        ({"simulate": {"revolutions": 2}}, ["settled_revolution 4", "simulate.revolutions"]),
        ({"simulate": {"samples_per_revolution": 720}}, ["samples_per_revolution 720", "five times"]),
        ({"surrogate": {"seeds": [1, 1]}}, ["seeds = [1, 1]", "give each once"]),
        ({"mechanism": {"effects": [{"name": "gravty"}]}}, ["mechanism.effects.0.name = 'gravty'", "'gravity'"]),
    ],
)
def test_a_mistake_is_named_with_its_scenario_key_value_and_mend(over, words):
    with pytest.raises(InputError) as caught:
        resolved(over)
    assert str(caught.value).startswith("configuration, scenario paper: ")
    for word in words:
        assert word in str(caught.value)


def test_the_printed_configuration_of_a_sweep_is_read_again():
    done = CliRunner().invoke(cli, ["config", str(ROOT / "config/sweep.yaml")])
    assert done.exit_code == 0
    assert json.loads(parse_options(done.output).model_dump_json(by_alias=True)) == json.loads(done.output)


@pytest.mark.parametrize("key", sorted(Scenario.removed))
def test_a_removed_section_says_what_to_use_instead(key):
    said = re.escape(f"key '{key}' is gone; {Scenario.removed[key]}")
    for given in ({key: {}}, {"scenarios": {"paper": {key: {}}}}):
        with pytest.raises(InputError, match=said):
            resolve({"mechanism": "erkaya2009", "scenarios": {"paper": {}}} | given)


def test_a_box_set_to_null_is_taken_away_and_another_becomes_the_main_one():
    own = {"crank_length": ["145 mm", "155 mm"], "rod_length": ["560 mm", "570 mm"]}
    assert list(resolved({"optimise": {"boxes": {"paper": None, "own": own}}}).optimise.boxes) == ["wide", "own"]


def test_where_no_box_is_given_lengths_are_searched_five_percent_around_the_mechanism_s_own():
    searched = resolved({"optimise": {"boxes": {"paper": None, "wide": None}}}).optimise.boxes
    assert searched == {"own": Box(crank_length=(0.1425, 0.1575), rod_length=(0.5358, 0.5922))}


OWN = {"scenarios": {"mine": {"mechanism": "config/mechanisms/erkaya2009.yaml"}}}


@pytest.mark.parametrize(
    ("given", "alone"),
    [
        (OWN, True),
        (OWN | {"run": ["mine"]}, True),
        ({"scenarios": {"mine": None}, "mechanism": "m.yaml"}, True),
        ({"scenarios": {"mine": {"simulate": {}}}}, False),  # of the shipped mechanism
        (OWN | {"run": ["paper", "mine"]}, False),
        ({"simulate": {"speed": "300 rpm"}}, False),
        ({"campaigns": ["c.yaml"]}, False),
        ({}, False),
    ],
)
def test_a_configuration_that_brings_its_scenarios_and_their_mechanisms_stands_alone(given, alone):
    assert stands_alone(given) is alone


def test_a_scenario_that_stands_alone_trains_for_some_hundred_iterations_and_has_no_limit_of_the_ratio():
    mine = resolve(OWN, (ROOT,))["mine"]
    assert (mine.surrogate.iterations, mine.surrogate.seeds, mine.optimise.ratio_limit) == (300, (0,), None)


def test_what_is_left_to_its_defaults_has_to_go_with_the_rest_where_all_is_asked_for():
    coarse = OWN | {"simulate": {"samples_per_revolution": 100}}
    with pytest.raises(InputError, match=r"scenario mine: .*must be a multiple of surrogate\.training_points"):
        resolve(coarse, (ROOT,))
    mine = resolve(coarse, (ROOT,), whole=False)["mine"]
    with pytest.raises(InputError, match=r"scenario mine: .*must be a multiple of surrogate\.training_points"):
        check_whole(mine, "mine")
    check_whole(resolve(OWN, (ROOT,), whole=False)["mine"], "mine")


@pytest.mark.parametrize("name", ["wide (5 %)", "a/b", "..", "", "wide box", "a:b", "w" * 61])
def test_a_box_whose_name_cannot_be_that_of_a_file_or_a_parameter_is_refused(name):
    own = {"crank_length": ["145 mm", "155 mm"], "rod_length": ["560 mm", "570 mm"]}
    with pytest.raises(InputError, match=r"optimise\.boxes\.[^\[]* = .*(use letters|60 letters|1 character)"):
        resolved({"optimise": {"boxes": {name: own}}})


def test_a_mistake_in_a_shared_contact_is_told_once():
    with pytest.raises(InputError) as caught:
        resolved({"mechanism": {"contacts": {"steel": {"restitution": 1.4}}}})
    assert len(str(caught.value).splitlines()) == 1


def test_every_mistake_is_told_in_one_go():
    with pytest.raises(InputError) as caught:
        resolved({"simulate": {"samples_per_revolution": -1, "revolutions": 0}})
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (SHIPPED | {"run": ["papr"]}, "did you mean 'paper'"),
        (SHIPPED | {"scenarios": {}}, "scenarios: must have at least 1 item"),
        (SHIPPED | {"run": "paper"}, "must be a list"),
        (SHIPPED | {"mechanism": "nowhere.yaml"}, "no file 'nowhere.yaml'"),
        ({"scenarios": {"a": {}}}, "'mechanism' is missing"),
        ({"scenarios": {"a": 5}}, "must be a mapping"),
        (SHIPPED | {"run": [["paper"]]}, "run.0 = .*must be text"),
        (SHIPPED | {"run": ["a/b"], "scenarios": {"a/b": {}}}, "files or folders are called so"),
        (SHIPPED | {"run": ["a" * 61], "scenarios": {"a" * 61: {}}}, "60 letters at most, not 61"),
        (SHIPPED | {"run": ["campaigns"], "scenarios": {"campaigns": {}}}, "another kind have that folder"),
        (SHIPPED | {"run": ["a"], "scenarios": {"a": [1]}}, "must be a mapping"),
    ],
)
def test_a_configuration_without_a_usable_scenario_is_refused(config, words):
    with pytest.raises(InputError, match=words):
        resolve(config, (ROOT,))


@pytest.mark.parametrize("stage", sorted(STAGES))
def test_what_a_stage_reads_survives_the_command_line(stage):
    scenario = resolved({"mechanism": {"effects": [{"name": "gravity"}]}})
    read_back = parse_options(STAGES[stage].options(scenario))
    for section in STAGES[stage].sections:
        assert getattr(read_back, section) == getattr(scenario, section)


def test_a_key_that_a_stage_does_not_read_does_not_reach_it():
    one, other = resolved({}), resolved({"optimise": {"ratio_limit": 0.2}})
    simulate, optimise = SCENARIO_STAGES["simulate"], SCENARIO_STAGES["optimise"]
    assert simulate.options(one) == simulate.options(other)
    assert optimise.options(one) != optimise.options(other)


def test_options_may_be_a_file_with_a_mechanism_beside_it(tmp_path):
    (tmp_path / "mine.yaml").write_text("mechanism: crank.yaml\nsimulate: {speed: 100 rpm}\n", encoding="utf-8")
    (tmp_path / "crank.yaml").write_text((ROOT / "config/mechanisms/erkaya2009.yaml").read_text(), encoding="utf-8")
    assert parse_options(str(tmp_path / "mine.yaml")).simulate.speed == pytest.approx(100 * math.tau / 60)


@pytest.mark.parametrize("text", ['{"simulate": ', '{"simulate": {"speed": NaN}}'])
def test_options_that_are_not_json_are_refused(text):
    with pytest.raises(InputError, match="--options"):
        parse_options(text)


def test_the_schema_accepts_what_is_shipped_and_refuses_an_unknown_section():
    validator = jsonschema.Draft202012Validator(json_schema())
    validator.validate(SHIPPED)
    validator.validate(yaml.safe_load((ROOT / "config/smoke.yaml").read_text(encoding="utf-8")))
    assert not validator.is_valid(SHIPPED | {"simulat": {}})
    assert not validator.is_valid(SHIPPED | {"simulate": {"sped": 1}})


def test_the_stored_schema_is_the_one_the_types_give():
    stored = json.loads((ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8"))
    assert stored == json_schema(), "run: jointgap schema --write workflow/schemas/config.schema.json"


def test_every_key_has_a_meaning_in_the_reference_or_in_the_configurations_readme():
    """The reference is made of the schema; a key without a description there is explained by hand."""
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    sections = [json_schema(), *json_schema()["$defs"].values()]
    keys = [(name, key) for section in sections for name, key in section.get("properties", {}).items()]
    says_itself = {"description", "$ref", "anyOf", "oneOf", "const"}
    without = {name for name, key in keys if not says_itself & key.keys()} - {"parameters", "site"}  # of effects
    assert [name for name in sorted(without) if not re.search(rf"`([\w.]+\.)?{name}`", text)] == []


def test_a_mechanism_that_comes_with_jointgap_is_named_from_every_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_mechanism("erkaya2009") == load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml")
    laid_over = resolve({"mechanism": {"base": "ideal_joints"}, "scenarios": {"mine": {}}})["mine"].mechanism
    assert laid_over == load_mechanism("ideal_joints")
    (tmp_path / "ideal_joints").write_text((ROOT / "config/mechanisms/erkaya2009.yaml").read_text(encoding="utf-8"))
    assert load_mechanism("ideal_joints") == load_mechanism("erkaya2009")  # a file goes before a name
    with pytest.raises(InputError, match=r"no file 'erkaya'.* or one of the names .*erkaya2009, ideal_joints"):
        load_mechanism("erkaya")
