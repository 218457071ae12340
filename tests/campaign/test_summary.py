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
from tests.catalogue import each


def markdown(verdict=NAMED, tables=None, *given):
    return to_markdown(page(verdict, tables or {}, *given))


def effects(*found):
    return NAMED | {"effects": list(found)}


def nuisances(**values):
    return NAMED | {"nuisances": values}


def bounded(value, low, **more):
    return {"value": value, "sd": None, "interval_90": [low, value], "remark": AT_BOUND} | more


def law(formula, **coefficients):
    named = {"name": "discovered_slider_force", "site": "slider", "delta_bic": 99.0}
    return named | {"parameters": {"formula": {"value": formula}} | coefficients}


def gaps(rows, columns=("run", "channel", "before", "after")):
    table = pd.DataFrame(rows, columns=columns).assign(role="confirm", closed=1.0)
    for when in ("before", "after"):
        table[f"{when}_low"], table[f"{when}_high"] = 0.97 * table[when], 1.03 * table[when]
    return {"gaps": table}


def best_known():
    rival = {"explanation": "gravity", "behind": 432.4, "explained_share": 0.1}
    best = {"effects": [COULOMB], "explained_share": 0.56, "gap": NAMED["gap"], "rival": rival}
    return VERDICTS["unexplained"] | {"best_known": best, "held_out_test": "falls"}


def undetectable(*names):
    return NAMED | {"preflight": {"undetectable": list(names), "merged": []}}


SEEN = pd.DataFrame(
    [
        ("rod_flexibility", "frequency_Hz", 157.2, "Hz", True, True, None),
        ("slider_coulomb_friction", "force_N", 0.0787, "N", False, True, None),
        ("sensor_gain:crank_torque", "gain_error", 0.05, "1", False, True, None),
        ("crank_unbalance", "unbalance_kg_m", np.nan, "kg*m", False, False, None),
        ("gas_pressure", "force_N", np.nan, "N", False, False, "the slider jams"),
    ],
    columns=["label", "parameter", "smallest_detectable", "unit", "falls", "detectable", "failed"],
).assign(assumed="crank_torque in run slow: 0.0042 N*m, 2 % of what it varies by")
OPTIMUM = pd.DataFrame({"model": ["base", "augmented"], "source": "network", "reduction": [0.038, 0.05]}).assign(
    crank_length=[0.150, 0.1515], rod_length=0.564, failed=None, at_edge=[True, False], resimulated=[0.03, np.nan]
)
ERRORS = pd.DataFrame(
    {"run": "fast", "speed": 41.8879, "channel": ["crank_torque", "crank_angle"], "held_out": True, "samples": 99}
    | {"unit": ["N*m", "deg"], "si_per_unit": [1.0, 0.0174533], "noise": [0.4, 0.1]}
    | {"before": [0.776, 0.1005], "after": [0.42, 0.0995]}
)
WORSE = NAMED | {"gap": {"identify": {"before": 4.0, "after": 1.1}, "confirm": {"before": 10.1, "after": 13.2}}}
HELD = [{"run": "slow", "part": "last_third", "gap": {"before": 8.7, "after": 1.05}}]
LOST = {"run": "fast", "part": "whole", "gap": {"before": 8.7, "after": None}, "not_simulated": "it flies off"}
UNKNOWN = {"identify": {"before": 9.1, "after": 1.02}, "confirm": {"before": 8.7, "after": None}}
LOSING = NAMED | {"gap": UNKNOWN, "held_out": [LOST]}
FAST = [("fast", "all", 8.7, 1.05)]
SMALL = [("slow", "guide_force", 3.0, 0.79), ("slow", "crank_torque", 2.0, 1.01), ("all", "all", 2.5, 0.9)]
NONE_ADDED = {"campaign_optimum": OPTIMUM.head(0)}
AMBIGUOUS = VERDICTS["ambiguous"] | {"separated_by": "A run at 900 rpm would tell them apart."}
COULOMB_AT_BOUND = COULOMB | {"parameters": {"force_N": bounded(21.3, None, interval_90=[None, None])}}
COEFFICIENT = {"value": 1.25, "sd": 0.1, "interval_90": [1.09, 1.41]}
MASS = {"value": 0.447, "sd": 0.002, "interval_90": [0.4437, 0.4503]}
FLAT = {"value": 20.9, "sd": None, "interval_90": [None, None], "remark": CHANGES_NOTHING}
KEPT = bounded(0.795, 0.713, kept=True)
ALIKE = "a bias of the sensor of crank torque and Coulomb friction of the crank"
SMALLEST = (
    "bending of the rod (natural frequency of the mode up to 157.2 Hz), a wrong gain of the sensor of crank torque "
    "(0.05), Coulomb friction of the slider (0.0787 N)."
)
SAYS = [  # verdict, tables, what the page says
    (NAMED, {}, "| force of friction | 21.30 N | 20.60 to 22.00 |"),
    (NAMED, {"channel_errors": ERRORS}, "| fast | 400 | yes | crank torque | N m | 0.4 | 0.776 | 0.42 |"),
    (NAMED, {"channel_errors": ERRORS}, "| fast | 400 | yes | crank angle | deg | 0.1 | 0.1005 | 0.0995 |"),
    (VERDICTS["no_disagreement"], {"channel_errors": ERRORS}, "| 0.776 |\n"),
    (effects(COULOMB_AT_BOUND), {}, "| force of friction | 21.3 N | – | at its bound |"),
    (effects(law("-a*v*|v|", a=COEFFICIENT)), {}, r"| formula | -a\*v\*\|v\| | – |"),
    (effects(law("-a*v*|v|", a=COEFFICIENT)), {}, "| a | 1.25 | 1.09 to 1.41 |"),
    (NAMED, gaps(SMALL), "The gap of guide force (slow 0.79) is far below 1"),
    (WORSE | {"held_out_test": "rises"}, {}, "it rises from 10.10 to 13.20, so what was added does not hold there."),
    (NAMED | {"held_out": HELD}, {}, "last third of slow is held out"),
    (LOSING, {}, "it is 8.70 before anything is added. What was added cannot be simulated in run fast (it flies off)"),
    (LOSING, gaps([("fast", "all", 8.7, np.nan)]), "| fast | 8.7 | 8.439 | 8.961 | – | – | – |"),
    (AMBIGUOUS, {}, "- Coulomb friction of the slider (21.30 N)"),
    (AMBIGUOUS, {}, "- a bias of the sensor of crank torque (0.5000 N m)"),
    (AMBIGUOUS, {}, "A run at 900 rpm would tell them apart."),
    (
        effects(COULOMB | {"delta_bic": None}, BIAS),
        {},
        "Gain in BIC: not known for Coulomb friction of the slider and 40",
    ),
    (NAMED, {"campaign_optimum": OPTIMUM}, "| before | network | 150 | 564 | 0.038 | 0.03 | yes | – |"),
    (NAMED, {"campaign_optimum": OPTIMUM}, "| after | network | 151.5 | 564 | 0.05 | – | no | – |"),
    (NAMED, NONE_ADDED, "all joints are ideal"),
    (NAMED, {"campaign_optimum": OPTIMUM.tail(1)}, "Before, all joints were ideal"),
    (NAMED, {"campaign_optimum": OPTIMUM.assign(failed=[None, "the slider jams"])}, "the slider jams"),
    (VERDICTS["unexplained"], NONE_ADDED, "Nothing was added to the mechanism"),
    (effects(BIAS), NONE_ADDED, "Nothing was added to the mechanism"),
    (VERDICTS["no_disagreement"], {"detectable": SEEN}, f"Smallest detectable sizes: {SMALLEST}"),
    (NAMED, {"detectable": SEEN}, "assumed noise where the campaign states none"),
    (
        undetectable("crank_unbalance", "gas_pressure"),
        {"detectable": SEEN},
        "and channels: an unbalance of the crank.\n",
    ),
    (
        undetectable("gas_pressure"),
        {"detectable": SEEN},
        "is not known: the pressure of a closed gas volume on the slider",
    ),
    (undetectable("slider_coulomb_friction", "crank_unbalance"), {}, "and channels: an unbalance of the crank."),
    (NAMED, {}, f"Cannot be told apart and count as one: {ALIKE}"),
    (best_known(), gaps(FAST), "| force of friction | 21.30 N | 20.60 to 22.00 |"),
    (best_known(), gaps(FAST), "- To prove it: "),
    (best_known(), gaps(FAST), "figures/residuals.svg"),
    (nuisances(slider_mass=MASS), {}, "| slider mass | 0.4470 kg | 0.4437 to 0.4503 |"),
    (nuisances(**{"speed@slow": FLAT}), {}, "| crank speed of run slow | 199.6 rpm | – | changes nothing in what was"),
    (
        nuisances(restitution=bounded(0.9, 0.82)),
        {},
        "of restitution of both pins | 0.900 | 0.820 to 0.900 | at its bound |",
    ),
    (nuisances(restitution=bounded(0.9, 0.82)), {}, "Check each value at its bound"),
    (nuisances(restitution=KEPT), {}, "| 0.795 | 0.713 to 0.795 | at its bound; stated value kept |"),
]
SAYS_NOT = [
    (NAMED, gaps([("slow", "guide_force", 3.0, 0.97)]), "far below 1"),
    (NAMED | {"held_out": [HELD[0] | {"part": "whole"}]}, {}, "last third"),
    (NAMED, {}, "Does it move the optimum"),
    (effects(BIAS), NONE_ADDED, "ideal"),
    (effects(BIAS), {}, "figures/missing_force.svg"),  # there is no force
    (NAMED, {"detectable": SEEN.assign(assumed="")}, "assumed noise"),
    (nuisances(friction_speed=bounded(0.9, 0.82)), {}, "Check each value"),  # one of every fit
    (nuisances(friction_speed=KEPT), {}, "stated value kept"),  # that one nobody stated
]


def test_the_page_says_what_was_found_with_its_numbers_and_nothing_that_is_not_so():
    def says(verdict, tables, words):
        assert words in markdown(verdict, tables)

    def says_not(verdict, tables, words):
        assert words not in markdown(verdict, tables)

    each(says, SAYS)
    each(says_not, SAYS_NOT)


def test_the_page_says_the_same_as_the_markdown():
    formula = effects(law("-a*v*|v|", a=COEFFICIENT))
    assert "<td class='s'>-a*v*|v|</td>" in to_html(page(formula, {}))
    for verdict in VERDICTS.values():
        given = verdict, {}, ["A gap of 3 s in run slow."]
        shown = re.sub("</?code>", "`", to_html(page(*given)))
        for line in markdown(*given).splitlines():
            if line and line[0] not in "#!*|-":
                assert line.replace("'", "&#39;") in shown


def test_the_headline_holds_the_effect_its_number_and_the_interval():
    left = VERDICTS["named_with_remaining_misfit"] | {"interval_factor": 1.84}
    ends = [
        (NAMED, "Coulomb friction of the slider, 21.30 N (90 % interval 20.60 to 22.00)"),
        (VERDICTS["ambiguous"], "Something is missing: 2 explanations fit equally well"),
        (
            effects(COULOMB, BIAS),
            "and a bias of the sensor of crank torque, 0.5000 N m (90 % interval 0.4970 to 0.5030)",
        ),
        (effects(law("-a*v", a={"value": 2.0})), "found by regression: -a*v"),
        (left, "; the residual exceeds noise, so intervals are 1.8 times as wide"),
    ]
    for verdict, end in ends:
        assert page(verdict, {}).title.endswith(end)
    assert "exceeds noise" not in page(NAMED | {"interval_factor": 1.02}, {}).title


CODE_NAMES = {name for name in (*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES, *VERDICTS) if "_" in name}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_no_page_shows_the_name_of_an_effect_a_channel_or_a_parameter_as_the_code_has_it(verdict):
    remarks = ["sensor_bias:crank_torque may be at work: slider_acceleration reads 2 % too much, see encoder_zero."]
    values = {key: {"value": 0.1, "sd": 0.002} for key in (*NUISANCES, "speed@slow", "first_angle@slow")}
    given = VERDICTS[verdict] | {"nuisances": values, "because": "slider_spring explains 90 %"}
    text = to_html(page(given, {"detectable": SEEN}, remarks)).partition("</style>")[2]
    plain = re.sub("`[^`]*`|<code>.*?</code>", "", text)
    assert {name for name in CODE_NAMES if re.search(rf"\b{name}\b", plain)} == set()
    assert "a bias of the sensor of crank torque may be at work: slider acceleration reads" in text


def test_a_fault_of_a_sensor_stands_in_the_unit_of_its_channel():
    cases = [("sensor_bias", "bias", "bias", " N m", 0.5), ("sensor_gain", "gain_error", "gain error", "", 0.5)]
    cases += [("sensor_lag", "lag_s", "lag", " s", 0.5), ("encoder_offset", "offset_rad", "offset", " deg", 28.65)]
    for name, parameter, words, unit, value in cases:
        fault = BIAS | {"name": name, "parameters": {parameter: BIAS["parameters"]["bias"]}}
        low, high = ("28.48", "28.82") if unit == " deg" else ("0.4970", "0.5030")
        assert f"| {words} | {value:#.4g}{unit} | {low} to {high} |" in markdown(effects(fault))


def test_the_largest_windows_come_first_and_the_rest_are_counted():
    rows = [("fast", "crank_torque", 10.0 * k, 10.0 * k + 10.0, 1.0 + k, 1.5 + k, 1e-3) for k in range(7)]
    rows.append(("slow", "crank_torque", 0.0, 360.0, 0.0, 9.0, 1e-3))
    columns = ["run", "channel", "start_deg", "end_deg", "mean", "rms", "p_adjusted"]
    text = markdown(NAMED, {"map_windows": pd.DataFrame(rows, columns=columns)})
    assert "| slow | crank torque | 0 | 360 | 0 | 9 |\n| fast | crank torque | 60 | 70 | 7 | 7.5 |" in text
    assert text.count("| fast | crank torque |") == 6  # the map shows all
