"""The peers: CMA-ES finds what is hidden in ideal data, and the network learns and answers."""

import json
import math
import shutil

import numpy as np
import pytest

pytest.importorskip("cma", reason="needs pymoo's cma: the extra learn")
pytest.importorskip("torch", reason="needs torch: the extra learn")

from jointgap.core.candidates import Parameter
from jointgap.core.errors import InputError
from validation import peers
from validation.kinds import Trial
from validation.trial import make_trial


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("campaign")
    make_trial(Trial("single", "ideal", 8.0, ("slider_constant_force",), number=3, id="0123456789ab"), 5, place)
    return place


@pytest.mark.integration
def test_the_least_bic_is_the_hidden_effect(folder):
    named, bic = peers.optimiser_names(folder / "campaign.yaml", 25.0)
    assert named == ["slider_constant_force"]
    assert bic["base"] > bic["slider_constant_force"] + 100.0


def test_every_effect_has_a_share_of_a_small_budget(folder):
    found = folder.parent / "found.json"
    found.write_text(json.dumps({"seconds": 2.0}))
    record = peers.ask("optimiser", folder, found)
    assert record["seconds"] < 6.0
    assert {"base", "gravity", "slider_constant_force"} <= record["bic"].keys()
    assert record["optimiser"] in ([], [min(record["bic"], key=record["bic"].__getitem__)])


@pytest.mark.parametrize(
    ("parameter", "amplitude"),
    [
        (Parameter("force", 0.0, step=0.5), True),
        (Parameter("length", 0.0, -0.01, 0.02, 1e-3), True),
        (Parameter("mass", 1.0, 0.9, 1.2), False),
        (Parameter("frequency", 1.0, 0.1, 100.0), False),
        (Parameter("free", 2.0), False),
    ],
)
def test_coordinates_and_values_go_both_ways(parameter, amplitude):
    place, value = peers.scale(parameter, amplitude)
    for x in (parameter.nominal, parameter.nominal + 0.01):
        assert -1.0 <= place(x) <= 1.0
        assert value(place(x)) == pytest.approx(x, abs=1e-12)


def test_an_amplitude_without_bounds_reaches_either_sign():
    _, value = peers.scale(Parameter("force", 0.0, step=0.5), True)
    assert (value(-1.0), value(1.0)) == (pytest.approx(-300.0), pytest.approx(300.0))
    assert value(0.5) < 20.0


def test_a_network_learns_writes_its_weights_and_answers(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "_EPOCHS", 12)
    monkeypatch.setattr(peers, "_NETWORKS", 2)
    own = peers.features(folder / "campaign.yaml")
    rng = np.random.default_rng(0)
    x = np.repeat(own[None], 64, axis=0) + 0.01 * rng.normal(size=(64, own.size)) * (own != 0.0) * (own != 1.0)
    classes = np.full(64, peers.CLASSES.index("slider_constant_force"))
    x[32:, : own.size - 7] *= np.where(x[32:, : own.size - 7] == 1.0, 1.0, -1.0)
    classes[32:] = 0
    np.savez(tmp_path / "features.npz", features=x.astype(np.float32), classes=classes, rigs=np.arange(64))
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


def test_data_that_are_refused_stop_with_the_reason(folder, tmp_path):
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken)
    (broken / "campaign.yaml").write_text("name: broken\n")
    with pytest.raises(InputError):
        peers.optimiser_names(broken / "campaign.yaml", 1.0)


@pytest.mark.integration
def test_a_rig_gives_campaigns_of_several_classes():
    examples = peers.draw_examples(1)
    assert len({label for _, label, _ in examples}) > 5
    assert {one.size for one, *_ in examples} == {len(peers.READ) * 2 * (peers.BINS + 3) + 7}
