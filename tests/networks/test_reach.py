"""Networks on the simulated motion: the paper's eight errors are reached, those of regularised ones
hold."""

import pandas as pd
import pytest

from jointgap.config import Simulate, Surrogate, read_yaml, resolve
from jointgap.config.yaml_files import merge
from jointgap.core.joints import OUTPUTS
from jointgap.motion.slider_crank import simulate
from jointgap.networks.train import SAMPLING, train, train_regularised

pytestmark = pytest.mark.slow


def scenario(root, name):
    folder = root / "config"
    configuration = merge(read_yaml(folder / "config.yaml"), read_yaml(folder / "variants.yaml"))
    return resolve(configuration, (root, folder))[name]


def motion(pytestconfig, name, samples):
    chosen = scenario(pytestconfig.rootpath, name)
    options = Simulate.model_validate(
        chosen.simulate.model_dump() | {"revolutions": 1, "samples_per_revolution": samples}
    )
    return simulate(chosen.mechanism, options).samples


@pytest.mark.parametrize("output", OUTPUTS)
def test_networks_reach_the_papers_training_error_from_the_default_seed(pytestconfig, output):
    options = Surrogate(iterations=2000, seeds=(0,))
    errors = train(motion(pytestconfig, "paper", 3600), output, options)[0].errors()
    assert errors["training_mse"].iloc[0] <= errors["paper_mse"].iloc[0]


@pytest.mark.parametrize("name", ["paper", "nearest_settings"])
def test_all_regularised_networks_err_at_most_twice_as_much_at_samples_held_out(pytestconfig, name):
    coarse, fine = (motion(pytestconfig, name, samples) for samples in (3600, 3600 * SAMPLING))
    errors = pd.concat(
        [train_regularised(coarse, fine, output, Surrogate()).errors() for output in OUTPUTS]
    )
    errors = errors[errors["region"] == "all"]
    assert len(errors) == 8
    shown = errors[["output", "training_mse", "held_out_mse", "smoothing_spline_held_out_mse"]]
    assert (errors["held_out_mse"] <= 2 * errors["training_mse"]).all(), shown
