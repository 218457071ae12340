"""A comparison method: a network that classifies campaigns, trained on simulated ones."""

import copy
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from jointgap.core.errors import InputError, SimulationError
from validation.benchmark.features import (
    CHANNEL_NAMES,
    EFFECTS,
    SENSOR_FAULTS,
    Features,
    features,
)
from validation.benchmark.training import SEED, load_training

MODEL = "model.pt"
"""Name of the file of a trained model."""

_WIDTH, _DROPOUT, _MEMBERS = 128, 0.3, 5  # of a network; networks whose outputs are averaged
_RATE, _DECAY, _BATCH, _EPOCHS, _PATIENCE = 1e-3, 1e-2, 64, 120, 15
_VALIDATION_EVERY = 8  # campaign of which one is for the stop of the training and the threshold
_THRESHOLDS = np.linspace(0.05, 0.95, 91)


@dataclass(frozen=True)
class _Batch:
    """Campaigns padded to the same number of tokens."""

    tokens: torch.Tensor  # (b, n, t)
    places: torch.Tensor  # (b, n, c) 1 for the channel of a token
    rig: torch.Tensor  # (b, g)

    def __getitem__(self, chosen: torch.Tensor) -> "_Batch":
        return _Batch(self.tokens[chosen], self.places[chosen], self.rig[chosen])

    @classmethod
    def of(cls, campaigns: Sequence[Features]) -> "_Batch":
        count = max(len(campaign.channels) for campaign in campaigns)
        width = campaigns[0].tokens.shape[1]
        tokens = np.zeros((len(campaigns), count, width), np.float32)
        places = np.zeros((len(campaigns), count, len(CHANNEL_NAMES)), np.float32)
        for row, campaign in enumerate(campaigns):
            number = len(campaign.channels)
            tokens[row, :number] = campaign.tokens
            places[row, np.arange(number), campaign.channels] = 1.0
        rig = np.array([campaign.rig for campaign in campaigns], np.float32)
        return cls(*map(torch.from_numpy, (tokens, places, rig)))


class _Network(nn.Module):
    """Logits of the labels, and of an intact campaign with nothing hidden, for a set of tokens.

    Each token is encoded alone; the tokens of a channel and of the campaign are averaged, and for
    the campaign their maximum is taken too.
    """

    def __init__(self, token_width: int, rig_width: int):
        super().__init__()
        self.register_buffer("token_mean", torch.zeros(token_width))
        self.register_buffer("token_size", torch.ones(token_width))
        self.register_buffer("rig_mean", torch.zeros(rig_width))
        self.register_buffer("rig_size", torch.ones(rig_width))
        self.encoder = _layers(token_width + len(CHANNEL_NAMES), _WIDTH)
        self.whole = _layers(2 * _WIDTH + rig_width, _WIDTH)
        self.effects = nn.Linear(_WIDTH, len(EFFECTS) + 1)
        self.faults = nn.Sequential(_layers(2 * _WIDTH, _WIDTH), nn.Linear(_WIDTH, _FAULTS))

    def scale(self, batch: _Batch) -> None:
        """Centre and scale the inputs as in a batch."""
        tokens = batch.tokens[batch.places.sum(-1) > 0]
        self.token_mean, self.token_size = tokens.mean(0), tokens.std(0) + 1e-3
        self.rig_mean, self.rig_size = batch.rig.mean(0), batch.rig.std(0) + 1e-3

    def forward(self, batch: _Batch) -> torch.Tensor:
        tokens = ((batch.tokens - self.token_mean) / self.token_size).clamp(-5, 5)
        code = self.encoder(torch.cat([tokens, batch.places], -1))
        present = batch.places.sum(-1, keepdim=True)
        mean = (code * present).sum(1) / present.sum(1)
        largest = (code - 1e9 * (1 - present)).amax(1)
        rig = ((batch.rig - self.rig_mean) / self.rig_size).clamp(-5, 5)
        whole = self.whole(torch.cat([mean, largest, rig], -1))
        number = batch.places.sum(1)[..., None]
        channels = batch.places.transpose(1, 2) @ code / number.clamp(min=1)
        beside = whole[:, None, :].expand(-1, len(CHANNEL_NAMES), -1)
        faults = self.faults(torch.cat([channels, beside], -1))
        faults = faults.masked_fill(number == 0, -30.0)  # of absent channels
        return torch.cat([self.effects(whole), faults.flatten(1)], -1)


_FAULTS = len(SENSOR_FAULTS)
_OUTPUTS = (
    *EFFECTS,
    "nothing",
    *(f"{fault}:{channel}" for channel in CHANNEL_NAMES for fault in SENSOR_FAULTS),
)
_NOTHING = len(EFFECTS)


def _layers(inputs: int, outputs: int) -> nn.Sequential:
    hidden = [nn.Linear(inputs, _WIDTH), nn.ReLU(), nn.Dropout(_DROPOUT)]
    return nn.Sequential(*hidden, nn.Linear(_WIDTH, outputs), nn.ReLU())


def train(folder: Path, members: int = _MEMBERS, epochs: int = _EPOCHS) -> str:
    """Train `members` networks on the campaigns of a folder and write them to `MODEL` there; a
    summary.

    One campaign in eight is for validation: a training ends where the validation loss is least,
    and a label is named from the probability on that gives the largest F1 of the names there.
    """
    begin = time.process_time()
    torch.set_num_threads(1)
    campaigns, labels = load_training(folder)
    targets = torch.tensor([[float(label in hidden) for label in _OUTPUTS] for hidden in labels])
    held = np.arange(len(campaigns)) % _VALIDATION_EVERY == 0
    known, checks = ([c for c, h in zip(campaigns, held, strict=True) if h == x] for x in (0, 1))
    if not known or not checks:
        raise InputError(f"{folder}: has {len(campaigns)} training campaigns; simulate more")
    known, checks = _Batch.of(known), _Batch.of(checks)
    wanted, wanted_checks = targets[~held], targets[held]
    networks = [
        _trained(member, epochs, known, wanted, checks, wanted_checks) for member in range(members)
    ]
    probabilities, hidden = _probabilities(networks, checks), wanted_checks.numpy() > 0.5
    scores = [_f1(probabilities, hidden, threshold) for threshold in _THRESHOLDS]
    best = int(np.argmax(scores))
    content = {
        "networks": [network.state_dict() for network in networks],
        "outputs": _OUTPUTS,
        "widths": (known.tokens.shape[2], known.rig.shape[1]),
        "threshold": float(_THRESHOLDS[best]),
    }
    torch.save(content, folder / MODEL)
    return (
        f"{len(campaigns)} campaigns, {held.sum()} of them for validation: F1 {scores[best]:.3f}"
        f" of the names with a threshold of {_THRESHOLDS[best]:.2f};"
        f" {time.process_time() - begin:.0f} CPU-s"
    )


def _trained(
    member: int,
    epochs: int,
    known: _Batch,
    wanted: torch.Tensor,
    checks: _Batch,
    wanted_checks: torch.Tensor,
) -> _Network:
    """A network with the parameters of the epoch with the least loss of the `checks`."""
    torch.manual_seed(SEED + member)
    network = _Network(known.tokens.shape[2], known.rig.shape[1])
    network.scale(known)
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    loss_of = nn.BCEWithLogitsLoss(reduction="sum")
    best, least, waited = network.state_dict(), math.inf, 0
    for _ in range(epochs):
        network.train()
        for chosen in torch.randperm(len(wanted)).split(_BATCH):
            optimiser.zero_grad()
            loss = loss_of(network(known[chosen]), wanted[chosen]) / len(chosen)
            loss.backward()
            optimiser.step()
        network.eval()
        with torch.no_grad():
            loss = float(loss_of(network(checks), wanted_checks))
        waited += 1
        if loss < least:
            best, least, waited = copy.deepcopy(network.state_dict()), loss, 0
        elif waited > _PATIENCE:
            break
    network.load_state_dict(best)
    return network.eval()


def _probabilities(networks: Sequence[_Network], batch: _Batch) -> np.ndarray:
    """Mean probability of each output (b, o)."""
    with torch.no_grad():
        return torch.stack([network(batch).sigmoid() for network in networks]).mean(0).numpy()


def _f1(probabilities: np.ndarray, hidden: np.ndarray, threshold: float) -> float:
    """F1 of the names, without the output `nothing`."""
    named, hidden = (np.delete(v, _NOTHING, 1) for v in (probabilities >= threshold, hidden))
    return 2.0 * float((named & hidden).sum()) / max(float(named.sum() + hidden.sum()), 1.0)


class Classifier:
    """A trained model file."""

    def __init__(self, model_file: Path):
        torch.set_num_threads(1)
        content = torch.load(model_file, weights_only=True)
        if tuple(content["outputs"]) != _OUTPUTS:
            raise InputError(f"{model_file}: was trained for other labels; train it again")
        self._threshold, self._networks = content["threshold"], []
        for state in content["networks"]:
            network = _Network(*content["widths"])
            network.load_state_dict(state)
            self._networks.append(network.eval())

    def names(self, campaign: Features) -> list[str] | None:
        """Labels from the threshold on; without one [] if probably nothing is hidden, else None."""
        (probabilities,) = _probabilities(self._networks, _Batch.of([campaign]))
        named = [
            label
            for label, p in zip(_OUTPUTS, probabilities, strict=True)
            if p >= self._threshold and label != "nothing"
        ]
        return sorted(named) or ([] if probabilities[_NOTHING] >= 0.5 else None)


def answer(model_file: Path, campaign: Path, analysis: object = None) -> list[str] | None:
    """The names of a campaign folder; None also if its features cannot be computed."""
    try:
        return Classifier(model_file).names(features(campaign / "campaign.yaml"))
    except (InputError, SimulationError):
        return None
