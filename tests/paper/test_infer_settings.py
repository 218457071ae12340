"""The settings that the paper does not print: shares and nearest designs that are known."""

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
    departures,
    page,
)
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import infer_settings, sweep
from tests.draws import check_rate
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
    """Inferred from designs in which every printed number is off by a function of the parameters,
    as a share."""
    designs = designs_of(asked(number, parameters, **more))
    frame = pd.DataFrame(designs.values(0, number))
    off = departure(frame)
    for one in NUMBERS:
        frame[one.column] = one.printed + one.scale * off
    frame = frame.assign(design=np.arange(number), reason=None)
    return accept(designs, frame, more.get("within", 0.05))


def by_friction(frame: pd.DataFrame) -> np.ndarray:
    """No departure at a friction of 0.1, and 1 at 0.2."""
    return (frame["friction"].to_numpy() - 0.1) / 0.1


def test_a_number_comes_out_in_the_share_of_the_range_that_is_near_enough():
    known = found(by_friction, within=0.1)
    assert (departures(known.frame) <= 0.1).mean(axis=0) == pytest.approx(0.1, abs=0.002)
    assert known.frame["together"].mean() == pytest.approx(0.1, abs=0.002)


def test_a_setting_on_which_the_numbers_depend_is_informative_and_the_others_are_not():
    known = found(by_friction)
    chances = known.settings.groupby("setting")["p_value"].first()
    assert chances["friction"] < 1e-3 < 0.01 < min(chances["restitution"], chances["error_measure"])
    own = known.settings[known.settings["setting"] == "friction"].iloc[0]
    assert (own["low"], own["high"]) == pytest.approx((0.0955, 0.1045), abs=5e-4)
    assert known.settings.groupby("setting")[
        ["drawn", "accepted"]
    ].sum().to_numpy() == pytest.approx(1.0)
    text = to_markdown(page(known))
    assert text.count("| not informative |") == 3 and text.count("| informative |") == 1


def test_a_setting_without_influence_is_informative_once_in_a_hundred():
    """The departures are drawn; a list has fewer probabilities than a range, whose p is at most as
    small as stated."""
    random = np.random.default_rng(1)
    p = [
        found(lambda frame: random.random(len(frame)), number=512, within=0.1).settings
        for _ in range(100)
    ]
    for setting, at_least in (("friction", 0.05), ("error_measure", 0.0)):
        own = np.array([one.loc[one["setting"] == setting, "p_value"].iloc[0] for one in p])
        check_rate(own < 0.1, at_least, 0.1)
        check_rate(own < 0.01, 0.0, 0.01)


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
def test_what_cannot_be_inferred_is_refused_before_anything_is_simulated(sweep, message):
    with pytest.raises(InputError) as raised:
        check(Scenario(mechanism=PAPER, simulate=COARSE, sweep=sweep, infer_settings={}))
    assert message in str(raised.value)


@pytest.mark.integration
def test_from_a_sweep_come_page_tables_and_a_scenario_of_the_nearest_settings(tmp_path):
    scenario = asked(16)
    results = ScenarioResults(tmp_path, scenario)
    sweep(results, workers=1)
    text = infer_settings(results)
    assert "## Nearest designs" in text and "nan" not in text
    nearest = (
        pd.read_parquet(tmp_path / "infer_settings/designs.parquet")
        .query("error_measure == 'rms'")
        .iloc[0]
    )
    written = yaml.safe_load((tmp_path / "infer_settings/nearest_scenario.yaml").read_text())
    made = resolve(written, (tmp_path,), whole=False)[NEAREST_NAME]
    contact = made.mechanism.joint("piston_pin").contact
    assert (contact.friction, contact.restitution) == pytest.approx(
        (nearest["friction"], nearest["restitution"])
    )
