"""Content and names of the MLflow runs of each stage."""

import hashlib
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.core import parquet, schema
from jointgap.core.joints import OUTPUTS
from jointgap.core.publish import thinned
from jointgap.scenario.mlflow_runs import scenario_records
from tests.scenario.mlflow_store import client_of, runs_of
from tests.scenario.published_tables import ITERATIONS, SECTIONS, fit, numbers, scenario


@pytest.fixture(scope="module")
def client(finished):
    return client_of(finished)


@pytest.fixture(scope="module")
def published(client):
    """The runs of the scenario by stage and output, as MLflow shows them."""
    runs = {}
    for run in runs_of(client).values():
        tags = run.data.tags
        runs[f"{tags['jointgap.stage']}/{tags['jointgap.output']}".removesuffix("/")] = run
    return runs


@pytest.fixture
def artifact(client, published):
    """Content of a file of a run, or the folder of that name."""

    def download(run: str, path: str):
        place = Path(client.download_artifacts(published[run].info.run_id, path))
        return place if place.is_dir() else place.read_bytes()

    return download


@pytest.fixture
def curve(client, published):
    """Values by step of a curve of a run."""

    def history(run: str, name: str):
        points = client.get_metric_history(published[run].info.run_id, name)
        assert len({point.step for point in points}) == len(points)
        return {point.step: point.value for point in points}

    return history


def test_results_costs_and_configuration_of_the_simulation_are_logged(published, artifact):
    run = published["simulate"].data
    metrics = {"seconds": 3.5, "peak_memory_mb": 123.4}
    metrics |= {"crank_pin_impacts": 2, "piston_pin_impacts": 1}
    assert {name: run.metrics[name] for name in metrics} == metrics
    params = {"simulate.revolutions": "4", "mechanism.crank.length": "0.15"}
    params["mechanism.joints.crank_pin.contact.friction"] = "0.05"
    assert {name: run.params[name] for name in params} == params
    assert json.loads(artifact("simulate", "options.json"))["simulate"]["revolutions"] == 4
    assert artifact("figures", "figures/figure 5.png") == b"a picture"


def test_networks_are_nested_runs_with_errors_seconds_and_seeds(published):
    stage = published["surrogate"]
    for output in OUTPUTS:
        nested = published[f"surrogate/{output}"]
        assert nested.data.tags["mlflow.parentRunId"] == stage.info.run_id
        assert nested.info.run_name == f"paper {output}"
    metrics = published["surrogate/r2"].data.metrics
    for name in ("training_mse", "held_out_mse", "paper_mse", "spline_held_out_mse"):
        assert metrics[f"log10_{name}"] == pytest.approx(np.log10(metrics[name]))
        assert name in published["surrogate/regularised r2"].data.metrics
    assert {"held_out_mse_past_60_deg", "spline_held_out_mse_past_60_deg", "weights"} <= set(
        metrics
    )
    assert metrics["seconds"] == 10.0 and stage.data.metrics["seconds"] == 30.0
    assert metrics["seeds"] == 2 and metrics["seeds_iterations"] == 100
    # all seeds after as many iterations
    assert metrics["seeds_mse_median"] == pytest.approx(0.1 / 101)
    for model in ("network", "regularised"):
        assert stage.data.metrics[f"{model}_outputs"] == 8


@pytest.mark.parametrize(
    "run, name",
    [("surrogate/r2", "mse"), ("surrogate/r2", "log10_mse"), ("surrogate", "log10_mse/r2")],
)
def test_published_curves_are_thinned_and_keep_both_ends(curve, run, name):
    steps = sorted(curve(run, name))
    assert 280 <= len(steps) <= 300 and steps[:20] == list(range(20)) and steps[-1] == ITERATIONS


def test_curves_have_the_values_of_the_history(curve):
    for step, value in curve("surrogate/r2", "mse").items():
        assert value == pytest.approx(0.1 / (1 + step))
    assert sorted(curve("surrogate/regularised r2", "mse")) == list(range(51))
    steps = {"surrogate/r2": [10, 100], "surrogate/regularised r2": list(range(51))}
    for run, judged in steps.items():
        held_out = curve(run, "mse_held_out")
        assert sorted(held_out) == judged
        assert all(value == pytest.approx(0.2 / (1 + step)) for step, value in held_out.items())
    assert curve("surrogate", "log10_mse_held_out/r2")
    assert curve("surrogate", "log10_regularised_mse/r2")


@pytest.mark.parametrize("count", [1, 300, 301, 20_001])
def test_a_thinned_curve_has_at_most_300_points(count):
    thin = thinned(pd.Series(np.arange(count) * 2.0), 300)
    assert len(thin) == count if count <= 300 else 100 <= len(thin) <= 300
    assert thin.index[0] == 0 and thin.index[-1] == count - 1
    assert thin.index.is_monotonic_increasing
    np.testing.assert_array_equal(thin, 2 * thin.index)


def _by_hand(frame, seed: int, angle: np.ndarray) -> np.ndarray:
    """Layer by layer, as the table's description says: the source -1 is the bias."""
    rows = frame[(frame["model"] == "network") & (frame["seed"] == seed)]
    signal = angle[None] / (2 * np.pi)
    for layer in range(3):
        weights = rows[rows["layer"] == layer].pivot(
            index="neuron", columns="source", values="weight"
        )
        signal = weights.drop(columns=-1).to_numpy() @ signal + weights[[-1]].to_numpy()
        signal = np.tanh(signal) if layer < 2 else signal
    return 8.0 * signal[0] - 3.0


def loaded(folder: Path):
    """Layers of torch with published weights, loaded without pickle, and their description."""
    import torch

    about = json.loads((folder / "network.json").read_text())
    layers = [
        torch.nn.Linear(a, b, dtype=torch.float64)
        for a, b in pairwise(about.get("neurons", (1, 3, 2)))
    ]
    chain = torch.nn.Sequential(*(part for layer in layers for part in (layer, torch.nn.Tanh())))[
        :-1
    ]
    arrays = np.load(folder / "weights.npz", allow_pickle=False)
    chain.load_state_dict({name: torch.from_numpy(arrays[name]) for name in arrays})
    return lambda x: chain(torch.from_numpy(x)[:, None]).detach().numpy(), about


def test_torch_loads_published_weights(artifact, finished):
    angle = np.linspace(0, 2 * np.pi, 9)
    chain, _ = loaded(artifact("surrogate/gamma2", "network"))
    values = 8.0 * chain(angle / (2 * np.pi))[:, 0] - 3.0
    np.testing.assert_allclose(values, _by_hand(fit(OUTPUTS.index("gamma2")), 7, angle), rtol=1e-12)


def test_dataset_inputs_carry_the_digest_of_their_file(published, finished):
    inputs = published["surrogate/r2"].inputs.dataset_inputs
    inputs = {entry.dataset.name: entry for entry in inputs}
    assert set(inputs) == {"trajectory", "fit/r2", "fit_errors/r2", "fit_history/r2"}
    for name, entry in inputs.items():
        path = finished / "paper" / f"{name}.parquet"
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        tags = {tag.key: tag.value for tag in entry.tags}
        assert tags["jointgap.sha256"] == digest and digest.startswith(entry.dataset.digest)
        assert tags["mlflow.data.context"] == ("input" if name == "trajectory" else "result")
        assert json.loads(entry.dataset.source)["uri"] == str(path)
    for stage in ("kinematics", "optimise"):
        names = {entry.dataset.name for entry in published[stage].inputs.dataset_inputs}
        assert {"trajectory", *(f"fit/{output}" for output in OUTPUTS)} <= names


def test_the_stage_has_the_optimum_found_in_the_papers_way(published):
    stage = published["optimise"].data
    assert stage.tags["jointgap.point"] == "networks_paper_genetic"
    lengths = stage.metrics["crank_length_mm"], stage.metrics["crank_length_change_um"]
    assert lengths == pytest.approx((149.0, -1000.0))
    assert stage.metrics == published["optimise/networks_paper_genetic"].data.metrics
    metrics = published["optimise/simulation_wide_genetic"].data.metrics
    low = metrics["resimulated_settled/rms_reduction_low_percent"]
    assert metrics["gain_revolution_low_percent"] == pytest.approx(low, abs=1e-4)


def test_verdicts_on_the_paper_are_counted_and_listed(published, artifact):
    metrics = published["compare"].data.metrics
    counts = {"number agrees": 1, "claim holds": 2, "claim does not hold": 0}
    assert {name: metrics[f"verdicts/{name}"] for name in counts} == counts
    assert {"ours/rods gain real at 5", "ratio/rods gain real at 5"} <= set(metrics)
    assert artifact("compare", "comparison.md") == b"in words"


def write(frames, folder):
    files = {name: folder / f"{name}.parquet" for name in frames}
    for name, frame in frames.items():
        parquet.write(schema.TABLES[name], frame, files[name])
    return files


def test_a_box_without_an_optimum_has_the_reason_and_no_lengths_or_gain(tmp_path):
    status = "no lengths within the bounds keep the pin force below 300 N"
    point = {"point": ["original", "least_force_paper"], "box": [None, "paper"]}
    point |= {"method": ["original", "least_force"], "status": [None, status]}
    point["source"] = "simulation"
    files = write({"optimise_optima": numbers(schema.OPTIMISE_OPTIMA, 2, **point)}, tmp_path)
    (record,) = scenario_records(scenario(), SECTIONS, files, tmp_path)
    assert (record.stage, record.output, record.notes["status"]) == ("optimise", "", status)
    assert not record.metrics


def test_without_networks_the_run_of_the_stage_has_the_chosen_lengths(tmp_path):
    point = ["simulation_paper_genetic", "simulation_paper_local"]
    optima = {"point": point, "source": "simulation", "box": "paper"}
    optima |= {"method": ["genetic", "local"], "crank_length": [0.148, 0.149]}
    gains = {"point": point * 2, "measure": "rms", "error": [2.0, 1.0] * 2}
    gains["stretch"] = ["settled"] * 2 + ["window"] * 2
    loads = {"point": point, "joint": "crank_pin", "peak_force": 100.0}
    frames = {
        "optimise_optima": numbers(schema.OPTIMISE_OPTIMA, 2, **optima),
        "optimise_resimulated": numbers(schema.OPTIMISE_RESIMULATED, 4, **gains),
        "optimise_loads": numbers(schema.OPTIMISE_LOADS, 2, **loads),
    }
    stage, *_ = scenario_records(scenario(), SECTIONS, write(frames, tmp_path), tmp_path)
    assert stage.metrics["crank_length_mm"] == pytest.approx(149.0)
    assert stage.notes["point"] == point[1]
