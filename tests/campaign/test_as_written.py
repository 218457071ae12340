"""A mechanism with the found effects is written in the style of its user."""

from pathlib import Path

import yaml

from jointgap.campaign.augment import in_file_convention
from jointgap.config import Mechanism
from jointgap.config.load import load_mechanism, validate
from jointgap.config.yaml_files import read_yaml

FILE = Path("config/mechanisms/ideal_joints.yaml")
MECHANISM = load_mechanism(FILE)
OLD = MECHANISM.model_dump(mode="json")


def written(mechanism: Mechanism, text=None) -> dict:
    given = {} if text is None else {"text": text}
    return yaml.safe_load(
        yaml.safe_dump(in_file_convention(mechanism.model_dump(mode="json"), OLD, **given))
    )


def heavier(mass: float) -> Mechanism:
    return MECHANISM.model_copy(
        update={"slider": MECHANISM.slider.model_copy(update={"mass": mass})}
    )


def test_unchanged_values_and_units_stay_as_written():
    text = read_yaml(FILE)
    content = written(heavier(0.45294869418420297), text)
    assert content == text | {"slider": {"mass": "0.4529487 kg", "offset": "0 mm"}}
    text = text | {"slider": {"mass": "448.2 g", "offset": "0 mm"}}
    assert written(heavier(0.45294869418420297), text)["slider"]["mass"] == "452.9487 g"
    assert validate(Mechanism, written(MECHANISM, read_yaml(FILE)), "here") == MECHANISM
    assert validate(Mechanism, written(MECHANISM), "here") == MECHANISM
    found = validate(Mechanism, written(heavier(0.45294869418420297), read_yaml(FILE)), "here")
    assert found == heavier(0.4529487)


def test_a_found_effect_is_added_to_those_of_the_user():
    weight = {"name": "gravity", "parameters": {"acceleration_m_s2": "9.81 m/s^2"}}
    friction = {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.934212578413444}}
    text = read_yaml(FILE) | {"effects": [weight]}
    before = validate(Mechanism, text, "here")
    after = validate(Mechanism, text | {"effects": [weight, friction]}, "here")
    content = in_file_convention(
        after.model_dump(mode="json"), before.model_dump(mode="json"), text
    )
    assert content["effects"] == [weight, friction | {"parameters": {"force_N": 5.934213}}]
