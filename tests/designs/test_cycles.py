"""Statistics over revolutions against values by hand."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.designs.statistics import (
    contacts,
    cycles,
    periodicity,
    poincare_section,
    time_shares,
)
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import ALL, SPEED, mechanism, options


def events(*rows) -> pd.DataFrame:
    """Rows of time, event, maxima of one joint."""
    frame = pd.DataFrame(rows, columns=["time", "event", "maxima"])
    begins = frame["event"] == "impact"
    return frame.assign(
        joint="crank_pin",
        crank_angle=SPEED * frame["time"],
        approach_speed=np.where(begins, 0.5, np.nan),
        impulse=np.where(begins, np.nan, 2.0),
        peak_force=np.where(begins, np.nan, 100.0),
    )


BY_HAND = events(
    (1.0, "impact", np.nan),
    (1.5, "separation", 1),  # half a second of impact
    (2.0, "impact", np.nan),
    (6.0, "separation", 7),  # four of contact
    (9.0, "impact", np.nan),  # one of contact, not ended
)


def test_shares_of_flight_impact_and_contact_add_up_to_the_time():
    found = contacts(BY_HAND, "crank_pin")
    assert time_shares(found, 0.0, 10.0) == pytest.approx(
        {"flight": 0.45, "impact": 0.05, "contact": 0.5}
    )
    assert time_shares(found, 1.25, 2.25) == pytest.approx(
        {"flight": 0.5, "impact": 0.25, "contact": 0.25}
    )
    assert time_shares(contacts(BY_HAND, "piston_pin"), 0.0, 10.0) == {
        "flight": 1.0,
        "impact": 0.0,
        "contact": 0.0,
    }


def test_the_period_is_the_number_of_revolutions_after_which_the_motion_repeats():
    for period in (1, 3):
        turns = np.arange(12 * 100 + 1) / 100
        vectors = 1e-3 * np.stack(
            [np.cos(2 * np.pi * turns / period), np.sin(2 * np.pi * turns)], axis=1
        )
        found = periodicity(vectors, 100, 1e-3)
        assert found.period == period and found.distances[period - 1] < 1e-15
    turns = np.arange(8 * 100 + 1) / 100
    vectors = 1e-3 * np.cos(2 * np.pi * turns * (math.sqrt(5) - 1) / 2)[:, None]
    found = periodicity(vectors, 100, 1e-3)
    assert found.period is None
    # three revolutions are nearest to a whole number, 2, of its turns: 3 x 0.618 = 1.854
    assert found.distances[2] == pytest.approx(
        2e-3 * math.sin(math.pi * (2 - 3 * (math.sqrt(5) - 1) / 2)), rel=0.01
    )


@pytest.fixture(scope="module")
def settled():
    made, wanted = (
        mechanism(friction=0.2, loose=ALL),
        options(revolutions=12, samples_per_revolution=360),
    )
    return made, wanted, simulate(made, wanted)


def test_a_settled_motion_with_friction_has_period_1_and_lasting_contact(settled):
    made, wanted, run = settled
    found = cycles(run.samples, run.events, made, wanted, settled_revolution=11)
    assert found.periodicity.period == 1
    last = found.revolutions[found.revolutions["revolution"] == 12]
    assert list(last["share_contact"]) == [1.0, 1.0, 1.0]
    shares = found.revolutions[["share_flight", "share_impact", "share_contact"]].sum(axis=1)
    np.testing.assert_allclose(shares, 1.0, rtol=1e-12)
    hardest = found.revolutions.groupby("joint")["peak_force"].max()
    assert (
        hardest >= run.events.groupby("joint")["peak_force"].max().reindex(hardest.index).fillna(0)
    ).all()
    spread = found.eccentricity["high"] - found.eccentricity["low"]
    assert spread.max() < 1e-5
    apart = found.section.groupby("joint")[["x", "y"]].agg(np.ptp)
    assert apart.to_numpy().max() < 1e-5


def test_the_section_has_each_revolution_once_at_the_requested_angle(settled):
    _, _, run = settled
    section = poincare_section(
        run.samples, ["crank_pin"], 360, math.radians(90.2), settled_revolution=11
    )
    assert list(section["revolution"]) == [11, 12]
    assert np.degrees(section["crank_angle"]).to_numpy() == pytest.approx([3690, 4050])
    assert math.hypot(section["x"][0], section["y"][0]) == pytest.approx(
        run.samples.iloc[3690]["r2"], rel=1e-12
    )
    with pytest.raises(InputError, match="the motion has 12 revolutions"):
        poincare_section(run.samples, ["crank_pin"], 360, settled_revolution=13)


def test_the_command_prints_and_writes_the_statistics_of_a_simulated_motion(tmp_path):
    sections = {
        "mechanism": mechanism(friction=0.2).model_dump(),
        "simulate": {"revolutions": 3, "samples_per_revolution": 360, "tolerance": 1e-9},
    }

    def call(*arguments) -> str:
        command = [*map(str, arguments)]
        done = CliRunner().invoke(cli, command, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return done.output

    options = ["--options", json.dumps(sections), "--results", tmp_path]
    call("simulate", *options)
    output = call("cycles", *options, "--angle", "90 deg")
    assert "from revolution 2 on: " in output and "crank_pin: flight" in output
    section = parquet.read(schema.POINCARE_SECTION, tmp_path / "cycles/section.parquet")
    assert list(section["revolution"]) == [2, 3, 2, 3]
    assert len(parquet.read(schema.JOINT_REVOLUTIONS, tmp_path / "cycles/revolutions.parquet")) > 0
