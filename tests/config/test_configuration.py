"""A configuration is read once, checked whole, and refused with key, value and mend."""

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
from jointgap.config.load import json_schema, sources_of
from jointgap.config.yaml_files import Layer, merge, merged
from jointgap.core.errors import InputError
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES
from tests.catalogue import each, refused, written
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


def test_quantities_with_units_become_si_and_plain_numbers_are():
    simulate = resolved(
        {"simulate": {"speed": "600 rpm", "start_angle": "90 deg", "tolerance": "1e-9 mm"}}
    ).simulate
    found = simulate.speed, simulate.start_angle, simulate.tolerance
    assert found == pytest.approx((20 * math.pi, math.pi / 2, 1e-12), rel=1e-15)
    assert resolved({"simulate": {"speed": 60}}).simulate.speed == 60.0
    as_text = {
        "mechanism": {"contacts": {"steel": {"youngs_modulus": yaml.safe_load("2e11")}}}
    }  # text in YAML 1.1
    assert resolved(as_text).mechanism.joint("crank_pin").contact.youngs_modulus == 2e11


def test_a_scenario_changes_only_the_keys_it_names():
    changed, plain = (
        resolved({"mechanism": {"contacts": {"steel": {"friction": 0.2}}}}),
        resolved({}),
    )
    for pin in ("crank_pin", "piston_pin"):
        own, shipped = (one.mechanism.joint(pin).contact for one in (changed, plain))
        assert own.friction == 0.2 != shipped.friction and own.restitution == shipped.restitution
    assert changed.simulate == plain.simulate


OTHER = """
crank: {length: 50 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 20 mm}
rod: {length: 200 mm, mass: 1 kg, inertia: 1e-3 kg*m^2, mass_centre: 60 mm}
slider: {mass: 2 kg}
joints: {crank_pin: ideal, piston_pin: ideal}
"""
HOLDING_IT = {
    "boxes": {"own": {"crank_length": ["49 mm", "51 mm"], "rod_length": ["198 mm", "202 mm"]}}
}


@pytest.fixture
def other(tmp_path):
    (tmp_path / "other.yaml").write_text(OTHER, encoding="utf-8")
    return tmp_path / "other.yaml"


def test_a_scenarios_mechanism_file_is_the_whole_mechanism(other):
    """Nothing of the mechanism beside the scenarios is left in it: offset, looseness, contacts,
    effects."""
    base = {
        "base": SHIPPED["mechanism"],
        "slider": {"offset": "20 mm"},
        "effects": [{"name": "gravity"}],
    }
    config = SHIPPED | {"mechanism": base, "run": ["own"]}
    for mechanism in ("other.yaml", yaml.safe_load(OTHER), {"base": "other.yaml"}):
        scenarios = {"own": {"mechanism": mechanism, "optimise": HOLDING_IT}}
        own = resolve(config | {"scenarios": scenarios}, (ROOT, other.parent))["own"].mechanism
        assert own == load_mechanism(other)
        assert (own.loose, own.contacts, own.effects, own.slider.offset) == ((), {}, (), 0.0)


def test_a_mechanism_file_may_be_laid_over_the_one_beside_it_and_a_base_that_is_none_is_refused(
    other,
):
    folder = other.parent
    (folder / "lower").mkdir()
    other.rename(folder / "lower/other.yaml")
    (folder / "lower/heavy.yaml").write_text(
        "base: other.yaml\nslider: {mass: 5 kg}\n", encoding="utf-8"
    )
    (folder / "both.yaml").write_text(
        "base: lower/heavy.yaml\nrod: {mass: 3 kg}\n", encoding="utf-8"
    )
    lowest, both = load_mechanism(folder / "lower/other.yaml"), load_mechanism(folder / "both.yaml")
    assert (both.slider.mass, both.rod.mass) == (5.0, 3.0)
    assert (both.crank, both.rod.length, both.joints) == (
        lowest.crank,
        lowest.rod.length,
        lowest.joints,
    )
    for one, base in (("one", "two"), ("two", "one")):
        (folder / f"{one}.yaml").write_text(f"base: {base}.yaml", encoding="utf-8")
    rows = """
    {slider: {mass: 1}} => key 'mechanism.crank' is missing; add it, or the key base, the path of
    {base: nowhere.yaml} => scenario own: mechanism.base: no file 'nowhere.yaml'
    {base: {slider: {}}} => mechanism.base =  ~ must be the path of a mechanism file
    {base: null} => mechanism.base = None: must be the path of a mechanism file
    one.yaml => two.yaml: base: 'one.yaml' is its own base
    """
    own = SHIPPED | {"run": ["own"]}
    refused(
        lambda given: resolve(own | {"scenarios": {"own": {"mechanism": given}}}, (ROOT, folder)),
        written(rows),
    )


def test_each_value_is_reported_with_the_file_that_it_is_written_in(other):
    folders = (ROOT, other.parent)
    own = {
        "mechanism": {"base": "other.yaml", "slider": {"offset": "1 mm"}},
        "simulate": {"speed": "9 rpm"},
    }
    lower = Layer("lower.yaml", SHIPPED | {"figures": {"magnification": 3}})
    files = [
        lower,
        Layer("mine.yaml", {"run": ["own"], "scenarios": {"own": own | {"optimise": HOLDING_IT}}}),
    ]
    scenario = resolve(merged(files), folders)["own"]
    told = {
        key: (source, value) for key, source, value in sources_of(scenario, "own", files, folders)
    }
    wanted = {
        "mechanism.slider.mass": (str(other), '"2 kg"'),
        "mechanism.slider.offset": ("mine.yaml, scenario own", '"1 mm"'),
        "simulate.speed": ("mine.yaml, scenario own", '"9 rpm"'),
        "simulate.revolutions": ("lower.yaml", "4"),
        "figures.magnification": ("lower.yaml", "3"),
        "mechanism.gravity_direction": ("default", str(-math.pi / 2)),
        "mechanism.joints.crank_pin": (str(other), '"ideal"'),
    }
    assert {key: told[key] for key in wanted} == wanted


MISTAKES = """
simulate: {sped: 3} => unknown key 'simulate.sped' ~ did you mean 'speed'
mechanism: {contacts: {steel: {frictoin: 0.1}}} => mechanism.contacts.steel.frictoin ~ did you mean 'friction'
mechanism: {crank: {mass: -350 g}} => mechanism.crank.mass = '-350 g', -0.35 in SI ~ greater than 0
mechanism: {crank: {mass_centre: -0.2 m}} => mass_centre -0.2 m ~ beyond the link's length
mechanism: {rod: {mass_centre_across: 1 mm}} => rod.mass_centre_across ~ only a crank's
mechanism: {crank: {length: 0.6 m}} => crank.length 0.6 m ~ cannot turn ~ shorten the crank
mechanism: {joints: {crank_pin: {journal_radius: 9 mm}}} => joints.crank_pin ~ journal_radius 0.009 m is not smaller
mechanism: {joints: {crank_pin: {contact: steal}}} => 'steal' ~ did you mean 'steel'
mechanism: {joints: {crank_pin: {journal: slider}}} => journal must be 'crank' or 'rod'
mechanism: {contacts: 7} => mechanism.contacts = 7: must be a mapping
mechanism: {effects: [{name: gravty}]} => mechanism.effects.0.name = 'gravty' ~ 'gravity'
optimise: {boxes: {paper: {crank_length: [153 mm, 147 mm]}}} => crank_length ~ wrong order
optimise: {rod_tolerance: 3} => optimise.rod_tolerance 3000 mm ~ tenth of the rod, 564 mm ~ 35 um
mechanism: {crank: {length: 100 mm}} => optimise.boxes (paper) ~ crank 100 mm and rod 564 mm ~ give bounds around
optimise: {window: [60 deg, 400 deg]} => exceeds the first revolution
optimise: {ensemble: {members: 1000000000}} => optimise.ensemble.members ~ must be less than or equal to 10000
simulate: {speed: 600 mm} => simulate.speed = '600 mm' ~ millimeter ~ rad/s
simulate: {speed: fast} => simulate.speed = 'fast' ~ not a number
simulate: {speed: true} => simulate.speed = True ~ must be a number
simulate: {speed: .inf} => simulate.speed = inf ~ finite
simulate: {speed: 1e400} => simulate.speed = '1e400' ~ finite
simulate: {speed: 10 Hz} => simulate.speed = '10 Hz' ~ write rpm, turn/s or rad/s
simulate: {revolutions: 6000} => revolutions 6000 times samples_per_revolution 3600 ~ 2e+07 samples
simulate: {revolutions: true} => simulate.revolutions = True ~ not true or false
simulate: {revolutions: 2} => settled_revolution 4 ~ simulate.revolutions
simulate: {samples_per_revolution: 720} => samples_per_revolution 720 ~ five times
study: {members: 4} => key 'study' was removed ~ design: grid
ensemble: {members: 4} => key 'ensemble' was removed ~ starts: 15
sweep: {number: 4, trajectories: [4]} => trajectories: there is no design 4; the last one is 3
surrogate: {hidden: [100, 100]} => surrogate ~ hidden [100, 100] has 10401 weights, more than 5000
surrogate: {seeds: [1, 1]} => seeds = [1, 1] ~ give each value once
surrogate: {clearance_sampling: 20} => surrogate.clearance_sampling ~ was removed; delete it
"""
WIDER = [
    ({"simulate": {"speed": 10**400}}, "simulate.speed = 1000 ~ too large for a number"),
    (
        {"sweep": {"number": 10_000_000, "starts": 2}},
        "10000000 designs with 2 start(s) each are more than 10000000 simulations",
    ),
    (
        {
            "simulate": {"tolerance": 6e-8},
            "mechanism": {"joints": {"piston_pin": {"bearing_radius": "7.5 mm"}}},
        },
        (
            "simulate.tolerance 6e-08 m ~ 0.0001 of the clearance 0.0005 m of piston_pin ~ at most"
            " 5e-08 m"
        ),
    ),
    (
        yaml.safe_load(
            "mechanism: {effects: [{name: slider_spring, parameters: {stiffness_N_m: -2 N/mm,"
            " rest_position_m: 0}}]}"
        ),
        "stiffness_N_m = '-2 N/mm', -2000 in SI ~ greater than or equal to 0",
    ),
]


def test_a_mistake_is_named_with_its_scenario_key_value_and_mend():
    refused(resolved, [*written(MISTAKES), *WIDER], starts="configuration, scenario paper: ")


def test_every_mistake_is_reported_together_and_one_in_a_shared_contact_once():
    for over, lines in (
        ({"simulate": {"samples_per_revolution": -1, "revolutions": 0}}, 2),
        ({"mechanism": {"contacts": {"steel": {"restitution": 1.4}}}}, 1),
    ):
        with pytest.raises(InputError) as caught:
            resolved(over)
        assert len(str(caught.value).splitlines()) == lines


def test_boxes_are_taken_away_by_null_and_are_five_percent_around_where_none_is_left():
    own = {"crank_length": ["145 mm", "155 mm"], "rod_length": ["560 mm", "570 mm"]}
    assert list(resolved({"optimise": {"boxes": {"paper": None, "own": own}}}).optimise.boxes) == [
        "own"
    ]
    searched = resolved({"optimise": {"boxes": {"paper": None}}}).optimise.boxes
    assert searched == {"own": Box(crank_length=(0.1425, 0.1575), rod_length=(0.5358, 0.5922))}
    rows = [
        ("wide (5 %)", "use letters"),
        ("..", "use letters"),
        ("", "1 character"),
        ("w" * 61, "60 letters"),
    ]
    refused(lambda name: resolved({"optimise": {"boxes": {name: own}}}), rows)


OWN = {"scenarios": {"mine": {"mechanism": "config/mechanisms/erkaya2009.yaml"}}}


def test_a_configuration_that_brings_its_scenarios_and_their_mechanisms_stands_alone():
    alone = [OWN, OWN | {"run": ["mine"]}, {"scenarios": {"mine": None}, "mechanism": "m.yaml"}]
    laid_over = [
        {"scenarios": {"mine": {"simulate": {}}}},  # of the shipped mechanism
        OWN | {"run": ["paper", "mine"]},
        {"simulate": {"speed": "300 rpm"}},
        {"campaigns": ["c.yaml"]},
        {},
    ]
    assert all(map(is_complete, alone)) and not any(map(is_complete, laid_over))
    mine = resolve(OWN, (ROOT,))["mine"]
    assert (mine.surrogate.iterations, mine.surrogate.seeds, mine.optimise.ratio_limit) == (
        300,
        (0,),
        None,
    )


def test_what_is_left_to_its_defaults_has_to_go_with_the_rest_where_all_is_asked_for():
    coarse, words = (
        OWN | {"simulate": {"samples_per_revolution": 100}},
        r"scenario mine: .*must be a multiple of",
    )
    with pytest.raises(InputError, match=words):
        resolve(coarse, (ROOT,))
    with pytest.raises(InputError, match=words):
        check_all_sections(resolve(coarse, (ROOT,), whole=False)["mine"], "mine")
    check_all_sections(resolve(OWN, (ROOT,), whole=False)["mine"], "mine")


def test_a_configuration_without_a_usable_scenario_is_refused():
    rows = """
    {run: [papr]} => did you mean 'paper'
    {scenarios: {}} => scenarios: must have at least 1 item
    {run: paper} => must be a list
    {run: [[paper]]} => run.0 =  ~ must be text
    {mechanism: nowhere.yaml} => no file 'nowhere.yaml'
    {run: [a/b], scenarios: {a/b: {}}} => name of files or folders
    {run: [campaigns], scenarios: {campaigns: {}}} => reserved for other results
    {run: [a], scenarios: {a: [1]}} => must be a mapping
    """
    long = ({"run": ["a" * 61], "scenarios": {"a" * 61: {}}}, "at most 60 letters, not 61")
    refused(lambda over: resolve(SHIPPED | over, (ROOT,)), [*written(rows), long])
    bare = [
        ({"scenarios": {"a": {}}}, "'mechanism' is missing"),
        ({"scenarios": {"a": 5}}, "must be a mapping"),
    ]
    refused(lambda config: resolve(config, (ROOT,)), bare)


def test_a_stage_is_given_what_it_reads_and_nothing_else():
    scenario = resolved({"mechanism": {"effects": [{"name": "gravity"}]}})

    def survives(stage):
        read_back = parse_options(STAGES[stage].options(scenario))
        for section in STAGES[stage].sections:
            assert getattr(read_back, section) == getattr(scenario, section)

    each(survives, sorted(STAGES))
    one, other = resolved({}), resolved({"optimise": {"ratio_limit": 0.2}})
    assert STAGES["simulate"].options(one) == STAGES["simulate"].options(other)
    assert STAGES["optimise"].options(one) != STAGES["optimise"].options(other)


def test_options_may_be_a_file_with_a_mechanism_beside_it_or_what_a_command_printed(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "mechanism: crank.yaml\nsimulate: {speed: 100 rpm}\n", encoding="utf-8"
    )
    (tmp_path / "crank.yaml").write_text(PAPER.read_text(), encoding="utf-8")
    assert parse_options(str(tmp_path / "mine.yaml")).simulate.speed == pytest.approx(
        100 * math.tau / 60
    )
    done = CliRunner().invoke(cli, ["config", str(ROOT / "config/sweep.yaml")])
    assert done.exit_code == 0
    assert json.loads(parse_options(done.stdout).model_dump_json(by_alias=True)) == json.loads(
        done.stdout
    )
    refused(
        parse_options,
        [('{"simulate": ', "--options"), ('{"simulate": {"speed": NaN}}', "--options")],
    )


def test_the_schema_is_the_stored_one_accepts_what_is_shipped_and_explains_every_key():
    stored = json.loads((ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8"))
    assert stored == json_schema(), (
        "run: jointgap schema --write workflow/schemas/config.schema.json"
    )
    validator = jsonschema.Draft202012Validator(stored)
    validator.validate(SHIPPED)
    validator.validate(yaml.safe_load((ROOT / "config/smoke.yaml").read_text(encoding="utf-8")))
    for wrong in ({"simulat": {}}, {"simulate": {"sped": 1}}):
        assert not validator.is_valid(SHIPPED | wrong)
    # the reference is made of the schema; a key without a description there is explained by hand
    text = (ROOT / "config/README.md").read_text(encoding="utf-8")
    sections = [stored, *stored["$defs"].values()]
    keys = [
        (name, key) for section in sections for name, key in section.get("properties", {}).items()
    ]
    says_itself = {"description", "$ref", "anyOf", "oneOf", "const"}
    without = {name for name, key in keys if not says_itself & key.keys()} - {
        "parameters",
        "site",
    }  # of effects
    assert [name for name in sorted(without) if not re.search(rf"`([\w.]+\.)?{name}`", text)] == []


def test_a_mechanism_that_comes_with_jointgap_is_named_from_every_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_mechanism("erkaya2009") == load_mechanism(PAPER)
    laid_over = resolve({"mechanism": {"base": "ideal_joints"}, "scenarios": {"mine": {}}})[
        "mine"
    ].mechanism
    assert laid_over == load_mechanism("ideal_joints")
    (tmp_path / "ideal_joints").write_text(PAPER.read_text(encoding="utf-8"))
    assert load_mechanism("ideal_joints") == load_mechanism(
        "erkaya2009"
    )  # a file goes before a name
    with pytest.raises(
        InputError, match=r"no file 'erkaya'.* or one of the names .*erkaya2009, ideal_joints"
    ):
        load_mechanism("erkaya")
