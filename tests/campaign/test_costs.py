"""Costs of a campaign by job and in total: CPU time, simulated runs and revolutions."""

import math
from types import SimpleNamespace

import pytest

from benchmarks.project import ROOT
from jointgap.campaign.campaign_files import costs, recorded_costs
from jointgap.campaign.stages import run_stage
from jointgap.campaign.state import CampaignState
from jointgap.core.costs import count_run
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.stage import Stage
from jointgap.rig.model import build_model


def test_the_costs_of_a_campaign_are_the_sum_over_its_jobs_of_whatever_process(tmp_path):
    folder = ResultsFolder(tmp_path)
    jobs = [("recalibrate", 0, 1, 2), ("fit", 0, 1, 9), ("fit", 0, 2, 3), ("fit", 1, 2, 0)]
    for stage, part, parts, runs in jobs:  # the fit in one part is repeated in two
        with recorded_costs(folder, stage, part, parts):
            for _ in range(runs):
                count_run(12.5)
            sum(range(300_000))
    found = costs(folder)
    spent = {job: (cost["runs"], cost["revolutions"]) for job, cost in found["jobs"].items()}
    assert spent == {"recalibrate": (2, 25.0), "fit-0": (3, 37.5), "fit-1": (0, 0.0)}
    assert (found["total"]["runs"], found["total"]["revolutions"]) == (5, 62.5)
    assert found["total"]["cpu_seconds"] == pytest.approx(
        sum(own["cpu_seconds"] for own in found["jobs"].values())
    )
    assert found["total"]["cpu_seconds"] > 0.0


def test_every_stage_and_part_records_its_costs(tmp_path):
    state = SimpleNamespace(folder=ResultsFolder(tmp_path))

    def fails(state, **given):
        count_run(1.0)
        raise ValueError("it cannot be located")

    run_stage(Stage("locate", fails), state, optional=True)
    for part in (0, 1):
        run_stage(Stage("fit", lambda state, **given: count_run(1.0)), state, part=part, parts=2)
    run_stage(Stage("pair", lambda state, **given: None), state, part=0, parts=1)
    runs = {job: cost["runs"] for job, cost in costs(state.folder)["jobs"].items()}
    assert runs == {"locate": 1, "fit-0": 1, "fit-1": 1, "pair": 0}


def test_a_simulated_run_counts_with_the_revolutions_of_its_record(tmp_path):
    state = CampaignState(ROOT / "config/campaigns/demonstration.yaml", tmp_path)
    model = build_model(state.campaign, None, {run.id: 3.0 for run in state.campaign.runs})
    run = state.campaign.runs[0].id
    with recorded_costs(state.folder, "noise"):
        model.simulate(run, model.nominal(run))
    spent = costs(state.folder)["total"]
    turned = model.plans[run].samples.turned / math.tau
    assert spent["runs"] == 1
    assert spent["revolutions"] == pytest.approx(turned, abs=1e-3)
    assert turned >= 3.0
