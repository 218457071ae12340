"""A network that classifies campaigns: its training campaigns, its training and its answers."""

import copy
import json
import math
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from jointgap.core.errors import InputError, SimulationError
from jointgap.core.files import write_text
from validation.benchmark.features import (
    CHANNEL_NAMES,
    EFFECTS,
    SENSOR_FAULTS,
    Features,
    features,
)
from validation.benchmark.pool import in_parallel
from validation.data_faults import damage
from validation.kinds import Trial, plan_trials
from validation.rig import RECIPE, Hidden, Readings, Rig, Run, draw_effect, draw_rig, read
from validation.score import LEAST_GAP, effect_label
from validation.trial import campaign_of, noisy, write_campaign

MODEL = "model.pt"
"""Name of the file of a trained model."""

SEED = 65_002  # of the training campaigns; their random streams differ from those of all sets
_STREAM = 101  # `validation.trial.make_trial` has 100
_SETS = 10  # planned training campaigns, in numbers of the set
# Of motion that never repeats every third planned campaign is drawn: it takes ten times as long
_CHAOTIC_EVERY = 3
_LARGEST_GAP = 20.0  # of an effect
_SECONDS = 60.0  # processor time of a training campaign, after which it is given up

_WIDTH, _DROPOUT, _MEMBERS = 128, 0.3, 5  # of a network; networks whose outputs are averaged
_RATE, _DECAY, _BATCH, _EPOCHS, _PATIENCE = 1e-3, 1e-2, 64, 120, 15
_VALIDATION_EVERY = 8  # campaign of which one is for the stop of the training and the threshold
_THRESHOLDS = np.linspace(0.05, 0.95, 91)


def simulate(folder: Path, count: int, trial_set: Any, cores: int = 1) -> None:
    """Draw training campaigns like those of a set until `folder` has `count` usable ones; each is
    a file ``{number}.npz``, a refused one ``{number}.json``.

    Sizes of effects are scaled in one step to a random gap without recalibration; campaigns are
    refused if the effect is not visible after a linear recalibration.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plans = [plan for plan in _training_plans(trial_set) if not list(_files(folder, plan))]
    usable = len(list(folder.glob("*.npz")))
    if usable >= count:
        return
    for outcome in in_parallel(partial(_simulated, folder), plans, cores):
        usable += outcome == ""
        note = f", one refused: {outcome}" if outcome else ""
        print(f"{usable} of {count} training campaigns{note}", flush=True)
        if usable >= count:
            return
    raise InputError(f"{folder}: no more than {usable} training campaigns; give a lower number")


def _training_plans(trial_set: Any) -> list[Trial]:
    larger = {kind: min(_SETS * getattr(trial_set, kind), 10_000) for kind in RECIPE["kinds"]}
    plans = plan_trials(trial_set.model_copy(update={"seed": SEED, **larger}))
    return [p for p in plans if p.base != "chaotic" or p.number % _CHAOTIC_EVERY == 0]


def _files(folder: Path, plan: Trial) -> Iterator[Path]:
    return folder.glob(f"{plan.number:05d}.*")


def _simulated(folder: Path, plan: Trial) -> str:
    """Write the file of a training campaign; why it is refused, or ""."""
    usual = signal.signal(signal.SIGPROF, _give_up)
    signal.setitimer(signal.ITIMER_PROF, _SECONDS)
    begin = time.process_time()
    try:
        with tempfile.TemporaryDirectory() as place:
            outcome = _drawn(Path(place), plan)
    except (InputError, SimulationError, RuntimeError, TimeoutError) as error:
        outcome = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, usual)
    seconds = round(time.process_time() - begin, 2)
    path = folder / f"{plan.number:05d}"
    if isinstance(outcome, str):
        record = {"kind": plan.kind, "base": plan.base, "refused": outcome, "seconds": seconds}
        write_text(path.with_suffix(".json"), json.dumps(record) + "\n")
        return outcome
    temporary = folder / f".{path.name}.npz"
    np.savez_compressed(temporary, **outcome, seconds=seconds)
    temporary.replace(path.with_suffix(".npz"))
    return ""


def _give_up(*_: object) -> None:
    raise TimeoutError(f"{_SECONDS:g} s of processor time")


def _drawn(place: Path, plan: Trial) -> dict[str, Any] | str:
    """Arrays of a training campaign, or why there are none."""
    rng = np.random.default_rng([SEED, _STREAM, plan.number])
    rig = draw_rig(rng, plan)
    effects = _with_sizes(plan, rig, rng)
    if effects is None:
        return "the rig cannot have the effect"
    clean = {name: read(rig.true, run, rig.numerics, effects) for name, run in rig.runs.items()}
    campaign, frames = campaign_of(rng, rig, noisy(rng, rig, clean), plan.id, ("parquet",))
    if plan.damage:
        damage(rng, plan.damage, campaign, frames)
    write_campaign(rng, place, rig, campaign, frames)
    found = features(place / "campaign.yaml")
    if effects and not LEAST_GAP <= found.gap <= _LARGEST_GAP:
        return f"gap {found.gap:.3g}"
    named = [effect_label({"name": e.name, "site": e.site}) for e, _ in effects]
    return {
        **{"channels": found.channels, "tokens": found.tokens, "rig": found.rig},
        **{"labels": np.array(named, dtype=str), "nothing": not (effects or plan.damage)},
        **{"kind": plan.kind, "base": plan.base, "gap": found.gap},
    }


def _with_sizes(
    plan: Trial, rig: Rig, rng: np.random.Generator
) -> list[tuple[Hidden, float]] | None:
    """The effects of a plan with random sizes; None if the rig cannot have one."""
    fastest = max((rig.runs[name] for name in rig.fitted), key=lambda run: run.speed)
    base = read(rig.true, fastest, rig.numerics)
    spread = {channel: float(base[channel].std()) for channel in rig.sensors}
    sizes = []
    for label in plan.effects:
        effect = draw_effect(label, rig, spread, rng)
        if effect is None:
            return None
        if plan.shown:
            size = _log_uniform(rng, effect.lowest or 0.01 * effect.most, effect.most)
        elif rig.base == "chaotic":
            size = _log_uniform(rng, effect.first, effect.most)  # one motion has no gap
        else:
            gap = _log_uniform(rng, min(RECIPE["gaps"]), max(RECIPE["gaps"]))
            changed = read(rig.true, fastest, rig.numerics, [(effect, effect.first)])
            size = effect.first * _factor(rig, fastest, base, changed, gap)
        sizes.append((effect, min(max(size, effect.lowest), effect.most)))
    return sizes


def _factor(rig: Rig, run: Run, base: Readings, changed: Readings, gap: float) -> float:
    """Factor of the size of an effect for a gap, if the readings respond in proportion.

    The analyst's crank follows the encoder: its readings at constant speed on a line.
    """
    shift, squares = np.zeros(run.times.size), []
    if rig.angle_noise:
        shift = changed["crank_angle"] - base["crank_angle"]
        if rig.drive == "constant_speed":
            line = np.polyval(np.polyfit(run.times, shift, 1), run.times)
            sd = math.hypot(rig.angle_noise, rig.angle_step / math.sqrt(12.0))
            squares.append(np.mean(((shift - line) / sd) ** 2))
            shift = line
    for name, sensor in rig.sensors.items():
        followed = base[name] + shift * np.gradient(base[name], base["crank_angle"])
        sd = sensor.noise_share * base[name].std()
        squares.append(np.mean(((changed[name] - followed) / sd) ** 2))
    return math.sqrt((gap**2 - 1.0) / max(float(np.mean(squares)), 1e-12))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


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
        count = max(len(one.channels) for one in campaigns)
        width = campaigns[0].tokens.shape[1]
        tokens = np.zeros((len(campaigns), count, width), np.float32)
        places = np.zeros((len(campaigns), count, len(CHANNEL_NAMES)), np.float32)
        for row, one in enumerate(campaigns):
            tokens[row, : len(one.channels)] = one.tokens
            places[row, np.arange(len(one.channels)), one.channels] = 1.0
        rig = np.array([one.rig for one in campaigns], np.float32)
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
    campaigns, targets = _read_training(folder)
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


def _read_training(folder: Path) -> tuple[list[Features], torch.Tensor]:
    campaigns, targets = [], []
    for path in sorted(folder.glob("[0-9]*.npz")):
        with np.load(path) as content:
            arrays = [content[key] for key in ("channels", "tokens", "rig")]
            labels = {*content["labels"].tolist(), *(["nothing"] if content["nothing"] else [])}
        campaigns.append(Features(*arrays, math.nan))
        targets.append([float(label in labels) for label in _OUTPUTS])
    return campaigns, torch.tensor(targets)


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
