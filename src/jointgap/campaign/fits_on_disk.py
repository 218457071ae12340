"""Fits and outcomes of identification as tables."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign
from jointgap.core import schema
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.results_folder import Frames
from jointgap.core.schema import CHANNEL_ERRORS
from jointgap.identification.baseline import Baseline
from jointgap.identification.decide_verdict import NO_DISAGREEMENT, Decision, Ranked, proposal
from jointgap.identification.fit import FAILED, LEVELS, Fit, compress_rows, effect_estimates, nuisance_estimates
from jointgap.identification.force_law import ForceLawResult
from jointgap.identification.law_family import FamilyInterval
from jointgap.identification.noise import NoiseEstimate
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.screening import LinearizedFit, Signature, Signatures, only_searched
from jointgap.identification.settings import DEFAULT_SETTINGS

_ANGLE = "crank_angle"


def clockwise(campaign: Campaign) -> frozenset[str]:
    """The runs whose crank turns clockwise."""
    return frozenset(run.id for run in campaign.runs if run.direction == "clockwise")


def map_as_read(spans: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Bins or windows of the map of disagreement, of which those in clockwise `runs` are mirrored back."""
    turned = spans["run"].isin(runs)
    sign = np.where(turned & (spans["channel"] == _ANGLE), -1.0, 1.0)
    return spans.assign(
        start_deg=spans["start_deg"].where(~turned, 360.0 - spans["end_deg"]),
        end_deg=spans["end_deg"].where(~turned, 360.0 - spans["start_deg"]),
        mean=sign * spans["mean"],
    )


def residuals_as_read(residuals: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Table `RESIDUALS`, of which the angles in clockwise `runs` are mirrored back."""
    turned = residuals["run"].isin(runs)
    sign = np.where(turned & (residuals["channel"] == _ANGLE), -1.0, 1.0)
    signed = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    angle = np.where(turned, -1.0, 1.0) * residuals[_ANGLE]
    return residuals.assign(crank_angle=angle, **{name: sign * residuals[name] for name in signed})


def parameter_as_read(parameter: Parameter, estimate: dict[str, Any], runs: Collection[str]) -> dict[str, Any]:
    """A fitted parameter with its interval, as `jointgap.identification.fit.estimate_with_interval` says it: the
    first angle of clockwise `runs` is mirrored back.
    """
    if parameter.name != "first_angle" or parameter.run not in runs:
        return estimate
    mirrored = {"value": -estimate["value"]}
    for key in (f"interval_{level}" for level in LEVELS):
        mirrored[key] = [None if end is None else -end for end in reversed(estimate[key])]
    return estimate | mirrored


def nuisances_as_read(fit: Fit, runs: Collection[str] = ()) -> list[tuple[Parameter, dict[str, Any]]]:
    """`jointgap.identification.fit.nuisance_estimates`, of which the first angles of clockwise `runs` are
    mirrored back.
    """
    return [(p, parameter_as_read(p, estimate, runs)) for p, estimate in nuisance_estimates(fit)]


JOINED = " + "
"""What stands between the labels of effects that are one explanation."""

_ORIGIN = "origin"  # in place of a parameter's name: residuals at zero size, where these are not the base's
_BETWEEN_TEXTS = "; "


def noise_to_frames(noise: Mapping[tuple[str, str], NoiseEstimate]) -> Frames:
    """Tables `NOISE_TABLES`, by name."""
    samples, memory, drive = [], [], []
    for (run, channel), series in noise.items():
        count = series.sd.size
        numerics = np.broadcast_to(series.numerics, count)
        columns = {"run": run, "channel": channel, "sample": np.arange(count), "sd": series.sd, "numerics": numerics}
        samples.append(pd.DataFrame(columns))
        if series.drive is not None:
            place = {"run": run, "channel": channel, "sample": np.repeat(np.arange(count), series.drive.shape[1])}
            errors = np.tile(np.arange(series.drive.shape[1]), count)
            drive.append(pd.DataFrame(place | {"error": errors, "change": series.drive.ravel()}))
        shared = {
            "run": run,
            "channel": channel,
            "source": series.source,
            "found": series.estimated_sd,
            "effective_samples": series.effective_samples,
            "remarks": _BETWEEN_TEXTS.join(series.remarks),
        }
        memory += [
            shared | {"lag": lag, "autocorrelation": rho} for lag, rho in enumerate((1.0, *series.autocorrelation))
        ]
    return {
        "noise": pd.concat(samples, ignore_index=True),
        "noise_memory": pd.DataFrame(memory),
        "noise_drive": _frame(schema.NOISE_DRIVE, drive),
    }


def noise_from_frames(frames: Frames) -> dict[tuple[str, str], NoiseEstimate]:
    """The noise of every series from the tables of `noise_to_frames`."""
    lags = {
        key: rows.sort_values("lag") for key, rows in frames["noise_memory"].groupby(["run", "channel"], sort=False)
    }
    drive = dict(list(frames["noise_drive"].groupby(["run", "channel"], sort=False)))
    noise = {}
    for key, rows in frames["noise"].groupby(["run", "channel"], sort=False):
        shared = lags[key].iloc[0]
        noise[key] = NoiseEstimate(
            rows["sd"].to_numpy(),
            tuple(lags[key]["autocorrelation"].iloc[1:]),
            rows["numerics"].to_numpy(),
            shared["source"],
            drive[key].pivot(index="sample", columns="error", values="change").to_numpy() if key in drive else None,
            shared["found"],
            shared["effective_samples"],
            tuple(shared["remarks"].split(_BETWEEN_TEXTS)) if shared["remarks"] else (),
        )
    return noise


def signatures_to_frames(signatures: Signatures) -> Frames:
    """Tables `SIGNATURES` and `SIGNATURE_SHAPES`, by name."""
    columns, shapes, count = [], [], {}
    for signature in signatures.entries:
        label = signature.candidate.label
        start = count[label] = count.get(label, -1) + 1
        columns += [
            (label, start, p.key, column) for p, column in zip(signature.amplitudes, signature.columns.T, strict=True)
        ]
        if signature.origin is not signatures.residual:
            columns.append((label, start, _ORIGIN, signature.origin))
        shapes += [(label, start, name, value) for name, value in signature.shape_parameters.items()]
    frames = [
        pd.DataFrame(
            {"label": label, "start": start, "name": name, "sample": np.arange(column.size), "derivative": column}
        )
        for label, start, name, column in columns
    ]
    return {
        "signatures": _frame(schema.SIGNATURES, frames),
        "signature_shapes": pd.DataFrame(shapes, columns=["label", "start", "name", "value"]),
    }


def signatures_from_frames(frames: Frames, base: Baseline) -> Signatures:
    """The signatures of all candidates from their tables."""
    columns = {
        key: {name: rows["derivative"].to_numpy() for name, rows in own.groupby("name", sort=False)}
        for key, own in frames["signatures"].groupby(["label", "start"], sort=False)
    }
    shapes = {
        key: dict(zip(rows["name"], rows["value"], strict=True))
        for key, rows in frames["signature_shapes"].groupby(["label", "start"], sort=False)
    }
    fit, runs = base.base, base.problem.runs
    by_label = {candidate.label: candidate for candidate in base.problem.model.candidates}
    signatures, factor = [], base.problem.settings.screening.secant_factor
    for (label, start), own in columns.items():
        candidate = by_label.get(label)
        sizes = [p.key for p in candidate.coordinates_in(runs) if p.key in candidate.amplitudes] if candidate else []
        if candidate is None or not own.keys() >= set(sizes):
            raise InputError(
                f"screen/signatures.parquet: holds {label} of another model than the campaign file and its mechanism "
                "now give; run `jointgap noise` on the campaign file again, and the stages after it"
            )
        derivatives = np.column_stack([own[key] for key in sizes]) if sizes else np.empty((fit.residual.size, 0))
        origin = own.get(_ORIGIN, fit.residual)
        own_shapes, searched = shapes.get((label, start), {}), only_searched(base.problem, candidate)
        signatures.append(Signature(candidate, own_shapes, derivatives, origin, runs, factor, searched))
    failed = frames["screened"].query("kind == 'failed'")
    reasons = dict(zip(failed["explanation"], failed["reason"], strict=True))
    return Signatures(fit.parameters, fit.values, fit.jacobian, fit.residual, signatures, reasons)


def screened_frame(signatures: Signatures, chosen: Sequence[LinearizedFit]) -> pd.DataFrame:
    """Table `SCREENED`."""
    rows = [(screened.label, kind_of(screened.hypothesis), screened.chi2, screened.bic, None) for screened in chosen]
    rows += [(label, "failed", np.nan, np.nan, reason) for label, reason in signatures.failed.items()]
    return pd.DataFrame(rows, columns=["explanation", "kind", "chi2", "bic", "reason"])


def hypothesis_of(label: str, candidates: Sequence[Candidate]) -> Hypothesis:
    """The explanation that `label_of` calls so."""
    by_label = {candidate.label: candidate for candidate in candidates}
    names = [] if label == label_of(()) else label.split(JOINED)
    if unknown := [name for name in names if name not in by_label]:
        raise InputError(f"explanation '{label}': the model has no candidate {unknown}; run the stages before it again")
    return tuple(by_label[name] for name in names)


def kind_of(hypothesis: Hypothesis) -> str:
    """What the table fits calls it: ``base``, ``single``, ``pair`` or ``formula``."""
    if any(candidate.name.startswith("discovered_") for candidate in hypothesis):
        return "formula"
    return ("base", "single", "pair")[len(hypothesis)]


_MATRICES = {
    "fit_curvature": ("sample", "derivative"),
    "fit_shifts": ("numerics", "shift"),
    "fit_draws": ("draw", "value"),
}
"""Tables of a matrix with a column for each parameter of a fit: what counts its rows, and what its entries are."""


def _rows_of_matrix(fit: Fit, table: str, matrix: np.ndarray) -> pd.DataFrame:
    count, entry = _MATRICES[table]
    keys = [p.key for p in fit.parameters]
    places = np.arange(len(matrix)) + (count == "numerics")  # these count from 1
    return _labelled(fit, {count: np.repeat(places, len(keys)), "key": keys * len(matrix), entry: np.ravel(matrix)})


def fits_to_frames(fits: Iterable[Fit], seconds: Iterable[float] | None = None, whole_jacobian: bool = False) -> Frames:
    """Fits as tables; those that failed keep their reason and values, and have neither curvature nor residuals."""
    fits = list(fits)
    durations = [np.nan] * len(fits) if seconds is None else list(seconds)
    rows, parts = [], {name: [] for name in ("fit_values", "fit_residuals", *_MATRICES)}
    for fit, duration in zip(fits, durations, strict=True):
        failed = fit.status == FAILED
        rows.append(
            {
                "explanation": fit.label,
                "kind": kind_of(fit.hypothesis),
                "status": fit.status,
                "reason": fit.reason or None,
                "chi2": np.nan if failed else fit.chi2,
                "samples": fit.residual.size,
                "parameters": len(fit.parameters),
                "bic": np.nan if failed else fit.bic,
                "simulations": fit.simulations,
                "seconds": duration,
                "gap_left": fit.gap_left,
            }
        )
        slope = np.nan if failed else fit.half_derivative
        values = {"key": [p.key for p in fit.parameters], "value": fit.values, "slope": slope}
        parts["fit_values"].append(_labelled(fit, values))
        if failed:
            continue
        residuals = {"sample": np.arange(fit.residual.size), "residual": fit.residual}
        parts["fit_residuals"].append(_labelled(fit, residuals))
        jacobian = fit.jacobian if whole_jacobian else compress_rows(fit.jacobian)[0]
        for table, matrix in zip(_MATRICES, (jacobian, fit.shifts, fit.draws), strict=True):
            if matrix is not None:
                parts[table].append(_rows_of_matrix(fit, table, matrix))
    parts["fits"] = [pd.DataFrame(rows)] if rows else []
    return {name: _frame(schema.TABLES[name], own) for name, own in parts.items()}


def fits_from_frames(frames: Frames, problem: Problem, more: Sequence[Candidate] = ()) -> list[Fit]:
    """The fits in these tables, in order.

    Unless they were kept whole, their Jacobians have as many rows as columns and the same inner products, which is all
    that covariances ask of them.
    """
    families = {f.law.label: f.law for c in problem.model.candidates for f in c.families}
    candidates = (*problem.model.candidates, *families.values(), *more)
    own = {
        (name, label): rows
        for name in ("fit_values", "fit_residuals", *_MATRICES)
        for label, rows in frames[name].groupby("explanation", sort=False)
    }
    fits = []
    for row in frames["fits"].to_dict("records"):
        label = row["explanation"]
        hypothesis = hypothesis_of(label, candidates)
        stored = own.get(("fit_values", label), frames["fit_values"].head(0)).set_index("key")
        parameters = tuple(p for p in problem.parameters(hypothesis) if p.key in stored.index)
        keys = [p.key for p in parameters]
        values, slope = (stored.loc[keys, name].to_numpy(dtype=float) for name in ("value", "slope"))
        residual = np.full(problem.size, np.nan)
        if ("fit_residuals", label) in own:
            residual = own["fit_residuals", label]["residual"].to_numpy()
        jacobian, shifts, draws = (
            own[table, label].pivot(index=count, columns="key", values=entry)[keys].to_numpy()
            if (table, label) in own
            else None
            for table, (count, entry) in _MATRICES.items()
        )
        if jacobian is None:
            jacobian = np.empty((problem.size, 0))
        status = row["simulations"], row["status"], row["reason"] or ""
        known = slope, shifts, draws, problem.settings, row["gap_left"]
        fits.append(Fit(hypothesis, parameters, values, residual, jacobian, *status, *known))
    return fits


def parameter_frame(fits: Iterable[Fit], clockwise: Collection[str] = ()) -> pd.DataFrame:
    """Table `FIT_PARAMETERS`: nuisances as fitted, effects' parameters as a verdict states them."""
    rows = []
    for fit in fits:
        if fit.status == FAILED:
            continue
        found = [((p.key, p.name, None, p.run), own, p.unit) for p, own in nuisances_as_read(fit, clockwise)]
        for candidate in fit.hypothesis:
            for name, own in effect_estimates(fit, candidate).items():
                found.append(((f"{candidate.label}.{name}", name, candidate.label, None), own, ""))
        for names, own, unit in found:
            rows.append(
                (fit.label, *names, own["value"], own["sd"], *own["interval_90"], own.get("remark"), unit),
            )
    return pd.DataFrame(rows, columns=schema.FIT_PARAMETERS.names)


@dataclass(frozen=True)
class Outcome:
    """A verdict with all that later stages need of the fits."""

    verdict: str
    because: str
    chosen: Fit  # The explanation named; the base where none is
    base: Fit  # What explanations were compared with: the recalibrated base, or a better one that was found on the way
    equivalent: list[Fit]
    ranking: pd.DataFrame  # Table `RANKING`
    best_known: Fit | None = None  # The best explanation where it is not proven

    @property
    def named(self) -> Fit | None:
        """The explanation that was added to the model; None where none was."""
        return self.chosen if self.verdict.startswith("named") else None

    @property
    def proposed(self) -> Fit | None:
        """What the held-out data are asked about, as of `jointgap.identification.decide_verdict.Decision`."""
        return proposal(self.chosen, self.equivalent, self.best_known)

    @property
    def explanations(self) -> list[Fit]:
        """All that later stages show of the fits: the one named, those that are as good, or the best known."""
        return [fit for fit in (self.named, *self.equivalent, self.best_known) if fit is not None]

    def frame(self) -> pd.DataFrame:
        """Table `DECISION`."""
        nuisances = "nominal" if self.verdict == NO_DISAGREEMENT else "base"
        return pd.DataFrame([{"verdict": self.verdict, "because": self.because, "nuisances": nuisances}])


def outcome_of(decision: Decision, seconds: Mapping[str, float]) -> Outcome:
    """A decision with its ranking as a table."""
    found = Outcome(
        decision.verdict,
        decision.because,
        decision.chosen,
        decision.base,
        decision.equivalent,
        ranking_frame(decision.ranking, seconds),
        decision.best_known,
    )
    return with_places(found)


def with_places(outcome: Outcome) -> Outcome:
    """The outcome with what its ranking says of the `place` of each explanation."""
    places = {fit.label: "equivalent" for fit in outcome.equivalent}
    places |= {fit.label: "best_known" for fit in (outcome.best_known,) if fit is not None}
    places |= {fit.label: "named" for fit in (outcome.named,) if fit is not None}
    ranking = outcome.ranking
    return replace(outcome, ranking=ranking.assign(place=[places.get(label, "") for label in ranking["explanation"]]))


def outcome_with_law(outcome: Outcome, proposed: ForceLawResult) -> Outcome:
    """The outcome with a force law for what is missing, where one is accepted and has no rival; else with the better
    one of the law and of what is best known.
    """
    ranking = pd.concat([outcome.ranking, ranking_frame(proposed.ranking)], ignore_index=True)
    if not proposed.named:
        known = outcome.best_known
        enough = outcome.base.bic - DEFAULT_SETTINGS.decision.min_delta_bic if known is None else known.bic
        if proposed.fit is not None and proposed.fit.bic < enough:
            known = proposed.fit
        because = f"{outcome.because}; {proposed.reason}"
        return with_places(replace(outcome, because=because, ranking=ranking, best_known=known))
    return with_places(Outcome(proposed.verdict, proposed.reason, proposed.fit, outcome.base, [], ranking))


def ranking_frame(
    ranking: Sequence[Ranked],
    seconds: Mapping[str, float] | None = None,
) -> pd.DataFrame:
    """Table `RANKING`, with no explanation named."""
    fits = [ranked.fit for ranked in ranking]
    frame = fits_to_frames(fits, [(seconds or {}).get(fit.label, np.nan) for fit in fits])["fits"]
    failed = ~np.isfinite([ranked.delta_bic for ranked in ranking])
    return frame.assign(
        delta_bic=np.where(failed, np.nan, [ranked.delta_bic for ranked in ranking]),
        explained_share=np.where(failed, np.nan, [ranked.share for ranked in ranking]),
        feature_gain=[ranked.feature_gain for ranked in ranking],
        passes=[ranked.passes for ranked in ranking],
        admissible=[ranked.admissible for ranked in ranking],
        place="",
        remark=[ranked.remark or None for ranked in ranking],
    )


def family_frame(families: Sequence[FamilyInterval]) -> pd.DataFrame:
    """Table `LAW_FAMILIES` of what the data leave of `families`."""
    return pd.DataFrame([asdict(family) for family in families], columns=schema.LAW_FAMILIES.names)


def confusability_frame(cosines: pd.DataFrame, merged: Iterable[Iterable[str]]) -> pd.DataFrame:
    """Table `CONFUSABILITY`: a matrix of cosines as one row for each two effects."""
    together = {frozenset((a, b)) for group in merged for a in group for b in group if a != b}
    labels = list(cosines.columns)
    rows = [
        (first, second, cosines.loc[first, second], frozenset((first, second)) in together)
        for first in labels
        for second in labels
    ]
    return pd.DataFrame(rows, columns=["first", "second", "cosine", "merged"])


def confusable_groups(confusability: pd.DataFrame) -> list[list[str]]:
    """Groups of effects that a campaign cannot tell apart, from table `CONFUSABILITY`."""
    groups: list[list[str]] = []
    for first, rows in confusability[confusability["merged"]].groupby("first", sort=False):
        group = sorted({first, *rows["second"]})
        if group not in groups:
            groups.append(group)
    return groups


def undetectable(detectable: pd.DataFrame) -> list[str]:
    """Effects of which a campaign says nothing, from table `DETECTABLE`.

    No size within their bounds shows them, or they cannot be simulated (`failures`).
    """
    seen = detectable.groupby("label", sort=False)["detectable"].any()
    return list(seen.index[~seen])


def failures_of_preflight(detectable: pd.DataFrame) -> dict[str, str]:
    """Why effects could not be simulated, by label, from table `DETECTABLE`."""
    failed = detectable[detectable["failed"].notna()]
    return dict(zip(failed["label"], failed["failed"], strict=True))


def assumed(detectable: pd.DataFrame) -> list[str]:
    """Noise that was assumed where none is stated, by run and channel, from table `DETECTABLE`."""
    return [text for texts in detectable["assumed"].unique() for text in texts.split(_BETWEEN_TEXTS) if text]


def assumed_in_a_cell(assumptions: Iterable[str]) -> str:
    """What `assumed` takes apart again."""
    return _BETWEEN_TEXTS.join(assumptions)


def gap_of(gaps: pd.DataFrame, role: str, run: str = "all", added: bool = True) -> dict[str, float | None]:
    """Gap before and after over all channels of a run, or of all runs, in a role, from table `GAPS`.

    None where there is no such gap: what was added cannot be simulated there.
    """
    row = gaps[(gaps["role"] == role) & (gaps["run"] == run) & (gaps["channel"] == "all")].iloc[0]
    gap = {when: None if np.isnan(row[when]) else float(row[when]) for when in ("before", "after")}
    return gap if added else gap | {"after": gap["before"]}


def held_out(gaps: pd.DataFrame, roles: Mapping[str, str], added: bool = True) -> list[dict[str, Any]]:
    """The held-out data as a verdict lists them."""
    runs = []
    for row in gaps[(gaps["role"] == "confirm") & (gaps["channel"] == "all")].to_dict("records"):
        if (run := row["run"]) != "all":
            part = "last_third" if roles[run] == "split" else "whole"
            reason = {"not_simulated": row["remark"]} if added and isinstance(row["remark"], str) else {}
            runs.append({"run": run, "part": part, "gap": gap_of(gaps, "confirm", run, added), **reason})
    return runs


def _labelled(fit: Fit, columns: dict[str, Any]) -> pd.DataFrame:
    return pd.DataFrame(columns).assign(explanation=fit.label)


def _frame(table: schema.Table, parts: list[pd.DataFrame]) -> pd.DataFrame:
    """The parts below each other, with the table's columns even where there is none."""
    names = [column.name for column in table.columns]
    filled = [part.reindex(columns=names) for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=names)


def channel_errors(residuals: pd.DataFrame, campaign: Campaign) -> pd.DataFrame:
    """Root mean square errors by run and channel, held-out samples apart."""
    speeds = {run.id: run.speed for run in campaign.runs}
    rows = []
    for (run, name, held_out), own in residuals.groupby(["run", "channel", "held_out"], sort=False):
        channel = name.partition(" ")[0]  # a statistic is of the channel that its name begins with
        # A model of another mechanism may have channels of its own, in SI.
        unit, factor = campaign.shown_unit(channel) if channel in campaign.channels else ("", 1.0)
        row = {"run": run, "speed": speeds[run], "channel": name, "held_out": held_out, "samples": len(own)}
        row |= {
            "unit": unit,
            "si_per_unit": factor,
            "noise": _rms(own["spread"]) / factor,
        }
        for when, model in (("before", "base"), ("after", "augmented")):
            row[when] = _rms(own["measured"] - own[model]) / factor
        rows.append(row)
    return pd.DataFrame(rows, columns=CHANNEL_ERRORS.names)


def _rms(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values.to_numpy(dtype=float) ** 2)))
