"""One line of the comparison."""

from dataclasses import dataclass

AGREES = 0.01  # share of the paper's value within which a number agrees
LENGTH_AGREES = 0.001  # the same for optimum lengths: any point of the box would agree within 1 %

HOLDS, FAILS, UNKNOWN = "holds", "does not hold", "cannot be told"
REACHED, MISSED = "reached", "missed"


@dataclass(frozen=True)
class Row:
    """A number or a claim of the paper and ours beside it.

    Attributes
    ----------
    kind : str
        ``'number'`` or ``'claim'``.
    item, unit, sentence : str
    paper, ours : float or None
        In `unit`; None where there is none.
    verdict : str
        Empty for numbers that agree or differ; claims and training errors (reached or missed) bring their own.
    agrees : float
        For numbers: share of the paper's value within which ours agrees.
    """

    kind: str
    item: str
    unit: str
    paper: float | None
    ours: float | None
    sentence: str
    verdict: str = ""
    agrees: float = AGREES

    def record(self) -> dict:
        """The row of the table comparison."""
        both = self.paper is not None and self.ours is not None and self.paper != 0
        ratio = self.ours / self.paper if both else None
        verdict = self.verdict
        if not verdict:
            verdict = UNKNOWN if ratio is None else "agrees" if abs(ratio - 1) <= self.agrees else "differs"
        return {
            "kind": self.kind,
            "item": self.item,
            "unit": self.unit,
            "paper": self.paper,
            "ours": self.ours,
            "ratio": ratio,
            "verdict": verdict,
            "sentence": self.sentence,
        }


def claim(item: str, paper: float | None, ours: float | None, unit: str, holds: bool | None, sentence: str) -> Row:
    """A claim with its verdict; `holds` None: cannot be told."""
    verdict = UNKNOWN if holds is None else HOLDS if holds else FAILS
    return Row("claim", item, unit, paper, ours, sentence, verdict)
