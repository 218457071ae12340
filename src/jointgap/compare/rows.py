"""One line of the comparison."""

from dataclasses import dataclass

AGREES = 0.01  # [1] of the paper's value within which a number agrees

HOLDS, FAILS, UNKNOWN = "holds", "does not hold", "cannot be told"


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
        For claims; numbers judge themselves.
    """

    kind: str
    item: str
    unit: str
    paper: float | None
    ours: float | None
    sentence: str
    verdict: str = ""

    def record(self) -> dict:
        """The row of the table comparison."""
        both = self.paper is not None and self.ours is not None and self.paper != 0
        ratio = self.ours / self.paper if both else None
        verdict = self.verdict
        if self.kind == "number":
            verdict = UNKNOWN if ratio is None else "agrees" if abs(ratio - 1) <= AGREES else "differs"
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
