"""Objections to an effect, and the outcome of held-out data."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate, Parameter, Series
from jointgap.identification.confirmation import Confirmed
from jointgap.identification.evidence import final_verdict, row_of
from jointgap.identification.fit import Fit
from jointgap.identification.verdict import Decision, Thresholds

SAMPLES = 1000
NOISE = SAMPLES - 1.0


def effect(name, *more, low=-np.inf, high=np.inf, **attributes):
    """An effect with one amplitude, and further coordinates."""
    return Candidate(
        name, "slider", (Parameter("size", 0.0, low, high), *more), ("size",), **attributes
    )


BOTH = Parameter("joint_friction", 0.1, 0.0, 0.2)
LIMITS = Thresholds(0.01, 1.05, 12.0)
COULOMB, SPRING = effect("coulomb"), effect("spring")
MASS = effect("mass", replaces={"slider_mass": "size"})
PIN = effect("pin", BOTH, replaces={"joint_friction": "size"})
BOTH_SIZES = Parameter("a", 0.0), Parameter("b", 0.0)
LENGTHS = Candidate("lengths", "rod", BOTH_SIZES, ("a", "b"), replaces={"length": "a"})


def fitted(chi2, *effects, values=(1.0,), slope=1e6, nuisances=1, **more):
    """A fit with this chi2; coordinates have `values`, the last one repeated."""
    parameters = [Parameter(f"n{place}", 0.5, 0.0, 1.0) for place in range(nuisances)]
    own = [replace(p, name=f"{one.label}.{p.name}") for one in effects for p in one.coordinates]
    residual, jacobian = np.zeros(SAMPLES), np.zeros((SAMPLES, nuisances + len(own)))
    residual[-1] = np.sqrt(chi2)
    np.fill_diagonal(jacobian, slope)
    values = np.array([0.5] * nuisances + [*values, *values[-1:] * len(own)][: len(own)])
    status = more.pop("status", "converged")
    return Fit(effects, (*parameters, *own), values, residual, jacobian, 1, status, **more)


def objection(*effects, bounds=None, order_label=lambda _: "", **more):
    return row_of(fitted(NOISE, *effects, **more), bounds or {}, order_label=order_label).objection


# Absent effects, and parameters within their ranges


LENGTH = effect("length", low=-0.5, high=0.5)
KNOWN_LENGTH = replace(LENGTH, is_perturbation=True)  # vanishes at its lower bound
SHAPED = effect("drag", Parameter("exponent", 2.0, 1.0, 3.0))  # shapes may end at bounds


@pytest.mark.parametrize(
    "effects, values, slope, is_present",
    [
        ((COULOMB,), [1.0], 1e6, True),
        ((COULOMB,), [0.0], 1e6, False),
        ((COULOMB, SPRING), [1.0, 0.0], 1e6, False),
        ((COULOMB,), [1.646], 1.0, True),  # a 90 % interval with a standard error of 1
        ((COULOMB,), [1.644], 1.0, False),
        ((LENGTH,), [0.5], 1e6, False),
        ((LENGTH,), [0.499], 1e6, True),
        ((LENGTH,), [-0.5], 1e6, False),
        ((LENGTH,), [-0.499], 1e6, True),
        ((KNOWN_LENGTH,), [-0.5], 1e6, True),
        ((KNOWN_LENGTH,), [0.5], 1e6, False),
        ((SHAPED,), [1.0, 3.0], 1e6, True),
    ],
)
def test_an_effect_is_absent_at_zero_or_at_a_bound(effects, values, slope, is_present):
    remark = objection(*effects, values=values, slope=slope)
    assert (remark == "") == is_present
    assert is_present or effects[-1].label in remark


@pytest.mark.parametrize(
    "values, is_present", [([1.0, 1.0], True), ([1.0, 0.0], False), ([0.0, 1.0], False)]
)
def test_an_effect_with_one_part_at_its_bound_is_absent(values, is_present):
    """Example: a spring given as two springs at the outermost rest positions."""
    parts = Parameter("out", 0.0, 0.0, step=0.1), Parameter("in", 0.0, 0.0, step=0.1)

    def stated(at):
        return {"size": at["out"] + at["in"], "place": at["out"]}

    pair = Candidate("two", "slider", parts, ("out", "in"), parameters=stated)
    remark = objection(pair, values=values)
    assert (remark == "") == is_present and (is_present or "bound of size" in remark)


def test_a_force_at_a_crank_order_is_rejected():
    swing = effect("swing", Parameter("frequency_Hz", 5.0), carrier="push")
    for order in ("order 1 of the crank in run slow", ""):
        for others in ((), (COULOMB,)):
            values = [1.0] * len(others) + [1.0, 5.04]
            label = {5.04: order}.__getitem__
            found = objection(*others, swing, values=values, order_label=label)
            assert (found == "") == (order == "") and order in found


MASS_RANGE = {"slider_mass": (1.0, 0.9, 1.5)}
LENGTH_RANGE = {"length": (1.0, 0.9, 1.1)}
TWO_LENGTHS = replace(LENGTHS, replaces={"crank_length": "a", "rod_length": "b"})
TWO_RANGES = dict.fromkeys(TWO_LENGTHS.replaces, (1.0, 0.9, 1.1))
PINS = {"joint_friction": (0.1, 0.0, 0.2), "slider_mass": (1.0, 0.9, 1.1)}
ERRORS = [1.0, 100.0, 4.0]  # a further size counts from two standard errors of 0.25


@pytest.mark.parametrize(
    "effects, values, bounds, names, slope",
    [
        *(((MASS,), [size], MASS_RANGE, ["slider_mass"], 1e6) for size in (0.49, 1e-4, -0.09)),
        *(((MASS,), [size], MASS_RANGE, [], 1e6) for size in (0.51, -0.11)),
        *(((LENGTHS,), [0.05, size], LENGTH_RANGE, [], ERRORS) for size in (0.51, -0.51)),
        *(((LENGTHS,), [0.05, size], LENGTH_RANGE, ["length"], ERRORS) for size in (0.49, -0.49)),
        ((TWO_LENGTHS,), [0.05], TWO_RANGES, ["crank_length", "rod_length"], 1e6),
        ((PIN,), [0.05, 0.1], PINS, [], 1e6),  # the other pin's friction is still fitted
        ((PIN, MASS), [0.05, 0.1, 0.05], PINS, ["mass is equivalent to slider_mass"], 1e6),
    ],
)
def test_an_effect_must_exceed_the_range_of_its_parameter(effects, values, bounds, names, slope):
    remark = objection(*effects, values=values, slope=slope, bounds=bounds)
    assert (remark == "") == (not names) and all(name in remark for name in names)


# The row of a fit


def test_a_row_lists_shared_nuisances_at_bounds():
    fit = fitted(NOISE, COULOMB, nuisances=3)
    own = replace(fit.parameters[2], run="slow")
    parameters = (*fit.parameters[:2], own, fit.parameters[3])
    fit = replace(fit, values=np.array([0.0, 1.0, 1.0, 1.0]), parameters=parameters)
    assert row_of(fit).at_bounds == ("n0", "n1")
    # the first changes nothing
    assert row_of(replace(fit, jacobian=fit.jacobian * [0, 1, 1, 1])).at_bounds == ("n1",)


def test_only_a_joint_that_becomes_loose_makes_the_motion_nonsmooth():
    loose = effect("loose", low=0.0, search_range=(0.1, 2.0))
    looser = effect("looser", low=-1.0, high=2.0, is_perturbation=True, search_range=(-0.5, 2.0))
    assert [row_of(fitted(NOISE, one)).is_nonsmooth for one in (loose, looser)] == [True, False]


# Held-out data


def confirmed(identify=1.0, confirm=1.0, channel="crank_torque", variation=2.0, run=""):
    """Residuals of one channel with these gaps after the effects, noise 1 and gap 2 before."""
    frames, gaps = [], []
    for role, gap in (("identify", identify), ("confirm", confirm)):
        series = {"run": run or role, "channel": channel, "spread": np.ones(9)}
        series["held_out"] = role == "confirm"
        frames.append(pd.DataFrame(series | {"augmented": 1.0, "whitened_augmented": gap}))
        row = {"role": role, "before": 2.0, "after": gap, "after_low": 1.0}
        row |= {"fall_low": 2.0, "fall_high": 4.0}
        names = ((run or role, channel), (run or role, "all"), ("all", "all"))
        gaps += [row | {"fall_expected": 3.0, "run": run, "channel": of} for run, of in names]
    residuals = pd.concat(frames, ignore_index=True)
    keys = [key for key, _ in residuals.groupby(["run", "channel"])]
    return Confirmed(residuals, pd.DataFrame(gaps), dict.fromkeys(keys, variation))


def together(*parts):
    """Several channels or runs; the gaps are those of the first."""
    variation = {key: value for part in parts for key, value in part.variation.items()}
    return Confirmed(pd.concat([part.residuals for part in parts]), parts[0].gaps, variation)


def test_the_worst_channel_counts_and_runs_are_combined_by_the_root_mean_square():
    others = (confirmed(1.0, 2.0, f"other_{number}") for number in range(9))
    found = together(confirmed(4.0, 0.5), *others).held_out
    assert (found.fitted, found.held_out) == ((4.0, "crank torque"), (2.0, "other 0"))
    assert (found.gap, found.test.outcome) == (0.5, "falls")
    found = together(confirmed(1.0, run="a"), confirmed(4.0, run="b")).held_out
    assert found.fitted == (pytest.approx(np.sqrt((1 + 16) / 2)), "crank torque")


def test_noise_is_compared_with_the_variation_of_the_channel():
    found = together(confirmed(), confirmed(channel="slider_x", variation=1.25)).held_out
    assert found.noise == (pytest.approx(0.8), "slider x")
    angle = np.linspace(0.0, 60 * 2 * np.pi, 5000)
    series = Series("run", "crank_angle", "rad", angle, angle, angle, angle > 0)
    assert series.variation(angle) == pytest.approx(2 * np.pi / np.sqrt(12))
    assert replace(series, unit="m").variation(angle) == pytest.approx(angle.std())


@pytest.mark.parametrize(
    "low, high, outcome",
    [
        (0.01, 0.02, "falls"),
        (-0.02, -0.01, "rises"),
        (-0.01, 0.02, "stays"),
        (-0.01, 0.5, "cannot_tell"),
    ],
)
def test_the_held_out_outcome_follows_from_the_interval_of_the_fall(low, high, outcome):
    found = confirmed()
    found = replace(found, gaps=found.gaps.assign(fall_low=low, fall_high=high, fall_expected=0.5))
    assert (found.test.outcome, found.test.before, found.test.after) == (outcome, 2.0, 1.0)


def test_the_worst_simulated_held_out_run_counts():
    held = confirmed()
    lost = held.gaps[held.gaps["role"] == "confirm"].assign(after=np.nan)
    one = lost.query("run == 'confirm' and channel == 'all'")
    rises = one.assign(run="b", after=2.2, fall_low=-1.0, fall_high=-0.5)
    falls = one.assign(run="c", after=1.0, fall_low=1.0, fall_high=2.0)
    some = (([falls], "falls"), ([falls, rises], "rises"), ([rises, falls], "rises"))
    for rows, outcome in (*some, ([], "not_simulated")):
        assert replace(held, gaps=pd.concat([lost, *rows])).test.outcome == outcome
    fitted_alone = replace(held, gaps=held.gaps.query("role == 'identify'"))
    assert fitted_alone.test.outcome == "nothing_held_out"


# The final verdict


BASE, FRICTION = fitted(4.0 * SAMPLES), fitted(990.0, COULOMB)
NAMED = Decision("named", FRICTION, BASE)


def test_a_confirmed_name_is_kept_and_inconsistent_channels_withdraw_it():
    assert final_verdict(NAMED, confirmed()) is NAMED
    assert "torque" in final_verdict(NAMED, confirmed(), ["torque"]).because


def test_errors_grow_with_the_remaining_held_out_gap():
    left = fitted(4.0 * (SAMPLES - 2), COULOMB)
    rest = Decision("named_with_remaining_misfit", left, fitted(9e4))
    for gap, scale in ((0.9, 1.0), (1.4, 1.4)):
        assert final_verdict(NAMED, confirmed(confirm=gap)).chosen.scale == pytest.approx(scale)
        assert final_verdict(rest, confirmed(confirm=gap)).chosen.scale == pytest.approx(2.0)
    # also those of the best known and equivalent fits, and of the base without a proposal
    withheld = final_verdict(NAMED, confirmed(confirm=4.0))
    assert withheld.verdict == "unexplained"
    assert withheld.chosen == BASE
    assert withheld.best_known.gap_left == 4.0
    rivals = Decision("ambiguous", BASE, BASE, [FRICTION, fitted(991.0, SPRING)])
    heard = final_verdict(rivals, confirmed(confirm=1.4))
    assert ([fit.gap_left for fit in heard.equivalent], heard.chosen.gap_left) == ([1.4, 1.4], 1.0)
    alone = final_verdict(Decision("parameters_only", BASE, BASE), confirmed(confirm=1.4))
    assert (alone.chosen.gap_left, alone.best_known) == (1.4, None)
