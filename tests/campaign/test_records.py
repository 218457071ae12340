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
    keys = ("name", "site", "delta_bic", "parameters")
    rows = [(name, site, 10.0 * x, {key: {"value": x}}) for name, site, key, x in effects]
    found = [dict(zip(keys, row, strict=True)) for row in rows]
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
    pins = {"crank_pin": 1.0, "piston_pin": 2.0}
    effects = [("pin_friction", pin, "coefficient", size) for pin, size in pins.items()]
    both = " + ".join(f"pin_friction:{pin}" for pin in pins)
    expected = {f"effect/pin_friction_{pin}_coefficient": size for pin, size in pins.items()}
    expected |= {f"effect/pin_friction_{pin}_delta_bic": 10.0 * pins[pin] for pin in pins}
    assert effect_metrics(tmp_path, *effects, explanation=both) == expected
    spring = effect_metrics(
        tmp_path, ("slider_spring", "slider", "stiffness_N_m", 5.0), explanation="slider_spring"
    )
    assert spring["effect/slider_spring_stiffness_N_m"] == 5.0
