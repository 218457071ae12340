"""Texts and JSON of a verdict on random evidence agree with its numbers."""

import json
import re
from dataclasses import replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pandas as pd
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from benchmarks.project import ROOT
from jointgap.app.run_summary import verdict_lines
from jointgap.campaign import verdict_json
from jointgap.campaign.outcome import outcome_of
from jointgap.campaign.page import page
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.page import to_markdown
from jointgap.core.schema import TABLES
from jointgap.identification.confirmation import held_out_test
from jointgap.identification.evidence import final_verdict, row_of, weigh_fit
from jointgap.identification.fit import Fit
from jointgap.identification.force_law import ForceLawResult, with_force_law
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import Evidence, HeldOut, Thresholds, verdict
from tests.campaign.verdicts import VERDICTS

SAMPLES = 200
CAMPAIGN = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
SCHEMA = Draft202012Validator(
    json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text())
)
NOISE_GAP = DEFAULT_SETTINGS.decision.noise_gap
LARGE_GAP = DEFAULT_SETTINGS.decision.max_gap_of_noise
FEW_DRAWS = replace(
    DEFAULT_SETTINGS,
    intervals=replace(DEFAULT_SETTINGS.intervals, chains=8, settling_sweeps=2, sweeps=8),
)
MASS = Parameter("slider_mass", 1.0, 0.0, 9.0)
ANGLE = Parameter("first_angle", 0.0, -1.0, 1.0, run="slow")


def candidate(name, site, *sizes, low=-50.0, has_site=False):
    coordinates = tuple(Parameter(size, 0.0, low, 50.0) for size in sizes)
    return Candidate(name, site, coordinates, sizes[:1], has_site=has_site)


FRICTION = candidate("slider_coulomb_friction", "slider", "force_N", low=0.0)
DRAG = candidate("slider_power_drag", "slider", "force_N", "exponent", low=0.0)
SPRING = candidate("slider_spring", "slider", "stiffness_N_m")
BIAS = candidate("sensor_bias", "crank_torque", "bias", has_site=True)
LAW = candidate("discovered_slider_force[v^3]", "slider", "size")
CONSTANT = candidate("discovered_slider_force[1]", "slider", "size")
EFFECTS = (FRICTION, DRAG, SPRING, BIAS)
SINGLES = [(one,) for one in EFFECTS]
PAIRS = [(one, other) for i, one in enumerate(EFFECTS) for other in EFFECTS[i + 1 :]]
LAWS = [(LAW,), (LAW, CONSTANT)]


def fit_of(rng, effects, chi2):
    """A fit with some values at bounds, and with errors from a thousandth to once the range."""
    own = [
        Parameter(f"{c.label}.{p.key}", 0.0, p.low, p.high) for c in effects for p in c.coordinates
    ]
    parameters = (MASS, ANGLE, *own)
    count = len(parameters)
    places = np.where(rng.random(count) < 0.1, rng.integers(0, 2, count), rng.random(count))
    width = np.array([p.high - p.low for p in parameters])
    residual, jacobian = np.zeros(SAMPLES), np.zeros((SAMPLES, width.size))
    residual[-1] = chi2**0.5
    np.fill_diagonal(
        jacobian, (chi2 / SAMPLES) ** 0.5 * 10.0 ** rng.uniform(0.0, 3.0, width.size) / width
    )
    values = np.array([p.low for p in parameters]) + width * places
    return Fit(
        tuple(effects), parameters, values, residual, jacobian, 1, "converged", settings=FEW_DRAWS
    )


def gap_table(rng, base, best):
    """Table of gaps; those of channels weigh otherwise than samples, held-out data may disagree
    altogether."""
    rows = []
    for role, run in (("identify", "all"), ("confirm", "all"), ("confirm", "slow")):
        before = rng.uniform(0.8, 1.2) * (base.chi2 / SAMPLES) ** 0.5
        after = before
        if best is not None:
            after = rng.uniform(0.8, 1.2) * (best.chi2 / SAMPLES) ** 0.5
        if best is not None and role == "confirm":
            after = rng.choice(
                [after, before, max(before * np.exp(rng.uniform(-6.0, 1.0)), 0.9)],
                p=[0.5, 0.1, 0.4],
            )
        fall = before**2 - after**2
        width = rng.choice([0.01, 0.05, 0.3, 2.0]) * (before**2 + after**2)
        expected = rng.uniform(0.0, 2.0) * before**2
        ends = {"fall_low": fall - width, "fall_high": fall + width, "fall_expected": expected}
        gap = {"before": before, "after": after, "after_low": 0.95 * after}
        gap |= {"before_low": 0.95 * before, "before_high": 1.05 * before}
        key = {"run": run, "role": role, "channel": "all", "samples": SAMPLES, "remark": None}
        rows.append(key | gap | ends | {"after_high": 1.05 * after})
    table = pd.DataFrame(rows).astype({"remark": object})
    if best is not None and rng.random() < 0.05:
        table.loc[1:, ["after", "after_low", "after_high"]] = np.nan
        table.loc[2, "remark"] = "the slider jams"
    return table


def made_from(rng):
    """``verdict.json`` of random evidence, with the tables that the page shows."""
    base_chi2 = SAMPLES * 10.0 ** rng.choice(
        [rng.uniform(-0.05, 0.1), rng.uniform(0.0, 6.0)], p=[0.3, 0.7]
    )
    base, nominal = (fit_of(rng, (), base_chi2 * factor) for factor in (1.0, rng.uniform(1.0, 1.5)))
    good, poor = SAMPLES * rng.uniform(0.8, 1.2), base_chi2 * rng.uniform(0.0, 0.1)
    best = rng.choice([good, poor, base_chi2 * rng.random()])
    found = []
    for place in rng.permutation(len(SINGLES + PAIRS))[: rng.integers(0, 7)]:
        other = rng.choice([best + rng.uniform(-5.0, 5.0), base_chi2 * rng.random()])
        found.append(fit_of(rng, (SINGLES + PAIRS)[place], min(max(other, 50.0), base_chi2)))
    limits = Thresholds(0.01, rng.choice([1.05, 1.3, 4.0]), rng.choice([5.0, 12.0, 60.0]))
    bounds = {MASS.name: (MASS.nominal, MASS.low, MASS.high)}
    rows = [row_of(fit, bounds, similarity=rng.random()) for fit in found]
    decision = verdict(Evidence(row_of(base), row_of(nominal), rows, limits))
    if decision.verdict == "unexplained" and rng.random() < 0.5:
        laws = [fit_of(rng, effects, base_chi2 * rng.random()) for effects in LAWS]
        ranking = [weigh_fit(base, law, limits) for law in laws]
        reason = (
            f"the best sum, {laws[0].label}, explains only {ranking[0].share:.1%} of the misfit"
        )
        found_law = ForceLawResult(
            laws[0], rng.random() < 0.5, reason, laws[1 : rng.integers(1, 3)], ranking=ranking
        )
        decision = with_force_law(decision, found_law)
    outcome = outcome_of(decision, {})
    outcome = replace(
        outcome, ranking=outcome.ranking.astype({"admissible": bool})
    )  # as read from its table
    gaps = gap_table(rng, base, outcome.proposed)
    test, after = held_out_test(gaps), float(gaps.loc[1, "after"])
    left = ((left, "crank torque") for left in (float(gaps.loc[0, "after"]), after, 0.1))
    confirmed = SimpleNamespace(held_out=HeldOut(test, after, *left), gap=lambda role: after)
    inconsistent = ("crank_torque",) if rng.random() < 0.1 else ()
    outcome = final_verdict(outcome, confirmed, inconsistent)
    if (
        rng.random() < 0.3
        and len(explained := outcome.explanations)
        and len(labels := explained[0].label.split(" + ")) > 1
    ):
        outcome = replace(outcome, certain=(labels[0],), not_searched=("pairs of effects",))
    tables = {name: pd.DataFrame(columns=TABLES[name].names) for name in verdict_json.TABLES} | {
        "gaps": gaps
    }
    pair = ["slider_spring", "sensor_bias:crank_torque"]
    tables["confusability"] = pd.DataFrame(
        {"first": pair, "second": pair[::-1], "merged": rng.random() < 0.5}
    )
    if any(one.label == DRAG.label for one in outcome.chosen.hypothesis):
        shape = outcome.chosen.mapping[f"{DRAG.label}.exponent"]
        ends = [shape - rng.random(), shape + rng.random()]
        flags = (rng.random() < 0.5, rng.random() < 0.5)
        row = (DRAG.label, DRAG.label, "exponent", shape, *ends, *flags)
        tables["law_families"] = pd.DataFrame([row], columns=TABLES["law_families"].names)
    content = verdict_json.document(outcome, tables, CAMPAIGN, inconsistent) | {
        "false_alarm_rate": 0.01
    }
    return json.loads(verdict_json.text(content)), {"gaps": gaps, "ranking": outcome.placed_ranking}


def texts_of(content, tables):
    """The terminal's lines and the page."""
    with TemporaryDirectory() as folder:
        Path(folder, "verdict.json").write_text(json.dumps(content))
        lines = "\n".join(verdict_lines(Path(folder)))
    return lines, to_markdown(page(content, tables, campaign=CAMPAIGN))


NUMBER = r"(-?\d+(?:\.\d+)?)"


def inconsistencies(content, lines, text):
    """Sentences that contradict the numbers of the verdict."""
    both, gap, best = f"{lines}\n{text}", content["gap"], content["best_known"]
    fitted, confirm = gap["identify"], gap["confirm"]
    found, after = [], confirm["after"]

    def numbers(pattern):
        """The numbers, as text, in each sentence of this pattern."""
        return re.findall(pattern.replace("#", NUMBER), both)

    def check(holds, remark):
        if not holds:
            found.append(remark)

    for verb, old, new in numbers("(falls|rises|reduces the gap of the fitted data) from # to #"):
        is_larger = float(new) > float(old)
        check(
            float(old) != float(new) and is_larger == (verb == "rises"),
            f"{verb} from {old} to {new}",
        )
    for old, new in numbers(r"significantly \(# before, # after"):
        check(old != new, f"{old} before, {new} after")
    for change in numbers(r"(?:smaller|larger) by (\S+)|Gain in BIC: (\S+)"):
        shown = "".join(change).rstrip(".;,")
        is_word = shown in ("more", "unknown", "none")
        check(is_word or 0.0 < float(shown) <= 1000.0, f"BIC by {shown}")
    for share in numbers(r"explains # % of the misfit of|partly explained \(#"):
        off = float("".join(share)) - 100.0 * best["explained_share"]
        check(abs(off) <= 0.5, f"a share of {share} for {best['explained_share']}")
    for share in map(float, numbers("explains # % of the misfit of the fitted data")):
        check(0.0 < share < 100.0 and fitted["after"] < fitted["before"], f"{share} % at {fitted}")
    for share in map(float, numbers("# % of the excess over noise is explained")):
        is_all = share == 100.0
        check(0.0 < share <= 100.0 and (not is_all or after <= 1.0), f"{share} % at {confirm}")
    check(not best or "% of the excess" not in both, "a second share of the best candidate")
    if "explains the misfit" in both:
        is_explained = fitted["after"] <= NOISE_GAP
        is_small = (after or 0.0) <= LARGE_GAP or "remains" in lines
        check(is_explained and is_small, f"explains the misfit at {gap}")
    reduces = "does not reduce the misfit" in both and "reduces the gap" in both
    check(not reduces, "reduces and does not reduce")
    if "best candidate" in lines and after is not None and after > confirm["before"]:
        check(f"{after:.2f}" <= f"{confirm['before']:.2f}", f"best candidate at {confirm}")
    if content["effects"] and "consistent with noise" in lines:
        check(fitted["after"] <= NOISE_GAP, f"consistent with noise at {fitted}")
    for shown_gaps in numbers("gap on held-out data [^.:(]*?from # to #"):
        for shown, true in zip(map(float, shown_gaps), confirm.values(), strict=True):
            within = 0.501 if true >= 99.0 else 0.00501
            check(abs(shown - true) <= within, f"held-out gap {shown} for {true}")
    prose = re.sub(r"`[^`]*`|\[[^\]]*\]\([^)]*\)|!\[", "", lines)
    raw = re.search(r"\[\w|\]\s*[,.+]|regression\[", prose)
    check(not raw, f"raw label {raw}")
    estimates = [*content["nuisances"].values()]
    for effects in (content["effects"], *content["equivalent"], (best or {}).get("effects", [])):
        for effect in effects:
            estimates += effect["parameters"].values()
            families = effect.get("families", ())
            estimates += [{key: of[key] for key in ("value", "interval_99")} for of in families]
    return found + [f"intervals {one}" for one in estimates if not in_order(one)]


def in_order(estimate):
    """Whether the interval of 99 % contains that of 90 %, that of 50 % and the value."""
    value = estimate["value"]
    if isinstance(value, str):
        return True
    inner = (value, value)
    for level in (50, 90, 99):
        low, high = estimate.get(f"interval_{level}", (None, None))
        ends = (-inf if low is None else low, inf if high is None else high)
        slack = 1e-9 * max(1.0, abs(value))
        if ends[0] > inner[0] + slack or ends[1] < inner[1] - slack:
            return False
        inner = inner if None in (low, high) else ends
    return True


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 2**32 - 1))
def test_no_sentence_contradicts_the_numbers_of_a_verdict(seed):
    content, tables = made_from(np.random.default_rng(seed))
    SCHEMA.validate(content)
    assert inconsistencies(content, *texts_of(content, tables)) == []


def test_the_stored_verdicts_do_not_contradict_themselves():
    for content in VERDICTS.values():
        assert inconsistencies(content, *texts_of(content, {})) == []
