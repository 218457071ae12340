"""The chosen lengths, their numbers and remarks, and the summary page."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest

from jointgap.config import resolve
from jointgap.core.page import to_markdown
from jointgap.lengths.region import regions
from jointgap.scenario.chosen_lengths import choose_lengths, details, document, headline, remarks
from jointgap.scenario.summary_page import page

SOURCES = ("networks", "simulation", "simulation_settled")


def scenario(**optimise):
    """A compressor whose contact law gives another restitution than the configured one."""
    contact = {"law": "lankarani_nikravesh", "restitution": 0.5}
    mechanism = {"base": "config/mechanisms/compressor.yaml", "contacts": {"steel": contact}}
    box = {"crank_length": ["24 mm", "26 mm"], "rod_length": ["90 mm", "100 mm"]}
    options = {"boxes": {"within": box}, **optimise}
    return resolve({"scenarios": {"mine": {"mechanism": mechanism, "optimise": options}}})["mine"]


def tables(
    after=0.38,  # RMS error at the chosen lengths [deg]; 0.61 at the original ones
    reductions=(0.36, 0.39),  # 5 % and 95 % quantile
    crank=0.026,
    bound="none",
    peak_factor=1.0,  # of the peak error at the chosen lengths
    forces=(400.0, 500.0),  # before and after [N]
    held_out=1e-8,
    rod_deviation_allowed=1e-3,
    others=(1.001, 0.0987),  # factor on the error, and rod length, of the other sources
    floor=(0.37, 0.38),  # reductions along the valley
):
    """Tables of an optimisation by three sources."""
    box = "own" if crank == 0.025 else "within"
    points = {f"{source}_{box}_local": (crank, others[1]) for source in SOURCES}
    points |= {"original": (0.025, 0.095), f"simulation_settled_{box}_local": (crank, 0.0987)}
    rows = {name: [] for name in ("optima", "floor", "resimulated", "worth", "loads")}
    for point, (crank_length, rod_length) in points.items():
        is_original = point == "original"
        lengths = {"point": point, "crank_length": crank_length, "rod_length": rod_length}
        optimum = lengths | {"rms": 0.01}
        optimum |= {"method": "original" if is_original else "local", "active_bounds": bound}
        optimum["rod_deviation_allowed"] = rod_deviation_allowed
        rows["optima"] += [optimum | {"source": source} for source in SOURCES]
        gain = lengths | {"frozen_reduction": 0.4, "share_better": 1.0, "members": 15}
        gain |= {"reduction": 1 - after / 0.61, "original_error": np.radians(0.61)}
        gain |= {"reduction_low": reductions[0], "reduction_high": reductions[1]}
        for stretch, measure in itertools.product(
            ("window", "settled"), ("rms", "mean_absolute", "peak")
        ):
            error = np.radians(0.61 if is_original else after)
            error *= 1.0 if is_original or "settled" in point else others[0]
            error *= peak_factor if measure == "peak" and not is_original else 1.0
            rows["resimulated"].append(
                gain | {"stretch": stretch, "measure": measure, "error": error}
            )
        cycle = lengths | {"stroke": 2 * crank_length, "smallest_transmission_angle": 1.3}
        cycle |= {"outer_dead_centre": rod_length + crank_length}
        cycle |= {"inner_dead_centre": rod_length - crank_length}
        rows["worth"] += [cycle | {"cycle": name} for name in ("ideal", "simulated")]
        load = lengths | {"peak_force": forces[not is_original], "rms_force": 100.0}
        load["peak_angle"] = np.radians(30.0 if is_original else 35.0)
        for joint, share in (("crank_pivot", np.nan), ("crank_pin", 0.9), ("piston_pin", 0.9)):
            rows["loads"].append(load | {"joint": joint, "contact_share": share})
    for source, reduction in itertools.product(SOURCES, floor):
        valley = {"source": source, "box": box, "measure": "rms", "ratio": 0.2634}
        rows["floor"].append(valley | {"reduction": reduction})
    errors = {"region": "all", "seed": 0, "training_mse": 1e-8}
    errors["model"] = ["network"] * 8 + ["regularised"] * 8
    errors["held_out_mse"] = [held_out] * 8 + [1.5e-8] * 7 + [1e-7]
    frames = {f"optimise_{name}": pd.DataFrame(entries) for name, entries in rows.items()}
    return frames | {"fit_errors": pd.DataFrame(errors)}


def chosen(optimise=None, **result):
    return choose_lengths(tables(**result), scenario(**(optimise or {})))


def text_of(lengths):
    return to_markdown(page(lengths, "mine"))


def document_of(lengths):
    return json.loads(json.dumps(document(lengths, "mine"), allow_nan=False))


KEEPS_CRANK = {"boxes": {"within": None}}


def test_the_headline_has_lengths_and_change_of_the_objective():
    change = "error of the transmission angle 37.7 % smaller"
    assert headline(chosen()) == f"Crank 26.00 mm, rod 98.70 mm: {change}"
    assert headline(chosen(reductions=(-0.1, 0.39))).endswith("(not significant)")
    assert details(chosen()) == (
        "Simulated again, RMS error of the transmission angle over a settled revolution: 0.61 →"
        " 0.38 deg (-39.0 to -36.0 % over the starts). Crank length 25.000 → 26.000 mm; rod length"
        " 95.000 → 98.700 mm; crank over rod 0.2632 → 0.2634."
    )


@pytest.mark.parametrize(
    "constraints, crank",
    [
        ({}, 0.025),
        ({"stroke": "51 mm"}, 0.0255),
        ({"inner_dead_centre": "69.6 mm", "outer_dead_centre": "120.6 mm"}, 0.0255),
        ({"outer_dead_centre": "121 mm"}, 0.025),
    ],
)
def test_without_boxes_the_stroke_sets_the_crank_length(constraints, crank):
    options = scenario(**KEEPS_CRANK, constraints=constraints).optimise
    (region,) = regions(scenario().mechanism.applied(), options).values()
    projected = region.project([[0.024, 0.09], [0.026, 0.099]])
    assert projected[:, 0] == pytest.approx(crank, abs=1e-7)


def test_the_smallest_resimulated_error_is_chosen_or_within_a_percent_the_smallest_change():
    best = chosen()
    assert (best.row["source"], best.stretch) == ("simulation_settled", "settled")
    assert chosen({"window": ["60 deg", "360 deg"]}).stretch == "window"
    assert chosen(others=(1.009, 0.0951)).lengths == (0.026, 0.0951)
    assert chosen(others=(1.011, 0.0951)).lengths == (0.026, 0.0987)


@pytest.mark.parametrize(
    "result, text",
    [
        ({"reductions": (-0.1, 0.2)}, "not significant"),
        ({"reductions": (-0.2, -0.1), "after": 0.7}, "keep the original lengths"),
        (
            {"bound": "crank length at its upper bound 26 mm"},
            "widen `optimise.boxes.within.crank_length`",
        ),
        ({}, "The stroke changes by +2 mm (+4.0 %)"),
        ({}, "largest force in a pin grows from 400 to 500 N (+25 %)"),
        ({}, "Contact of the crank pin and piston pin: you asked for a restitution of"),
        (
            {"peak_factor": 2.0},
            "peak error of the transmission angle grows from 0.61 to 0.76 deg (+25 %)",
        ),
        ({"rod_deviation_allowed": 5e-6}, "within ±5.0 µm"),
        ({"held_out": 1e-6}, "8 of 8 networks overfit"),
        ({"held_out": 1e-6}, "7 of 8 regularised networks do not"),
    ],
)
def test_remarks_name_what_a_designer_checks_first(result, text):
    assert any(text in remark for remark in remarks(chosen(**result)))


def test_a_result_without_side_effects_and_active_bounds_has_no_remarks_on_them():
    text = " ".join(remarks(chosen(KEEPS_CRANK, crank=0.025, forces=(400.0, 401.0))))
    for word in ("stroke", "force", "network", "limits the result", "peak"):
        assert word not in text


def test_where_no_lengths_keep_the_force_limit_the_smallest_force_comes_first():
    infeasible = chosen({"constraints": {"largest_pin_force": "450 N"}})
    title = (
        "No lengths within the bounds keep the pin force below 450 N (least: 500 N at crank 26.00"
        " mm, rod 98.70 mm)"
    )
    advice = "Allow a force above 500 N, or widen `optimise.boxes.within`."
    assert headline(infeasible) == title and remarks(infeasible)[0] == advice
    text = text_of(infeasible)
    assert text.startswith(f"# Scenario mine: {title}\n")
    assert "| largest force in a pin | 450 N at most | 400 N | 500 N | no |" in text
    for word in ("No bound is active", "Gain", "smaller", "larger", "valley"):
        assert word not in text
    content = document_of(infeasible)
    assert (content["status"], content["headline"]) == ("infeasible", title)
    smallest = {"limit_N": 450.0, "force_N": 500.0, "crank_length_mm": 26.0, "rod_length_mm": 98.7}
    assert content["smallest_force"] == pytest.approx(smallest)
    assert content["crank_length_mm"] == {"before": 25.0, "after": None}
    assert set(content["reduction_percent"].values()) == {None}
    assert content["largest_force_N"]["crank_pin"]["after_at_deg"] is None


@pytest.mark.parametrize(
    "force, status, is_converged",  # 450 N are allowed; searches tolerate 0.5 % more
    [(440.0, "not converged", False), (451.0, "infeasible", True)],
)
def test_lengths_with_the_smallest_force_are_no_optimum(force, status, is_converged):
    frames = tables(forces=(400.0, force))
    for frame in frames.values():
        if "point" in frame:
            points = {"simulation_settled_within_local": "least_force_within"}
            frame["point"] = frame["point"].replace(points)
    optima = frames["optimise_optima"].query("point in ('original', 'least_force_within')").copy()
    optima.loc[optima["point"] == "least_force_within", "method"] = "least_force"
    frames["optimise_optima"] = optima
    frames["optimise_floor"] = frames["optimise_floor"].iloc[:0]
    infeasible = choose_lengths(frames, scenario(constraints={"largest_pin_force": "450 N"}))
    content = document_of(infeasible)
    assert (content["status"], content["found_on"]) == (status, None)
    assert ("did not converge" not in " ".join(remarks(infeasible))) == is_converged
    text = text_of(infeasible)
    assert "Motion used by the search: simulation" not in text
    assert "No bound is active" not in text
    is_met = "no" if is_converged else "yes"
    row = f"| largest force in a pin | 450 N at most | 400 N | {force:.0f} N | {is_met} |"
    assert row in text


def test_the_page_has_lengths_gain_side_effects_and_constraints():
    text = text_of(chosen({"constraints": {"stroke": "52 mm"}}))
    for line in (
        "| crank length | mm | 25.000 | 26.000 | +1.000 | +4.00 |",
        "| rod length | mm | 95.000 | 98.700 | +3.700 | +3.89 |",
        "| largest force, crank pin | N | 400 | 500 | +100 | +25.00 |",
        "| share of time in contact, piston pin | % | 90 | 90 | +0 | – |",
        "| stroke | 52 mm | 50 mm | 52 mm | yes |",
        "crank fixed, rod 90 to 100 mm",
        "Motion used by the search: simulation, a settled revolution.",
    ):
        assert line in text, line
    assert "all these pairs are equivalent" in text_of(chosen(floor=(0.37, 0.38)))
    assert "all these pairs are equivalent" not in text_of(chosen(floor=(0.1, 0.38)))


def test_a_crank_that_keeps_its_length_was_not_searched_and_equal_ends_are_no_interval():
    kept = chosen(KEEPS_CRANK, crank=0.025, reductions=(0.3768, 0.3772), floor=(0.3768, 0.3772))
    text = text_of(kept)
    assert "| crank length | mm | 25.000 | 25.000 | +0.000 | +0.00 |" in text
    assert "crank fixed, rod 90.25 to 99.75 mm" in text
    assert "-37.7 to -37.7" not in text and "0.26340 to 0.26340" not in text
    narrowed = chosen({"constraints": {"stroke": ["49 mm", "50.5 mm"]}})
    assert "crank 24.5 to 25.25 mm" in text_of(narrowed)


def test_the_document_has_the_numbers_of_the_page_under_stable_keys():
    content = document_of(chosen())
    assert content["crank_length_mm"] == {"before": 25.0, "after": 26.0}
    assert content["reduction_percent"]["5_percent"] == pytest.approx(36.0)
    force = content["largest_force_N"]["crank_pin"]
    assert force == pytest.approx({"before": 400.0, "after": 500.0, "after_at_deg": 35.0})
    assert content["remarks"] == list(remarks(chosen()))


@pytest.mark.parametrize(
    "angle, text", [(np.inf, "All samples"), (np.radians(66.0), "up to 66 deg after the start")]
)
def test_the_page_says_up_to_which_crank_angle_samples_repeat(angle, text):
    assert text in to_markdown(page(chosen(), "mine", angle))
