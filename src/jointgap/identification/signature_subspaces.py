"""How alike explanations look in the measured channels, once the nuisances have taken up what they can."""

from collections.abc import Iterable

import numpy as np

from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import Signatures
from jointgap.identification.settings import DEFAULT_SETTINGS, ScreeningSettings


class SignatureSubspaces:
    """What each candidate can change in the whitened residuals beyond what nuisances can, as orthonormal columns."""

    def __init__(self, signatures: Signatures, settings: ScreeningSettings = DEFAULT_SETTINGS.screening):
        self._settings = settings
        self.nuisances = orthonormal(signatures.jacobian)
        self.of: dict[str, list[np.ndarray]] = {}
        linear = {signature.candidate.label for signature in signatures.entries if not signature.is_secant}
        for signature in signatures.entries:
            if signature.is_secant and signature.candidate.label in linear:
                continue  # from where a fit starts too; what it can change is what small amplitudes do
            space = orthonormal(self.projected(signature.columns))
            self.of.setdefault(signature.candidate.label, []).append(space)
        self._groups = {s.candidate.label: s.candidate.exclusion_group for s in signatures.entries}

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """What of the columns (n, m) the nuisances cannot take up; zero where that is rounding."""
        left = columns - self.nuisances @ (self.nuisances.T @ columns)
        lost = np.linalg.norm(left, axis=0) < self._settings.negligible_projection * np.linalg.norm(columns, axis=0)
        return np.where(lost, 0.0, left)

    def span(self, labels: Iterable[str]) -> np.ndarray:
        """All that the candidates `labels` together can change, shape (n, dimensions)."""
        return orthonormal(np.hstack([self.nuisances[:, :0], *(space for label in labels for space in self.of[label])]))

    def cosine(self, space: np.ndarray, label: str) -> float:
        """Largest cosine [1] of anything that the candidate changes with the columns of `space`; 0 where it changes
        nothing.
        """
        cosines = [np.linalg.norm(space.T @ own, 2) for own in self.of[label] if own.size and space.size]
        return float(min(max(cosines, default=0.0), 1.0))

    def is_special_case(self, special: Hypothesis, general: Hypothesis) -> bool:
        """Whether the second hypothesis can do all that the first can, and more: a constant force is a spring without
        stiffness.
        """
        general_labels = {candidate.label for candidate in general}
        own = [candidate.label for candidate in special if candidate.label not in general_labels]
        if any(not self.span([label] if label in self.of else []).size for label in own):
            return False  # nuisances take up all that it changes, or nothing is known of it
        inner, outer = (self.span([c.label for c in hyp if c.label in self.of]) for hyp in (special, general))
        if not 0 < inner.shape[1] < outer.shape[1]:
            return False
        return bool(np.linalg.norm(inner - outer @ (outer.T @ inner), 2) < self._settings.special_case_distance)

    def nearest(self, hypothesis: Hypothesis) -> tuple[str, float]:
        """The candidate beyond the explanation that it could stand for best, and the squared cosine; '' where there is
        none. Alternatives to its effects are left out: signatures cannot tell these apart, fits can.
        """
        named = {candidate.label for candidate in hypothesis}
        taken = {candidate.exclusion_group for candidate in hypothesis}
        space = self.span([label for label in named if label in self.of])
        others = [(self.cosine(space, label) ** 2, label) for label in self.of if self._groups[label] not in taken]
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
