"""A torque on the crank at a high order is found with its order, named, and told where it shows."""

import math

import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.page import page
from jointgap.core.page import to_markdown
from tests.slider_crank.test_library import written_campaign


@pytest.fixture(scope="module")
def verdict(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ripple")
    hidden = {"name": "crank_periodic_torque", "parameters": {"torque_N_m": 0.35, "order": 12, "phase_rad": 0.7}}
    return analyse(written_campaign(folder, hidden), folder / "results"), folder / "results"


def test_it_is_named_with_its_order_its_size_and_its_phase(verdict):
    content, results = verdict
    assert content["verdict"] == "named"
    (effect,) = content["effects"]
    assert effect["name"] == "crank_periodic_torque"
    found = {name: estimate["value"] for name, estimate in effect["parameters"].items()}
    assert found["order"] == 12
    low, high = effect["parameters"]["torque_N_m"]["interval_90"]
    assert low < 0.35 < high and high - low < 0.1
    assert math.cos(found["phase_rad"] - 0.7) > 0.99
    (written,) = yaml.safe_load((results / "mechanism.yaml").read_text())["effects"]
    assert written["parameters"]["order"] == 12


def test_the_order_the_amplitude_and_the_channel_are_told(verdict):
    content, _ = verdict
    lines = [line for line in content["orders"] if line["channel"] == "crank_torque"]
    assert {line["run"] for line in lines} == {"slow", "mid"}
    for line in lines:
        assert line["order"] == 12
        assert line["unit"] == "N*m"
        assert line["amplitude"] == pytest.approx(0.35, rel=0.1)


def test_the_page_shows_it(verdict):
    content, _ = verdict
    text = to_markdown(page(content, {}))
    assert "| slow | crank torque | 12 | 0.3" in text
