"""Draws of the parameters of a fit where chi2 is not quadratic: along its curved valley.

Where joints are loose, restitution, damping and masses may change together by many standard errors and chi2 hardly
changes, along a valley that bends. So chi2 is learned where it counts, a few simulations at a time
(`jointgap.identification.residual_surrogate`): they are drawn from what is known so far, at first from a flattened chi2
that reaches farther out, then from chi2 itself. The draws are those of an ensemble that moves by its own differences
(C. J. F. ter Braak, Statistics and Computing 16 (2006) 239-249); they cost no simulation.
"""

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.fit import Fit, bounds_of
from jointgap.identification.problem import Problem
from jointgap.identification.residual_surrogate import ResidualSurrogate
from jointgap.identification.settings import ValleySettings


def draws_along_valley(problem: Problem, fit: Fit, numerical_noise_chi2: float = 0.0) -> np.ndarray | None:
    """Draws of all that a fit varies, from exp(-chi2 / 2) within the bounds.

    chi2 counts less where the residual is more than noise, as in `Fit.distribution`.
    """
    settings, known = problem.settings.valley, fit.distribution
    errors = np.sqrt(np.diag(known.covariance))
    live = (errors > 0.0) & ~np.array([parameter.whole for parameter in fit.parameters])
    if not live.any():
        return None
    generator = np.random.default_rng(0)
    low, high = bounds_of(fit.parameters)
    if known.draws is None:
        correlation = known.covariance[np.ix_(live, live)] / np.outer(errors[live], errors[live])
        normal = generator.multivariate_normal(np.zeros(live.sum()), correlation, settings.walkers, method="svd")
        ensemble = np.clip(fit.values[live] + errors[live] * normal, low[live], high[live])
    else:
        ensemble = known.draws[generator.choice(len(known.draws), settings.walkers, replace=False)][:, live]
    surrogate = ResidualSurrogate(fit.values[live], fit.residual, fit.jacobian[:, live], errors[live], settings)
    bounds, inflation = (low[live], high[live]), fit.inflation

    def simulate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What can be simulated of `points`, and the residuals."""
        kept, residuals = [], []
        for point in points:
            values = fit.values.copy()
            values[live] = point
            at = dict(zip((p.key for p in fit.parameters), map(float, values), strict=True))
            try:
                residuals.append(problem.residual(fit.mapping | at, fit.hypothesis))
            except (InputError, SimulationError):
                continue
            kept.append(point)
        return np.array(kept).reshape(-1, points.shape[1]), np.array(residuals).reshape(-1, problem.size)

    farther = fit.values[live] + settings.probe_reach * (ensemble[: settings.probes] - fit.values[live])
    probes, residuals = simulate(np.clip(farther, *bounds))
    missed = np.abs(np.sum(residuals**2, axis=1) - surrogate.chi2(probes))
    if not np.any(missed > settings.quadratic_within * inflation + numerical_noise_chi2):
        return None
    surrogate.add(probes, residuals)
    for temperature in settings.temperatures:
        ensemble = _drawn(surrogate, ensemble, bounds, temperature * inflation, generator, settings)[-len(ensemble) :]
        points, residuals = simulate(ensemble[generator.choice(len(ensemble), settings.batch, replace=False)])
        if len(points):
            surrogate.add(points, residuals)
    ensemble = _drawn(surrogate, ensemble, bounds, inflation, generator, settings)[-len(ensemble) :]
    drawn = _drawn(surrogate, ensemble, bounds, inflation, generator, settings)
    drawn = drawn[generator.choice(len(drawn), min(settings.kept_draws, len(drawn)), replace=False)]
    draws = np.tile(fit.values, (len(drawn), 1))
    draws[:, live] = drawn
    return draws


def _drawn(
    surrogate: ResidualSurrogate,
    ensemble: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    temperature: float,
    generator: np.random.Generator,
    settings: ValleySettings,
) -> np.ndarray:
    """The ensembles (walkers, k) of the second half of the steps, every tenth, one below the other: the last is last.

    The density is exp(-chi2 / (2 `temperature`)) within the `bounds` (k,). One half of the ensemble moves by
    differences between members of the other, which stands still, so that the move is symmetric.
    """
    low, high = bounds
    now, chi2 = ensemble.copy(), surrogate.chi2(ensemble)
    count, half = ensemble.shape[1], len(ensemble) // 2
    kept = []
    for step in range(settings.steps):
        for moving, standing in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
            others = now[standing]
            size = len(now[moving])
            first, second = generator.integers(len(others), size=(2, size))
            jumps = generator.random(size) < settings.long_jumps
            gamma = np.where(jumps, 1.0, generator.uniform(0.3, 1.2, size) * 2.38 / np.sqrt(2.0 * count))
            proposed = now[moving] + gamma[:, None] * (others[first] - others[second])
            proposed += settings.jitter * surrogate.errors * generator.normal(size=proposed.shape)
            inside = np.all((proposed >= low) & (proposed <= high), axis=1)
            there = np.full(size, np.inf)
            if inside.any():
                there[inside] = surrogate.chi2(proposed[inside])
            fall = np.where(inside, chi2[moving] - there, -np.inf)
            taken = np.log(generator.random(size)) < fall / (2.0 * temperature)
            now[moving] = np.where(taken[:, None], proposed, now[moving])
            chi2[moving] = np.where(taken, there, chi2[moving])
        if step >= settings.steps // 2 and (step + 1) % 10 == 0:
            kept.append(now.copy())
    return np.concatenate(kept)
