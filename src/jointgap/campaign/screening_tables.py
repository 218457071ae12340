"""Stage screen: what every candidate changes, and what campaigns in which nothing is hidden would show."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.campaign.fit_tables import kind_of
from jointgap.errors import InputError
from jointgap.identification.baseline import Recalibrated, other_numerics
from jointgap.identification.model_selection import shortlist
from jointgap.identification.screening import Screened, Signature, Signatures, signatures
from jointgap.identification.thresholds import Thresholds, thresholds

_ORIGIN = "origin"


@dataclass(frozen=True)
class Screening:
    """What the stage hands on.

    Attributes
    ----------
    known : Signatures
        Of all candidates.
    limits : Thresholds
    chosen : list of Screened
        Single effects to fit, best first.
    """

    known: Signatures
    limits: Thresholds
    chosen: list[Screened]

    def frame(self) -> pd.DataFrame:
        """Table `jointgap.tables.SCREENED`."""
        rows = [
            {
                "explanation": one.label,
                "kind": kind_of(one.explanation),
                "chi2": one.chi2,
                "bic": one.bic,
                "reason": None,
            }
            for one in self.chosen
        ]
        nothing = {"kind": "failed", "chi2": np.nan, "bic": np.nan}
        rows += [{"explanation": label, **nothing, "reason": why} for label, why in self.known.failed.items()]
        return pd.DataFrame(rows, columns=["explanation", "kind", "chi2", "bic", "reason"])


def screen(found: Recalibrated, rate: float, noise_dof: float = np.inf, seed: int = 0) -> Screening:
    """Simulate every candidate at a small size, and choose what is worth a fit.

    Parameters
    ----------
    found : Recalibrated
    rate : float
        False alarms allowed.
    noise_dof : float
        Degrees of freedom from which the noise was estimated; infinite where it is stated.
    seed : int
        Of the null campaigns.
    """
    known = signatures(found.problem, found.base, found.differences)
    numerics = other_numerics(found.problem, found.base)
    limits = thresholds(found.problem, known, numerics, rate, noise_dof, found.differences.rough_chi2, seed)
    return Screening(known, limits, shortlist(known, limits))


def to_frames(known: Signatures) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables `jointgap.tables.SIGNATURES` and `jointgap.tables.SIGNATURE_SHAPES`."""
    columns, shapes, count = [], [], {}
    for one in known.found:
        label = one.candidate.label
        start = count[label] = count.get(label, -1) + 1
        columns += [(label, start, p.key, column) for p, column in zip(one.amplitudes, one.columns.T, strict=True)]
        if one.origin is not known.residual:
            columns.append((label, start, _ORIGIN, one.origin))
        shapes += [(label, start, name, value) for name, value in one.shape_parameters.items()]
    frames = [
        pd.DataFrame(
            {"label": label, "start": start, "name": name, "sample": np.arange(column.size), "derivative": column}
        )
        for label, start, name, column in columns
    ]
    names = ["label", "start", "name", "sample", "derivative"]
    derivatives = pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=names)
    return derivatives, pd.DataFrame(shapes, columns=["label", "start", "name", "value"])


def from_frames(
    derivatives: pd.DataFrame, shapes: pd.DataFrame, screened: pd.DataFrame, found: Recalibrated
) -> Signatures:
    """The signatures of all candidates from their tables.

    Raises
    ------
    InputError
        They are of another model than that of `found`.
    """
    columns = {
        place: {name: rows["derivative"].to_numpy() for name, rows in of.groupby("name", sort=False)}
        for place, of in derivatives.groupby(["label", "start"], sort=False)
    }
    at = {
        place: dict(zip(rows["name"], rows["value"], strict=True))
        for place, rows in shapes.groupby(["label", "start"], sort=False)
    }
    base, runs = found.base, found.problem.runs
    size = base.residual.size
    by_label = {candidate.label: candidate for candidate in found.problem.model.candidates}
    signatures = []
    for (label, start), own in columns.items():
        candidate = by_label.get(label)
        sizes = [p.key for p in candidate.coordinates_in(runs) if p.key in candidate.amplitudes] if candidate else []
        if candidate is None or not own.keys() >= set(sizes):
            raise InputError(
                f"screen/signatures.parquet: holds {label} of another model than the campaign file and its mechanism now give; run "
                "`jointgap noise` on the campaign file again, and the stages after it"
            )
        origin = own.get(_ORIGIN, base.residual)
        stacked = _stacked([own[key] for key in sizes], size)
        signatures.append(Signature(candidate, at.get((label, start), {}), stacked, origin, runs))
    lost = screened[screened["kind"] == "failed"]
    failed = dict(zip(lost["explanation"], lost["reason"], strict=True))
    return Signatures(base.parameters, base.values, base.jacobian, base.residual, signatures, failed)


def _stacked(columns: list[np.ndarray], size: int) -> np.ndarray:
    return np.column_stack(columns) if columns else np.empty((size, 0))
