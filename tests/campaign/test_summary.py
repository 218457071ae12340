"""The one-page summary agrees with the verdict, in plain words."""

import re

import numpy as np
import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.campaign.page import page
from jointgap.config.campaign import NUISANCES
from jointgap.config.channels import CHANNELS
from jointgap.config.load import load_campaign
from jointgap.core.page import to_html, to_markdown
from jointgap.effects import EFFECTS
from jointgap.identification.fit import AT_BOUND, CHANGES_NOTHING
from jointgap.rig.sensors import FAULTS
from tests.campaign.verdicts import BIAS, COULOMB, NAMED, VERDICTS


def markdown(verdict=NAMED, tables=None, **options):
    return to_markdown(page(verdict, tables or {}, **options))


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
    best = {"effects": [COULOMB], "explained_share": 0.56, "rival": rival}
    return VERDICTS["unexplained"] | {"best_known": best, "held_out_test": "falls"}


def undetectable(*names):
    return NAMED | {"preflight": {"undetectable": list(names), "merged": []}}


SEEN = pd.DataFrame(
    [
        ("rod_flexibility", "frequency_Hz", 157.2, "Hz", True, True, None),
        ("slider_coulomb_friction", "force_N", 0.0787, "N", False, True, None),
        ("crank_unbalance", "unbalance_kg_m", np.nan, "kg*m", False, False, None),
        ("gas_pressure", "force_N", np.nan, "N", False, False, "the slider jams"),
    ],
    columns=["label", "parameter", "smallest_detectable", "unit", "falls", "detectable", "failed"],
).assign(assumed="crank_torque in run slow: 0.0042 N*m, 2 % of its variation")
OPTIMUM = pd.DataFrame({"model": ["base", "augmented"], "source": "network", "failed": None})
OPTIMUM = OPTIMUM.assign(objective="RMS error of the transmission angle", length="crank_length")
OPTIMUM = OPTIMUM.assign(original=0.149, optimum=[0.150, 0.1515], at_edge=[True, False])
OPTIMUM = OPTIMUM.assign(reduction=[0.038, 0.05], resimulated=[0.03, np.nan])
ERRORS = pd.DataFrame({"run": "fast", "speed": 41.8879, "channel": ["crank_torque"]}).assign(
    held_out=True, samples=99, unit="N*m", si_per_unit=1.0, noise=0.4, before=0.776, after=0.42
)
WINDOWS = pd.DataFrame({"start_deg": 10.0 * np.arange(9), "rms": 1.5 + np.arange(9)})
WINDOWS = WINDOWS.assign(end_deg=WINDOWS["start_deg"] + 10.0, mean=WINDOWS["rms"] - 0.5)
WINDOWS = WINDOWS.assign(run="fast", channel="crank_torque")
COEFFICIENT = {"value": 1.25, "sd": 0.1, "interval_90": [1.09, 1.41]}
FLAT = {"value": 20.9, "sd": None, "interval_90": [None, None], "remark": CHANGES_NOTHING}
KEPT, HIGH = bounded(0.795, 0.713, kept=True), bounded(0.9, 0.82)
SPLIT = [{"run": "slow", "part": "last_third", "gap": {"before": 8.7, "after": 1.05}}]
NO_GAP = {"before": 8.7, "after": None}
LOST = {"run": "fast", "part": "whole", "gap": NO_GAP, "not_simulated": "it flies off"}
LOSING = {"gap": {"identify": NAMED["gap"]["identify"], "confirm": NO_GAP}, "held_out": [LOST]}

FAST = {"channel_errors": ERRORS}
COUNTED = NAMED, gaps([("slow", "guide_force", 3.0, 0.79)])
THIRD = NAMED | {"held_out": SPLIT}, gaps([("slow", "guide_force", 3.0, 0.97)])
RUN = VERDICTS["ambiguous"] | {"separated_by": "A run at 900 rpm would do so."}
FURTHER = VERDICTS["ambiguous"] | {"separated_by": "A further run at 900 rpm would do."}
BEFORE, NONE = {"campaign_optimum": OPTIMUM}, {"campaign_optimum": OPTIMUM.head(0)}
MASS = nuisances(slider_mass={"value": 0.447, "sd": 0.002, "interval_90": [0.4437, 0.4503]})
SPEED, CLOCK = {"speed@slow": FLAT}, {"clock_offset@slow": FLAT | {"value": 0.0123}}
SEPARATE = "Measure the run or channel that separates"
BOUND = "| 0.900 | 0.820 to 0.900 | at its bound | ~ Check the range of coefficient of restitution"
SHOWN = {
    "| fast | 400 | yes | crank torque | N m | 0.4 | 0.776 | 0.42 |": (NAMED, FAST),
    "| friction force | 21.30 N | 20.60 to 22.00 |": (NAMED, {}),
    r"| formula | -a\*v\*\|v\| | – | ~ | a | 1.25 | 1.09 to 1.41 |": (
        effects(law("-a*v*|v|", a=COEFFICIENT)),
        {},
    ),
    "The gap of guide force (slow 0.79) is far below 1": COUNTED,
    "last third of slow is held": THIRD,
    "it flies off ~ | fast | 8.7 | 8.439 | 8.961 | – | – | – |": (
        NAMED | LOSING,
        gaps([("fast", "all", 8.7, np.nan)]),
    ),
    "- Coulomb friction of the slider (21.30 N) ~ A run at 900 rpm would do so.": (RUN, {}),
    SEPARATE: (FURTHER, {}),
    "| before | network | crank length | 149 | 150 | 0.038 | 0.03 | yes | – |": (NAMED, BEFORE),
    "Smallest RMS error of the transmission angle: reduction": (NAMED, BEFORE),
    "No effect was added to the mechanism": (effects(BIAS), NONE),
    "Detectability unknown: the pressure ~ channels: an unbalance": (
        undetectable("crank_unbalance", "gas_pressure"),
        {"detectable": SEEN},
    ),
    "mode up to 157.2 Hz) ~ (0.0787 N).": (VERDICTS["no_disagreement"], {"detectable": SEEN}),
    "| 21.30 N | 20.60 to 22.00 | ~ To confirm it:": (
        best_known(),
        gaps([("fast", "all", 8.7, 1.05)]),
    ),
    "| slider mass | 0.4470 kg | 0.4437 to 0.4503 |": (MASS, {}),
    "| 0.713 to 0.795 | at its bound; stated value kept": (nuisances(restitution=KEPT), {}),
    "| crank speed of run slow | 199.6 rpm | – | changes nothing": (nuisances(**SPEED), {}),
    "second file of run slow | 12.3 ms | –": (nuisances(**CLOCK), {}),
    BOUND: (nuisances(restitution=HIGH), {}),
    # the windows with the largest residuals; the map shows all
    "| 80 | 90 | 9 | 9.5 |\n| fast | crank torque | 70 | 80 |": (NAMED, {"map_windows": WINDOWS}),
}
HIDDEN = [
    ("far below 1", (NAMED, FAST)),
    ("last third", (NAMED, {})),
    ("far below 1", THIRD),
    (SEPARATE, (RUN, {})),
    ("ideal", (NAMED, BEFORE)),
    ("ideal", (effects(BIAS), NONE)),
    ("kept", (MASS, {})),
    ("kept", (nuisances(restitution=HIGH), {})),
    ("| fast | crank torque | 10 | 20 |", (NAMED, {"map_windows": WINDOWS})),
]


@pytest.mark.parametrize("contents", SHOWN)
def test_the_page_contains_the_results_with_their_numbers(contents):
    text = markdown(*SHOWN[contents])
    assert [part for part in contents.split(" ~ ") if part not in text] == []


@pytest.mark.parametrize("text, case", HIDDEN)
def test_the_page_leaves_out_what_does_not_apply(text, case):
    assert text not in markdown(*case)


def test_figures_that_were_not_drawn_are_not_on_the_page():
    assert "figures/gaps" in markdown() and "figures/gaps" not in markdown(figures=("ranking",))


def test_effects_that_the_fits_distinguish_are_not_called_indistinguishable():
    delay, lag = "sensor_delay:crank_torque", "sensor_lag:crank_torque"
    groups = [[delay, lag], ["gravity", "slider_spring", "slider_offset"]]
    verdict = best_known() | {"preflight": {"undetectable": [], "merged": groups}}
    pairs = [f"{delay} + gravity", f"{lag} + gravity", f"{delay} + slider_spring"]
    ranking = pd.DataFrame({"explanation": pairs, "bic": [100.0, 600.0, 104.0]})
    said = markdown(verdict, {"ranking": ranking})
    assert said.count("Distinguished neither by their sensitivities nor by the fits") == 1
    not_fitted = (
        "the weight of the bodies, a linear spring on the slider and an offset of the slide"
    )
    assert not_fitted in said
    near = {"ranking": ranking.assign(bic=[100.0, 109.0, 104.0])}
    assert "a delay of the sensor of crank torque and a lag of the" in markdown(verdict, near)


def test_only_values_with_a_range_in_the_campaign_file_are_to_be_checked_at_their_bounds():
    values = {"first_angle@slow": bounded(0.1, 0.0), "speed@slow": bounded(9.0, 8.0)}
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    assert "Check the range" not in markdown(nuisances(**values), campaign=campaign)
    listed = campaign.model_copy(update={"nuisance": {"slider_mass": None}})
    said = markdown(nuisances(slider_mass=HIGH, **values), campaign=listed)
    assert "Check the range of slider mass under `nuisance`: this value is at its bound" in said


def test_the_headline_holds_the_effect_its_number_and_the_interval():
    left = VERDICTS["named_with_remaining_misfit"] | {"interval_factor": 1.84}
    crank = {"value": -7.2e-5, "sd": 5e-5, "interval_90": [-1.5e-4, 1e-5]}
    rod = {"value": 2.02e-3, "sd": 3e-5, "interval_90": [1.97e-3, 2.07e-3]}
    lengths = {"name": "link_length_error", "site": "crank and rod", "delta_bic": 9.0}
    lengths["parameters"] = {"crank_m": crank, "rod_m": rod}
    force = {"value": 1.13, "sd": None, "interval_90": [0.015, 1.13], "remark": AT_BOUND}
    bias = "and a bias of the sensor of crank torque, 0.5000 N m (90 % interval 0.4970 to 0.5030)"
    ends = {  # the most certain of sizes of one kind
        "rod length 2.020 mm (90 % interval 1.970 to 2.070)": effects(lengths),
        "1.13 N (at its bound; 90 % interval 0.015 to 1.13)": effects(
            COULOMB | {"parameters": {"force_N": force}}
        ),
        "Coulomb friction of the slider, 21.30 N (90 % interval 20.60 to 22.00)": NAMED,
        "An effect is missing: 2 explanations fit equally well": VERDICTS["ambiguous"],
        bias: effects(COULOMB, BIAS),
        "found by regression: -a*v": effects(law("-a*v", a={"value": 2.0})),
        "; intervals widened by the factor 1.8, as the residual exceeds noise": left,
    }
    for end, verdict in ends.items():
        assert page(verdict, {}).title.endswith(end)
    assert "exceeds noise" not in page(NAMED | {"interval_factor": 1.02}, {}).title


CODE_NAMES = {name for name in (*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES, *VERDICTS) if "_" in name}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_no_page_shows_the_name_of_an_effect_a_channel_or_a_parameter_as_the_code_has_it(verdict):
    remarks = [
        "sensor_bias:crank_torque may be at work: slider_acceleration reads 2 % too much, see"
        " encoder_zero."
    ]
    values = {
        key: {"value": 0.1, "sd": 0.002} for key in (*NUISANCES, "speed@slow", "first_angle@slow")
    }
    given = VERDICTS[verdict] | {"nuisances": values, "because": "slider_spring explains 90 %"}
    text = to_html(page(given, {"detectable": SEEN}, warnings=remarks)).partition("</style>")[2]
    plain = re.sub("`[^`]*`|<code>.*?</code>", "", text)
    assert {name for name in CODE_NAMES if re.search(rf"\b{name}\b", plain)} == set()
    assert "a bias of the sensor of crank torque may be at work: slider acceleration reads" in text


def test_the_page_of_a_model_of_the_user_advises_what_a_model_has():
    unexplained = VERDICTS["unexplained"] | {"subject": "model", "cycle": ""}
    unexplained |= {"nuisances": {"inertia": bounded(0.2, 0.1)}}
    said = markdown(unexplained)
    assert "class of the model" in said and "campaign file" not in said
    assert "in the class: this value is at its bound" in said


def test_a_gain_that_was_not_measured_is_said_to_be_so():
    said = markdown(effects(COULOMB, BIAS | {"delta_bic": None}))
    assert "Gain in BIC: 812 for Coulomb friction of the slider." in said
    assert "No fit was made without a bias of the sensor of crank torque." in said
