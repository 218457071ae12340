"""How alike explanations look in the measured channels, once the nuisances have taken up what they can."""

import numpy as np

from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import Signatures

_INSIDE = 0.03  # of a signature's length may lie outside another's span, for it to be a special case of that


class SignatureSubspaces:
    """What each candidate can change in the whitened residuals beyond what nuisances can, as orthonormal columns.

    Parameters
    ----------
    known : Signatures
    """

    def __init__(self, known: Signatures):
        self.nuisances = orthonormal(known.jacobian)
        self.of: dict[str, list[np.ndarray]] = {}
        for one in known.found:
            self.of.setdefault(one.candidate.label, []).append(orthonormal(self.projected(one.columns)))

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """What of the columns (n, m) the nuisances cannot take up; zero where that is rounding."""
        left = columns - self.nuisances @ (self.nuisances.T @ columns)
        lost = np.linalg.norm(left, axis=0) < 1e-6 * np.linalg.norm(columns, axis=0)
        return np.where(lost, 0.0, left)

    def span(self, labels) -> np.ndarray:
        """All that the candidates `labels` together can change, shape (n, dimensions)."""
        return orthonormal(np.hstack([self.nuisances[:, :0], *(space for label in labels for space in self.of[label])]))

    def cosine(self, space: np.ndarray, label: str) -> float:
        """Largest cosine of anything that `label` changes with the orthonormal columns `space`; 0 where it changes nothing."""
        found = [np.linalg.norm(space.T @ one, 2) for one in self.of[label] if one.size and space.size]
        return float(min(max(found, default=0.0), 1.0))

    def is_special_case(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Whether `one` is a special case of `other`, which can do more: a constant force is a spring without stiffness."""
        part, whole = (self.span([c.label for c in hypothesis if c.label in self.of]) for hypothesis in (one, other))
        if not 0 < part.shape[1] < whole.shape[1]:
            return False
        return bool(np.linalg.norm(part - whole @ (whole.T @ part), 2) < _INSIDE)

    def nearest(self, hypothesis: Hypothesis) -> tuple[str, float]:
        """The candidate beyond the explanation that it could stand for best, and the squared cosine; '' where there is none."""
        named = {candidate.label for candidate in hypothesis}
        space = self.span([label for label in named if label in self.of])
        others = [(self.cosine(space, label) ** 2, label) for label in self.of if label not in named]
        cosine, label = max(others, default=(0.0, ""))
        return label, cosine


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns of the same span, shape (n, rank)."""
    length = np.linalg.norm(columns, axis=0)
    live = columns[:, length > 0] / length[length > 0]
    if not live.shape[1]:
        return live
    left, sizes, _ = np.linalg.svd(live, full_matrices=False)
    return left[:, sizes > 1e-9 * sizes[0]]
