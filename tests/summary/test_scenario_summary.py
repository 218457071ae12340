"""The page of an outcome answers with the numbers that somebody who designs a mechanism decides by."""

import json

import numpy as np
import pandas as pd
import pytest

from jointgap.config import resolve
from jointgap.report.page import to_html, to_markdown
from jointgap.summary.scenario_outcome import outcome
from jointgap.summary.scenario_page import document, headline, page
from jointgap.summary.scenario_remarks import remarks

SOURCES = ("networks", "clearance", "simulation", "simulation_settled")


def scenario(**optimise):
    """An own compressor, whose contact delivers another restitution than asked for."""
    mechanism = {
        "base": "config/mechanisms/compressor.yaml",
        "contacts": {"steel": {"law": "lankarani_nikravesh", "restitution": 0.5}},
    }
    box = {"crank_length": ["24 mm", "26 mm"], "rod_length": ["90 mm", "100 mm"]}
    options = {"boxes": {"within": box}, **optimise}
    return resolve({"scenarios": {"mine": {"mechanism": mechanism, "optimise": options}}})["mine"]


def frames(
    before=0.61, after=0.38, low=0.36, high=0.39, crank=0.026, bound="none", force=(400.0, 500.0), held_out=1e-8
):
    """Tables in which every source found the same lengths but for micrometres; angles in degrees."""
    points = {"original": (0.025, 0.095)} | {f"{source}_within_local": (crank, 0.0987) for source in SOURCES}
    optima, again, worth, loads = [], [], [], []
    for point, (crank_length, rod_length) in points.items():
        found, lengths = point != "original", {"crank_length": crank_length, "rod_length": rod_length}
        for source in SOURCES:
            optima.append({"source": source, "point": point, "active_bounds": bound} | lengths)
        for stretch in ("window", "settled"):
            for measure in ("rms", "mean_absolute", "peak"):
                worse = 1.001 if found and not point.startswith("simulation_settled") else 1.0
                sizes = {"original_error": np.radians(before), "error": np.radians(after if found else before) * worse}
                gain = {"reduction": 1 - after / before, "reduction_low": low, "reduction_high": high}
                more = {"frozen_reduction": 0.4, "share_better": 1.0, "members": 15}
                again.append({"point": point, "stretch": stretch, "measure": measure} | lengths | sizes | gain | more)
        for cycle in ("ideal", "simulated"):
            outer, inner = rod_length + crank_length, rod_length - crank_length
            places = {"stroke": outer - inner, "outer_dead_centre": outer, "inner_dead_centre": inner}
            worth.append({"point": point, "cycle": cycle, "smallest_transmission_angle": 1.3} | lengths | places)
        for joint in ("crank_pivot", "crank_pin", "piston_pin"):
            share = np.nan if joint == "crank_pivot" else 0.9
            numbers = {"peak_force": force[found], "rms_force": 100.0, "contact_share": share}
            loads.append({"point": point, "joint": joint} | lengths | numbers)
    errors = {"model": "network", "region": "all", "seed": 0, "training_mse": 1e-8, "held_out_mse": [held_out] * 8}
    names = ("optimise_optima", "optimise_resimulated", "optimise_worth", "optimise_loads", "fit_errors")
    return dict(zip(names, map(pd.DataFrame, (optima, again, worth, loads, errors)), strict=True))


def found(given=None, **optimise):
    return outcome(frames(**(given or {})), scenario(**optimise))


def test_the_headline_answers_in_numbers():
    assert headline(found()) == (
        "Crank 25.0 → 26.0 mm, rod 95.0 → 98.7 mm: RMS error of the transmission angle 0.610 → 0.380 deg, −37.7 % "
        "(−39.0 to −36.0 %), simulated again"
    )


def test_of_the_lengths_found_those_with_the_smallest_error_simulated_again_are_taken():
    assert found().source == "simulation_settled"
    assert found().stretch == "settled"
    assert found(window=["60 deg", "360 deg"]).stretch == "window"  # asked for, so it counts


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"low": -0.1, "high": 0.2}, "cannot be told from chance"),
        ({"low": -0.2, "high": -0.1, "after": 0.7}, "keep your own"),
        ({"bound": "crank length at its upper bound 26 mm"}, "move `optimise.boxes.within.crank_length`"),
        ({}, "The stroke changes by +2 mm (+4.0 %)"),
        ({}, "largest force in a pin grows from 400 to 500 N (+25 %)"),
        ({}, "Contact of the crank pin and piston pin: lankarani_nikravesh delivers a restitution of 0.7"),
        ({"held_out": 1e-6}, "8 of 8 networks do not know the motion between"),
    ],
)
def test_what_has_to_be_known_before_the_lengths_are_taken_over_is_remarked(given, words):
    assert any(words in remark for remark in remarks(found(given)))


def test_nothing_is_remarked_of_what_is_held_or_did_not_change():
    said = " ".join(remarks(found({"crank": 0.025, "force": (400.0, 401.0)})))
    assert "stroke" not in said and "force" not in said and "network" not in said and "bound" not in said
    kept = found({}, constraints={"stroke": ["49 mm", "53 mm"], "largest_pin_force": "600 N"})
    assert not any("constraints" in remark for remark in remarks(kept))


def test_a_largest_force_that_no_lengths_keep_is_told_with_the_nearest():
    over = found({}, constraints={"largest_pin_force": "450 N"})
    assert any("450 N at most; the nearest are shown, with 500 N" in remark for remark in remarks(over))
    text = to_markdown(page(over, "mine", ()))
    assert "| largest force in a pin | 450 N at most | 400 N | 500 N | no |" in text
    assert "no limit decides" not in text


def test_the_page_tells_lengths_gain_price_and_what_was_asked():
    outcome = found({}, constraints={"stroke": "52 mm"})
    text = to_markdown(page(outcome, "mine", remarks(outcome)))
    for line in (
        "| crank length \\[mm\\] | 25.0 | 26.0 | +1.000 | +4.00 | 24 to 26 |".replace("\\", ""),
        "| stroke without clearance [mm] | 50.0 | 52.0 | +2.0 | +4.0 |",
        "| largest force in the crank pin [N] | 400 | 500 | +100 | +25.0 |",
        "| share of time in contact, piston pin [%] | 90.0 | 90.0 | 0.0 | – |",
        "| stroke | 52 mm | 50 mm | 52 mm | yes |",
    ):
        assert line in text, line
    assert "paper" not in text.lower()
    assert "Crank 25.0 → 26.0 mm" in to_html(page(outcome, "mine", ()))


def test_programs_find_the_same_numbers():
    known = json.loads(json.dumps(document(found(), "mine", ("a remark",))))
    assert known["crank_length_mm"] == {"before": 25.0, "after": 26.0} and known["remarks"] == ["a remark"]
    assert known["reduction_percent"]["5_percent"] == pytest.approx(36.0)
