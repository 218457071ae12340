"""The one-page summary says what the verdict says, in words that someone understands who was not there."""

import re

import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.page import page
from jointgap.config.campaign import CHANNELS, NUISANCES
from jointgap.core.page import to_html, to_markdown
from jointgap.effects import EFFECTS
from jointgap.identification.fit import AT_BOUND, CHANGES_NOTHING
from jointgap.rig.sensors import FAULTS
from tests.campaign.verdicts import BIAS, COULOMB, NAMED, VERDICTS


def markdown(*given):
    return to_markdown(page(*given))


def html(*given):
    return to_html(page(*given))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_says_the_same_as_the_markdown(verdict):
    shown = html(VERDICTS[verdict], {}, ["A gap of 3 s in run slow."])
    for line in markdown(VERDICTS[verdict], {}, ["A gap of 3 s in run slow."]).splitlines():
        if line and line[0] not in "#!*|-":
            assert line.replace("'", "&#39;") in re.sub("</?code>", "`", shown)


def test_a_value_stands_with_its_unit_and_its_interval():
    assert "| force of friction | 21.30 N | 20.60 to 22.00 |" in markdown(NAMED, {})


def test_the_headline_holds_the_effect_its_number_and_the_interval():
    headlines = {name: page(verdict, {}).title for name, verdict in VERDICTS.items()}
    assert headlines["named"] == "Coulomb friction of the slider, 21.30 N (90 % interval 20.60 to 22.00)"
    assert headlines["ambiguous"] == "Something is missing: 2 explanations fit equally well"
    assert page(NAMED | {"effects": [COULOMB, BIAS]}, {}).title.endswith(
        "and a bias of the sensor of crank torque, 0.5000 N m (90 % interval 0.4970 to 0.5030)"
    )
    law = {"name": "discovered_slider_force", "site": "slider", "delta_bic": 9.0}
    formula = law | {"parameters": {"formula": {"value": "-a*v"}, "a": {"value": 2.0}}}
    assert page(NAMED | {"effects": [formula]}, {}).title.endswith("found by regression: -a*v")


CODE_NAMES = {name for name in (*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES, *VERDICTS) if "_" in name}


def code_names_in(text: str) -> set[str]:
    """Those that a reader sees outside of what is marked as code."""
    return {name for name in CODE_NAMES if re.search(rf"\b{name}\b", re.sub("`[^`]*`|<code>.*?</code>", "", text))}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_no_page_shows_the_name_of_an_effect_a_channel_or_a_parameter_as_the_code_has_it(verdict):
    remarks = ["sensor_bias:crank_torque may be at work: slider_acceleration reads 2 % too much, see encoder_zero."]
    nuisances = {key: {"value": 0.1, "sd": 0.002} for key in (*NUISANCES, "speed@slow", "first_angle@slow")}
    given = VERDICTS[verdict] | {"nuisances": nuisances, "because": "slider_spring explains 90 %"}
    text = to_html(page(given, {"detectable": EFFECTS_SEEN}, remarks)).partition("</style>")[2]
    assert code_names_in(text) == set()
    assert "a bias of the sensor of crank torque may be at work: slider acceleration reads" in text


def test_errors_stand_in_the_unit_of_each_channel_before_and_after():
    errors = pd.DataFrame(
        {"run": "fast", "speed": 41.8879, "channel": ["crank_torque", "crank_angle"], "held_out": True, "samples": 99}
        | {"unit": ["N*m", "deg"], "si_per_unit": [1.0, 0.0174533], "noise": [0.4, 0.1]}
        | {"before": [0.776, 0.1005], "after": [0.42, 0.0995]}
    )
    text = markdown(NAMED, {"channel_errors": errors})
    assert "| fast | 400 | yes | crank torque | N m | 0.4 | 0.776 | 0.42 |" in text
    assert "| fast | 400 | yes | crank angle | deg | 0.1 | 0.1005 | 0.0995 |" in text
    assert "| 0.776 |\n" in markdown(VERDICTS["no_disagreement"], {"channel_errors": errors})


def test_a_parameter_at_its_bound_is_called_so():
    lost = {"sd": None, "remark": "at its bound"}
    friction = COULOMB | {"parameters": {"force_N": {"value": 21.3, "interval_90": [None, None]} | lost}}
    text = markdown(NAMED | {"effects": [friction], "nuisances": {"slider_mass": {"value": 0.47} | lost}}, {})
    assert "| force of friction | 21.3 N | – | at its bound |" in text
    assert "| slider mass | 0.47 kg | – | at its bound |" in text


def test_a_formula_stands_as_it_is_with_its_coefficients():
    parameters = {"formula": {"value": "-a*v*|v|"}, "a": {"value": 1.25, "sd": 0.1, "interval_90": [1.09, 1.41]}}
    law = {"name": "discovered_slider_force", "site": "slider", "delta_bic": 99.0, "parameters": parameters}
    text = markdown(NAMED | {"effects": [law]}, {})
    assert "<td class='s'>-a*v*|v|</td>" in html(NAMED | {"effects": [law]}, {})
    assert r"| formula | -a\*v\*\|v\| | – |" in text
    assert "| a | 1.25 | 1.09 to 1.41 |" in text


@pytest.mark.parametrize(
    ("name", "parameter", "words", "shown"),
    [
        ("sensor_bias", "bias", "bias", "0.5000 N m | 0.4970 to 0.5030"),
        ("sensor_gain", "gain_error", "gain error", "0.5000 | 0.4970 to 0.5030"),
        ("sensor_lag", "lag_s", "lag", "0.5000 s | 0.4970 to 0.5030"),
        ("encoder_offset", "offset_rad", "offset", "28.65 deg | 28.48 to 28.82"),
    ],
)
def test_a_fault_of_a_sensor_stands_in_the_unit_of_its_channel(name, parameter, words, shown):
    fault = BIAS | {"name": name, "parameters": {parameter: BIAS["parameters"]["bias"]}}
    text = markdown(NAMED | {"effects": [fault]}, {})
    assert f"| {words} | {shown} |" in text
    assert "figures/missing_force.svg" not in text  # there is no force


def test_a_gap_far_below_1_is_commented_with_its_channel():
    def gaps(after: float) -> pd.DataFrame:
        keys = {"run": ["slow", "slow", "all"], "role": "confirm", "channel": ["guide_force", "crank_torque", "all"]}
        table = pd.DataFrame(keys | {"before": [3.0, 2.0, 2.5], "after": [after, 1.01, 0.9], "closed": 1.0})
        for when in ("before", "after"):
            table[f"{when}_low"], table[f"{when}_high"] = 0.97 * table[when], 1.03 * table[when]
        return table

    assert "The gap of guide force (slow 0.79) is far below 1" in markdown(NAMED, {"gaps": gaps(0.79)})
    assert "far below 1" not in markdown(NAMED, {"gaps": gaps(0.97)})


def test_a_gap_that_does_not_fall_is_not_called_a_fall():
    worse = NAMED | {"gap": {"identify": {"before": 4.0, "after": 1.1}, "confirm": {"before": 10.1, "after": 13.2}}}
    said = markdown(worse | {"held_out_test": "rises"}, {})
    assert "it rises from 10.10 to 13.20, so what was added does not hold there." in said


def test_a_run_that_was_used_for_both_is_called_weaker_evidence():
    listed = [{"run": "slow", "part": "last_third", "gap": {"before": 8.7, "after": 1.05}}]
    assert "last third of slow is held out" in markdown(NAMED | {"held_out": listed}, {})
    assert "last third" not in markdown(NAMED | {"held_out": [listed[0] | {"part": "whole"}]}, {})


def test_a_held_out_run_that_cannot_be_simulated_is_told_with_the_reason():
    lost = {"run": "fast", "part": "whole", "gap": {"before": 8.7, "after": None}, "not_simulated": "it flies off"}
    gaps = pd.DataFrame({"run": ["fast"], "role": "confirm", "channel": "all"})
    gaps = gaps.assign(before=8.7, before_low=8.0, before_high=9.0, after=np.nan, after_low=np.nan, after_high=np.nan)
    unknown = {"identify": {"before": 9.1, "after": 1.02}, "confirm": {"before": 8.7, "after": None}}
    text = markdown(NAMED | {"gap": unknown, "held_out": [lost]}, {"gaps": gaps})
    assert "it is 8.70 before anything is added. What was added cannot be simulated in run fast (it flies off)" in text
    assert "| fast | 8.7 | 8 | 9 | – | – | – |" in text


def test_the_explanations_that_cannot_be_told_apart_are_listed_with_the_experiment_that_would():
    text = markdown(VERDICTS["ambiguous"] | {"separated_by": "A run at 900 rpm would tell them apart."}, {})
    assert "- Coulomb friction of the slider (21.30 N)" in text
    assert "- a bias of the sensor of crank torque (0.5000 N m)" in text
    assert "A run at 900 rpm would tell them apart." in text


def test_the_largest_windows_come_first_and_the_rest_are_counted():
    rows = [("fast", "crank_torque", 10.0 * k, 10.0 * k + 10.0, 1.0 + k, 1.5 + k, 1e-3) for k in range(7)]
    rows.append(("slow", "crank_torque", 0.0, 360.0, 0.0, 9.0, 1e-3))
    columns = ["run", "channel", "start_deg", "end_deg", "mean", "rms", "p_adjusted"]
    text = markdown(NAMED, {"map_windows": pd.DataFrame(rows, columns=columns)})
    assert "| slow | crank torque | 0 | 360 | 0 | 9 |\n| fast | crank torque | 60 | 70 | 7 | 7.5 |" in text
    assert text.count("| fast | crank torque |") == 6  # the map shows all


def test_a_gain_that_is_not_known_is_called_so():
    text = markdown(NAMED | {"effects": [COULOMB | {"delta_bic": None}, BIAS]}, {})
    assert "Gain in BIC: not known for Coulomb friction of the slider and 40 for a bias of the sensor" in text


OPTIMUM = pd.DataFrame({"model": ["base", "augmented"], "source": "network", "reduction": [0.038, 0.05]}).assign(
    crank_length=[0.150, 0.1515], rod_length=0.564, failed=None, at_edge=[True, False], resimulated=[0.03, np.nan]
)


def test_optimal_lengths_stand_with_their_error_reduction_before_and_after():
    text = markdown(NAMED, {"campaign_optimum": OPTIMUM})
    assert "| before | network | 150 | 564 | 0.038 | 0.03 | yes | – |" in text
    assert "| after | network | 151.5 | 564 | 0.05 | – | no | – |" in text
    assert "Does it move the optimum" not in markdown(NAMED, {})
    assert "all joints are ideal" in markdown(NAMED, {"campaign_optimum": OPTIMUM.head(0)})
    assert "Before, all joints were ideal" in markdown(NAMED, {"campaign_optimum": OPTIMUM.tail(1)})
    lost = OPTIMUM.assign(failed=[None, "the slider jams"])
    assert "the slider jams" in markdown(NAMED, {"campaign_optimum": lost})


@pytest.mark.parametrize("verdict", [VERDICTS["unexplained"], NAMED | {"effects": [BIAS]}])
def test_no_optimum_moves_where_nothing_was_added(verdict):
    text = markdown(verdict, {"campaign_optimum": OPTIMUM.head(0)})
    assert "Nothing was added to the mechanism" in text
    assert "ideal" not in text


EFFECTS_SEEN = pd.DataFrame(
    [
        ("rod_flexibility", "frequency_Hz", 157.2, "Hz", True, True, None),
        ("slider_coulomb_friction", "force_N", 0.0787, "N", False, True, None),
        ("sensor_gain:crank_torque", "gain_error", 0.05, "1", False, True, None),
        ("crank_unbalance", "unbalance_kg_m", np.nan, "kg*m", False, False, None),
        ("gas_pressure", "force_N", np.nan, "N", False, False, "the slider jams"),
    ],
    columns=["label", "parameter", "smallest_detectable", "unit", "falls", "detectable", "failed"],
).assign(assumed="crank_torque in run slow: 0.0042 N*m, 2 % of what it varies by")


def test_what_would_have_been_seen_is_told_by_parameter_and_unit_in_the_direction_in_which_it_shows():
    text = markdown(VERDICTS["no_disagreement"], {"detectable": EFFECTS_SEEN})
    seen = (
        "bending of the rod (natural frequency of the mode up to 157.2 Hz), a wrong gain of the sensor of crank torque "
        "(0.05), Coulomb friction of the slider (0.0787 N)."
    )
    assert f"Smallest detectable sizes: {seen}" in text


def test_what_could_not_be_simulated_is_not_called_undetectable():
    verdict = NAMED | {"preflight": {"undetectable": ["crank_unbalance", "gas_pressure"], "merged": []}}
    text = markdown(verdict, {"detectable": EFFECTS_SEEN})
    assert "with these runs and channels: an unbalance of the crank.\n" in text
    assert "is not known: the pressure of a closed gas volume on the slider (the slider jams)." in text


def test_noise_that_was_assumed_for_what_could_be_seen_is_told():
    told = "assumed noise where the campaign states none"
    assert told in markdown(NAMED, {"detectable": EFFECTS_SEEN})
    assert "assumed noise" not in markdown(NAMED, {"detectable": EFFECTS_SEEN.assign(assumed="")})


def test_what_was_not_detectable_and_what_looks_alike_is_said():
    text = markdown(NAMED, {})
    assert "with these runs and channels: an unbalance of the crank" in text
    alike = "a bias of the sensor of crank torque and Coulomb friction of the crank"
    assert f"Cannot be told apart and count as one: {alike}" in text


def test_what_is_best_but_not_proven_stands_with_its_values_and_the_figures_show_it():
    best = {
        "effects": [COULOMB],
        "explained_share": 0.56,
        "gap": NAMED["gap"],
        "rival": {"explanation": "gravity", "behind": 432.4, "explained_share": 0.1},
    }
    verdict = VERDICTS["unexplained"] | {"best_known": best, "held_out_test": "falls"}
    gaps = pd.DataFrame({"run": ["fast"], "role": "confirm", "channel": "all"})
    gaps = gaps.assign(before=8.7, before_low=8.0, before_high=9.0, after=1.05, after_low=1.0, after_high=1.1)
    text = markdown(verdict, {"gaps": gaps})
    assert "| force of friction | 21.30 N | 20.60 to 22.00 |" in text
    assert "- To prove it: " in text
    assert "figures/residuals.svg" in text


def test_re_fitted_parameters_are_shown_with_their_intervals_and_one_sided_ones_with_the_bound():
    nuisances = {
        "slider_mass": {"value": 0.447, "sd": 0.002, "interval_90": [0.4437, 0.4503]},
        "speed@slow": {"value": 20.9, "sd": None, "interval_90": [None, None], "remark": CHANGES_NOTHING},
        "restitution": {"value": 0.9, "sd": None, "interval_90": [0.82, 0.9], "remark": AT_BOUND},
    }
    text = markdown(NAMED | {"nuisances": nuisances}, {})
    assert "| parameter | value | 90 % interval |" in text
    assert "| slider mass | 0.4470 kg | 0.4437 to 0.4503 |" in text
    assert "| crank speed of run slow | 199.6 rpm | – | changes nothing in what was measured |" in text
    assert "| coefficient of restitution of both pins | 0.900 | 0.820 to 0.900 | at its bound |" in text


def test_a_listed_parameter_at_its_bound_is_pointed_out_and_one_of_every_fit_is_not():
    at_bound = {"value": 0.9, "sd": None, "interval_90": [0.82, 0.9], "remark": AT_BOUND}
    assert "Check each value at its bound" in markdown(NAMED | {"nuisances": {"restitution": at_bound}}, {})
    text = markdown(NAMED | {"nuisances": {"friction_speed": at_bound}}, {})
    assert "at its bound" in text
    assert "Check each value" not in text


def test_what_is_among_the_explanations_is_not_said_to_be_undetectable():
    preflight = {"undetectable": ["slider_coulomb_friction", "crank_unbalance"], "merged": []}
    text = markdown(NAMED | {"preflight": preflight}, {})
    assert "with these runs and channels: an unbalance of the crank." in text


def test_the_headline_says_where_intervals_are_widened_for_what_is_left():
    left = VERDICTS["named_with_remaining_misfit"] | {"interval_factor": 1.84}
    assert page(left, {}).title.endswith("; the residual exceeds noise, so intervals are 1.8 times as wide")
    assert "exceeds noise" not in page(NAMED | {"interval_factor": 1.02}, {}).title


def test_the_page_says_which_parameters_keep_their_stated_value():
    kept = {"value": 0.795, "sd": None, "interval_90": [0.713, 0.795], "remark": AT_BOUND, "kept": True}
    text = markdown(NAMED | {"nuisances": {"restitution": kept, "friction_speed": kept}}, {})  # that one nobody stated
    assert "| 0.795 | 0.713 to 0.795 | at its bound; stated value kept |" in text
    assert text.count("stated value kept") == 1
