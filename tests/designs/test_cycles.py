"""Statistics over revolutions against what can be worked out by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT
from jointgap.designs.statistics import (
    clearance_vectors,
    contacts,
    cycles,
    eccentricity_band,
    periodicity,
    poincare_section,
    time_shares,
)
from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import ALL, SPEED, mechanism, options


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


def test_time_is_shared_out_among_flight_impact_and_contact():
    found = contacts(BY_HAND, "crank_pin")
    assert time_shares(found, 0.0, 10.0) == pytest.approx({"flight": 0.45, "impact": 0.05, "contact": 0.5})
    assert time_shares(found, 1.25, 2.25) == pytest.approx({"flight": 0.5, "impact": 0.25, "contact": 0.25})
    assert time_shares(contacts(BY_HAND, "piston_pin"), 0.0, 10.0) == {"flight": 1.0, "impact": 0.0, "contact": 0.0}


def test_a_contact_joins_its_impact_to_its_separation():
    found = contacts(BY_HAND, "crank_pin")
    assert list(found["begin"]) == [1.0, 2.0, 9.0]
    assert list(found["end"][:2]) == [1.5, 6.0] and math.isnan(found["end"][2])
    assert list(found["impulse"][:2]) == [2.0, 2.0] and math.isnan(found["peak_force"][2])


@pytest.mark.parametrize("period", [1, 2, 3])
def test_a_motion_that_repeats_after_some_revolutions_has_that_period(period):
    turns = np.arange(12 * 100 + 1) / 100
    vectors = 1e-3 * np.stack([np.cos(2 * np.pi * turns / period), np.sin(2 * np.pi * turns)], axis=1)
    found = periodicity(vectors, 100, 1e-3)
    assert found.period == period
    assert found.distances[period - 1] < 1e-15
    assert f"period {period}" in found.verdict


def test_a_motion_that_never_repeats_has_no_period_and_says_how_near_it_comes():
    turns = np.arange(8 * 100 + 1) / 100
    vectors = 1e-3 * np.cos(2 * np.pi * turns * (math.sqrt(5) - 1) / 2)[:, None]
    found = periodicity(vectors, 100, 1e-3)
    assert found.period is None
    # Three revolutions are nearest to a whole number, 2, of its turns: 3 x 0.618 = 1.854; the farthest is 2 sin(pi x
    # 0.146).
    assert found.distances[2] == pytest.approx(2e-3 * math.sin(math.pi * (2 - 3 * (math.sqrt(5) - 1) / 2)), rel=0.01)
    assert "after 3 it comes back nearest" in found.verdict


def test_a_period_needs_two_revolutions():
    with pytest.raises(InputError, match="simulate two or more"):
        periodicity(np.zeros((101, 2)), 100, 1e-3)


@pytest.fixture(scope="module")
def settled():
    made, wanted = mechanism(friction=0.2, loose=ALL), options(revolutions=12, samples_per_revolution=360)
    return made, wanted, simulate(made, wanted)


def test_the_journal_touches_its_bearing_where_it_carries_the_load(settled):
    made, _, run = settled
    last = run.samples.iloc[-361:]
    for joint, partner in (("crank_pin", "crank"), ("piston_pin", "slider"), ("crank_pivot", "frame")):
        assert made.joint(joint).journal == partner
        # Seen from the bearing: the clearance vector, turned round where the other body carries the journal
        centre = clearance_vectors(last, joint) * (1.0 if made.joint(joint).journal == JOINT[joint].body else -1.0)
        # A journal on the partner presses the bearing outwards: the force on the body points where the journal went.
        force = last[[f"{joint}_force_x", f"{joint}_force_y"]].to_numpy()
        loaded = np.linalg.norm(force, axis=1) > 50
        along = np.sum(centre * force, axis=1)[loaded] / np.linalg.norm(centre, axis=1)[loaded]
        assert np.all(along > 0.98 * np.linalg.norm(force, axis=1)[loaded])


def test_rates_of_the_clearance_vectors_are_their_derivatives(settled):
    _, _, run = settled
    fine = run.samples.iloc[-361:]
    for joint in ALL:
        vectors, rates = clearance_vectors(fine, joint), clearance_vectors(fine, joint, rates=True)
        way = np.trapezoid(rates, fine["time"], axis=0)
        np.testing.assert_allclose(way, vectors[-1] - vectors[0], atol=2e-5)


def test_statistics_of_a_settled_motion_say_that_it_repeats_in_contact(settled):
    made, wanted, run = settled
    found = cycles(run.samples, run.events, made, wanted, first=11)
    assert found.periodicity.period == 1
    last = found.revolutions[found.revolutions["revolution"] == 12]
    assert list(last["share_contact"]) == [1.0, 1.0, 1.0]
    shares = found.revolutions[["share_flight", "share_impact", "share_contact"]].sum(axis=1)
    np.testing.assert_allclose(shares, 1.0, rtol=1e-12)
    hardest = found.revolutions.groupby("joint")["peak_force"].max()
    assert (hardest >= run.events.groupby("joint")["peak_force"].max().reindex(hardest.index).fillna(0)).all()
    assert "period 1" in found.summary and "contact 100.0 %" in found.summary
    spread = found.eccentricity["high"] - found.eccentricity["low"]
    assert spread.max() < 1e-5
    apart = found.section.groupby("joint")[["x", "y"]].agg(np.ptp)
    assert apart.to_numpy().max() < 1e-5


def test_the_section_takes_each_revolution_once_at_the_angle_asked_for(settled):
    _, _, run = settled
    section = poincare_section(run.samples, ["crank_pin"], 360, math.radians(90.2), first=10)
    assert list(section["revolution"]) == [10, 11, 12]
    assert np.degrees(section["crank_angle"]).to_numpy() == pytest.approx([3330, 3690, 4050])
    at = run.samples.iloc[3330]
    assert math.hypot(section["x"][0], section["y"][0]) == pytest.approx(at["r2"], rel=1e-12)
    with pytest.raises(InputError, match="there are 12 revolutions"):
        poincare_section(run.samples, ["crank_pin"], 360, first=13)


def test_the_band_of_the_eccentricity_holds_nine_tenths_of_the_revolutions():
    r = np.tile(np.arange(1, 22) * 1e-4, (4, 1)).T.ravel()  # 21 revolutions of 4 samples
    samples = pd.DataFrame({"crank_angle": np.arange(85) * math.pi / 2, "r2": np.append(r, r[-1])})
    band = eccentricity_band(samples, ["crank_pin"], 4, 1)
    np.testing.assert_allclose(band[["low", "mean", "high"]], np.tile([2e-4, 11e-4, 20e-4], (4, 1)))
