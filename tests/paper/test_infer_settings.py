"""The settings that the paper does not print: a posterior that is known, shares and nearest designs that are known."""

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap import tables
from jointgap.config import Scenario, resolve
from jointgap.config.infer_settings_config import InferSettings
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.designs.design_of_experiments import designs_of
from jointgap.paper_settings.infer_settings import (
    NUMBERS,
    check_infer_settings,
    densest,
    effective_sample_size,
    inferred_from,
    weights,
)
from jointgap.paper_settings.infer_settings_page import headline, page
from jointgap.paper_settings.infer_settings_results import NEAREST_NAME, nearest_configuration
from jointgap.paper_settings.train_networks import NEAREST, RANDOM, train_networks
from jointgap.scenario.stages import infer_settings, sweep
from tests.dynamics.cases import mechanism, options

PAPER = mechanism(friction=0.1)
COARSE = options(revolutions=1, samples_per_revolution=1800, tolerance=1e-7)
SETTINGS = {
    "friction": {"from": 0, "to": 0.2},
    "restitution": {"from": 0.3, "to": 0.7},
    "error_measure": ["rms", "peak"],
}


def asked(number=2048, parameters=SETTINGS, **more) -> Scenario:
    swept = {"parameters": parameters, "number": number, "printed_numbers": True}
    return Scenario(mechanism=PAPER, simulate=COARSE, sweep=swept, infer_settings=more)


def found(departure, number=2048, parameters=SETTINGS, **more):
    """Inferred from designs in which every printed number is off by a function of the parameters, as a share."""
    designs = designs_of(asked(number, parameters, **more))
    frame = pd.DataFrame(designs.values(0, number))
    off = departure(frame)
    for one in NUMBERS:
        frame[one.column] = one.printed + one.scale * off
    frame = frame.assign(design=np.arange(number), reason=None)
    return inferred_from(designs, frame, InferSettings(**more))


def by_friction(frame: pd.DataFrame) -> np.ndarray:
    """No departure at a friction of 0.1, and 1 at 0.2."""
    return (frame["friction"].to_numpy() - 0.1) / 0.1


def test_the_posterior_of_a_setting_on_which_the_numbers_depend_is_the_normal_one_that_is_known():
    known = found(by_friction, number=8192, deviation=0.2)
    own, weight = known.frame["friction"].to_numpy(), known.frame["weight"].to_numpy()
    mean = weight @ own
    # two numbers, the reductions as one of them and the ratio, each of deviation 0.2 x 0.1
    assert mean == pytest.approx(0.1, abs=1e-4)
    assert np.sqrt(weight @ (own - mean) ** 2) == pytest.approx(0.02 / np.sqrt(2), rel=0.01)


def test_three_reductions_along_one_valley_count_as_one_number():
    off = np.array([[0.0, 0.0, 0.0, 0.0], [0.1, 0.1, 0.1, 0.0], [0.0, 0.0, 0.0, 0.1]])
    weight = weights(off, 0.1)
    assert weight[1] == pytest.approx(weight[2])
    assert weight[1] / weight[0] == pytest.approx(np.exp(-0.5))


def test_equal_weights_are_worth_all_designs_and_one_weight_is_worth_one():
    assert effective_sample_size(np.full(10, 0.1)) == pytest.approx(10)
    assert effective_sample_size(np.eye(10)[0]) == pytest.approx(1)


def test_a_number_comes_out_in_the_share_of_the_range_that_is_near_enough():
    known = found(by_friction, within=0.1)
    assert known.numbers["share"].to_numpy() == pytest.approx(0.1, abs=0.002)
    assert known.together == pytest.approx(0.1, abs=0.002)


def test_numbers_that_come_out_alone_need_not_come_out_together():
    designs = designs_of(asked())
    frame = pd.DataFrame(designs.values(0, 2048))
    for one, middle in zip(NUMBERS, (0.05, 0.05, 0.05, 0.15), strict=True):
        frame[one.column] = one.printed + one.scale * (frame["friction"] - middle) / 0.1
    known = inferred_from(designs, frame.assign(design=frame.index, reason=None), InferSettings())
    assert (known.numbers["share"] > 0.04).all()
    assert known.together == 0.0
    assert "together for none of 2048 designs" in headline(known)


def test_the_nearest_design_is_the_one_whose_farthest_number_is_nearest():
    known = found(by_friction)
    assert known.nearest.iloc[0]["friction"] == pytest.approx(0.1, abs=1e-4)
    assert np.all(np.diff(known.nearest["farthest"]) >= 0)


def test_a_scenario_gets_the_nearest_design_that_counts_as_its_optimum_does():
    known = found(lambda frame: by_friction(frame) + 0.3 * (frame["error_measure"] == "rms"))
    assert known.nearest.iloc[0]["error_measure"] == "peak"
    assert known.nearest_scenario["error_measure"] == "rms"
    assert known.nearest_scenario["friction"] == pytest.approx(0.07, abs=1e-3)


def test_settings_that_decide_are_told_and_the_others_are_not():
    known = found(by_friction)
    assert known.moved["told"].to_dict() == {"friction": True, "restitution": False, "error_measure": False}
    shown = to_markdown(page(known, pd.DataFrame(columns=tables.INFERRED_TRAINING.names)))
    assert (
        "does: friction: 0.075 to 0.125 (" in shown
        or "does: friction: 0.1 to 0.125 (" in shown
        or "does: friction: 0.075 to 0.1 (" in shown
    )
    assert "tell nothing of: restitution and measure of the error" in shown


def test_prior_and_posterior_of_each_setting_are_whole():
    sums = found(by_friction).settings.groupby("setting")[["prior", "posterior"]].sum()
    assert sums.to_numpy() == pytest.approx(1.0)


def test_half_of_the_weight_lies_in_the_fewest_bins_that_hold_it():
    rows = pd.DataFrame({"from": [0.0, 1, 2, 3], "to": [1.0, 2, 3, 4], "posterior": [0.1, 0.35, 0.4, 0.15]})
    assert densest(rows.assign(prior=0.25)) == pytest.approx((1.0, 3.0, 0.75, 0.5))


def test_failed_designs_are_left_out_and_counted():
    designs = designs_of(asked(64))
    frame = pd.DataFrame(designs.values(0, 64)).assign(design=range(64), reason=None)
    for one in NUMBERS:
        frame[one.column] = one.printed
    frame.loc[:3, "reason"] = "it broke"
    known = inferred_from(designs, frame, InferSettings())
    assert (known.failed, len(known.frame)) == (4, 60)
    with pytest.raises(InputError, match="all designs failed"):
        inferred_from(designs, frame.assign(reason="it broke"), InferSettings())


@pytest.mark.parametrize(
    ("sweep", "more", "message"),
    [
        ({}, {}, "nothing is swept"),
        ({"parameters": {"friction": {"from": 0, "to": 0.2}}}, {}, "set sweep.printed_numbers to true"),
        ({"parameters": {"friction": [0.1]}, "printed_numbers": True}, {}, "no setting varies"),
        (
            {"parameters": {"friction": [0.1, 0.2]}, "printed_numbers": True},
            {"samples_per_revolution": 500},
            "must be a multiple of the 360 points",
        ),
    ],
)
def test_what_cannot_be_inferred_is_refused_before_anything_is_simulated(sweep, more, message):
    simulate = options(revolutions=1, samples_per_revolution=1800, tolerance=1e-7).model_dump() | more
    with pytest.raises(InputError) as raised:
        check_infer_settings(Scenario(mechanism=PAPER, simulate=simulate, sweep=sweep, infer_settings={}))
    assert message in str(raised.value)


def test_from_a_sweep_come_page_tables_figures_and_a_scenario_of_the_nearest_settings(tmp_path):
    scenario = asked(16, trained=1, iterations=3)
    sweep(scenario, tmp_path / "sweep", 1)
    text = infer_settings(scenario, tmp_path / "sweep/designs", tmp_path / "infer")
    assert "## The nearest settings" in text and "## The training errors" in text
    assert "nan" not in text and "two of each have to tell" in text
    training = tables.read(tables.INFERRED_TRAINING, tmp_path / "infer/training.parquet")
    assert set(training["drawn"]) == {NEAREST, RANDOM} and len(training) == 16
    assert {path.stem for path in (tmp_path / "infer/figures").glob("*.png")} == {"printed_numbers", "posterior", "map"}
    nearest = pd.read_parquet(tmp_path / "infer/designs.parquet").query("error_measure == 'rms'").iloc[0]
    written = yaml.safe_load((tmp_path / "infer/nearest_scenario.yaml").read_text())
    made = resolve(written, (tmp_path,), whole=False)[NEAREST_NAME]
    contact = made.mechanism.joint("piston_pin").contact
    assert (contact.friction, contact.restitution) == pytest.approx((nearest["friction"], nearest["restitution"]))


def test_without_networks_the_page_says_so():
    known = found(by_friction, number=64, trained=0)
    training = train_networks(known)
    assert training.empty
    assert "No networks were trained" in to_markdown(page(known, training))


def test_where_no_scenario_counts_so_there_is_none():
    known = found(by_friction, parameters={"friction": {"from": 0, "to": 0.2}, "error_measure": ["peak"]})
    assert known.nearest_scenario is None
    assert nearest_configuration(known, asked()).startswith("# No design counts")
