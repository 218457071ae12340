"""Costs of a campaign by stage and in total: CPU time, simulated runs and revolutions."""

import math

import pytest

from benchmarks.project import ROOT
from jointgap.campaign.campaign_files import costs, recorded_costs
from jointgap.campaign.state import CampaignState
from jointgap.core.costs import count_run
from jointgap.core.results_folder import ResultsFolder
from jointgap.rig.model import build_model


def test_the_costs_of_a_campaign_are_the_sum_over_its_stages_of_whatever_process(tmp_path):
    folder = ResultsFolder(tmp_path)
    for stage, runs in (("measure", 2), ("identify", 9), ("identify", 3)):  # repeated: counts once
        with recorded_costs(folder, stage):
            for _ in range(runs):
                count_run(12.5)
            sum(range(3_000_000))
    found = costs(folder)
    spent = {stage: (cost["runs"], cost["revolutions"]) for stage, cost in found["jobs"].items()}
    assert spent == {"measure": (2, 25.0), "identify": (3, 37.5)}
    assert (found["total"]["runs"], found["total"]["revolutions"]) == (5, 62.5)
    assert found["total"]["cpu_seconds"] == pytest.approx(
        sum(own["cpu_seconds"] for own in found["jobs"].values())
    )
    assert found["total"]["cpu_seconds"] > 0.0


def test_a_simulated_run_counts_with_the_revolutions_of_its_record(tmp_path):
    state = CampaignState(ROOT / "config/campaigns/demonstration.yaml", tmp_path)
    model = build_model(state.campaign, None, {run.id: 3.0 for run in state.campaign.runs})
    run = state.campaign.runs[0].id
    with recorded_costs(state.folder, "identify"):
        model.simulate(run, model.nominal(run))
    spent = costs(state.folder)["total"]
    turned = model.plans[run].samples.turned / math.tau
    assert spent["runs"] == 1
    assert spent["revolutions"] == pytest.approx(turned, abs=1e-3)
    assert turned >= 3.0
