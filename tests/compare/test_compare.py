"""The comparison puts every printed number and claim beside ours, and judges by rules that are stated."""

import numpy as np
import pandas as pd
import pytest

from jointgap import tables
from jointgap.compare import html, markdown
from jointgap.compare.claims import _contact, _distinct, _superposed
from jointgap.compare.rows import FAILS, HOLDS, UNKNOWN, Row, claim
from jointgap.config import read_yaml, resolve
from jointgap.paper import OPTIMA, TRAINING_MSE
from jointgap.tables import OUTPUTS


@pytest.fixture(scope="module")
def scenario():
    return resolve(read_yaml("config/config.yaml"))["paper"]


def test_a_number_agrees_within_a_percent_and_says_its_ratio():
    assert Row("number", "x", "1", 2.0, 2.019, "").record() | {"ratio": 0} == {
        "kind": "number",
        "item": "x",
        "unit": "1",
        "paper": 2.0,
        "ours": 2.019,
        "ratio": 0,
        "verdict": "agrees",
        "sentence": "",
    }
    assert Row("number", "x", "1", 2.0, 2.021, "").record()["verdict"] == "differs"
    assert Row("number", "x", "1", 2.0, None, "").record()["verdict"] == UNKNOWN


def test_a_claim_holds_does_not_hold_or_cannot_be_told():
    verdicts = [claim("x", None, 1.0, "", holds, "").record()["verdict"] for holds in (True, False, None)]
    assert verdicts == [HOLDS, FAILS, UNKNOWN]


def test_the_printed_points_share_one_ratio_of_lengths_and_one_valley():
    ratios = [point.crank_length / point.rod_length for point in OPTIMA]
    assert max(ratios) - min(ratios) < 1.1e-5
    invariants = [(1 - point.reduction) * point.rod_length for point in OPTIMA]
    assert max(invariants) - min(invariants) < 6e-5


def test_an_mse_is_printed_for_each_of_the_eight_outputs():
    assert tuple(TRAINING_MSE) == OUTPUTS


def test_end_points_closer_than_a_micrometre_count_as_one():
    points = np.array([[0.15, 0.564], [0.15 + 5e-7, 0.564], [0.15, 0.5640021]])
    assert _distinct(points) == 2


def _revolution(scenario, **columns):
    turned = np.radians(np.arange(0.0, 360.1, 0.1))
    return pd.DataFrame({"crank_angle": turned} | {name: function(turned) for name, function in columns.items()})


def test_the_angle_at_which_contact_is_last_lost_is_found(scenario):
    first = _revolution(
        scenario,
        r2=lambda angle: np.where(angle < np.radians(20.05), 0.5e-3, 1.001e-3),
        r3=lambda angle: np.where(np.abs(angle - np.radians(100.0)) < np.radians(0.05), 0.9e-3, 1.001e-3),
        gamma2=lambda angle: angle + 0.3,
    )
    contact, follows = _contact(first, np.degrees(first["crank_angle"].to_numpy()), scenario)
    assert contact.ours == pytest.approx(100.0)
    assert contact.verdict == FAILS
    assert follows.verdict == HOLDS
    assert follows.ours == pytest.approx(1.0)


def test_a_piston_moved_by_both_clearances_is_seen_as_superposed_and_one_moved_by_neither_is_not(scenario):
    first = _revolution(
        scenario,
        r2=lambda angle: 1e-3 + 0 * angle,
        gamma2=lambda angle: angle,
        r3=lambda angle: 1e-3 + 0 * angle,
        gamma3=lambda angle: 2 * angle,
    )
    ideal = pd.DataFrame({"slider_position": np.zeros(len(first))})
    both = 1e-3 * (np.cos(first["crank_angle"]) - np.cos(2 * first["crank_angle"]))
    assert _superposed(first.assign(slider_position=both), ideal).ours == pytest.approx(1.0)
    neither = 1e-3 * np.sin(3 * first["crank_angle"])
    assert _superposed(first.assign(slider_position=neither), ideal).verdict == FAILS


def test_pages_hold_every_row_and_escape_what_is_not_text(scenario):
    rows = [Row("number", "a < b", "1", 1.0, 2.0, "because & so"), claim("c | d", None, None, "", None, "who knows")]
    comparison = pd.DataFrame([row.record() for row in rows])
    tables.to_arrow(tables.COMPARISON, comparison)
    page, text = html(comparison, scenario), markdown(comparison, scenario)
    assert "a &lt; b" in page
    assert "because &amp; so" in page
    assert "| c / d |" in text
    assert "of its other numbers 0 agree and 1 differ; of 1 claims 0 hold, 0 do not, and 1 cannot be told." in text
