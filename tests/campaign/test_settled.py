"""Later results refer to the base of the verdict if it is better than the recalibrated one."""

from dataclasses import replace

import pytest

from benchmarks.project import ROOT
from jointgap.campaign import reoptimise
from jointgap.campaign.identify import explain, locate, write_tables
from jointgap.campaign.state import FALSE_ALARM_RATE, CampaignState
from jointgap.campaign.verdict_json import gap_of
from jointgap.config import load_mechanism
from jointgap.core.errors import SimulationError
from jointgap.identification import identification
from jointgap.identification.disagreement import map_disagreement
from jointgap.identification.force_law import ForceLawResult
from jointgap.identification.verdict import Decision

pytestmark = pytest.mark.integration


@pytest.fixture
def better(chain):
    """Another base than the recalibrated one, with other residuals."""
    base = chain.recalibrated.base
    values = base.values.copy()
    values[[p.name for p in base.parameters].index("slider_mass")] *= 1.01
    by_key = {p.key: value for p, value in zip(base.parameters, values, strict=True)}
    return replace(base, values=values, residual=chain.recalibrated.problem.residual(by_key))


@pytest.fixture
def state(chain, tmp_path, monkeypatch):
    """A campaign with the model of the chain, whose fits are known."""
    state = CampaignState(ROOT / "config/campaigns/demonstration.yaml", tmp_path)
    state.model, state.inconsistent_channels, state.library = chain.model, (), []
    state.steps = ()
    monkeypatch.setattr(identification, "first_values", lambda *_: {})
    monkeypatch.setattr(identification, "noise_of_model", lambda *_: chain.noise)
    monkeypatch.setattr(identification, "recalibrate", lambda *_: chain.recalibrated)
    monkeypatch.setattr(identification, "screen_candidates", lambda *_: chain.screening)
    return state


def explained(state, base, verdict, monkeypatch):
    decision = Decision(verdict, base, base, not_searched=("pairs",))
    monkeypatch.setattr(identification, "decide", lambda *_: decision)
    return explain(state)


def test_map_and_gaps_refer_to_the_better_base(state, chain, better, monkeypatch):
    identified, outcome = explained(state, better, "parameters_only", monkeypatch)
    problem, recalibrated = chain.recalibrated.problem, chain.recalibrated.base.residual
    assert outcome.base is better
    assert outcome.not_searched == ("pairs",)
    locate(state, identified, outcome)
    expected, other = (
        map_disagreement(problem, residual, FALSE_ALARM_RATE).bins["mean"].tolist()
        for residual in (better.residual, recalibrated)
    )
    means = state.folder.read("map_bins")["mean"].tolist()
    assert means == pytest.approx(expected) != pytest.approx(other)
    write_tables(state, identified, outcome)
    before = gap_of(state.folder.read("gaps"), "identify")["before"]
    assert before == pytest.approx(problem.gap(better.residual))
    assert before != pytest.approx(problem.gap(recalibrated))


def test_a_force_law_is_searched_from_the_better_base(state, better, monkeypatch):
    bases = []

    def search(problem, base, *_):
        bases.append(base)
        return ForceLawResult(None, False, "no law holds")

    monkeypatch.setattr(identification, "find_force_law", search)
    _, outcome = explained(state, better, "unexplained", monkeypatch)
    assert bases == [better] and outcome.because.endswith("no law holds")


def test_a_model_that_cannot_be_optimised_has_the_reason_and_the_other_its_lengths(monkeypatch):
    plain = load_mechanism("erkaya2009")
    heavy = plain.model_copy(update={"slider": plain.slider.model_copy(update={"mass": 9.0})})

    def optima(mechanism, speed):
        if mechanism.slider.mass == heavy.slider.mass:
            raise SimulationError("the slider jams")
        return [{"source": "network", "length": "crank_length", "optimum": 0.15}]

    monkeypatch.setattr(reoptimise, "_optima", optima)
    table = reoptimise.optimal_lengths({"base": plain, "augmented": heavy}, 30.0)
    assert table["failed"].isna().tolist() == [True, False]
    assert table["failed"].iloc[1] == "the slider jams"
    assert table["optimum"].iloc[0] == 0.15
