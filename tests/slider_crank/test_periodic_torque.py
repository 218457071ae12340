"""A torque on the crank at a high order is found with its order, named, and told where it shows."""

import math

import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.page import page
from jointgap.core.page import to_markdown
from tests.slider_crank.campaigns import with_hidden


@pytest.mark.integration
def test_it_is_named_with_its_order_its_size_and_its_phase_and_the_page_tells_where_it_shows(tmp_path):
    hidden = {"name": "crank_periodic_torque", "parameters": {"torque_N_m": 0.35, "order": 12, "phase_rad": 0.7}}
    verdict = analyse(with_hidden(tmp_path, hidden), tmp_path / "results")
    (effect,) = verdict["effects"]
    assert (verdict["verdict"], effect["name"]) == ("named", hidden["name"])
    found = {name: estimate["value"] for name, estimate in effect["parameters"].items()}
    low, high = effect["parameters"]["torque_N_m"]["interval_90"]
    assert low < 0.35 < high and high - low < 0.1
    assert found["order"] == 12 and math.cos(found["phase_rad"] - 0.7) > 0.99
    (written,) = yaml.safe_load((tmp_path / "results" / "mechanism.yaml").read_text())["effects"]
    assert written["parameters"]["order"] == 12

    lines = [line for line in verdict["orders"] if line["channel"] == "crank_torque"]
    assert [(line["run"], line["order"], line["unit"]) for line in lines] == [(r, 12, "N*m") for r in ("slow", "mid")]
    assert [line["amplitude"] for line in lines] == pytest.approx([0.35] * 2, rel=0.1)
    assert "| slow | crank torque | 12 | 0.3" in to_markdown(page(verdict, {}))
