"""What MLflow is told of a verdict, and what a second analysis in the same folder leaves of the first."""

import json
import shutil
from dataclasses import replace

import pandas as pd
import pytest
from mlflow.utils.validation import _validate_metric_name

from benchmarks.project import ROOT
from jointgap.campaign.analyse import analyse
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.mlflow_runs import records
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core import schema
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.results_folder import ResultsFolder

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def effect(name: str, site: str, parameter: str, value) -> dict:
    return {"name": name, "site": site, "delta_bic": 10.0 * value, "parameters": {parameter: {"value": value}}}


def concluded(folder, *effects: dict, explanation: str) -> list:
    """The records of a campaign whose verdict names `effects`."""
    found = {"schema_version": 2, "verdict": "named", "because": "so it is", "effects": list(effects)}
    found |= {"certain": [], "best_known": None}
    found |= {"gap": {"confirm": {"before": 3.0, "after": 1.0}}, "where": [], "equivalent": []}
    (folder / VERDICT).write_text(json.dumps(found))
    row = {column.name: 1 if column.kind == "int" else 1.0 for column in schema.RANKING.columns}
    row |= {column.name: "" for column in schema.RANKING.columns if column.kind == "text"}
    row |= {column.name: True for column in schema.RANKING.columns if column.kind == "bool"}
    ResultsFolder(folder).write("ranking", pd.DataFrame([row | {"explanation": explanation}]), "verdict")
    return records(folder)


def test_effects_of_one_name_at_two_sites_have_metrics_each(tmp_path):
    pins = [
        effect("pin_friction", site, "coefficient", value) for site, value in (("crank_pin", 1.0), ("piston_pin", 2.0))
    ]
    whole, _ = concluded(tmp_path, *pins, explanation="pin_friction:crank_pin + pin_friction:piston_pin")
    told = {name: value for name, value in whole.metrics.items() if name.startswith("effect/")}
    assert told == {
        "effect/pin_friction_crank_pin_coefficient": 1.0,
        "effect/pin_friction_crank_pin_delta_bic": 10.0,
        "effect/pin_friction_piston_pin_coefficient": 2.0,
        "effect/pin_friction_piston_pin_delta_bic": 20.0,
    }
    for name in told:
        _validate_metric_name(name)


def test_an_effect_that_has_but_one_site_is_called_by_its_name(tmp_path):
    spring = effect("slider_spring", "slider", "stiffness_N_m", 5.0)
    whole, _ = concluded(tmp_path, spring, explanation="slider_spring")
    assert whole.metrics["effect/slider_spring_stiffness_N_m"] == 5.0


@pytest.fixture
def used_before(tmp_path):
    """A results folder with what an earlier analysis concluded, and with a file of the user's own."""
    names = [VERDICT, MECHANISM, *SUMMARIES, "augment/force.parquet", "figures/mine.png"]
    names += [f"figures/{name}.{ending}" for name in FIGURES for ending in ("svg", "png", "parquet")]
    names += [
        "decide/decision.parquet",
        "regress/decision.parquet",
        "verdict/decision.parquet",
        "reoptimise/optimum.parquet",
    ]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("of another day")
    return tmp_path


def test_an_analysis_that_fails_leaves_no_older_conclusion(used_before, monkeypatch):
    def fails(case, **given):
        raise SimulationError("the slide flies off")

    monkeypatch.setitem(CAMPAIGN_STAGES, "measure", replace(CAMPAIGN_STAGES["measure"], function=fails))
    with pytest.raises(SimulationError):
        analyse(DEMONSTRATION, used_before)
    left = sorted(str(path.relative_to(used_before)) for path in used_before.rglob("*") if path.is_file())
    assert left == ["augment/force.parquet", "figures/mine.png"]


def test_an_analysis_that_cannot_begin_leaves_all_as_it_was(used_before):
    shutil.rmtree(used_before / "decide")
    (used_before / "decide").write_text("a file where a folder should be")
    with pytest.raises(InputError, match="cannot be written"):
        analyse(DEMONSTRATION, used_before)
    assert (used_before / VERDICT).read_text() == "of another day"
