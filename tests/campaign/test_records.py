"""MLflow metrics of a verdict."""

import json

import pandas as pd
from mlflow.utils.validation import _validate_metric_name

from jointgap.campaign.campaign_files import VERDICT
from jointgap.campaign.mlflow_runs import records
from jointgap.core import schema
from jointgap.core.results_folder import ResultsFolder
from tests.campaign.verdicts import NAMED


def effect_metrics(folder, *effects: tuple, explanation: str) -> dict:
    """Metrics of the effects of a campaign whose verdict names these: name, site, parameter,
    value."""
    found = [
        {
            "name": name,
            "site": site,
            "delta_bic": 10.0 * value,
            "parameters": {parameter: {"value": value}},
        }
        for name, site, parameter, value in effects
    ]
    (folder / VERDICT).write_text(json.dumps(NAMED | {"because": "so it is", "effects": found}))
    fills = {"int": 1, "float": 1.0, "text": "", "category": "", "bool": True}
    row = {column.name: fills[column.kind] for column in schema.RANKING.columns} | {
        "explanation": explanation
    }
    ResultsFolder(folder).write("ranking", pd.DataFrame([row]))
    record, _ = records(folder)
    for name in record.metrics:
        _validate_metric_name(name)
    return {name: value for name, value in record.metrics.items() if name.startswith("effect/")}


def test_effects_have_metrics_each_with_their_site_where_a_name_has_two(tmp_path):
    pins = [
        ("pin_friction", "crank_pin", "coefficient", 1.0),
        ("pin_friction", "piston_pin", "coefficient", 2.0),
    ]
    assert effect_metrics(
        tmp_path, *pins, explanation="pin_friction:crank_pin + pin_friction:piston_pin"
    ) == {
        "effect/pin_friction_crank_pin_coefficient": 1.0,
        "effect/pin_friction_crank_pin_delta_bic": 10.0,
        "effect/pin_friction_piston_pin_coefficient": 2.0,
        "effect/pin_friction_piston_pin_delta_bic": 20.0,
    }
    spring = effect_metrics(
        tmp_path, ("slider_spring", "slider", "stiffness_N_m", 5.0), explanation="slider_spring"
    )
    assert spring["effect/slider_spring_stiffness_N_m"] == 5.0
