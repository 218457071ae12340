"""What is logged of each stage, and under which names."""

import hashlib
import json
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from jointgap.core import parquet, schema
from jointgap.core.joints import OUTPUTS
from jointgap.core.publish import thinned
from jointgap.networks.clearance import ClearanceNetwork
from tests.track.conftest import client_of, runs_of
from tests.track.synthetic import ITERATIONS, fit


@pytest.fixture
def client(two_scenarios):
    return client_of(two_scenarios)


@pytest.fixture
def published(client):
    """The runs of a scenario by stage and output, as MLflow shows them."""
    runs = {
        run.data.tags["jointgap.stage"] + "/" + run.data.tags["jointgap.output"]: run for run in named(client, "paper")
    }
    return {name.removesuffix("/"): run for name, run in runs.items()}


def named(client, scenario: str) -> list:
    return [run for run in runs_of(client).values() if run.data.tags["jointgap.scenario"] == scenario]


def test_results_costs_and_configuration_of_the_simulation_are_logged(published, client):
    run = published["simulate"]
    metrics, params = run.data.metrics, run.data.params
    assert metrics["seconds"] == 3.5 and metrics["peak_memory_mb"] == 123.4
    assert metrics["crank_pin_impacts"] == 2 and metrics["piston_pin_impacts"] == 1
    assert params["simulate.revolutions"] == "4" and params["mechanism.crank.length"] == "0.15"
    assert params["mechanism.joints.crank_pin.contact.friction"] == "0.05"
    with open(client.download_artifacts(run.info.run_id, "options.json")) as file:
        assert json.load(file)["simulate"]["revolutions"] == 4


def test_the_eight_networks_are_nested_in_the_run_of_their_scenario(published):
    for output in OUTPUTS:
        nested = published[f"surrogate/{output}"]
        assert nested.data.tags["mlflow.parentRunId"] == published["surrogate"].info.run_id
        assert nested.info.run_name == f"paper {output}"


def test_a_network_has_its_errors_the_papers_its_seconds_and_its_seeds(published):
    metrics = published["surrogate/r2"].data.metrics
    for name in ("training_mse", "held_out_mse", "paper_mse", "spline_held_out_mse"):
        assert metrics[f"log10_{name}"] == pytest.approx(np.log10(metrics[name]))
    assert {"held_out_mse_past_60_deg", "spline_held_out_mse_past_60_deg"} <= set(metrics)
    assert metrics["seconds"] == 10.0 and published["surrogate"].data.metrics["seconds"] == 30.0
    assert metrics["seeds"] == 2 and metrics["seeds_iterations"] == 100
    assert metrics["seeds_mse_median"] == pytest.approx(0.1 / 101)  # all seeds after as many iterations


def test_curves_are_thinned_evenly_on_a_logarithmic_axis_and_keep_both_ends(published, client):
    for name, run in (("mse", "surrogate/r2"), ("log10_mse", "surrogate/r2"), ("log10_mse/r2", "surrogate")):
        points = client.get_metric_history(published[run].info.run_id, name)
        steps = sorted(point.step for point in points)
        assert 280 <= len(steps) <= 300 and len(set(steps)) == len(steps)
        assert steps[:20] == list(range(20)) and steps[-1] == ITERATIONS
    error = {
        point.step: point.value for point in client.get_metric_history(published["surrogate/r2"].info.run_id, "mse")
    }
    assert all(value == pytest.approx(0.1 / (1 + step)) for step, value in error.items())


def test_both_recipes_have_curves_of_their_training_and_of_their_held_out_errors(published, client):
    steps = {"surrogate/r2": [10, 100], "surrogate/regularised r2": list(range(51))}
    for run, judged in steps.items():
        points = client.get_metric_history(published[run].info.run_id, "mse_held_out")
        assert sorted(point.step for point in points) == judged
        assert all(point.value == pytest.approx(0.2 / (1 + point.step)) for point in points)
    regularised = client.get_metric_history(published["surrogate/regularised r2"].info.run_id, "mse")
    assert sorted(point.step for point in regularised) == list(range(51))
    overall = published["surrogate"].info.run_id
    for name in ("log10_mse/r2", "log10_mse_held_out/r2", "log10_regularised_mse/r2"):
        assert client.get_metric_history(overall, name)
    assert published["surrogate"].data.metrics["regularised_outputs"] == 8


@pytest.mark.parametrize("count", [1, 2, 299, 300, 301, 1000, 20_001])
def test_thinning_keeps_short_curves_whole_and_cuts_long_ones(count):
    thin = thinned(pd.Series(np.arange(count) * 2.0), 300)
    assert len(thin) == count if count <= 300 else 100 <= len(thin) <= 300
    assert thin.index[0] == 0 and thin.index[-1] == count - 1 and thin.index.is_monotonic_increasing
    np.testing.assert_array_equal(thin, 2 * thin.index)


def _by_hand(frame, seed: int, angle: np.ndarray) -> np.ndarray:
    """Neuron by neuron, as the table's description says."""
    rows = frame[(frame["model"] == "network") & (frame["seed"] == seed)]
    rows = rows.set_index(["layer", "neuron", "source"])["weight"]
    result = []
    for value in angle / (2 * np.pi):
        signal = np.array([value])
        for layer in range(3):
            neurons = rows.loc[layer].index.get_level_values("neuron").unique()
            matrix = np.array([[rows[layer, n, s] for s in range(len(signal))] for n in neurons])
            signal = matrix @ signal + np.array([rows[layer, n, -1] for n in neurons])
            signal = np.tanh(signal) if layer < 2 else signal
        result.append(8.0 * signal[0] - 3.0)
    return np.array(result)


def test_torch_loads_published_weights_without_pickle(published, client):
    import torch

    folder = client.download_artifacts(published["surrogate/gamma2"].info.run_id, "network")
    with open(f"{folder}/network.json") as file:
        sizes = json.load(file)["neurons"]
    layers = [torch.nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes)]
    chain = torch.nn.Sequential(*(part for layer in layers for part in (layer, torch.nn.Tanh())))[:-1]
    arrays = np.load(f"{folder}/weights.npz", allow_pickle=False)
    chain.load_state_dict({name: torch.from_numpy(arrays[name]) for name in arrays})
    angle = np.linspace(0, 2 * np.pi, 9)
    scaled = torch.from_numpy(angle / (2 * np.pi))[:, None]
    values = 8.0 * chain(scaled).detach().numpy()[:, 0] - 3.0
    np.testing.assert_allclose(values, _by_hand(fit(OUTPUTS.index("gamma2")), 7, angle), rtol=1e-12)


@pytest.mark.parametrize("joint", [2, 3])
def test_torch_loads_the_second_surrogate_and_its_description_says_how_to_use_it(
    published, two_scenarios, client, joint
):
    import torch

    folder = client.download_artifacts(published[f"surrogate/clearance gamma{joint}"].info.run_id, "network")
    with open(f"{folder}/network.json") as file:
        about = json.load(file)
    chain = torch.nn.Sequential(torch.nn.Linear(1, 3), torch.nn.Tanh(), torch.nn.Linear(3, 2)).double()
    arrays = np.load(f"{folder}/weights.npz", allow_pickle=False)
    chain.load_state_dict({name: torch.from_numpy(arrays[name]) for name in arrays})
    angle = np.linspace(0.01, 2 * np.pi, 200)
    x, y = chain(torch.from_numpy(angle)[:, None]).detach().numpy().T
    s = 1.0 if about["settling"] is None else np.tanh((angle - about["start_angle"]) / about["settling"]) ** 2
    table = parquet.read(schema.CLEARANCE_FIT, two_scenarios / "paper/clearance_fit.parquet")
    theirs = ClearanceNetwork.from_frame(table, joint)
    np.testing.assert_allclose(s * np.hypot(x, y), theirs.output(f"r{joint}", angle)[0], rtol=1e-9)
    turn = np.exp(1j * theirs.output(f"gamma{joint}", angle)[0])
    np.testing.assert_allclose((x + 1j * y) / np.hypot(x, y), turn, atol=1e-9)


def test_the_second_surrogate_is_compared_under_the_same_names(published):
    ours, papers = (published[f"surrogate/{name}"].data.metrics for name in ("clearance r2", "r2"))
    for name in ("training_mse", "held_out_mse", "paper_mse", "spline_held_out_mse", "weights"):
        assert name in ours and name in papers
    whole = published["surrogate"].data.metrics
    assert whole["clearance_outputs"] == whole["network_outputs"] == 8


def test_dataset_inputs_carry_the_digest_of_their_file(published, two_scenarios):
    inputs = {found.dataset.name: found for found in published["surrogate/r2"].inputs.dataset_inputs}
    assert set(inputs) == {"trajectory", "fit/r2", "fit_errors/r2", "fit_history/r2"}
    for name, found in inputs.items():
        path = two_scenarios / "paper" / f"{name}.parquet"
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        tags = {tag.key: tag.value for tag in found.tags}
        assert tags["jointgap.sha256"] == digest and digest.startswith(found.dataset.digest)
        assert tags["mlflow.data.context"] == ("input" if name == "trajectory" else "result")
        assert json.loads(found.dataset.source)["uri"] == str(path)


@pytest.mark.parametrize("stage", ["kinematics", "optimise"])
def test_a_stage_that_reads_both_surrogates_names_both_among_its_inputs(published, stage):
    inputs = {found.dataset.name for found in published[stage].inputs.dataset_inputs}
    assert {"trajectory", "clearance_fit", *(f"fit/{output}" for output in OUTPUTS)} <= inputs


def test_the_optimum_of_the_paper_s_way_stands_for_the_scenario(published):
    metrics = published["optimise"].data.metrics
    assert published["optimise"].data.tags["jointgap.point"] == "networks_paper_genetic"
    assert metrics["crank_length_mm"] == pytest.approx(149.0)
    assert metrics["crank_length_change_um"] == pytest.approx(-1000.0)
    assert published["optimise"].data.params["optimise.window"] == f"[0.0, {2 * np.pi}]"
    assert metrics == published["optimise/networks_paper_genetic"].data.metrics
    assert published["optimise/simulation_wide_local"].data.metrics["crank_length_mm"] == pytest.approx(148.0)


def test_an_optimum_has_lengths_counts_and_four_reductions_frozen_and_true_with_spread(published):
    metrics = published["optimise/simulation_wide_genetic"].data.metrics
    assert {"crank_length_mm", "rod_length_mm", "evaluations"} <= set(metrics)
    for measure in ("rms", "mean_absolute", "peak", "sum_of_squares"):
        assert f"frozen/{measure}_reduction_percent" in metrics
        for stretch in ("window", "settled"):
            for end in ("reduction", "reduction_low", "reduction_high"):
                assert f"resimulated_{stretch}/{measure}_{end}_percent" in metrics
    assert metrics["gain_revolution_low_percent"] == pytest.approx(
        metrics["resimulated_settled/rms_reduction_low_percent"], abs=1e-4
    )
    assert {"ideal_cycle/stroke_change_mm", "simulated_cycle/smallest_transmission_angle_deg"} <= set(metrics)


def test_figures_are_kept_with_the_scenario(published, client):
    with open(client.download_artifacts(published["figures"].info.run_id, "figures/figure 5.png"), "rb") as file:
        assert file.read() == b"a picture"


def test_verdicts_on_the_paper_are_counted_and_the_text_is_kept(published, client):
    run = published["compare"]
    assert run.data.metrics["verdicts/number agrees"] == 1 and run.data.metrics["verdicts/claim holds"] == 2
    assert run.data.metrics["verdicts/claim does not hold"] == 0
    assert {"verdicts/number reached", "verdicts/number missed"} <= set(run.data.metrics)
    assert {"ours/rods gain real at 5", "ratio/rods gain real at 5"} <= set(run.data.metrics)
    with open(client.download_artifacts(run.info.run_id, "comparison.md")) as file:
        assert file.read() == "in words"


def test_names_of_metrics_and_parameters_are_the_same_in_every_scenario(published, client):
    for run in named(client, "frictionless"):
        other = published[f"{run.data.tags['jointgap.stage']}/{run.data.tags['jointgap.output']}".removesuffix("/")]
        assert set(run.data.metrics) == set(other.data.metrics)
        assert set(run.data.params) == set(other.data.params)
