"""The network as a comparison method: features of a campaign, training, answers."""

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs torch: the extra learn")

from jointgap.core.errors import InputError
from validation.benchmark import network, training
from validation.benchmark.features import CHANNEL_NAMES, EFFECTS, Features, features
from validation.kinds import Trial, read_set
from validation.rig import draw_rig
from validation.trial import Calibrator, make_trial


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """Folders of campaigns with ideal joints: nothing, and one effect, hidden."""
    folder = tmp_path_factory.mktemp("campaigns")
    plans = {
        "nothing": Trial("nothing", "ideal", id="000000000000"),
        "force": Trial("single", "ideal", 5.0, ("slider_constant_force",), id="000000000001"),
    }
    for name, plan in plans.items():
        make_trial(plan, 5, folder / name)
    return folder


def gains(found: Features) -> dict[str, float]:
    return dict(zip(EFFECTS, found.rig[-len(EFFECTS) :], strict=True))


def test_a_recalibration_leaves_noise_where_nothing_is_hidden_and_the_gap_of_an_effect(campaigns):
    nothing, force = (features(campaigns / name / "campaign.yaml") for name in ("nothing", "force"))
    assert nothing.gap == pytest.approx(1.0, abs=0.05)
    assert force.gap == pytest.approx(5.0, rel=0.25)  # within the tolerance of the draw
    sizes = {label: abs(gain) for label, gain in gains(force).items()}
    # some effects with several parameters, such as a spring, contain a constant force
    assert sizes["slider_constant_force"] > 0.95 * max(sizes.values()) > 1.1 * sizes["gravity"]
    for found in (nothing, force):
        assert np.isfinite(found.tokens).all() and np.isfinite(found.rig).all()
        assert found.tokens.shape[0] == found.channels.size
        assert found.tokens.shape[1] == nothing.tokens.shape[1]


def made(label: str, rng: np.random.Generator) -> dict:
    """A training campaign whose first numbers say what is hidden."""
    tokens = rng.normal(size=(6, 12)).astype(np.float32)
    channels = np.array([1, 2, 3] * 2)
    rig = rng.normal(size=5).astype(np.float32)
    if label == "gravity":
        rig[0] += 8.0
    elif label.startswith("sensor_gain"):
        tokens[channels == CHANNEL_NAMES.index(label.partition(":")[2]), 1] += 8.0
    labels = np.array([label] if label else [], dtype=str)
    return {"channels": channels, "tokens": tokens, "rig": rig, "labels": labels} | {
        "nothing": not label,
        "gap": 1.0,
    }


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("training"), np.random.default_rng(0)
    kinds = ["", "gravity", *(f"sensor_gain:{name}" for name in CHANNEL_NAMES[1:4])]
    for number in range(240):
        np.savez(folder / f"{number:05d}.npz", **made(kinds[number % 5], rng))
    return folder, network.train(folder, members=1, epochs=40)


def test_a_trained_network_names_effects_and_the_channel_of_a_faulty_sensor(trained):
    folder, summary = trained
    counts, f1 = re.match(r"(.*) for validation: F1 (\S+)", summary).groups()
    assert counts == "240 campaigns, 30 of them" and float(f1) > 0.95
    classifier, rng = network.Classifier(folder / network.MODEL), np.random.default_rng(1)
    for label in ("", "gravity", f"sensor_gain:{CHANNEL_NAMES[2]}"):
        content = made(label, rng)
        found = Features(content["channels"], content["tokens"], content["rig"], 1.0)
        assert classifier.names(found) == ([label] if label else [])
        # neither the order of the tokens nor a second one of a channel matters
        order = rng.permutation(6)
        shuffled = replace(found, channels=found.channels[order], tokens=found.tokens[order])
        assert classifier.names(shuffled) == classifier.names(found)


def test_a_network_abstains_if_neither_a_label_nor_nothing_is_likely(trained, monkeypatch):
    classifier = network.Classifier(trained[0] / network.MODEL)
    content, count = made("", np.random.default_rng(2)), len(network._OUTPUTS)
    found = Features(content["channels"], content["tokens"], content["rig"], 1.0)
    monkeypatch.setattr(network, "_probabilities", lambda *_: np.full((1, count), 0.01))
    monkeypatch.setattr(classifier, "_threshold", 0.5)
    assert classifier.names(found) is None


def test_training_needs_campaigns(tmp_path):
    with pytest.raises(InputError, match="has 0 training campaigns; simulate more"):
        network.train(tmp_path)


def test_training_campaigns_are_as_those_of_a_set_and_resume(tmp_path):
    sets = tmp_path / "sets.yaml"
    sets.write_text("sets:\n  small: {seed: 5, ideal: 3}\n")
    trial_set, folder = read_set(sets, "small"), tmp_path / "training"
    training.simulate(folder, 3, trial_set)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    training.simulate(folder, 3, trial_set)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    for path in folder.glob("*.npz"):
        with np.load(path) as content:
            assert content["tokens"].shape[0] == content["channels"].size
            assert bool(content["nothing"]) == (content["labels"].size == 0)
            # the sizes of effects are scaled in one linear step
            assert content["nothing"] or 1.26 <= content["gap"] <= 10.0


@pytest.mark.parametrize("label", ["encoder_offset", "encoder_eccentricity", "gravity"])
@pytest.mark.parametrize("measured_angle", [False, True])
def test_a_size_for_a_gap_counts_what_differs_from_the_reading_of_the_encoder(
    label, measured_angle
):
    rng = np.random.default_rng(4)
    plan = Trial("single", "ideal", 3.0, (label,), measured_angle=measured_angle)
    rig = draw_rig(rng, plan)
    ((effect, size),) = training._with_sizes(plan, rig, rng)
    calibrator = Calibrator(rig)
    gap = calibrator.gap([(effect, size)])
    assert 1.2 < gap < 10.0  # 1.5 to 8 without recalibration
