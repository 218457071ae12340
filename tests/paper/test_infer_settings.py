"""Inference of settings that the paper does not print: known shares and nearest designs."""

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config import Scenario, resolve
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.designs.infer_settings import (
    NEAREST_NAME,
    NUMBERS,
    accept,
    check,
    inference_study,
    relative_errors,
)
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import infer_settings, write_sweep
from tests.draws import check_rate
from tests.motion.cases import mechanism, options

PAPER = mechanism(friction=0.1)
COARSE = options(revolutions=1, samples_per_revolution=1800, tolerance=1e-7)
SETTINGS = {
    "friction": {"from": 0, "to": 0.2},
    "restitution": {"from": 0.3, "to": 0.7},
    "error_measure": ["rms", "peak"],
}


def scenario(number=2048, within=0.05) -> Scenario:
    swept = {"parameters": SETTINGS, "number": number, "printed_numbers": True}
    options = {"within": within}
    return Scenario(mechanism=PAPER, simulate=COARSE, sweep=swept, infer_settings=options)


def inferred(designs, errors: np.ndarray, within=0.05):
    """Inferred from designs with these relative errors of each printed number."""
    frame = pd.DataFrame(designs.values(0, designs.number))
    return accept(designs, with_errors(frame, errors), within)


def with_errors(frame: pd.DataFrame, errors: np.ndarray) -> pd.DataFrame:
    numbers = {number.column: number.printed + number.scale * errors for number in NUMBERS}
    return frame.assign(design=np.arange(len(frame)), reason=None, **numbers)


def inferred_by_friction(within=0.05):
    """No error at a friction of 0.1, and 1 at 0.2."""
    designs = designs_of(scenario())
    friction = np.array([values["friction"] for values in designs.values(0, designs.number)])
    return inferred(designs, (friction - 0.1) / 0.1, within)


def test_a_number_is_reproduced_in_the_share_of_the_range_that_is_near_enough():
    known = inferred_by_friction(within=0.1)
    assert (relative_errors(known.frame) <= 0.1).mean(axis=0) == pytest.approx(0.1, abs=0.002)
    assert known.frame["together"].mean() == pytest.approx(0.1, abs=0.002)


def test_a_setting_on_which_the_numbers_depend_is_informative_and_the_others_are_not():
    known = inferred_by_friction()
    chances = known.settings.groupby("setting")["p_value"].first()
    assert chances["friction"] < 1e-3 < 0.01 < min(chances["restitution"], chances["error_measure"])
    own = known.settings[known.settings["setting"] == "friction"].iloc[0]
    assert (own["low"], own["high"]) == pytest.approx((0.0955, 0.1045), abs=5e-4)
    assert known.settings.groupby("setting")[
        ["drawn", "accepted"]
    ].sum().to_numpy() == pytest.approx(1.0)
    text = to_markdown(inference_study(known).page)
    assert text.count("| not informative |") == 3 and text.count("| informative |") == 1


def test_a_setting_without_influence_is_informative_once_in_a_hundred():
    """The errors are random; a list has fewer probabilities than a range, whose p is at most as
    small as stated."""
    random, designs = np.random.default_rng(1), designs_of(scenario(256))
    frame = pd.DataFrame(designs.values(0, 256))
    tables = [
        accept(designs, with_errors(frame, random.random(256)), 0.1).settings for _ in range(100)
    ]
    for setting, at_least in (("friction", 0.05), ("error_measure", 0.0)):
        rows = pd.concat(table[table["setting"] == setting].iloc[:1] for table in tables)
        p_value = rows["p_value"].to_numpy()
        check_rate(p_value < 0.1, at_least, 0.1)
        check_rate(p_value < 0.01, 0.0, 0.01)


@pytest.mark.parametrize(
    "sweep, message",
    [
        ({}, "sweep.parameters is empty"),
        ({"parameters": {"friction": {"from": 0, "to": 0.2}}}, "set sweep.printed_numbers to true"),
        (
            {"parameters": {"friction": [0.1]}, "printed_numbers": True},
            "every setting has one value",
        ),
    ],
)
def test_an_infeasible_section_is_an_error_before_any_simulation(sweep, message):
    with pytest.raises(InputError) as raised:
        check(Scenario(mechanism=PAPER, simulate=COARSE, sweep=sweep, infer_settings={}))
    assert message in str(raised.value)


@pytest.mark.integration
def test_the_stage_writes_page_tables_and_the_nearest_settings_as_a_scenario(tmp_path):
    made = scenario(16)
    write_sweep(made, tmp_path / "sweep", 1)
    text = infer_settings(ScenarioResults(tmp_path, made))
    assert "Nearest designs" in text and "nan" not in text
    designs = pd.read_parquet(tmp_path / "infer_settings/designs.parquet")
    nearest = designs.query("error_measure == 'rms'").iloc[0]
    written = yaml.safe_load((tmp_path / "infer_settings/nearest_scenario.yaml").read_text())
    nearest_made = resolve(written, (tmp_path,), whole=False)[NEAREST_NAME]
    contact = nearest_made.mechanism.joint("piston_pin").contact
    assert (contact.friction, contact.restitution) == pytest.approx(
        (nearest["friction"], nearest["restitution"])
    )
