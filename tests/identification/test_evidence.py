"""What speaks against an effect, and what held-out data show, of fits and residuals made up for
it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate, Parameter, Series
from jointgap.identification.confirmation import Confirmed
from jointgap.identification.evidence import final_verdict, row_of
from jointgap.identification.fit import Fit
from jointgap.identification.verdict import Decision, Thresholds
from tests.catalogue import each

SAMPLES = 1000
NOISE = SAMPLES - 1.0


def effect(name, *more, low=-np.inf, high=np.inf, **attributes):
    """An effect with one amplitude, and `more` coordinates."""
    return Candidate(
        name, "slider", (Parameter("size", 0.0, low, high), *more), ("size",), **attributes
    )


BOTH = Parameter("joint_friction", 0.1, 0.0, 0.2)
LIMITS = Thresholds(0.01, 1.05, 12.0)
COULOMB, SPRING = effect("coulomb"), effect("spring")
MASS = effect("mass", replaces={"slider_mass": "size"})
PIN = effect("pin", BOTH, replaces={"joint_friction": "size"})
LENGTHS = Candidate(
    "lengths",
    "rod",
    (Parameter("a", 0.0), Parameter("b", 0.0)),
    ("a", "b"),
    replaces={"length": "a"},
)


def fitted(chi2, *effects, values=(1.0,), slope=1e6, nuisances=1, **more):
    """A fit with that chi2; its effects' coordinates have `values`, or all the last one of them."""
    parameters = [Parameter(f"n{place}", 0.5, 0.0, 1.0) for place in range(nuisances)]
    own = [replace(p, name=f"{one.label}.{p.name}") for one in effects for p in one.coordinates]
    residual, jacobian = np.zeros(SAMPLES), np.zeros((SAMPLES, nuisances + len(own)))
    residual[-1] = np.sqrt(chi2)
    np.fill_diagonal(jacobian, slope)
    values = np.array([0.5] * nuisances + [*values, *values[-1:] * len(own)][: len(own)])
    return Fit(
        effects,
        (*parameters, *own),
        values,
        residual,
        jacobian,
        1,
        more.pop("status", "converged"),
        **more,
    )


def objection(*effects, bounds=None, order_label=lambda _: "", **more):
    return row_of(fitted(NOISE, *effects, **more), bounds or {}, order_label=order_label).objection


# Effects that are not there, and parameters within their ranges


def test_an_effect_is_not_there_without_a_size_or_whose_interval_holds_zero_or_that_is_drawn_to_its_bound():
    def check(effect, values, is_there, slope=1e6):
        found = objection(*effect, values=values, slope=slope)
        assert (found == "") == is_there, found
        assert is_there or effect[-1].label in found

    def length(is_perturbation):
        return (effect("length", low=-0.5, high=0.5, is_perturbation=is_perturbation),)

    each(
        check,
        [
            ((COULOMB,), [1.0], True),
            ((COULOMB,), [0.0], False),
            ((COULOMB, SPRING), [1.0, 0.0], False),
            ((COULOMB,), [1.646], True, 1.0),  # of a standard error of 1: its 90 % interval
            ((COULOMB,), [1.644], False, 1.0),
            (length(False), [0.5], False),
            (length(False), [0.499], True),
            (length(False), [-0.5], False),
            (length(False), [-0.499], True),
            (length(True), [-0.5], True),  # nothing is left of what was known
            (length(True), [0.5], False),
            (
                (effect("drag", Parameter("exponent", 2.0, 1.0, 3.0)),),
                [1.0, 3.0],
                True,
            ),  # shapes may end at bounds
        ],
    )


def test_nor_one_whose_stated_size_is_at_its_bound_as_one_of_its_parts_is():
    """Such as a spring that is stated as one between two at the farthest places of rest."""
    parts = Parameter("out", 0.0, 0.0, step=0.1), Parameter("in", 0.0, 0.0, step=0.1)

    def check(values, is_there, **states):
        two = Candidate(
            "two",
            "slider",
            parts,
            ("out", "in"),
            parameters=lambda v: {k: s(v) for k, s in states.items()},
        )
        found = objection(two, values=values)
        assert (found == "") == is_there and (is_there or "bound of size" in found), found

    def total(values):
        return values["out"] + values["in"]

    each(
        lambda values, is_there: check(values, is_there, size=total, place=lambda v: v["out"]),
        [([1.0, 1.0], True), ([1.0, 0.0], False), ([0.0, 1.0], False)],
    )
    check(
        [1.0, 0.0], True, size=lambda v: v["out"], place=total
    )  # the size does not depend on that part


def test_nor_one_that_swings_at_an_order_of_a_crank():
    swing = effect("swing", Parameter("frequency_Hz", 5.0), carrier="push")
    for order in ("order 1 of the crank in run slow", ""):
        for beside in ((), (COULOMB,)):
            found = objection(
                *beside,
                swing,
                values=[1.0] * len(beside) + [1.0, 5.04],
                order_label={5.04: order}.__getitem__,
            )
            assert (found == "") == (order == "") and order in found


def test_a_nuisances_own_parameter_is_an_effect_beyond_its_range():
    def check(effects, values, bounds, named, slope=1e6):
        found = objection(*effects, values=values, slope=slope, bounds=bounds)
        assert (found == "") == (not named) and all(name in found for name in named), found

    mass, length, errors = (
        {"slider_mass": (1.0, 0.9, 1.5)},
        {"length": (1.0, 0.9, 1.1)},
        [1.0, 100.0, 4.0],
    )
    two = replace(LENGTHS, replaces={"crank_length": "a", "rod_length": "b"})
    pins = {"joint_friction": (0.1, 0.0, 0.2), "slider_mass": (1.0, 0.9, 1.1)}
    each(
        check,
        [
            *(((MASS,), [value], mass, ["slider_mass"]) for value in (0.49, 1e-4, -0.09)),
            *(((MASS,), [value], mass, []) for value in (0.51, -0.11)),
            # a further size counts from two standard errors of 0.25 on
            *(((LENGTHS,), [0.05, value], length, [], errors) for value in (0.51, -0.51)),
            *(((LENGTHS,), [0.05, value], length, ["length"], errors) for value in (0.49, -0.49)),
            (
                (two,),
                [0.05],
                dict.fromkeys(two.replaces, (1.0, 0.9, 1.1)),
                ["crank_length", "rod_length"],
            ),
            # the rest of a shared nuisance is left to be fitted
            ((PIN,), [0.05, 0.1], pins, []),
            ((PIN, MASS), [0.05, 0.1, 0.05], pins, ["mass is equivalent to slider_mass"]),
        ],
    )


# The row of a fit


def test_a_row_knows_which_shared_nuisances_ended_at_bounds():
    fit = fitted(NOISE, COULOMB, nuisances=3)
    own = replace(fit.parameters[2], run="slow")
    fit = replace(
        fit,
        values=np.array([0.0, 1.0, 1.0, 1.0]),
        parameters=(*fit.parameters[:2], own, fit.parameters[3]),
    )
    assert row_of(fit).at_bounds == ("n0", "n1")
    assert row_of(replace(fit, jacobian=fit.jacobian * [0, 1, 1, 1])).at_bounds == (
        "n1",
    )  # the first changes nothing


def test_motion_depends_roughly_on_a_joint_that_became_loose_not_on_one_that_was():
    loose = effect("loose", low=0.0, search_range=(0.1, 2.0))
    looser = effect("looser", low=-1.0, high=2.0, is_perturbation=True, search_range=(-0.5, 2.0))
    assert [row_of(fitted(NOISE, one)).is_nonsmooth for one in (loose, looser)] == [True, False]


# What held-out data show


def confirmed(identify=1.0, confirm=1.0, channel="crank_torque", variation=2.0, run=""):
    """Residuals of one channel that leave these gaps with the effects, a noise of 1, and the gaps
    of 2 before."""
    frames, gaps = [], []
    for role, gap in (("identify", identify), ("confirm", confirm)):
        series = {
            "run": run or role,
            "channel": channel,
            "held_out": role == "confirm",
            "spread": np.ones(9),
        }
        frames.append(pd.DataFrame(series | {"augmented": 1.0, "whitened_augmented": gap}))
        row = {
            "role": role,
            "before": 2.0,
            "after": gap,
            "after_low": 1.0,
            "fall_low": 2.0,
            "fall_high": 4.0,
        }
        names = ((run or role, channel), (run or role, "all"), ("all", "all"))
        gaps += [row | {"fall_expected": 3.0, "run": run, "channel": of} for run, of in names]
    return Confirmed(
        pd.concat(frames, ignore_index=True),
        pd.DataFrame(gaps),
        {key: variation for key, _ in pd.concat(frames).groupby(["run", "channel"])},
    )


def together(*parts):
    """Several channels or runs; the gaps are those of the first."""
    variation = {key: value for part in parts for key, value in part.variation.items()}
    return Confirmed(pd.concat([part.residuals for part in parts]), parts[0].gaps, variation)


def test_the_channel_with_the_largest_rest_counts_however_many_are_met_and_runs_by_the_root_mean_square():
    found = together(
        confirmed(4.0, 0.5), *(confirmed(1.0, 2.0, f"other_{number}") for number in range(9))
    ).held_out
    assert (found.fitted, found.held_out) == ((4.0, "crank torque"), (2.0, "other 0"))
    assert (found.gap, found.test.outcome) == (0.5, "falls")
    found = together(confirmed(1.0, run="a"), confirmed(4.0, run="b")).held_out
    assert found.fitted == (pytest.approx(np.sqrt((1 + 16) / 2)), "crank torque")


def test_noise_is_the_largest_part_of_what_a_channel_varies_by_a_crank_angle_by_no_more_than_a_turn():
    found = together(confirmed(), confirmed(channel="slider_x", variation=1.25)).held_out
    assert found.noise == (pytest.approx(0.8), "slider x")
    angle = np.linspace(0.0, 60 * 2 * np.pi, 5000)
    series = Series("run", "crank_angle", "rad", angle, angle, angle, angle > 0)
    assert series.variation(angle) == pytest.approx(2 * np.pi / np.sqrt(12))
    assert replace(series, unit="m").variation(angle) == pytest.approx(angle.std())


def test_the_gap_falls_or_rises_by_more_than_noise_leaves_open_or_stays_where_it_should_fall():
    def check(low, high, outcome):
        found = confirmed()
        found = replace(
            found, gaps=found.gaps.assign(fall_low=low, fall_high=high, fall_expected=0.5)
        )
        assert (found.test.outcome, found.test.before, found.test.after) == (outcome, 2.0, 1.0)

    each(
        check,
        [
            (0.01, 0.02, "falls"),
            (-0.02, -0.01, "rises"),
            (-0.01, 0.02, "stays"),
            (-0.01, 0.5, "cannot_tell"),
        ],
    )


def test_of_held_out_runs_one_of_which_cannot_be_simulated_the_one_that_speaks_against_counts():
    held = confirmed()
    lost = held.gaps[held.gaps["role"] == "confirm"].assign(after=np.nan)
    one = lost.query("run == 'confirm' and channel == 'all'")
    rises = one.assign(run="b", after=2.2, fall_low=-1.0, fall_high=-0.5)
    falls = one.assign(run="c", after=1.0, fall_low=1.0, fall_high=2.0)
    expected = (
        ([falls], "falls"),
        ([falls, rises], "rises"),
        ([rises, falls], "rises"),
        ([], "not_simulated"),
    )
    for rows, outcome in expected:
        assert replace(held, gaps=pd.concat([lost, *rows])).test.outcome == outcome
    assert (
        replace(held, gaps=held.gaps.query("role == 'identify'")).test.outcome == "nothing_held_out"
    )


# With held-out data heard


BASE, FRICTION = fitted(4.0 * SAMPLES), fitted(990.0, COULOMB)
NAMED = Decision("named", FRICTION, BASE)


def test_a_name_that_the_held_out_data_bear_out_stands_and_channels_in_doubt_are_no_evidence():
    assert final_verdict(NAMED, confirmed()) is NAMED
    assert "torque" in final_verdict(NAMED, confirmed(), ["torque"]).because


def test_errors_grow_with_the_gap_that_is_left_of_held_out_data():
    rest = Decision(
        "named_with_remaining_misfit", fitted(4.0 * (SAMPLES - 2), COULOMB), fitted(9e4)
    )
    for gap, scale in ((0.9, 1.0), (1.4, 1.4)):
        assert final_verdict(NAMED, confirmed(confirm=gap)).chosen.scale == pytest.approx(scale)
        assert final_verdict(rest, confirmed(confirm=gap)).chosen.scale == pytest.approx(2.0)
    # so do those of what is best known and equivalent, and of the base where nothing is proposed
    withheld = final_verdict(NAMED, confirmed(confirm=4.0))
    assert (withheld.verdict, withheld.chosen, withheld.best_known.gap_left) == (
        "unexplained",
        BASE,
        4.0,
    )
    rivals = Decision("ambiguous", BASE, BASE, [FRICTION, fitted(991.0, SPRING)])
    heard = final_verdict(rivals, confirmed(confirm=1.4))
    assert ([fit.gap_left for fit in heard.equivalent], heard.chosen.gap_left) == ([1.4, 1.4], 1.0)
    alone = final_verdict(Decision("parameters_only", BASE, BASE), confirmed(confirm=1.4))
    assert (alone.chosen.gap_left, alone.best_known) == (1.4, None)
