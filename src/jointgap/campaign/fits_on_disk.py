"""Tables of noise, sensitivities and fits."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign
from jointgap.core import schema
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.results_folder import Frames
from jointgap.identification.fit import FAILED, LEVELS, Fit, nuisance_estimates
from jointgap.identification.noise import NoiseEstimate
from jointgap.identification.problem import Hypothesis, Problem, label_of

JOINED = " + "
"""Separator of the effects of an explanation."""

_ANGLE = "crank_angle"
_BASE = label_of(())
_BETWEEN_TEXTS = "; "
_SERIES = ["run", "channel"]


# ---- runs with a clockwise crank are simulated mirrored, and mirrored back in tables and verdicts


def clockwise(campaign: Campaign) -> frozenset[str]:
    """Runs with a clockwise crank."""
    return frozenset(run.id for run in campaign.runs if run.direction == "clockwise")


def spans_in_file_convention(spans: pd.DataFrame, clockwise_runs: Collection[str]) -> pd.DataFrame:
    """Bins or windows of the map of disagreement."""
    mirrored = spans["run"].isin(clockwise_runs)
    start, end = spans["start_deg"], spans["end_deg"]
    return spans.assign(
        start_deg=start.where(~mirrored, 360.0 - end),
        end_deg=end.where(~mirrored, 360.0 - start),
        mean=np.where(mirrored & (spans["channel"] == _ANGLE), -1.0, 1.0) * spans["mean"],
    )


def residuals_in_file_convention(
    residuals: pd.DataFrame, clockwise_runs: Collection[str]
) -> pd.DataFrame:
    """Table `RESIDUALS`."""
    mirrored = residuals["run"].isin(clockwise_runs)
    sign = np.where(mirrored & (residuals["channel"] == _ANGLE), -1.0, 1.0)
    names = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    angle = np.where(mirrored, -1.0, 1.0) * residuals[_ANGLE]
    return residuals.assign(crank_angle=angle, **{name: sign * residuals[name] for name in names})


def nuisances_in_file_convention(
    fit: Fit, clockwise_runs: Collection[str] = ()
) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances with their estimates."""
    estimates = nuisance_estimates(fit)
    for parameter, estimate in estimates:
        if parameter.name == "first_angle" and parameter.run in clockwise_runs:
            estimate["value"] = -estimate["value"]
            for key in (f"interval_{level}" for level in LEVELS):
                estimate[key] = [None if end is None else -end for end in reversed(estimate[key])]
    return estimates


# ---- noise


def _frame(table: schema.Table, parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """The concatenated parts with the table's columns, even if empty."""
    parts = [part.reindex(columns=table.names) for part in parts if len(part)]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=table.names)


def noise_to_frames(noise: Mapping[tuple[str, str], NoiseEstimate]) -> Frames:
    """Tables `NOISE_TABLES`, by name."""
    samples, memory, drive = [], [], []
    for (run, channel), series in noise.items():
        key = {"run": run, "channel": channel}
        number = np.arange(series.sd.size)
        columns = {"sample": number, "sd": series.sd, "numerics": series.numerics}
        samples.append(pd.DataFrame(key | columns))
        if series.drive is not None:
            count = series.drive.shape[1]
            columns = {"sample": np.repeat(number, count), "change": series.drive.ravel()}
            columns["error"] = np.tile(np.arange(count), number.size)
            drive.append(pd.DataFrame(key | columns))
        columns = {
            "source": series.source,
            "found": series.estimated_sd,
            "effective_samples": series.effective_samples,
            "remarks": _BETWEEN_TEXTS.join(series.remarks),
            "lag": np.arange(1 + len(series.autocorrelation)),
            "autocorrelation": (1.0, *series.autocorrelation),
        }
        memory.append(pd.DataFrame(key | columns))
    return {
        "noise": _frame(schema.NOISE, samples),
        "noise_memory": _frame(schema.NOISE_MEMORY, memory),
        "noise_drive": _frame(schema.NOISE_DRIVE, drive),
    }


def noise_from_frames(frames: Frames) -> dict[tuple[str, str], NoiseEstimate]:
    """Inverse of `noise_to_frames`."""
    memory = dict(list(frames["noise_memory"].groupby(_SERIES, sort=False)))
    drive = dict(list(frames["noise_drive"].groupby(_SERIES, sort=False)))
    noise = {}
    for key, samples in frames["noise"].groupby(_SERIES, sort=False):
        lags = memory[key].sort_values("lag")
        shared = lags.iloc[0]
        changes = None
        if key in drive:
            changes = drive[key]["change"].to_numpy().reshape(len(samples), -1)
        noise[key] = NoiseEstimate(
            samples["sd"].to_numpy(),
            tuple(lags["autocorrelation"].iloc[1:]),
            samples["numerics"].to_numpy(),
            shared["source"],
            changes,
            shared["found"],
            shared["effective_samples"],
            tuple(filter(None, shared["remarks"].split(_BETWEEN_TEXTS))),
        )
    return noise


# ---- fits


def hypothesis_of(label: str, candidates: Sequence[Candidate]) -> Hypothesis:
    """Inverse of `label_of`."""
    by_label = {candidate.label: candidate for candidate in candidates}
    names = [] if label == _BASE else label.split(JOINED)
    if unknown := [name for name in names if name not in by_label]:
        raise InputError(
            f"explanation '{label}': the model has no candidate {unknown}; repeat the earlier"
            " stages"
        )
    return tuple(by_label[name] for name in names)


def kind_of(hypothesis: Hypothesis) -> str:
    """``base``, ``single``, ``pair`` or ``formula``."""
    if any(candidate.name.startswith("discovered_") for candidate in hypothesis):
        return "formula"
    return ("base", "single", "pair")[len(hypothesis)]


_MATRICES = ("jacobian", "shifts", "draws")
"""Arrays of a fit with a column for each parameter."""


def fit_row(fit: Fit, seconds: float = np.nan) -> dict[str, Any]:
    """Columns of a fit that tables `FITS` and `RANKING` share."""
    failed = fit.status == FAILED
    return {
        "explanation": fit.label,
        "kind": kind_of(fit.hypothesis),
        "status": fit.status,
        "reason": fit.reason or None,
        "chi2": np.nan if failed else fit.chi2,
        "samples": fit.residual.size,
        "bic": np.nan if failed else fit.bic,
        "simulations": fit.simulations,
        "seconds": seconds,
        "gap_left": fit.gap_left,
    }


def fits_to_frames(fits: Sequence[Fit], seconds: Sequence[float] = ()) -> Frames:
    """Tables `FIT_TABLES` by name; failed fits have no arrays."""
    rows, arrays = [], []

    def add(number: int, array: str, matrix: np.ndarray, columns: Sequence, run: str = "") -> None:
        place = {"fit": number, "array": array, "run": run}
        place["row"] = np.repeat(np.arange(len(matrix)), len(columns))
        place["column"] = np.tile(np.array(columns, dtype=object), len(matrix))
        arrays.append(pd.DataFrame(place | {"value": np.ravel(matrix)}))

    for number, fit in enumerate(fits):
        failed, keys = fit.status == FAILED, [parameter.key for parameter in fit.parameters]
        row = {"fit": number} | fit_row(fit, seconds[number] if len(seconds) else np.nan)
        slope = np.full(len(keys), np.nan) if failed else fit.half_derivative
        values = zip(keys, fit.values, slope, strict=True)
        rows += [
            row | {"key": key, "value": value, "slope": derivative}
            for key, value, derivative in values
        ] or [row]
        if failed:
            continue
        add(number, "residual", fit.residual, [""])
        for array in _MATRICES:
            if (matrix := getattr(fit, array)) is not None:
                add(number, array, matrix, keys)
        for run, states in (fit.states or {}).items():
            add(number, "states", states, [str(state) for state in range(states.shape[1])], run)
    return {
        "fits": pd.DataFrame(rows, columns=schema.FITS.names),
        "fit_arrays": _frame(schema.FIT_ARRAYS, arrays),
    }


def _matrix(array: pd.DataFrame) -> np.ndarray:
    return array["value"].to_numpy().reshape(-1, array["column"].nunique())


def fits_from_frames(frames: Frames, problem: Problem) -> list[Fit]:
    """Inverse of `fits_to_frames`."""
    families = [family.law for c in problem.model.candidates for family in c.families]
    candidates = (*problem.model.candidates, *families)
    arrays = dict(list(frames["fit_arrays"].groupby(["fit", "array"], sort=False)))
    fits = []
    for number, rows in frames["fits"].groupby("fit", sort=False):
        row = rows.iloc[:1].to_dict("records")[0]
        stored = rows.dropna(subset=["key"])
        hypothesis = hypothesis_of(row["explanation"], candidates)
        parameters = {parameter.key: parameter for parameter in problem.parameters(hypothesis)}
        residual, states = np.full(problem.size, np.nan), None
        if (number, "residual") in arrays:
            residual = arrays[number, "residual"]["value"].to_numpy()
        matrices = {
            array: _matrix(arrays[number, array])
            for array in _MATRICES
            if (number, array) in arrays
        }
        if (number, "states") in arrays:
            by_run = arrays[number, "states"].groupby("run", sort=False)
            states = {run: _matrix(part) for run, part in by_run}
        fits.append(
            Fit(
                hypothesis,
                tuple(parameters[key] for key in stored["key"]),
                stored["value"].to_numpy(dtype=float),
                residual,
                matrices.get("jacobian", np.empty((problem.size, 0))),
                row["simulations"],
                row["status"],
                row["reason"] or "",
                stored["slope"].to_numpy(dtype=float),
                matrices.get("shifts"),
                matrices.get("draws"),
                problem.settings,
                row["gap_left"],
                states,
            )
        )
    return fits


def channel_errors(residuals: pd.DataFrame, campaign: Campaign) -> pd.DataFrame:
    """Table `CHANNEL_ERRORS`: root mean square errors by run, channel and whether held out; runs by
    speed."""
    speeds, rows = {run.id: run.speed for run in campaign.runs}, []
    by_series = residuals.groupby(["run", "channel", "held_out"], sort=False)
    for (run, name, held_out), samples in by_series:
        channel = name.partition(" ")[0]  # the name of a statistic begins with its channel
        # a model of another mechanism may have its own channels, in SI
        unit, factor = campaign.shown_unit(channel) if channel in campaign.channels else ("", 1.0)
        errors = {"noise": samples["spread"], "before": samples["measured"] - samples["base"]}
        errors["after"] = samples["measured"] - samples["augmented"]
        row = {"run": run, "speed": speeds[run], "channel": name, "held_out": held_out}
        row |= {"samples": len(samples), "unit": unit, "si_per_unit": factor}
        for column, error in errors.items():
            row[column] = float(np.sqrt(np.mean(error.to_numpy(float) ** 2))) / factor
        rows.append(row)
    table = pd.DataFrame(rows, columns=schema.CHANNEL_ERRORS.names)
    return table.sort_values("speed", kind="stable", ignore_index=True)
