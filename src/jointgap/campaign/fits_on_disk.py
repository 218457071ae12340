"""Tables of fits and outcomes."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign
from jointgap.core import schema
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.results_folder import Frames
from jointgap.identification.baseline import Baseline
from jointgap.identification.fit import (
    FAILED,
    LEVELS,
    Fit,
    compress_rows,
    effect_estimates,
    nuisance_estimates,
)
from jointgap.identification.force_law import ForceLawResult
from jointgap.identification.law_family import FamilyInterval
from jointgap.identification.noise import NoiseEstimate
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.screening import LinearizedFit, Sensitivities, Sensitivity
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import Decision, Row

JOINED = " + "
"""Separator of the effects of an explanation."""

_ANGLE = "crank_angle"
_ORIGIN = (  # in place of a parameter's name: residuals at zero size, if they are not the base's
    "origin"
)
_BETWEEN_TEXTS = "; "
_SERIES = ["run", "channel"]


def clockwise(campaign: Campaign) -> frozenset[str]:
    """Runs with a clockwise crank: simulated mirrored, mirrored back in tables and verdicts."""
    return frozenset(run.id for run in campaign.runs if run.direction == "clockwise")


def map_as_read(spans: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Bins or windows of the map of disagreement; those of clockwise `runs` are mirrored back."""
    turned = spans["run"].isin(runs)
    return spans.assign(
        start_deg=spans["start_deg"].where(~turned, 360.0 - spans["end_deg"]),
        end_deg=spans["end_deg"].where(~turned, 360.0 - spans["start_deg"]),
        mean=np.where(turned & (spans["channel"] == _ANGLE), -1.0, 1.0) * spans["mean"],
    )


def residuals_as_read(residuals: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Table `RESIDUALS`; angles of clockwise `runs` are mirrored back."""
    turned = residuals["run"].isin(runs)
    sign = np.where(turned & (residuals["channel"] == _ANGLE), -1.0, 1.0)
    signed = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    angle = np.where(turned, -1.0, 1.0) * residuals[_ANGLE]
    return residuals.assign(crank_angle=angle, **{name: sign * residuals[name] for name in signed})


def nuisances_as_read(
    fit: Fit, runs: Collection[str] = ()
) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances with their estimates; the first angles of clockwise `runs` are mirrored back."""
    found = nuisance_estimates(fit)
    for p, estimate in found:
        if p.name == "first_angle" and p.run in runs:
            estimate["value"] = -estimate["value"]
            for key in (f"interval_{level}" for level in LEVELS):
                estimate[key] = [None if end is None else -end for end in reversed(estimate[key])]
    return found


def _frame(table: schema.Table, parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """The concatenated parts with the table's columns, even if empty."""
    filled = [part.reindex(columns=table.names) for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=table.names)


def _long(
    matrix: np.ndarray, row: str, column: str, value: str, names: Sequence = (), first: int = 0
) -> pd.DataFrame:
    """A matrix in long form; rows are counted from `first`, columns have `names` or numbers."""
    rows, columns = matrix.shape
    places = {
        row: np.repeat(np.arange(rows) + first, columns),
        column: list(names or range(columns)) * rows,
    }
    return pd.DataFrame(places | {value: np.ravel(matrix)})


def noise_to_frames(noise: Mapping[tuple[str, str], NoiseEstimate]) -> Frames:
    """Tables `NOISE_TABLES`, by name."""
    samples, memory, drive = [], [], []
    for (run, channel), series in noise.items():
        place, count = {"run": run, "channel": channel}, series.sd.size
        spread = {"sample": np.arange(count), "sd": series.sd, "numerics": series.numerics}
        samples.append(pd.DataFrame(place | spread))
        if series.drive is not None:
            drive.append(_long(series.drive, "sample", "error", "change").assign(**place))
        rho = (1.0, *series.autocorrelation)
        shared = {
            "source": series.source,
            "found": series.estimated_sd,
            "effective_samples": series.effective_samples,
        }
        shared |= {
            "remarks": _BETWEEN_TEXTS.join(series.remarks),
            "lag": range(len(rho)),
            "autocorrelation": rho,
        }
        memory.append(pd.DataFrame(place | shared))
    tables = {"noise": samples, "noise_memory": memory, "noise_drive": drive}
    return {name: _frame(schema.TABLES[name], parts) for name, parts in tables.items()}


def noise_from_frames(frames: Frames) -> dict[tuple[str, str], NoiseEstimate]:
    """Inverse of `noise_to_frames`."""
    memory, drive = (
        dict(list(frames[name].groupby(_SERIES, sort=False)))
        for name in ("noise_memory", "noise_drive")
    )
    noise = {}
    for key, rows in frames["noise"].groupby(_SERIES, sort=False):
        lags = memory[key].sort_values("lag")
        shared = lags.iloc[0]
        noise[key] = NoiseEstimate(
            rows["sd"].to_numpy(),
            tuple(lags["autocorrelation"].iloc[1:]),
            rows["numerics"].to_numpy(),
            shared["source"],
            (
                drive[key].pivot(index="sample", columns="error", values="change").to_numpy()
                if key in drive
                else None
            ),
            shared["found"],
            shared["effective_samples"],
            tuple(shared["remarks"].split(_BETWEEN_TEXTS)) if shared["remarks"] else (),
        )
    return noise


def sensitivities_to_frames(sensitivities: Sensitivities, base: Fit) -> Frames:
    """Tables `SIGNATURES` and `SIGNATURE_SHAPES` by name; with the base if it differs from its
    fit."""
    frames, shapes, count = [], [], {}

    def add(label: str, start: int, columns: Mapping[str, np.ndarray]) -> None:
        for name, column in columns.items():
            values = {"name": name, "sample": np.arange(column.size), "derivative": column}
            frames.append(pd.DataFrame({"label": label, "start": start} | values))

    if sensitivities.residual is not base.residual:
        keys = [p.key for p in sensitivities.parameters]
        add(
            label_of(()),
            0,
            dict(zip(keys, sensitivities.jacobian.T, strict=True))
            | {_ORIGIN: sensitivities.residual},
        )
        shapes += [
            (label_of(()), 0, key, value)
            for key, value in zip(keys, sensitivities.values, strict=True)
        ]
    for sensitivity in sensitivities.entries:
        label = sensitivity.candidate.label
        start = count[label] = count.get(label, -1) + 1
        columns = {
            p.key: column
            for p, column in zip(sensitivity.amplitudes, sensitivity.columns.T, strict=True)
        }
        if sensitivity.origin is not sensitivities.residual:
            columns[_ORIGIN] = sensitivity.origin
        add(label, start, columns)
        shapes += [
            (label, start, name, value) for name, value in sensitivity.shape_parameters.items()
        ]
    return {
        "signatures": _frame(schema.SIGNATURES, frames),
        "signature_shapes": pd.DataFrame(shapes, columns=schema.SIGNATURE_SHAPES.names),
    }


def sensitivities_from_frames(frames: Frames, base: Baseline) -> Sensitivities:
    """Inverse of `sensitivities_to_frames`."""
    shapes: dict[tuple[str, int], dict[str, float]] = {}
    for row in frames["signature_shapes"].itertuples():
        shapes.setdefault((row.label, row.start), {})[row.name] = row.value
    fit, runs = base.base, base.problem.runs
    values, residual, jacobian = fit.values, fit.residual, fit.jacobian
    by_label = {candidate.label: candidate for candidate in base.problem.model.candidates}
    sensitivities, factor = [], base.problem.settings.screening.secant_factor
    for (label, start), rows in frames["signatures"].groupby(["label", "start"], sort=False):
        own = {
            name: column.to_numpy()
            for name, column in rows.groupby("name", sort=False)["derivative"]
        }
        if label == label_of(()):
            residual, about = own.pop(_ORIGIN), shapes.get((label, start), {})
            values = np.array([about[p.key] for p in fit.parameters])
            jacobian = (
                np.array([own[p.key] for p in fit.parameters]).reshape(values.size, residual.size).T
            )
            continue
        candidate = by_label.get(label)
        sizes = (
            [p.key for p in candidate.coordinates_in(runs) if p.key in candidate.amplitudes]
            if candidate
            else []
        )
        if candidate is None or not own.keys() >= set(sizes):
            raise InputError(
                f"screen/signatures.parquet: {label} does not belong to the model of the campaign"
                " file and its mechanism; repeat `jointgap noise` and the later stages"
            )
        derivatives = (
            np.column_stack([own[key] for key in sizes]) if sizes else np.empty((residual.size, 0))
        )
        origin, own_shapes = own.get(_ORIGIN, residual), shapes.get((label, start), {})
        sensitivities.append(Sensitivity(candidate, own_shapes, derivatives, origin, runs, factor))
    failed = (
        frames["screened"].query("kind == 'failed'").set_index("explanation")["reason"].to_dict()
    )
    return Sensitivities(fit.parameters, values, jacobian, residual, sensitivities, failed)


def screened_frame(sensitivities: Sensitivities, chosen: Sequence[LinearizedFit]) -> pd.DataFrame:
    """Table `SCREENED`."""
    rows = [
        (screened.label, kind_of(screened.hypothesis), screened.chi2, screened.bic, None)
        for screened in chosen
    ]
    rows += [
        (label, "failed", np.nan, np.nan, reason) for label, reason in sensitivities.failed.items()
    ]
    return pd.DataFrame(rows, columns=schema.SCREENED.names)


def hypothesis_of(label: str, candidates: Sequence[Candidate]) -> Hypothesis:
    """Inverse of `label_of`."""
    by_label = {candidate.label: candidate for candidate in candidates}
    names = [] if label == label_of(()) else label.split(JOINED)
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


_MATRICES = {
    "fit_curvature": ("sample", "derivative"),
    "fit_shifts": ("numerics", "shift"),
    "fit_draws": ("draw", "value"),
}
"""Tables of matrices with a column for each parameter of a fit: name of the row number and of the
entries."""


def fits_to_frames(
    fits: Iterable[Fit], seconds: Iterable[float] | None = None, whole_jacobian: bool = False
) -> Frames:
    """Tables of fits; failed fits have neither curvature nor residuals."""
    fits = list(fits)
    durations = [np.nan] * len(fits) if seconds is None else list(seconds)
    parts: dict[str, list] = {
        name: [] for name in ("fits", "fit_values", "fit_residuals", "fit_states", *_MATRICES)
    }
    for fit, duration in zip(fits, durations, strict=True):
        failed, keys, label = (
            fit.status == FAILED,
            [p.key for p in fit.parameters],
            {"explanation": fit.label},
        )
        row = label | {
            "kind": kind_of(fit.hypothesis),
            "status": fit.status,
            "reason": fit.reason or None,
        }
        row |= {
            "chi2": np.nan if failed else fit.chi2,
            "samples": fit.residual.size,
            "parameters": len(keys),
        }
        row |= {
            "bic": np.nan if failed else fit.bic,
            "simulations": fit.simulations,
            "seconds": duration,
        }
        parts["fits"].append(row | {"gap_left": fit.gap_left})
        slope = np.nan if failed else fit.half_derivative
        parts["fit_values"].append(
            pd.DataFrame({"key": keys, "value": fit.values, "slope": slope}).assign(**label)
        )
        if failed:
            continue
        residuals = pd.DataFrame({"sample": np.arange(fit.residual.size), "residual": fit.residual})
        parts["fit_residuals"].append(residuals.assign(**label))
        for run, states in (fit.states or {}).items():
            parts["fit_states"].append(
                _long(states, "window", "number", "value").assign(run=run, **label)
            )
        jacobian = fit.jacobian if whole_jacobian else compress_rows(fit.jacobian)[0]
        matrices = jacobian, fit.shifts, fit.draws
        for (table, (count, entry)), matrix in zip(_MATRICES.items(), matrices, strict=True):
            if matrix is not None:
                first = int(count == "numerics")  # counted from 1
                parts[table].append(_long(matrix, count, "key", entry, keys, first).assign(**label))
    parts["fits"] = [pd.DataFrame(parts["fits"])]
    return {name: _frame(schema.TABLES[name], own) for name, own in parts.items()}


def fits_from_frames(frames: Frames, problem: Problem, more: Sequence[Candidate] = ()) -> list[Fit]:
    """Inverse of `fits_to_frames`.

    Jacobians that were compressed are square, with the inner products that covariances require.
    """
    families = {f.law.label: f.law for c in problem.model.candidates for f in c.families}
    candidates = (*problem.model.candidates, *families.values(), *more)
    own = {
        name: dict(list(frames[name].groupby("explanation", sort=False)))
        for name in frames
        if name != "fits"
    }
    fits = []
    for row in frames["fits"].to_dict("records"):
        label = row["explanation"]
        hypothesis = hypothesis_of(label, candidates)
        stored = own["fit_values"].get(label, frames["fit_values"].head(0)).set_index("key")
        parameters = tuple(p for p in problem.parameters(hypothesis) if p.key in stored.index)
        keys = [p.key for p in parameters]
        values, slope = (
            stored.loc[keys, name].to_numpy(dtype=float) for name in ("value", "slope")
        )
        residual, jacobian = np.full(problem.size, np.nan), np.empty((problem.size, 0))
        if label in own["fit_residuals"]:
            residual = own["fit_residuals"][label]["residual"].to_numpy()
        matrices = {
            table: (
                own[table][label].pivot(index=count, columns="key", values=entry)[keys].to_numpy()
            )
            for table, (count, entry) in _MATRICES.items()
            if label in own[table]
        }
        states = None
        if label in own["fit_states"]:
            of_runs = own["fit_states"][label].groupby("run", sort=False)
            states = {
                run: each.pivot(index="window", columns="number", values="value")
                for run, each in of_runs
            }
            states = {run: each.to_numpy() for run, each in states.items()}
        jacobian, shifts, draws = (matrices.get(table) for table in _MATRICES)
        if jacobian is None:
            jacobian = np.empty((problem.size, 0))
        status = row["simulations"], row["status"], row["reason"] or ""
        known = slope, shifts, draws, problem.settings, row["gap_left"], states
        fits.append(Fit(hypothesis, parameters, values, residual, jacobian, *status, *known))
    return fits


def parameter_frame(fits: Iterable[Fit], clockwise: Collection[str] = ()) -> pd.DataFrame:
    """Table `FIT_PARAMETERS`: fitted nuisances, and parameters of effects as in the verdict."""
    rows = []
    for fit in (fit for fit in fits if fit.status != FAILED):
        found = [
            ((p.key, p.name, None, p.run), own, p.unit)
            for p, own in nuisances_as_read(fit, clockwise)
        ]
        for candidate in fit.hypothesis:
            for name, own in effect_estimates(fit, candidate).items():
                found.append(((f"{candidate.label}.{name}", name, candidate.label, None), own, ""))
        for names, own, unit in found:
            rows.append(
                (
                    fit.label,
                    *names,
                    own["value"],
                    own["sd"],
                    *own["interval_90"],
                    own.get("remark"),
                    unit,
                )
            )
    return pd.DataFrame(rows, columns=schema.FIT_PARAMETERS.names)


@dataclass(frozen=True)
class Outcome(Decision):
    """A decision whose ranking is a table."""

    ranking: pd.DataFrame = field(
        default_factory=pd.DataFrame
    )  # Table `RANKING` without its column place

    @property
    def named(self) -> Fit | None:
        return self.chosen if self.verdict.startswith("named") else None

    @property
    def explanations(self) -> list[Fit]:
        """The named fit with its twins, the equivalent or the best known fits."""
        return [
            fit
            for fit in (self.named, *self.twins, *self.equivalent, self.best_known)
            if fit is not None
        ]

    @property
    def placed_ranking(self) -> pd.DataFrame:
        """Table `RANKING`."""
        places = {fit.label: "equivalent" for fit in self.equivalent} | {
            fit.label: "twin" for fit in self.twins
        }
        places |= {fit.label: "best_known" for fit in (self.best_known,) if fit}
        places |= {fit.label: "named" for fit in (self.named,) if fit}
        return self.ranking.assign(
            place=[places.get(label, "") for label in self.ranking["explanation"]]
        )


def outcome_of(decision: Decision, seconds: Mapping[str, float]) -> Outcome:
    """A decision with its ranking as a table."""
    return Outcome(**vars(decision) | {"ranking": ranking_frame(decision.ranking, seconds)})


def outcome_with_law(outcome: Outcome, proposed: ForceLawResult) -> Outcome:
    """The outcome with the force law named if it is accepted and has no rival; else with the law as
    best known explanation if it is better. A listed effect that was found by a formula replaces its
    earlier fit in the ranking.
    """
    found = ranking_frame(proposed.ranking)
    earlier = outcome.ranking[~outcome.ranking["explanation"].isin(found["explanation"])]
    ranking = pd.concat([earlier, found], ignore_index=True)
    law, known = proposed.fit, outcome.best_known
    if proposed.named:
        decided = {
            "verdict": proposed.verdict,
            "because": proposed.reason,
            "chosen": law,
            "best_known": None,
        }
        return replace(outcome, equivalent=[], certain=(), ranking=ranking, **decided)
    enough = (
        outcome.base.bic - DEFAULT_SETTINGS.decision.min_delta_bic if known is None else known.bic
    )
    best = law if law is not None and law.bic < enough else known
    return replace(
        outcome, because=f"{outcome.because}; {proposed.reason}", ranking=ranking, best_known=best
    )


def ranking_frame(
    ranking: Sequence[Row], seconds: Mapping[str, float] | None = None
) -> pd.DataFrame:
    """Table `RANKING` without its column place."""
    fits = [ranked.fit for ranked in ranking]
    frame = fits_to_frames(fits, [(seconds or {}).get(fit.label, np.nan) for fit in fits])["fits"]
    failed = ~np.isfinite([ranked.delta_bic for ranked in ranking])
    return frame.assign(
        delta_bic=np.where(failed, np.nan, [ranked.delta_bic for ranked in ranking]),
        explained_share=np.where(failed, np.nan, [ranked.share for ranked in ranking]),
        passes=[ranked.passes for ranked in ranking],
        admissible=[ranked.admissible for ranked in ranking],
        remark=[ranked.remark or None for ranked in ranking],
    )


def family_frame(families: Sequence[FamilyInterval]) -> pd.DataFrame:
    """Table `LAW_FAMILIES`."""
    return pd.DataFrame([asdict(family) for family in families], columns=schema.LAW_FAMILIES.names)


def channel_errors(residuals: pd.DataFrame, campaign: Campaign) -> pd.DataFrame:
    """Table `CHANNEL_ERRORS`: root mean square errors by run, channel and whether held out; runs by
    speed."""
    speeds, rows = {run.id: run.speed for run in campaign.runs}, []
    for (run, name, held_out), own in residuals.groupby(["run", "channel", "held_out"], sort=False):
        channel = name.partition(" ")[0]  # the name of a statistic begins with its channel
        # a model of another mechanism may have its own channels, in SI
        unit, factor = campaign.shown_unit(channel) if channel in campaign.channels else ("", 1.0)
        row = {
            "run": run,
            "speed": speeds[run],
            "channel": name,
            "held_out": held_out,
            "samples": len(own),
        }
        errors = {"noise": own["spread"], "before": own["measured"] - own["base"]}
        errors["after"] = own["measured"] - own["augmented"]
        rms = {
            when: float(np.sqrt(np.mean(error.to_numpy(float) ** 2))) / factor
            for when, error in errors.items()
        }
        rows.append(row | {"unit": unit, "si_per_unit": factor} | rms)
    table = pd.DataFrame(rows, columns=schema.CHANNEL_ERRORS.names)
    return table.sort_values("speed", kind="stable", ignore_index=True)
