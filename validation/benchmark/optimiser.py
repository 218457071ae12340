"""A comparison method: BIC of single effects with a global optimiser."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import cma
import numpy as np

from jointgap.config.load import load_campaign
from jointgap.core.candidates import Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.noise import noise_of_model, numerics_noise
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements

# Improvement of the BIC over the base that an effect needs
LEAST_GAIN = 10.0

# Step of CMA-ES at a start, of the range of a coordinate; tolerance of chi2, far below `LEAST_GAIN`
_SIGMA, _TOLERANCE = 0.3, 0.1
# Largest size of an unbounded amplitude [steps of a fit]; ratio of bounds for a logarithmic search
_LARGEST, _WIDE = 600.0, 10.0
_IMPOSSIBLE = 1e15  # chi2 of a failed simulation


def answer(campaign: Path, analysis: Mapping[str, Any]) -> list[str] | None:
    """The name after the processor time of an analysis; None if the files are refused."""
    try:
        names, _ = optimiser_names(campaign / "campaign.yaml", analysis["seconds"])
    except (InputError, SimulationError):
        return None
    return names


def optimiser_names(campaign_file: Path, cpu_seconds: float) -> tuple[list[str], dict[str, float]]:
    """The effect with the smallest BIC, if better than the base by `LEAST_GAIN`; BIC by label.

    CMA-ES (N. Hansen, arXiv:1604.00772) minimises chi2, with restarts of doubled population
    (A. Auger and N. Hansen, IEEE CEC 2005, 1769-1776). Each effect has the same share of the time.
    The base is fitted twice: first, and from the nuisances of the best effect.
    """
    end = time.process_time() + cpu_seconds
    campaign = load_campaign(campaign_file)
    model = build_model(campaign, read_measurements(campaign))
    nominal = {p.key: p.nominal for p in model.nuisances}
    problem = Problem(model, numerics_noise(model, nominal, noise_of_model(model)))
    remaining_fits = len(model.candidates) + 2
    bic: dict[str, float] = {}

    def fit(hypothesis: Hypothesis, start: Mapping[str, float]) -> dict[str, float]:
        nonlocal remaining_fits
        share = max(end - time.process_time(), 0.0) / remaining_fits
        values, chi2 = minimise(problem, hypothesis, start, time.process_time() + share)
        replaced = sum(len(candidate.replaces) for candidate in hypothesis)
        penalty = (len(problem.parameters(hypothesis)) + replaced) * math.log(problem.size)
        label, remaining_fits = label_of(hypothesis), remaining_fits - 1
        bic[label] = min(chi2 + penalty, bic.get(label, math.inf))
        return values

    base = fit((), nominal)
    values = {candidate.label: fit((candidate,), base) for candidate in model.candidates}
    best = min(values, key=bic.__getitem__)
    fit((), values[best])
    return [best] if bic[best] < bic["base"] - LEAST_GAIN else [], bic


def minimise(
    problem: Problem, hypothesis: Hypothesis, nuisances: Mapping, until: float
) -> tuple[dict, float]:
    """The best values found until a processor time, and their chi2 (infinite if none).

    Starts: the `nuisances`, the initial guesses in turn, amplitudes at 0, then at either sign.
    """
    parameters, best = problem.parameters(hypothesis), (dict(nuisances), math.inf)
    amplitudes = {f"{effect.label}.{key}" for effect in hypothesis for key in effect.amplitudes}
    scales = [scale(p, p.key in amplitudes) for p in parameters]

    def chi2(point: np.ndarray) -> float:
        nonlocal best
        values = {
            p.key: unscaled(float(u))
            for p, (_, unscaled), u in zip(parameters, scales, point, strict=False)
        }
        square = _IMPOSSIBLE
        with suppress(InputError, SimulationError, np.linalg.LinAlgError):
            square = min(float(np.sum(problem.residual(values, hypothesis) ** 2)), square)
            best = min(best, (values, square), key=lambda result: result[1])
        if time.process_time() >= until:
            raise TimeoutError
        return square

    guesses = [dict(guess) for effect in hypothesis for guess in effect.initial_guesses] or [{}]
    with suppress(TimeoutError):
        for launch in count():
            guess, restart, start = guesses[launch % len(guesses)], launch // len(guesses), []
            for p, (scaled, _) in zip(parameters, scales, strict=True):
                known = guess.get(p.key.rpartition(".")[2], nuisances.get(p.key))
                free = known is None and p.key in amplitudes
                shift = (0.0, 0.5, -0.5)[restart % 3] if free else 0.0
                start.append(scaled(p.nominal if known is None else known) + shift)
            # CMA-ES needs two coordinates
            start = np.clip([*start, *[0.0] * (2 - len(start))], -1.0, 1.0)
            chi2(start)
            population = (4 + int(3 * math.log(start.size))) * 2 ** min(restart, 6)
            options = {"tolfun": _TOLERANCE, "popsize": population, "bounds": [-1.0, 1.0]}
            options |= {"seed": launch + 1, "verbose": -9}
            cma.CMAEvolutionStrategy(start, _SIGMA, options).optimize(chi2)
    return best


def scale(
    p: Parameter, amplitude: bool
) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Functions from a value [SI] to a coordinate in [-1, 1] and back.

    Linear; logarithmic for positive parameters with wide bounds; asinh(value / step) for
    amplitudes.
    """
    bend, unbend, extent = float, float, _LARGEST * p.step
    if amplitude:
        bend, unbend = (lambda x: math.asinh(x / p.step)), (lambda y: p.step * math.sinh(y))
    elif p.low > 0.0 and math.inf > p.high > _WIDE * p.low:
        bend, unbend, extent = math.log, math.exp, math.inf
    low, high = bend(max(p.low, p.nominal - extent)), bend(min(p.high, p.nominal + extent))
    half = 0.5 * (high - low) or 1.0

    def scaled(x: float) -> float:
        return (bend(x) - low) / half - 1.0

    def unscaled(u: float) -> float:
        return unbend(low + (min(max(u, -1.0), 1.0) + 1.0) * half)

    return scaled, unscaled
