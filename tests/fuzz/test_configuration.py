"""Damaged configurations end with one error or work; quantities agree in every unit."""

import json
from pathlib import Path

import pint
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from jointgap.config import Scenario, read_yaml
from tests.config.mechanisms import PAPER
from tests.fuzz.command import damaged, fuzz, replaced, works_or_is_refused

pytestmark = pytest.mark.slow

FRICTION = {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.0}}
GOOD = {
    "mechanism": read_yaml(PAPER) | {"effects": [FRICTION]},
    "simulate": {"speed": "300 rpm", "revolutions": 4, "tolerance": "1e-8 m"},
    "optimise": {"genetic": {"population": 8, "generations": 2}},
    "sweep": {
        "number": 8,
        "parameters": {"clearance": {"from": "0.1 mm", "to": "1 mm"}, "friction": [0, 0.1]},
    },
    "scenarios": {
        "one": {"description": "one sentence"},
        "two": {"simulate": {"speed": "400 rpm"}},
    },
    "run": ["one", "two"],
}
UNITS = {
    ("mechanism", "crank", "length"): ("m", ["mm", "cm", "m", "inch"]),
    ("mechanism", "slider", "mass"): ("kg", ["g", "kg", "lb"]),
    ("mechanism", "contacts", "steel", "youngs_modulus"): ("Pa", ["GPa", "MPa", "Pa"]),
    ("simulate", "speed"): ("rad/s", ["rpm", "rad/s", "deg/s"]),
}
units = pint.UnitRegistry()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("configuration") / "mine.yaml"


def read(file: Path, content: str | bytes) -> dict | None:
    """Output of `jointgap config`, which can be read again; None if the file is refused."""
    file.write_bytes(
        content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    )
    output = works_or_is_refused(file, "config", file)
    assert list(file.parent.iterdir()) == [file]
    if output is None:
        return None
    scenario = Scenario.model_validate_json(output)
    assert json.loads(scenario.model_dump_json(by_alias=True)) == json.loads(output)
    return json.loads(output)


@settings(fuzz, max_examples=200)
@given(damaged(GOOD) | st.binary(max_size=200))
def test_a_damaged_configuration_works_or_is_refused(file, content):
    assert read(file, yaml.safe_dump(GOOD)) is not None
    read(file, content)


@fuzz
@given(st.data())
def test_a_quantity_is_converted_or_out_of_range(file, data):
    path = data.draw(st.sampled_from(sorted(UNITS)))
    si, written = UNITS[path]
    number, unit = data.draw(st.floats(1e-3, 1e3)), data.draw(st.sampled_from(written))
    held = read(file, yaml.safe_dump(replaced(GOOD | {"run": ["one"]}, path, f"{number!r} {unit}")))
    if held is not None:
        for key in path:
            held = held[key]
        assert held == pytest.approx(units.Quantity(number, unit).to(si).magnitude, rel=1e-12)
