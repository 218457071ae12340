"""The peers: CMA-ES finds what is hidden in ideal data, and the network learns and answers."""

import math

import numpy as np
import pytest

pytest.importorskip("cma", reason="needs pymoo's cma: the extra learn")
pytest.importorskip("torch", reason="needs torch: the extra learn")

from jointgap.core.candidates import Parameter
from validation import peers
from validation.kinds import Trial
from validation.trial import make_trial


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("campaign")
    make_trial(
        Trial("single", "ideal", 8.0, ("slider_constant_force",), number=3, id="0123456789ab"),
        5,
        place,
    )
    return place


@pytest.mark.integration
def test_the_least_bic_is_the_hidden_effect(folder):
    named, bic = peers.optimiser_names(folder / "campaign.yaml", 25.0)
    assert named == ["slider_constant_force"]
    assert bic["base"] > bic["slider_constant_force"] + 100.0


def test_coordinates_and_values_go_both_ways_and_an_amplitude_without_bounds_reaches_either_sign():
    for parameter, amplitude in (
        (Parameter("force", 0.0, step=0.5), True),
        (Parameter("length", 0.0, -0.01, 0.02, 1e-3), True),
        (Parameter("mass", 1.0, 0.9, 1.2), False),
        (Parameter("frequency", 1.0, 0.1, 100.0), False),
        (Parameter("free", 2.0), False),
    ):
        place, value = peers.scale(parameter, amplitude)
        for x in (parameter.nominal, parameter.nominal + 0.01):
            assert -1.0 <= place(x) <= 1.0
            assert value(place(x)) == pytest.approx(x, abs=1e-12)
    _, value = peers.scale(Parameter("force", 0.0, step=0.5), True)
    assert (value(-1.0), value(1.0)) == (pytest.approx(-300.0), pytest.approx(300.0))
    assert value(0.5) < 20.0


def test_a_network_learns_writes_its_weights_and_answers(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "_EPOCHS", 12)
    monkeypatch.setattr(peers, "_NETWORKS", 2)
    own = peers.features(folder / "campaign.yaml")
    rng = np.random.default_rng(0)
    x = np.repeat(own[None], 64, axis=0) + 0.01 * rng.normal(size=(64, own.size)) * (own != 0.0) * (
        own != 1.0
    )
    classes = np.full(64, peers.CLASSES.index("slider_constant_force"))
    x[32:, : own.size - 7] *= np.where(x[32:, : own.size - 7] == 1.0, 1.0, -1.0)
    classes[32:] = 0
    np.savez(
        tmp_path / "features.npz",
        features=x.astype(np.float32),
        classes=classes,
        rigs=np.arange(64),
    )
    assert peers.train(tmp_path / "features.npz", tmp_path / "network.pt") > 0.9
    record = peers.ask("network", folder, tmp_path / "network.pt")
    assert record["network"] == ["slider_constant_force"]
    assert sum(record["probabilities"].values()) == pytest.approx(1.0, abs=0.05)


def test_features_mark_the_channels_that_are_there(folder):
    own = peers.features(folder / "campaign.yaml")[: len(peers.READ) * 2 * (peers.BINS + 3)]
    there = own.reshape(len(peers.READ), 2, -1)[..., -1]
    assert 3 <= there[:, 0].sum() <= 7
    assert np.array_equal(there[:, 0], there[:, 1])
    assert math.isfinite(np.abs(own).max())
