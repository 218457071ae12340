"""The outcome of a campaign: the decision on its fits, with the ranking as a table."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core import schema
from jointgap.identification.fit import FAILED, Fit, compress_rows
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.law_family import FamilyInterval
from jointgap.identification.problem import Hypothesis
from jointgap.identification.verdict import Decision, Row


@dataclass(frozen=True)
class Outcome(Decision):
    """A decision whose ranking is a table."""

    ranking: pd.DataFrame = field(default_factory=pd.DataFrame)  # Table `RANKING` without place

    @property
    def named(self) -> Fit | None:
        return self.chosen if self.verdict.startswith("named") else None

    @property
    def explanations(self) -> list[Fit]:
        """The named fit with its twins, the equivalent or the best known fits."""
        fits = (self.named, *self.twins, *self.equivalent, self.best_known)
        return [fit for fit in fits if fit is not None]

    @property
    def bic(self) -> dict[str, float]:
        """BIC of the base and of all explanations, by label."""
        fitted = self.ranking.dropna(subset=["bic"]).set_index("explanation")["bic"]
        return {"base": self.base.bic} | fitted.to_dict()

    @property
    def placed_ranking(self) -> pd.DataFrame:
        """Table `RANKING`."""
        lists = {"equivalent": self.equivalent, "twin": self.twins}
        lists |= {"best_known": [self.best_known], "named": [self.named]}
        places = {fit.label: place for place, fits in lists.items() for fit in fits if fit}
        placed = [places.get(label, "") for label in self.ranking["explanation"]]
        return self.ranking.assign(place=placed)


def outcome_of(decision: Decision, seconds: Mapping[frozenset[str], float]) -> Outcome:
    """A decision with its ranking as a table; duration of the fits [s] by effects."""
    return Outcome(**vars(decision) | {"ranking": ranking_frame(decision.ranking, seconds)})


def compressed(outcome: Outcome) -> Outcome:
    """The outcome with fewer rows in the Jacobians of its explanations, with the same inner
    products."""

    def compress(fit: Fit) -> Fit:
        return replace(fit, jacobian=compress_rows(fit.jacobian)[0], slope=fit.half_derivative)

    chosen, best = outcome.chosen, outcome.best_known
    return replace(
        outcome,
        chosen=compress(chosen) if outcome.named else replace(chosen, gap_left=1.0),
        twins=[compress(fit) for fit in outcome.twins],
        equivalent=[compress(fit) for fit in outcome.equivalent],
        best_known=compress(best) if best else None,
    )


def ranking_frame(
    ranking: Sequence[Row], seconds: Mapping[frozenset[str], float] | None = None
) -> pd.DataFrame:
    """Table `RANKING` without its column place."""
    rows = []
    for row in ranking:
        is_fitted = np.isfinite(row.delta_bic)
        rows.append(
            _fit_row(row.fit, (seconds or {}).get(labels_of(row.fit.hypothesis), np.nan))
            | {
                "parameters": len(row.fit.parameters),
                "delta_bic": row.delta_bic if is_fitted else np.nan,
                "explained_share": row.share if is_fitted else np.nan,
                "passes": row.passes,
                "admissible": row.admissible,
                "remark": row.remark or None,
            }
        )
    columns = [name for name in schema.RANKING.names if name != "place"]
    return pd.DataFrame(rows, columns=columns)


def _fit_row(fit: Fit, seconds: float) -> dict[str, Any]:
    failed = fit.status == FAILED
    return {
        "explanation": fit.label,
        "kind": _kind_of(fit.hypothesis),
        "status": fit.status,
        "reason": fit.reason or None,
        "chi2": np.nan if failed else fit.chi2,
        "samples": fit.residual.size,
        "bic": np.nan if failed else fit.bic,
        "simulations": fit.simulations,
        "seconds": seconds,
        "gap_left": fit.gap_left,
    }


def _kind_of(hypothesis: Hypothesis) -> str:
    if any(candidate.name.startswith("discovered_") for candidate in hypothesis):
        return "formula"
    return ("base", "single", "pair", "triple")[len(hypothesis)]


def family_frame(families: Sequence[FamilyInterval]) -> pd.DataFrame:
    """Table `LAW_FAMILIES`."""
    return pd.DataFrame([asdict(family) for family in families], columns=schema.LAW_FAMILIES.names)
