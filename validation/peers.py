"""Two methods beside the identification, as others would do it: BIC with a global optimiser, and a
network classifier.

Both answer as `greedy_names` does: the labels named, none where nothing is missing.
"""

import json
import math
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import cma
import numpy as np
import torch
from torch import Tensor, nn

from jointgap.config import EFFECTS
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINTS
from jointgap.identification.noise import noise_of_model, numerics_noise
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import noise_of
from jointgap.rig.sensors import ENCODER_OFFSET
from jointgap.rig.simulate_run import channels_read
from validation.kinds import Trial
from validation.rig import (
    CHANNELS,
    LABELS,
    LISTED,
    PLAIN,
    RECIPE,
    SENSOR_FAULTS,
    draw_effect,
    draw_rig,
    read_truth,
)
from validation.score import LEAST_GAP, effect_label
from validation.trial import Calibrator, campaign_of, noisy, write_campaign

# BIC by which an effect has to be better than the model as it stands
LEAST_GAIN = 10.0

# Step of CMA-ES at a start, of the range of a coordinate; change of chi2 at its end, far below
# `LEAST_GAIN`
_SIGMA, _TOLERANCE = 0.3, 0.1
# Largest size of an amplitude without a bound [steps of a fit], the recipe's; ratio of bounds from
# which on a positive parameter is searched in its logarithm
_LARGEST, _WIDE = 600.0, 10.0
_IMPOSSIBLE = 1e15  # chi2 of what cannot be simulated

# ------------------------------------------------------------------------------ BIC with a global
# optimiser


def optimiser_names(campaign_file: Path, cpu_seconds: float) -> tuple[list[str], dict[str, float]]:
    """The effect of least BIC, if it is better than the model as it stands by `LEAST_GAIN`, and BIC
    by label.

    chi2 is minimised by CMA-ES (N. Hansen, arXiv:1604.00772) with restarts, the population doubled
    each time (A. Auger and N. Hansen, IEEE CEC 2005, 1769-1776). Runs are simulated whole, from
    long before the record on. Each effect has the same share of the processor time. The model as it
    stands has two: one at first, one from the best effect's nuisances, so that it does not lose by
    worse ones.
    """
    end = time.process_time() + cpu_seconds
    campaign = load_campaign(campaign_file)
    model = build_model(campaign, read_measurements(campaign))
    nominal = {p.key: p.nominal for p in model.nuisances}
    problem = Problem(model, numerics_noise(model, nominal, noise_of_model(model)))
    shares = len(model.candidates) + 2
    bic: dict[str, float] = {}

    def fit(hypothesis: Hypothesis, start: Mapping[str, float]) -> dict[str, float]:
        nonlocal shares
        share = max(end - time.process_time(), 0.0) / shares
        values, chi2 = minimise(problem, hypothesis, start, time.process_time() + share)
        number = len(problem.parameters(hypothesis)) + sum(
            len(candidate.replaces) for candidate in hypothesis
        )
        label, shares = label_of(hypothesis), shares - 1
        bic[label] = min(chi2 + number * math.log(problem.size), bic.get(label, math.inf))
        return values

    base = fit((), nominal)
    found = {candidate.label: fit((candidate,), base) for candidate in model.candidates}
    best = min(found, key=bic.__getitem__)
    fit((), found[best])
    return [best] if bic[best] < bic["base"] - LEAST_GAIN else [], bic


def minimise(
    problem: Problem, hypothesis: Hypothesis, nuisances: Mapping, until: float
) -> tuple[dict, float]:
    """The values of least chi2 found until a processor time, and chi2; infinite where none could be
    simulated.

    Begun at the `nuisances`, shapes at the candidate's initial guesses, one after the other,
    amplitudes at 0, where both signs are tried, then at one sign and the other.
    """
    parameters, best = problem.parameters(hypothesis), (dict(nuisances), math.inf)
    amplitudes = {
        f"{candidate.label}.{key}" for candidate in hypothesis for key in candidate.amplitudes
    }
    scales = [scale(p, p.key in amplitudes) for p in parameters]

    def chi2(place: np.ndarray) -> float:
        nonlocal best
        values = {
            p.key: value(float(u))
            for p, (_, value), u in zip(parameters, scales, place, strict=False)
        }
        square = _IMPOSSIBLE
        with suppress(InputError, SimulationError, np.linalg.LinAlgError):
            square = min(float(np.sum(problem.residual(values, hypothesis) ** 2)), square)
            best = min(best, (values, square), key=lambda found: found[1])
        if time.process_time() >= until:
            raise TimeoutError
        return square

    guesses = [dict(guess) for candidate in hypothesis for guess in candidate.initial_guesses] or [
        {}
    ]
    with suppress(TimeoutError):
        for launch in count():
            guess, again, start = guesses[launch % len(guesses)], launch // len(guesses), []
            for p, (place, _) in zip(parameters, scales, strict=True):
                known = guess.get(p.key.rpartition(".")[2], nuisances.get(p.key))
                push = (0.0, 0.5, -0.5)[again % 3] if known is None and p.key in amplitudes else 0.0
                start.append(place(p.nominal if known is None else known) + push)
            start = np.clip(
                [*start, *[0.0] * (2 - len(start))], -1.0, 1.0
            )  # CMA-ES asks for two coordinates
            chi2(start)
            options = {
                "tolfun": _TOLERANCE,
                "popsize": (4 + int(3 * math.log(start.size))) * 2 ** min(again, 6),
            }
            options |= {"bounds": [-1.0, 1.0], "seed": launch + 1, "verbose": -9}
            cma.CMAEvolutionStrategy(start, _SIGMA, options).optimize(chi2)
    return best


def scale(
    p: Parameter, amplitude: bool
) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """From a value [SI] to a coordinate, from -1 at the lower to 1 at the upper bound, and back.

    Linear in between; of a positive parameter with wide bounds in its logarithm; of an amplitude in
    asinh(value / step), since it may be small or hundreds of steps.
    """
    bend, unbend, reach = float, float, _LARGEST * p.step
    if amplitude:
        bend, unbend = (lambda x: math.asinh(x / p.step)), (lambda y: p.step * math.sinh(y))
    elif p.low > 0.0 and math.inf > p.high > _WIDE * p.low:
        bend, unbend, reach = math.log, math.exp, math.inf
    low, high = bend(max(p.low, p.nominal - reach)), bend(min(p.high, p.nominal + reach))
    half = 0.5 * (high - low) or 1.0
    return (lambda x: (bend(x) - low) / half - 1.0), (
        lambda u: unbend(low + (min(max(u, -1.0), 1.0) + 1.0) * half)
    )


# ------------------------------------------------------------------------------ network classifier

BINS = 36  # of the crank angle
READ = (*CHANNELS, "crank_angle")
CLASSES = ("nothing", *LABELS)

_SEED, _MOST_RIGS = 20261130, 20_000  # of the campaigns to learn from: the seed of no set of trials
# Effects tried in each rig that is drawn; campaigns of each, by their noise; processor time [s]
# after which no effect is tried; largest gap
_EFFECTS_A_RIG, _NOISES, _SECONDS_A_RIG, _LARGEST_GAP = 14, 2, 30.0, 20.0
_PER_CHANNEL, _FIRST_FAULT = 2 * (BINS + 3), 1 + len(PLAIN)
_SIZE, _GENERAL, _EPOCHS, _NETWORKS = len(READ) * _PER_CHANNEL, 7, 60, 5


def features(campaign_file: Path) -> np.ndarray:
    """Features of a campaign (12 x 78 + 7,): of each channel in the slowest and in the fastest run
    for fitting mean residuals of the model at nominal values, over the noise, in bins of the crank
    angle; their root mean square; the noise; whether it was measured. Then drive, joints and
    speeds."""
    campaign = load_campaign(campaign_file)
    measurements = read_measurements(campaign)
    model = build_model(campaign, measurements)
    runs = sorted(
        (run for run in model.campaign.runs if run.role != "confirm"), key=lambda run: run.speed
    )
    found = np.zeros((len(READ), 2, BINS + 3))
    for place, run in enumerate((runs[0], runs[-1])):
        plan, recording = model.plans[run.id], measurements.runs[run.id]
        measured, noise = (
            {**recording.channels, "crank_angle": recording.crank_angle},
            noise_of(campaign, run.id),
        )
        for channel, predicted in channels_read(campaign, plan, model.nominal(run.id)).items():
            known = np.isfinite(left := measured[channel] - predicted)
            left = np.angle(np.exp(1j * left[known])) if channel == "crank_angle" else left[known]
            varies = float(np.std(predicted)) + 1e-12
            # without a stated noise: what neighbouring samples differ by, that of a normal law by
            # its median
            sd = (
                noise.get(channel)
                or float(np.median(np.abs(np.diff(left)))) / 0.954 + 1e-6 * varies
            )
            bins = np.floor(plan.samples.angle[known] / math.tau * BINS).astype(int) % BINS
            counts, sums = (np.bincount(bins, weights, BINS) for weights in (None, left / sd))
            filled = np.flatnonzero(counts)
            means = np.interp(np.arange(BINS), filled, sums[filled] / counts[filled], period=BINS)
            numbers = np.arcsinh([*means, math.sqrt(np.mean(np.square(left / sd)))])
            found[READ.index(channel), place] = [*numbers, math.log10(sd / varies), 1.0]
    general = [campaign.drive == "measured_angle", "crank_angle" in campaign.channels]
    general += [joint in campaign.mechanism.loose for joint in JOINTS]
    general += [math.log(run.speed / 30.0) for run in (runs[0], runs[-1])]
    return np.concatenate([found.ravel(), np.array(general, float)])


def draw_examples(number: int) -> list[tuple[np.ndarray, int, int]]:
    """Features and classes of campaigns of one rig that is drawn by the recipe, with one effect
    after the other; and the rig's number."""
    rng, examples = np.random.default_rng([_SEED, number]), []
    base = str(rng.choice(list(RECIPE["bases"]), p=list(RECIPE["bases"].values())))
    rig = draw_rig(rng, Trial("single", base, measured_angle=bool(rng.random() < 0.2)))
    calibrator, until = Calibrator(rig), time.process_time() + _SECONDS_A_RIG
    for label in ("", *map(str, rng.permutation(LISTED)[:_EFFECTS_A_RIG])):
        steady = label in EFFECTS and EFFECTS[label].DRIVE == "constant"
        if (steady and rig.drive == "measured_angle") or (
            label == ENCODER_OFFSET and not rig.angle_noise
        ):
            continue
        with suppress(InputError, SimulationError, ArithmeticError):
            effects, named = [], "nothing"
            if label:
                effect = draw_effect(label, rig, calibrator.spread, rng)
                if effect is None or time.process_time() > until:
                    continue
                first, target = (
                    calibrator.gap([(effect, effect.first)]),
                    float(rng.choice(RECIPE["gaps"])),
                )
                size = effect.first * math.sqrt((target**2 - 1) / (first**2 - 1))  # as if linear
                effects = [(effect, min(max(size, effect.least), effect.most))]
                if not LEAST_GAP <= calibrator.gap(effects) <= _LARGEST_GAP:
                    continue
                named = effect_label({"name": effect.name, "site": effect.site})
            clean = {name: read_truth(rig, run, effects, False) for name, run in rig.runs.items()}
            for _ in range(_NOISES if label else 3 * _NOISES):
                with tempfile.TemporaryDirectory() as place:
                    write_campaign(
                        rng,
                        Path(place),
                        rig,
                        *campaign_of(rng, rig, noisy(rng, rig, clean), "training"),
                    )
                    examples.append(
                        (features(Path(place) / "campaign.yaml"), CLASSES.index(named), number)
                    )
    return examples


def draw_features(file: Path, seconds: float, cores: int = 2) -> None:
    """Draw rigs for so long, and write the features and classes of their campaigns."""
    end, examples = time.monotonic() + seconds, []
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        results = pool.imap_unordered(draw_examples, range(_MOST_RIGS))
        while time.monotonic() < end:
            with suppress(
                multiprocessing.TimeoutError, SimulationError, RuntimeError
            ):  # a rig may be impossible
                examples += results.next(max(end - time.monotonic(), 0.01))
    columns = dict(
        zip(
            ("features", "classes", "rigs"), map(np.array, zip(*examples, strict=True)), strict=True
        )
    )
    np.savez_compressed(file, **columns)


def build_network() -> nn.ModuleList:
    """The layers, without weights: of all; of the plain classes; of sensors, from the channel's own
    features too."""
    wide = nn.Sequential(
        nn.Linear(_SIZE + _GENERAL, 192), nn.SiLU(), nn.Dropout(0.3), nn.Linear(192, 96), nn.SiLU()
    )
    sensor = nn.Sequential(
        nn.Linear(_PER_CHANNEL + 96, 64), nn.SiLU(), nn.Linear(64, len(SENSOR_FAULTS))
    )
    return nn.ModuleList(
        [wide, nn.Sequential(nn.Dropout(0.2), nn.Linear(96, _FIRST_FAULT)), sensor]
    )


def log_probabilities(network: nn.ModuleList, x: Tensor) -> Tensor:
    """Logarithms of the classes' probabilities (n, c) from features (n, f); a channel that is
    absent has no fault."""
    wide, plain, sensor = network
    hidden, own = (
        wide(x),
        x[:, :_SIZE].reshape(len(x), len(READ), -1)[:, :-1],
    )  # the encoder's fault is a plain class
    faults = sensor(torch.cat([own, hidden[:, None].expand(-1, own.shape[1], -1)], dim=2))
    faults = faults.masked_fill(own[..., -1:] == 0.0, -30.0).flatten(1)
    return torch.log_softmax(torch.cat([plain(hidden), faults], dim=1), dim=1)


def train(file: Path, weights: Path) -> float:
    """Train networks on the features in a file, each without a part of the rigs, and write their
    weights.

    Returns
    -------
    float
        Share of campaigns of rigs held out that are classified right, over the networks.
    """
    data, networks, right = np.load(file), [], []
    x, y = torch.tensor(data["features"], dtype=torch.float32), torch.tensor(data["classes"])
    for number in range(_NETWORKS):
        torch.manual_seed(number)
        held_out = torch.tensor(data["rigs"] % _NETWORKS == number)
        network, learned = build_network(), torch.nonzero(~held_out)[:, 0]
        descent = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=0.05)
        for _ in range(_EPOCHS):
            for rows in learned[torch.randperm(len(learned))].split(64):
                descent.zero_grad()
                nn.functional.nll_loss(
                    log_probabilities(network, _without_some(x[rows], y[rows])), y[rows]
                ).backward()
                descent.step()
        networks.append(network.eval().state_dict())
        right += (log_probabilities(network, x[held_out]).argmax(1) == y[held_out]).tolist()
    torch.save({"classes": list(CLASSES), "networks": networks}, weights)
    return float(np.mean(right))


def _without_some(x: Tensor, y: Tensor) -> Tensor:
    """Features without some of the channels; never without the one whose sensor errs."""
    own = x[:, :_SIZE].reshape(len(x), len(READ), -1)
    kept, erring = torch.rand(own.shape[:2]) > 0.15, torch.nonzero(y >= _FIRST_FAULT)[:, 0]
    kept[erring, (y[erring] - _FIRST_FAULT) // len(SENSOR_FAULTS)] = True
    return torch.cat([(own * kept[..., None]).flatten(1), x[:, _SIZE:]], dim=1)


def network_names(campaign_file: Path, weights: Path) -> tuple[list[str], dict[str, float]]:
    """The most probable class, and probabilities of all that have one of 1 in 1000 at least."""
    saved, network = torch.load(weights, weights_only=True), build_network().eval()
    if saved["classes"] != list(CLASSES):
        raise InputError(f"{weights}: is of other classes than the recipe has now; train again")
    x, each = torch.tensor(features(campaign_file), dtype=torch.float32)[None], []
    for state in saved["networks"]:
        network.load_state_dict(state)
        each.append(log_probabilities(network, x)[0].exp().tolist())
    probabilities = dict(zip(CLASSES, np.mean(each, axis=0).tolist(), strict=True))
    named = max(probabilities, key=probabilities.__getitem__)
    return [one for one in (named,) if one != "nothing"], {
        k: round(p, 4) for k, p in probabilities.items() if p >= 1e-3
    }


def ask(which: str, campaign: Path, given: Path) -> dict[str, Any]:
    """What a peer names of a campaign, in a record with its processor time [s]: of the `optimiser`,
    `given` the verdict file with the identification's processor time; of the `network`, its
    weights."""
    begin, record = time.process_time(), {"id": campaign.name}
    if which == "optimiser":
        record[which], bic = optimiser_names(
            campaign / "campaign.yaml", json.loads(given.read_bytes())["seconds"]
        )
        record["bic"] = {label: round(value, 2) for label, value in bic.items() if value < math.inf}
    else:
        record[which], record["probabilities"] = network_names(campaign / "campaign.yaml", given)
    return record | {"seconds": round(time.process_time() - begin, 3)}
