"""Configurations: merging, defaults, and errors with key, value and fix."""

import json
import math
import re

import jsonschema
import pytest
import yaml
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.config import (
    Box,
    check_all_sections,
    is_complete,
    load_mechanism,
    parse_options,
    resolve,
)
from jointgap.config.load import json_schema
from jointgap.config.yaml_files import merge
from jointgap.core.errors import InputError
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES
from tests.config.mechanisms import PAPER, ROOT

STAGES = SCENARIO_STAGES | DESIGN_STAGES
SHIPPED = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def resolved(over):
    """The scenario `paper` with other keys; those of its mechanism are laid over the shipped
    one."""
    if isinstance(over.get("mechanism"), dict):
        over = over | {"mechanism": {"base": SHIPPED["mechanism"]} | over["mechanism"]}
    return resolve(merge(SHIPPED, {"run": ["paper"], "scenarios": {"paper": over}}), (ROOT,))[
        "paper"
    ]


def test_quantities_with_units_become_si_and_plain_numbers_are_si():
    keys = {"speed": "600 rpm", "start_angle": "90 deg", "tolerance": "1e-9 mm"}
    simulate = resolved({"simulate": keys}).simulate
    assert simulate.speed == pytest.approx(20 * math.pi, rel=1e-15)
    assert simulate.start_angle == pytest.approx(math.pi / 2, rel=1e-15)
    assert simulate.tolerance == pytest.approx(1e-12, rel=1e-15)
    assert resolved({"simulate": {"speed": 60}}).simulate.speed == 60.0
    text_in_yaml_1_1 = {"contacts": {"steel": {"youngs_modulus": yaml.safe_load("2e11")}}}
    contact = resolved({"mechanism": text_in_yaml_1_1}).mechanism.joint("crank_pin").contact
    assert contact.youngs_modulus == 2e11


def test_a_scenario_changes_only_its_keys():
    changed = resolved({"mechanism": {"contacts": {"steel": {"friction": 0.2}}}})
    shipped = resolved({})
    for pin in ("crank_pin", "piston_pin"):
        contact = changed.mechanism.joint(pin).contact
        expected = shipped.mechanism.joint(pin).contact
        assert contact.friction == 0.2 != expected.friction
        assert contact.restitution == expected.restitution
    assert changed.simulate == shipped.simulate


OTHER = """
crank: {length: 50 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 20 mm}
rod: {length: 200 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 60 mm}
slider: {mass: 2 kg}
joints: {crank_pin: ideal, piston_pin: ideal}
"""
BOX = {"crank_length": ["49 mm", "51 mm"], "rod_length": ["198 mm", "202 mm"]}
AROUND_IT = {"boxes": {"own": BOX}}


@pytest.fixture
def other(tmp_path):
    (tmp_path / "other.yaml").write_text(OTHER, encoding="utf-8")
    return tmp_path / "other.yaml"


def test_the_mechanism_file_of_a_scenario_replaces_the_common_one(other):
    base = SHIPPED["mechanism"]
    common = {"base": base, "slider": {"offset": "20 mm"}, "effects": [{"name": "gravity"}]}
    config = SHIPPED | {"mechanism": common, "run": ["own"]}
    for mechanism in ("other.yaml", yaml.safe_load(OTHER), {"base": "other.yaml"}):
        scenarios = {"own": {"mechanism": mechanism, "optimise": AROUND_IT}}
        scenario = resolve(config | {"scenarios": scenarios}, (ROOT, other.parent))["own"]
        assert scenario.mechanism == load_mechanism(other)
        assert scenario.mechanism.effects == () and scenario.mechanism.slider.offset == 0.0


def test_a_mechanism_file_may_modify_another_one(other):
    folder = other.parent
    (folder / "lower").mkdir()
    other.rename(folder / "lower/other.yaml")
    (folder / "lower/heavy.yaml").write_text("base: other.yaml\nslider: {mass: 5 kg}\n")
    (folder / "both.yaml").write_text("base: lower/heavy.yaml\nrod: {mass: 3 kg}\n")
    lowest, both = load_mechanism(folder / "lower/other.yaml"), load_mechanism(folder / "both.yaml")
    assert (both.slider.mass, both.rod.mass) == (5.0, 3.0)
    assert (both.crank, both.rod.length) == (lowest.crank, lowest.rod.length)


@pytest.mark.parametrize(
    "mechanism, words",
    [
        ({"slider": {"mass": 1}}, "key 'mechanism.crank' is missing; add it, or the key base"),
        ({"base": "nowhere.yaml"}, "scenario own: mechanism.base: no file 'nowhere.yaml'"),
        ({"base": {"slider": {}}}, "mechanism.base = .* must be the path of a mechanism file"),
        ("one.yaml", "two.yaml: base: 'one.yaml' is its own base"),
    ],
)
def test_a_wrong_base_is_an_error(tmp_path, mechanism, words):
    for name, base in (("one", "two"), ("two", "one")):
        (tmp_path / f"{name}.yaml").write_text(f"base: {base}.yaml")
    config = SHIPPED | {"run": ["own"], "scenarios": {"own": {"mechanism": mechanism}}}
    with pytest.raises(InputError, match=words):
        resolve(config, (ROOT, tmp_path))


WRONG = {
    "simulate: {sped: 3}": "unknown key 'simulate.sped'; did you mean 'speed'",
    "simulate: {speed: 600 mm}": "simulate.speed = '600 mm'.*millimeter.*rad/s",
    "simulate: {speed: fast}": "simulate.speed = 'fast'.*not a number",
    "simulate: {speed: true}": "simulate.speed = True.*must be a number",
    "simulate: {speed: 1e400}": "simulate.speed = '1e400'.*finite",
    "simulate: {speed: 10 Hz}": "simulate.speed = '10 Hz'.*write rpm, turn/s or rad/s",
    "simulate: {revolutions: 6000}": "revolutions 6000 times samples_per_revolution 3600",
    "simulate: {revolutions: true}": "simulate.revolutions = True.*not true or false",
    "simulate: {revolutions: 2}": "settled_revolution 4.*simulate.revolutions",
    "simulate: {samples_per_revolution: 720}": "samples_per_revolution 720.*five times",
    "mechanism: {contacts: {steel: {frictoin: 0.1}}}": "steel.frictoin'; did you mean 'friction'",
    "mechanism: {crank: {mass: -350 g}}": "crank.mass = '-350 g', -0.35 in SI.*greater than 0",
    "mechanism: {crank: {mass_centre: -0.2 m}}": "mass_centre -0.2 m is beyond the link's length",
    "mechanism: {rod: {mass_centre_across: 1 mm}}": "rod.mass_centre_across.*only a crank's",
    "mechanism: {crank: {length: 0.6 m}}": "crank.length 0.6 m.*cannot turn.*shorten the crank",
    "mechanism: {joints: {crank_pin: {journal_radius: 9 mm}}}": "0.009 m is not smaller",
    "mechanism: {joints: {crank_pin: {contact: steal}}}": "'steal'.*did you mean 'steel'",
    "mechanism: {joints: {crank_pin: {journal: slider}}}": "journal must be 'crank' or 'rod'",
    "mechanism: {contacts: 7}": "mechanism.contacts = 7: must be a mapping",
    "mechanism: {effects: [{name: gravty}]}": "effects.0.name = 'gravty'.*'gravity'",
    "mechanism: {crank: {length: 100 mm}}": r"optimise.boxes \(paper\).*crank 100 mm and rod 564",
    "optimise: {boxes: {paper: {crank_length: [153 mm, 147 mm]}}}": "crank_length.*wrong order",
    "optimise: {rod_tolerance: 35 um}": "optimise.rod_tolerance' was removed; delete it",
    "optimise: {window: [60 deg, 400 deg]}": "exceeds the first revolution",
    "optimise: {ensemble: {members: 1000000000}}": "members.*must be less than or equal to 10000",
    "optimise: {genetic: {elites: 3}}": "genetic.elites' was removed; delete it",
    "figures: {magnification: 3}": "figures.magnification' was removed; delete it",
    "study: {members: 4}": "key 'study' was removed; use sweep with design: grid",
    "ensemble: {members: 4}": "key 'ensemble' was removed.*starts: 15",
    "sweep: {number: 4, trajectories: [4]}": "no design 4; the last one is 3",
    "sweep: {number: 10000000, starts: 2}": r"10000000 designs with 2 start\(s\) each are more",
    "surrogate: {hidden: [100, 100]}": r"hidden \[100, 100\] has 10401 weights, more than 5000",
    "surrogate: {seeds: [1, 1]}": r"seeds = \[1, 1\].*give each value once",
    "surrogate: {clearance_sampling: 20}": "surrogate.clearance_sampling' was removed; delete it",
    """
    simulate: {tolerance: 6.0e-8}
    mechanism: {joints: {piston_pin: {bearing_radius: 7.5 mm}}}
    """: "tolerance 6e-08 m .* of the clearance 0.0005 m of piston_pin.*at most 5e-08 m",
}


@pytest.mark.parametrize("text, words", WRONG.items())
def test_an_error_names_scenario_key_value_and_fix(text, words):
    with pytest.raises(InputError, match=f"^configuration, scenario paper: .*{words}"):
        resolved(yaml.safe_load(text))


def test_all_errors_are_reported_together_and_one_in_a_shared_contact_once():
    samples = {"simulate": {"samples_per_revolution": -1, "revolutions": 0}}
    contact = {"mechanism": {"contacts": {"steel": {"restitution": 1.4}}}}
    for over, number_of_lines in ((samples, 2), (contact, 1)):
        with pytest.raises(InputError) as error:
            resolved(over)
        assert len(str(error.value).splitlines()) == number_of_lines


def test_null_removes_a_box_and_without_boxes_the_search_is_five_percent_around_the_lengths():
    box = {"crank_length": ["145 mm", "155 mm"], "rod_length": ["560 mm", "570 mm"]}
    boxes = resolved({"optimise": {"boxes": {"paper": None, "own": box}}}).optimise.boxes
    assert list(boxes) == ["own"]
    boxes = resolved({"optimise": {"boxes": {"paper": None}}}).optimise.boxes
    assert boxes == {"own": Box(crank_length=(0.1425, 0.1575), rod_length=(0.5358, 0.5922))}
    for name, words in {"..": "use letters", "": "1 character", "w" * 61: "60 letters"}.items():
        with pytest.raises(InputError, match=words):
            resolved({"optimise": {"boxes": {name: box}}})


OWN = {"scenarios": {"mine": {"mechanism": "config/mechanisms/erkaya2009.yaml"}}}


def test_a_configuration_with_scenarios_and_mechanisms_is_complete():
    complete = [OWN, OWN | {"run": ["mine"]}, {"scenarios": {"mine": None}, "mechanism": "m.yaml"}]
    overriding = [
        {"scenarios": {"mine": {"simulate": {}}}},  # of the shipped mechanism
        OWN | {"run": ["paper", "mine"]},
        {"campaigns": ["c.yaml"]},
        {},
    ]
    assert all(map(is_complete, complete)) and not any(map(is_complete, overriding))
    mine = resolve(OWN, (ROOT,))["mine"]
    assert (mine.surrogate.iterations, mine.optimise.ratio_limit) == (300, None)


def test_sections_that_only_have_defaults_are_checked_where_all_are_required():
    coarse = OWN | {"simulate": {"samples_per_revolution": 100}}
    words = r"scenario mine: .*must be a multiple of"
    with pytest.raises(InputError, match=words):
        resolve(coarse, (ROOT,))
    with pytest.raises(InputError, match=words):
        check_all_sections(resolve(coarse, (ROOT,), whole=False)["mine"], "mine")
    check_all_sections(resolve(OWN, (ROOT,), whole=False)["mine"], "mine")


@pytest.mark.parametrize(
    "over, words",
    [
        ({"run": ["papr"]}, "did you mean 'paper'"),
        ({"scenarios": {}}, "scenarios: must have at least 1 item"),
        ({"run": "paper"}, "must be a list"),
        ({"run": [["paper"]]}, "run.0 = .*must be text"),
        ({"mechanism": "nowhere.yaml"}, "no file 'nowhere.yaml'"),
        ({"run": ["a/b"], "scenarios": {"a/b": {}}}, "name of files or folders"),
        ({"run": ["campaigns"], "scenarios": {"campaigns": {}}}, "reserved for other results"),
        ({"run": ["a"], "scenarios": {"a": [1]}}, "must be a mapping"),
        ({"run": ["a" * 61], "scenarios": {"a" * 61: {}}}, "at most 60 letters, not 61"),
    ],
)
def test_a_configuration_without_a_usable_scenario_is_an_error(over, words):
    with pytest.raises(InputError, match=words):
        resolve(SHIPPED | over, (ROOT,))
    with pytest.raises(InputError, match="'mechanism' is missing"):
        resolve({"scenarios": {"a": {}}}, (ROOT,))


def test_a_stage_gets_only_the_sections_that_it_reads():
    scenario = resolved({"mechanism": {"effects": [{"name": "gravity"}]}})
    for stage in STAGES.values():
        read_back = parse_options(stage.options(scenario))
        for section in stage.sections:
            assert getattr(read_back, section) == getattr(scenario, section)
    limited = resolved({"optimise": {"ratio_limit": 0.2}})
    assert STAGES["simulate"].options(resolved({})) == STAGES["simulate"].options(limited)
    assert STAGES["optimise"].options(resolved({})) != STAGES["optimise"].options(limited)


def test_options_may_be_a_file_or_the_output_of_config(tmp_path):
    text = "mechanism: crank.yaml\nsimulate: {speed: 100 rpm}\n"
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "crank.yaml").write_text(PAPER.read_text(), encoding="utf-8")
    speed = parse_options(str(tmp_path / "mine.yaml")).simulate.speed
    assert speed == pytest.approx(100 * math.tau / 60)
    printed = CliRunner().invoke(cli, ["config", str(ROOT / "config/sweep.yaml")]).stdout
    again = parse_options(printed).model_dump_json(by_alias=True)
    assert json.loads(again) == json.loads(printed)
    with pytest.raises(InputError, match="--options"):
        parse_options('{"simulate": {"speed": NaN}}')
    several = "scenarios: {mine: {mechanism: erkaya2009}}"
    (tmp_path / "several.yaml").write_text(several, encoding="utf-8")
    with pytest.raises(InputError, match=r"several scenarios.* --scenario NAME"):
        parse_options(str(tmp_path / "several.yaml"))


def test_the_stored_schema_is_current_and_explains_every_key():
    stored = json.loads((ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8"))
    assert stored == json_schema(), (
        "run: jointgap schema --write workflow/schemas/config.schema.json"
    )
    validator = jsonschema.Draft202012Validator(stored)
    validator.validate(SHIPPED)
    validator.validate(yaml.safe_load((ROOT / "config/smoke.yaml").read_text(encoding="utf-8")))
    for wrong in ({"simulat": {}}, {"simulate": {"sped": 1}}):
        assert not validator.is_valid(SHIPPED | wrong)
    # the reference is generated from it; a key without a description is explained by hand
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    explained = {"description", "$ref", "anyOf", "oneOf", "const"}
    for section in (stored, *stored["$defs"].values()):
        for name, key in section.get("properties", {}).items():
            of_effect = name in ("parameters", "site")
            assert of_effect or explained & key.keys() or re.search(rf"`([\w.]+\.)?{name}`", text)


def test_a_shipped_mechanism_is_found_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_mechanism("erkaya2009") == load_mechanism(PAPER)
    config = {"mechanism": {"base": "ideal_joints"}, "scenarios": {"mine": {}}}
    assert resolve(config)["mine"].mechanism == load_mechanism("ideal_joints")
    (tmp_path / "ideal_joints").write_text(PAPER.read_text(encoding="utf-8"))
    # a file goes before a name
    assert load_mechanism("ideal_joints") == load_mechanism("erkaya2009")
    with pytest.raises(
        InputError, match=r"no file 'erkaya'.* or one of the names .*erkaya2009.* ideal_joints"
    ):
        load_mechanism("erkaya")
