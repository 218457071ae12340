"""The base that the verdict rests on, where it is not the recalibrated one: every stage after
decide goes on with it.
"""

from dataclasses import replace

import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.campaign import reoptimise, stages
from jointgap.campaign.state import FALSE_ALARM_RATE, CampaignState
from jointgap.campaign.verdict_json import gap_of
from jointgap.config import load_mechanism
from jointgap.core.errors import SimulationError
from jointgap.identification import force_law, model_selection
from jointgap.identification.disagreement import map_disagreement
from jointgap.identification.verdict import Decision

pytestmark = pytest.mark.integration

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


@pytest.fixture
def better(chain):
    """Another base than the recalibrated one, with residuals of its own."""
    base = chain.recalibrated.base
    values = base.values.copy()
    values[[p.name for p in base.parameters].index("slider_mass")] *= 1.01
    moved = {p.key: value for p, value in zip(base.parameters, values, strict=True)}
    return replace(base, values=values, residual=chain.recalibrated.problem.residual(moved))


@pytest.fixture
def decided(chain, better, tmp_path, monkeypatch):
    """Makes a case on a folder in which deciding has found the better base; everything else is as
    the chain has it."""

    def made(verdict: str = "") -> CampaignState:
        found = CampaignState(DEMONSTRATION, tmp_path)
        found.model, found.noise_with_numerics, found.inconsistent_channels = (
            chain.model,
            chain.noise,
            (),
        )
        found.baseline, found.screening, found.library = chain.recalibrated, chain.screening, []
        if verdict:
            decision = Decision(verdict, better, better)
            monkeypatch.setattr(model_selection, "select_hypothesis", lambda *_: decision)
            found.folder.write("not_searched", pd.DataFrame({"step": ["pairs"]}), "pair/0")
            stages.decide(found)
        return found

    monkeypatch.setattr(CampaignState, "fits", lambda *_: ([], {}))
    made("parameters_only")
    return made


def test_map_gaps_gains_and_laws_are_counted_from_the_better_base(
    decided, chain, better, monkeypatch
):
    problem, recalibrated = chain.recalibrated.problem, chain.recalibrated.base.residual
    outcome = decided().outcome("decide")
    assert outcome.base.values == pytest.approx(better.values) and outcome.chosen is outcome.base
    stages.locate(decided())
    expected, other = (
        map_disagreement(problem, residual, FALSE_ALARM_RATE).bins["mean"].tolist()
        for residual in (better.residual, recalibrated)
    )
    assert (
        decided().folder.read("map_bins")["mean"].tolist()
        == pytest.approx(expected)
        != pytest.approx(other)
    )
    stages.regress(decided())
    stages.confirm(decided())
    before = gap_of(decided().folder.read("gaps"), "identify")["before"]
    assert (
        before
        == pytest.approx(problem.gap(better.residual))
        != pytest.approx(problem.gap(recalibrated))
    )
    assert decided().outcome("regress").base.bic == pytest.approx(better.bic)
    asked, nothing = [], force_law.ForceLawResult(None, False, "no law holds")
    monkeypatch.setattr(
        force_law, "find_force_law", lambda problem, base, *_: asked.append(base) or nothing
    )
    stages.regress(decided("unexplained"))
    assert asked[0].values == pytest.approx(better.values)


def test_a_model_that_cannot_be_optimised_again_has_the_reason_and_the_other_its_lengths(
    monkeypatch,
):
    plain = load_mechanism("erkaya2009")
    heavy = plain.model_copy(update={"slider": plain.slider.model_copy(update={"mass": 9.0})})

    def optima(mechanism, speed):
        if mechanism.slider.mass == heavy.slider.mass:
            raise SimulationError("the slider jams")
        return [{"source": "network", "crank_length": 0.15}]

    monkeypatch.setattr(reoptimise, "_optima", optima)
    found = reoptimise.reoptimise({"base": plain, "augmented": heavy}, 30.0)
    assert (
        found["failed"].isna().tolist() == [True, False]
        and found["failed"].iloc[1] == "the slider jams"
    )
    assert found["crank_length"].iloc[0] == 0.15
