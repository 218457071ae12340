"""The verdict with the held-out data heard, by rules with sharp limits: each is met from both sides, with residuals
made up for it.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate, Parameter, Series
from jointgap.identification.confirmation import Confirmed, HeldOutTest
from jointgap.identification.decide_verdict import Decision, final_verdict
from jointgap.identification.fit import Fit

SAMPLES = 1000
COULOMB = Candidate("coulomb", "slider", (Parameter("size", 0.0),), ("size",))
LOOSE = Candidate("loose", "pin", (Parameter("size", 0.0, 0.0),), ("size",), search_range=(0.1, 2.0))
LOOSER = Candidate(
    "looser", "pin", (Parameter("size", 0.0, -1.0, 2.0),), ("size",), is_perturbation=True, search_range=(-0.5, 2.0)
)
BIAS = Candidate("bias", "torque", (Parameter("size", 0.0),), ("size",), sensor=True, has_site=True)
OFFSET = Candidate("offset", "sensor", (Parameter("size", 0.0),), ("size",), sensor=True)


def fitted(chi2, *effects, at_bounds=0):
    """A fit with a residual of `chi2`, and so many nuisances at the end of their range."""
    residual = np.zeros(SAMPLES)
    residual[0] = np.sqrt(chi2)
    parameters = tuple(Parameter(f"{candidate.label}.size", 0.0) for candidate in effects)
    parameters += tuple(Parameter(f"mass_{number}", 0.5, 0.0, 1.0) for number in range(at_bounds))
    count = len(parameters)
    return Fit(effects, parameters, np.ones(count), residual, np.ones((SAMPLES, count)), 1, "converged")


BASE = fitted(4.0 * SAMPLES)


def decided(verdict, *effects, chi2=1000.0, base=BASE, others=()):
    """What the fits say."""
    best = fitted(chi2, *effects)
    if verdict == "ambiguous":
        return Decision(verdict, base, base, [best, *others])
    return Decision(verdict, best, base, because="as the fits have it")


def confirmed(
    identify=1.0,
    confirm=1.0,
    before=2.0,
    fall=(2.0, 4.0),
    expected=3.0,
    signal=1.0,
    channel="torque",
    low=1.0,
):
    """Gaps of one channel with the effects, the bootstrap's interval of the fall, and the fall that is foretold.

    The noise is 1, the channel varies by `signal`, and the interval of the gap with the effects begins at `low`.
    """
    frames, gaps = [], []
    for role, gap in (("identify", identify), ("confirm", confirm)):
        measured = signal * np.where(np.arange(SAMPLES) % 2, 1.0, -1.0)
        frames.append(
            pd.DataFrame(
                {
                    "run": role,
                    "channel": channel,
                    "held_out": role == "confirm",
                    "measured": measured,
                    "augmented": measured - gap,
                    "whitened_augmented": gap,
                    "spread": 1.0,
                }
            )
        )
        row = {"role": role, "before": before, "after": gap, "fall_low": fall[0], "fall_high": fall[1]}
        row["after_low"] = low
        gaps += [
            row | {"run": run, "channel": of, "fall_expected": expected} for run, of in ((role, channel), (role, "all"))
        ]
        gaps.append(gaps[-1] | {"run": "all"})
    variation = {(role, channel): signal for role in ("identify", "confirm")}
    return Confirmed(pd.concat(frames, ignore_index=True), pd.DataFrame(gaps), variation)


def test_a_name_that_the_held_out_data_bear_out_stands():
    found = decided("named", COULOMB)
    assert final_verdict(found, confirmed()) is found


def test_a_verdict_that_names_nothing_is_not_put_to_the_held_out_data():
    for verdict in ("no_disagreement", "parameters_only", "unexplained"):
        found = final_verdict(Decision(verdict, BASE, BASE), confirmed(confirm=99.0), doubted_channels=["torque"])
        assert (found.verdict, found.base) == (verdict, BASE)


# Errors where more than noise is left


@pytest.mark.parametrize(("gap", "scale"), [(0.9, 1.0), (1.4, 1.4)])
def test_errors_of_what_is_named_grow_with_the_gap_that_is_left_of_held_out_data(gap, scale):
    found = final_verdict(decided("named", COULOMB, chi2=990.0), confirmed(confirm=gap)).chosen
    assert found.scale == pytest.approx(scale)
    assert found.covariance()[0, 0] == pytest.approx(scale**2 / SAMPLES)


def test_so_do_those_of_what_is_best_known_and_of_all_that_is_equivalent_but_no_base_beside_them():
    withheld = final_verdict(decided("named", COULOMB), confirmed(confirm=4.0))
    assert (withheld.best_known.gap_left, withheld.chosen.gap_left) == (pytest.approx(4.0), 1.0)
    rivals = final_verdict(decided("ambiguous", COULOMB, others=[fitted(1001.0, BIAS)]), confirmed(confirm=1.4))
    assert [fit.gap_left for fit in rivals.equivalent] == pytest.approx([1.4, 1.4])


def test_errors_are_those_of_the_fitted_data_where_these_leave_more():
    found = final_verdict(decided("named_with_remaining_misfit", COULOMB, chi2=4.0 * SAMPLES), confirmed(confirm=1.2))
    assert found.chosen.scale == pytest.approx(2.0, rel=1e-3)


# The held-out data have a vote


@pytest.mark.parametrize(
    ("fall", "expected", "outcome", "verdict"),
    [
        ((0.01, 0.02), 0.5, "falls", "named"),
        ((-0.01, 0.02), 0.5, "stays", "named_with_remaining_misfit"),
        ((-0.02, -0.01), 0.5, "rises", "unexplained"),
        ((-0.02, -0.01), 0.001, "rises", "unexplained"),
        ((-0.01, 0.02), 0.019, "cannot_tell", "named"),
        ((-0.01, 0.02), 0.021, "stays", "named_with_remaining_misfit"),
    ],
)
@pytest.mark.parametrize("by_the_fits", ["named", "named_with_remaining_misfit"])
def test_a_name_needs_a_fall_of_the_held_out_gap_where_it_would_show(by_the_fits, fall, expected, outcome, verdict):
    held = confirmed(before=1.05, confirm=1.04, fall=fall, expected=expected)
    assert held.test.outcome == outcome
    found = final_verdict(decided(by_the_fits, COULOMB), held)
    assert found.verdict == (by_the_fits if verdict == "named" else verdict)
    if verdict == "unexplained":
        assert (found.chosen, found.best_known.label) == (BASE, "coulomb")
        assert found.because.startswith("with coulomb the gap on the held-out data does not fall: it ")


@pytest.mark.parametrize("gap", [1.05, 1.06])
def test_a_held_out_gap_that_does_not_fall_at_all_where_it_should_withholds_the_name(gap):
    held = confirmed(before=1.05, confirm=gap, fall=(-0.03, 0.02), expected=0.5)
    assert held.test.outcome == "stays"
    found = final_verdict(decided("named", COULOMB), held)
    assert (found.verdict, found.best_known.label) == ("unexplained", "coulomb")


@pytest.mark.parametrize(("low", "verdict"), [(1.05, "named"), (1.051, "named_with_remaining_misfit")])
def test_what_leaves_more_than_noise_on_held_out_data_is_named_with_a_rest(low, verdict):
    found = final_verdict(decided("named", COULOMB), confirmed(confirm=1.1, low=low))
    assert (found.verdict, found.chosen.label) == (verdict, "coulomb")
    because = "it leaves noise alone on the data used for fitting, but more on the held-out data"
    assert (found.because == because) == (verdict != "named")


@pytest.mark.parametrize(
    ("before", "low", "verdict"),
    [
        (1.30, 1.14, "named_with_remaining_misfit"),  # 0.69 beyond noise, of which 0.33 are left
        (1.27, 1.14, "unexplained"),  # 0.61
        (1.27, 1.05, "named"),
    ],
)
def test_where_held_out_data_leave_more_than_noise_half_of_what_was_there_has_to_be_gone(before, low, verdict):
    held = confirmed(confirm=1.155, before=before, low=low)
    for by_the_fits in ("named", "named_with_remaining_misfit"):
        found = final_verdict(decided(by_the_fits, COULOMB), held)
        assert found.verdict == (verdict if verdict != "named" else by_the_fits)
        assert (found.best_known is None) == (verdict != "unexplained")


@pytest.mark.parametrize(
    ("fall", "verdict"), [((0.1, 0.2), "named_with_remaining_misfit"), ((-0.1, 9.0), "unexplained")]
)
def test_of_a_base_that_hardly_shows_what_leaves_more_than_noise_has_to_be_confirmed(fall, verdict):
    found = decided("named", COULOMB, base=fitted(1080.0))
    assert final_verdict(found, confirmed(before=1.4, confirm=1.1, low=1.06, fall=fall)).verdict == verdict


# Nuisances at their bounds, and noise that is no noise


@pytest.mark.parametrize(
    ("at_bounds", "signal", "verdict"), [(3, 3.3, "unexplained"), (2, 3.3, "named"), (3, 3.4, "named")]
)
def test_where_three_nuisances_end_at_bounds_and_noise_is_a_third_of_the_signal_nothing_is_named(
    at_bounds, signal, verdict
):
    best = fitted(1000.0, COULOMB, at_bounds=at_bounds)
    found = final_verdict(Decision("named", best, BASE), confirmed(signal=signal))
    assert found.verdict == verdict
    if verdict == "unexplained":
        assert (found.best_known.label, "mass_0, mass_1, mass_2" in found.because) == ("coulomb", True)


def test_held_out_data_that_cannot_be_simulated_or_are_not_there_do_not_veto():
    lost = confirmed()
    lost.gaps.loc[lost.gaps["role"] == "confirm", ["after", "fall_low", "fall_high", "fall_expected"]] = np.nan
    lost.residuals.loc[lost.residuals["held_out"], ["augmented", "whitened_augmented"]] = np.nan
    assert lost.test.outcome == "not_simulated"
    fitted_alone = lost.residuals[~lost.residuals["held_out"]], lost.gaps[lost.gaps["role"] == "identify"]
    none = Confirmed(*fitted_alone, lost.variation)
    assert none.test.outcome == "nothing_held_out"
    for held in (lost, none):
        assert final_verdict(decided("named", COULOMB), held).verdict == "named"


def test_of_held_out_runs_one_of_which_cannot_be_simulated_the_one_that_speaks_against_counts():
    held = confirmed()
    lost = held.gaps[held.gaps["role"] == "confirm"].assign(after=np.nan)
    rises = lost.query("run == 'confirm' and channel == 'all'").assign(
        run="b", after=2.2, fall_low=-1.0, fall_high=-0.5
    )
    falls = rises.assign(run="c", after=1.0, fall_low=1.0, fall_high=2.0)
    for rows, outcome in (([falls], "falls"), ([falls, rises], "rises"), ([rises, falls], "rises")):
        assert replace(held, gaps=pd.concat([lost, *rows])).test.outcome == outcome


# An absolute end


@pytest.mark.parametrize(
    ("role", "where"), [("identify", "the data used for fitting"), ("confirm", "the held-out data")]
)
@pytest.mark.parametrize(("gap", "verdict"), [(2.99, "named_with_remaining_misfit"), (3.01, "unexplained")])
def test_a_gap_of_three_is_left_at_most_in_a_channel_of_fitted_and_of_held_out_data(role, where, gap, verdict):
    far, met = (confirmed(**{role: left, "before": 2280.0, "fall": (9.0, 99.0)}) for left in (gap, 0.0))
    others = [met.residuals.assign(channel=f"other_{number}") for number in range(4)]  # together they are met
    variation = {key: 1.0 for one in others for key in one.groupby(["run", "channel"]).groups}
    gaps = [met.gaps.query("channel == 'torque'").assign(channel=f"other_{number}") for number in range(4)]
    held = Confirmed(pd.concat([far.residuals, *others]), pd.concat([far.gaps, *gaps]), far.variation | variation)
    found = final_verdict(decided("named_with_remaining_misfit", COULOMB), held)
    assert found.verdict == verdict
    if verdict == "unexplained":
        assert found.because == f"the best, coulomb, leaves a gap of 3.01 in torque on {where}: no small rest"
        assert found.best_known.label == "coulomb"


@pytest.mark.parametrize(("gap", "verdict"), [(1.49, "named_with_remaining_misfit"), (1.51, "unexplained")])
def test_in_all_channels_of_held_out_data_together_half_of_that(gap, verdict):
    held = confirmed(confirm=gap, before=99.0, low=1.4)
    for by_the_fits in ("named", "named_with_remaining_misfit"):
        found = final_verdict(decided(by_the_fits, COULOMB), held)
        assert found.verdict == verdict
        assert (found.best_known is None) == (verdict != "unexplained")
    assert final_verdict(decided("named", LOOSE), held).verdict == "named_with_remaining_misfit"


@pytest.mark.parametrize(("gap", "verdict"), [(2.99, "ambiguous"), (9.8, "unexplained")])
def test_explanations_that_all_leave_a_large_gap_are_not_called_equal(gap, verdict):
    found = final_verdict(decided("ambiguous", COULOMB, others=[fitted(1001.0, BIAS)]), confirmed(identify=gap))
    assert found.verdict == verdict
    assert len(found.equivalent) == (2 if verdict == "ambiguous" else 0)


def test_channels_that_are_met_make_up_for_none_that_is_not():
    near, far = confirmed(identify=1.0, channel="angle"), confirmed(identify=4.0)
    both = Confirmed(pd.concat([near.residuals, far.residuals]), far.gaps, near.variation | far.variation)
    assert {rest.channel: rest.gap for rest in both.rests("identify")} == pytest.approx({"angle": 1.0, "torque": 4.0})
    eleven = [confirmed(channel=f"other_{number}").residuals for number in range(11)]
    variation = far.variation | {key: 1.0 for frame in eleven for key in frame.groupby(["run", "channel"]).groups}
    many = Confirmed(pd.concat([*eleven, far.residuals]), far.gaps, variation)
    assert final_verdict(decided("named", COULOMB), many).verdict == "unexplained"


def test_runs_count_by_the_root_mean_square_of_their_rests():
    near, far = confirmed(identify=1.0), confirmed(identify=4.0)
    other = far.residuals.assign(run="other")
    both = Confirmed(pd.concat([near.residuals, other]), far.gaps, near.variation | {("other", "torque"): 1.0})
    (rest,) = both.rests("identify")
    assert rest.gap == pytest.approx(np.sqrt((1 + 16) / 2))


def test_a_crank_angle_varies_by_no_more_than_a_turn_however_long_it_ran():
    angle = np.linspace(0.0, 60 * 2 * np.pi, 5000)
    series = Series("run", "crank_angle", "rad", angle, angle, angle, angle > 0)
    assert series.variation(angle) == pytest.approx(2 * np.pi / np.sqrt(12))
    assert replace(series, unit="m").variation(angle) == pytest.approx(angle.std())


# A base that hardly shows


@pytest.mark.parametrize(
    ("fall", "verdict"), [((0.01, 0.02), "named_with_remaining_misfit"), ((-0.01, 0.9), "unexplained")]
)
def test_half_of_a_gap_that_hardly_shows_is_named_only_if_the_held_out_gap_falls(fall, verdict):
    base = fitted(1.08 * SAMPLES)
    found = decided("named_with_remaining_misfit", COULOMB, chi2=1.04 * SAMPLES, base=base)
    ended = final_verdict(found, confirmed(before=1.04, confirm=1.02, fall=fall, expected=0.04))
    assert ended.verdict == verdict
    assert (ended.best_known is None) == (verdict != "unexplained")


@pytest.mark.parametrize(
    ("base", "left"),
    [(1080.0, 1000.0), (1030.0, 985.0)],
    ids=["all of an excess that hardly shows", "an excess within what noise makes"],
)
def test_all_of_a_gap_that_hardly_shows_too(base, left):
    found = decided("named_with_remaining_misfit", COULOMB, chi2=left, base=fitted(base))
    unheard = confirmed(before=1.03, confirm=1.02, fall=(-0.01, 0.9), expected=0.5)
    assert unheard.test.outcome == "cannot_tell"
    assert final_verdict(found, unheard).verdict == "unexplained"
    falls = confirmed(before=1.03, confirm=1.02, fall=(0.01, 0.02), expected=0.02)
    assert final_verdict(found, falls).verdict == "named_with_remaining_misfit"


def test_what_leaves_noise_alone_of_a_gap_that_hardly_shows_stands_by_what_it_gains():
    found = decided("named", COULOMB, chi2=1000.0, base=fitted(1080.0))
    unheard = confirmed(before=1.03, confirm=1.02, fall=(-0.01, 0.9), expected=0.5)
    assert final_verdict(found, unheard).verdict == "named"


# Channels that contradict others


@pytest.mark.parametrize("effects", [(COULOMB,), (BIAS,), (OFFSET, COULOMB)])
def test_where_a_channel_contradicts_others_still_nothing_is_named(effects):
    assert final_verdict(decided("named", *effects), confirmed(), ()).verdict == "named"
    assert final_verdict(decided("named", *effects), confirmed(), ("torque",)).verdict == "unexplained"


def test_the_reason_names_the_channels_in_doubt():
    found = final_verdict(decided("named", COULOMB), confirmed(), ["crank_torque", "slider_acceleration"])
    assert found.because == (
        "what crank torque and slider acceleration read contradicts other channels, so no effect can be told from it"
    )
    rivals = decided("ambiguous", COULOMB, others=[fitted(1001.0, BIAS)])
    assert final_verdict(rivals, confirmed(), ["torque"]).verdict == "unexplained"


# In words


@pytest.mark.parametrize(
    ("outcome", "before", "after", "words"),
    [
        ("falls", 3.0, 1.021, "it falls from 3.00 to 1.02"),
        ("falls", 1.184, 1.181, "it falls from 1.184 to 1.181"),
        ("rises", 1.09, 1.12, "it rises from 1.09 to 1.12"),
        ("stays", 1.181, 1.184, "it stays at 1.18"),
        ("cannot_tell", 1.03, 1.01, "it stays within what noise leaves open, 1.03 before and 1.01 after"),
        ("falls", 2280.0, 139.4, "it falls from 2280 to 139"),
    ],
)
def test_words_are_true_of_the_numbers(outcome, before, after, words):
    assert HeldOutTest(outcome, before, after).words == words


@pytest.mark.parametrize(
    ("effect", "fall", "verdict"),
    [
        (LOOSE, (2.0, 6.0), "named_with_remaining_misfit"),
        (LOOSE, (-2.0, 6.0), "unexplained"),
        (COULOMB, (2.0, 6.0), "unexplained"),
        (LOOSER, (2.0, 6.0), "unexplained"),
    ],
)
def test_a_joint_that_became_loose_may_leave_a_large_gap_on_held_out_data_if_it_falls(effect, fall, verdict):
    data = confirmed(confirm=4.0, before=8.0, fall=fall, low=3.9)
    assert final_verdict(decided("named", effect), data).verdict == verdict


def test_a_joint_that_became_loose_may_leave_no_large_gap_on_the_data_used_for_fitting():
    assert final_verdict(decided("named", LOOSE), confirmed(identify=4.0, before=8.0)).verdict == "unexplained"
