"""Derivatives of whitened residuals: finite differences over steps that noise could just hide."""

from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Parameter


class FiniteDifferences:
    """Derivatives of a problem's residuals; remembers which steps were good."""

    def __init__(self, problem: Problem):
        self.problem = problem
        statistics = sum(part.place.stop - part.place.start for part in problem.parts if part.series.statistic)
        self.settings = problem.settings.differences
        self.target = max(self.settings.target_length, self.settings.target_per_statistic * np.sqrt(statistics))
        self._steps: dict[str, float] = {}
        self.numerical_noise = 0.0

    @property
    def numerical_noise_chi2(self) -> float:
        """Change of chi2 that numerical noise alone causes: it is added to residuals of about unit length along it."""
        return 2.0 * self.numerical_noise

    def probe(self, parameters: Sequence[Parameter], values: Mapping[str, float], residual: np.ndarray) -> None:
        """Find the numerical noise: the length of the whitened change where parameters are changed by next to nothing.

        Where contacts begin and end a hair earlier, an integration takes other steps; no derivative can be had from
        smaller changes than that, and no fit is better than it.
        """
        count = self.settings.probed_parameters
        shared = [p for p in parameters if p.run is None][:count] or list(parameters[:count])
        changes = []
        for p in shared:
            size = self.settings.probe_step * p.step
            step = size * (1.0 if values[p.key] + 2.0 * size <= p.high else -1.0)
            changes.append(self._noise_of(p.key, step, values, residual))
        self.numerical_noise = float(max(changes, default=0.0))
        self.target = max(self.target, self.settings.target_over_numerical_noise * self.numerical_noise)

    def _noise_of(self, key: str, step: float, values: Mapping[str, float], residual: np.ndarray) -> float:
        """Length of the change over a step that does not grow with the step, as a true effect does."""
        change = self.problem.residual({**values, key: values[key] + step}) - residual
        length = float(np.linalg.norm(change))
        if length <= 0.5 * self.problem.settings.stopping.min_decrease:
            return length  # no fit ends sooner for it
        twice = self.problem.residual({**values, key: values[key] + 2.0 * step}) - residual
        return min(length, float(np.linalg.norm(twice - 2.0 * change)))

    def jacobian(
        self,
        parameters: Sequence[Parameter],
        values: Mapping[str, float],
        residual: np.ndarray,
        hypothesis: Hypothesis,
        known_derivatives: Mapping[str, np.ndarray] | None = None,
        fine: bool = False,
    ) -> np.ndarray:
        """Derivatives of the residuals."""
        columns = [
            known_derivatives[p.key]
            if known_derivatives and p.key in known_derivatives
            else self.column(p, values, residual, hypothesis, fine)
            for p in parameters
        ]
        return np.column_stack(columns) if columns else np.empty((residual.size, 0))

    def column(
        self,
        parameter: Parameter,
        values: Mapping[str, float],
        residual: np.ndarray,
        hypothesis: Hypothesis,
        fine: bool = False,
    ) -> np.ndarray:
        """Derivative with respect to one parameter, (n,) [1/SI]; zero of a choice."""
        if parameter.choices:
            return np.zeros(residual.size)  # flat but for its steps
        settings, target = self.settings, self.target
        if not fine:
            target = max(target, settings.target_share_of_residual * float(np.linalg.norm(residual)))
        step = self._steps.get(parameter.key, parameter.step)
        change, step = self._change(parameter, step, values, residual, hypothesis)
        length, accepted = float(np.linalg.norm(change)), settings.accepted_factor
        if length > 0 and not target / accepted < length < target * accepted:
            ratio = np.clip(target / length, settings.min_step_ratio, settings.max_step_ratio)
            better, other = self._within(parameter, step * ratio), settings.min_step_change
            if abs(better) < abs(step) / other or abs(better) > abs(step) * other:
                try:
                    change, step = self._change(parameter, abs(better), values, residual, hypothesis)
                except (InputError, SimulationError):
                    pass  # too far; the first one will do
        self._steps[parameter.key] = abs(step)
        return change / step

    def _within(self, parameter: Parameter, step: float) -> float:
        span = parameter.high - parameter.low
        return min(step, self.settings.max_share_of_range * span) if np.isfinite(span) else step

    def _change(self, parameter, step, values, residual, hypothesis) -> tuple[np.ndarray, float]:
        """Change of the residuals over a step up, or down where up is out of bounds or fails."""
        here, step = values[parameter.key], self._within(parameter, step)
        runs = None if parameter.run is None else [parameter.run]
        problems = []
        for signed in (step, -step) if here + step <= parameter.high else (-step,):
            if not parameter.low <= here + signed <= parameter.high:
                continue
            moved = {**values, parameter.key: here + signed}
            try:
                return self.problem.residual(moved, hypothesis, runs, residual) - residual, signed
            except (InputError, SimulationError) as error:
                problems.append(error)
        raise problems[0] if problems else SimulationError(f"{parameter.key} cannot be varied within its bounds")
