"""What samples can tell of each effect, from signatures alone: how small it may be, and what it is mistaken for."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize, stats

from jointgap.identification.fit import bounds_of
from jointgap.identification.gauss_newton import bounded_step, compress_rows
from jointgap.identification.screening import Signature, Signatures
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.signature_subspaces import SignatureSubspaces

_Blocks = tuple[np.ndarray, dict[int, np.ndarray]]
"""Rows of the Jacobian, and of the columns of each signature by its `id`."""


class Detectability:
    """What is detectable, and what alike, over the samples of some channels of some runs."""

    def __init__(
        self,
        signatures: Signatures,
        lengths: Sequence[int],
        counts: Sequence[int],
        rate: float,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.signatures, self.rate, self.settings = signatures, rate, settings
        self._excess = settings.detectability.typical_gap**2 - 1.0  # mean square beyond noise
        self.size = sum(counts)
        self.labels = list(dict.fromkeys(signature.candidate.label for signature in signatures.entries))
        self._subspaces: dict[frozenset, SignatureSubspaces] = {}
        self._typical: dict[tuple[int, int], float] = {}
        blocks = [signatures.jacobian, *(signature.columns for signature in signatures.entries)]
        weight = np.repeat(np.sqrt(np.divide(counts, lengths)), lengths)[:, None]
        share = np.repeat((len(lengths) * np.array(lengths)) ** -0.5, lengths)[:, None]
        # The same in few rows: as chi2 sees them, and as the gap does, in which each channel of each run counts the
        # same.
        self._chi2 = self._by_signature(compress_rows(*(weight * block for block in blocks)))
        self._gap = self._by_signature(compress_rows(*(share * block for block in blocks)))

    def _by_signature(self, blocks: Sequence[np.ndarray]) -> _Blocks:
        return blocks[0], {
            id(signature): block for signature, block in zip(self.signatures.entries, blocks[1:], strict=True)
        }

    def part(self, rows: np.ndarray, lengths: Sequence[int], counts: Sequence[int]) -> "Detectability":
        """The same over some of the samples."""
        signatures = self.signatures
        entries = [
            replace(signature, columns=signature.columns[rows], origin=signature.origin[rows])
            for signature in signatures.entries
        ]
        fewer = replace(
            signatures, jacobian=signatures.jacobian[rows], residual=signatures.residual[rows], entries=entries
        )
        return Detectability(fewer, lengths, counts, self.rate, self.settings)

    def detectable_size(self, label: str) -> float:
        """First amplitude [SI] that is found with a probability of 90 %; infinite where none is.

        The median over the shape parameters to start from. Of an effect that replaces a nuisance it lies beyond the
        nuisance's range; of one whose signatures are secants to finite amplitudes it is no less than these are valid
        for.
        """
        return self._usual(
            label, [self._smallest(s, 0, self._chi2, self._noncentrality(s)) for s in self.signatures.of(label)]
        )

    def typical_size(self, label: str) -> float:
        """First amplitude [SI] that leaves the typical gap after recalibration, as `detectable_size`."""
        return self._usual(label, [self._typical_amount(s, 0) for s in self.signatures.of(label)])

    def _usual(self, label: str, sizes: list[float]) -> float:
        """Of the amplitudes that the signatures of an effect give: the median, or the least where each holds for
        others."""
        finite = any(
            signature.amplitudes[0].key in signature.shape_parameters for signature in self.signatures.of(label)
        )
        return float(min(sizes) if finite else np.median(sizes))

    def cosine(self, label: str, other: str) -> float:
        """Largest cosine [1] of anything that the two effects change, beyond what nuisances can."""
        both = self._beyond_nuisances(label, other)
        return max((both.cosine(space, other) for space in both.of[label]), default=0.0)

    def merged(self, labels: Sequence[str]) -> list[list[str]]:
        """Classes of effects that stand for each other at a typical size, in the order of `labels`."""
        group = {label: {label} for label in labels}
        for i, label in enumerate(labels):
            for other in labels[i + 1 :]:
                limit = self.settings.decision.min_delta_bic
                near = max(self._least_left(label, other), self._least_left(other, label)) < limit
                if near and self._mistaken(label, other) and self._mistaken(other, label):
                    joined = group[label] | group[other]
                    for member in joined:
                        group[member] = joined
        classes = []
        for label in labels:
            if len(group[label]) > 1 and sorted(group[label], key=labels.index) not in classes:
                classes.append(sorted(group[label], key=labels.index))
        return classes

    def _least_left(self, label: str, other: str) -> float:
        """chi2 that `other` leaves at least of what `label` typically does, as it would be if nothing had bounds.

        Nothing where the nuisances could take it all up, and only their bounds let the effect be seen. Secants to
        finite sizes are left out where an effect has a derivative too.
        """
        beyond, least = self._beyond_nuisances(other), np.inf
        for signature in self.signatures.of(label):
            amount = self._typical_amount(signature, 0)
            if np.isfinite(amount):
                left = beyond.projected(self._chi2[1][id(signature)][:, :1])
                least = min(least, amount**2 * float(np.sum(left**2)))
        cosine = max((beyond.cosine(space, other) for space in beyond.of[label]), default=0.0)
        return (1.0 - cosine**2) * least if np.isfinite(least) else least

    def _noncentrality(self, signature: Signature) -> float:
        """Of the gain in chi2, so that it exceeds with the power of the settings what the search among all candidates
        asks for."""
        dimensions = len(signature.amplitudes)
        asked = max(
            stats.chi2.isf(self.rate / len(self.labels), dimensions),
            sum(p.price(self.size) for p in signature.coordinates) + self.settings.decision.min_delta_bic,
        )
        return float(
            optimize.brentq(
                lambda shift: stats.ncx2.sf(asked, dimensions, shift) - self.settings.detectability.power,
                1e-6,
                20 * asked + 50,
            )
        )

    def _kept(self, *signatures: Signature) -> list[int]:
        """Places of the nuisances that no effect replaces."""
        replaced = {name for signature in signatures for name in signature.candidate.replaces}
        return [i for i, p in enumerate(self.signatures.parameters) if p.name not in replaced]

    def _room(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        low, high = bounds_of([self.signatures.parameters[i] for i in kept])
        return low - self.signatures.values[list(kept)], high - self.signatures.values[list(kept)]

    def _left(self, signature: Signature, size: int, amount: float, measure: _Blocks) -> float:
        """What recalibration cannot take up of an effect that is there, squared."""
        jacobian, columns = self._chi2
        effect = -amount * columns[id(signature)][:, size]
        step, _ = bounded_step(jacobian, effect, *self._room(range(jacobian.shape[1])))
        jacobian, columns = measure
        return float(np.sum((jacobian @ step - amount * columns[id(signature)][:, size]) ** 2))

    def _smallest(self, signature: Signature, size: int, measure: _Blocks, target: float) -> float:
        """Amount of which at least `target` is left; infinite where bounds forbid it. A secant says nothing below its
        reach."""
        p = signature.amplitudes[size]
        if (
            p.key in signature.shape_parameters
            and self._left(signature, size, signature.valid_range(p)[0], measure) >= target
        ):
            return float(signature.valid_range(p)[0])
        reach = [abs(bound) for bound in (p.low, p.high) if np.isfinite(bound) and bound != 0.0]
        most = max(reach) if np.isfinite(p.high) and reach else self.settings.detectability.max_steps * p.step
        per_unit = float(np.sum(measure[1][id(signature)][:, size] ** 2))
        if per_unit == 0.0 or self._left(signature, size, most, measure) < target:
            return float("inf")
        least = min(np.sqrt(target / per_unit), most)

        def excess(logarithm: float) -> float:
            return self._left(signature, size, float(np.exp(logarithm)), measure) - target

        if least == most or excess(np.log(least)) >= 0.0:
            return float(least)
        return float(np.exp(optimize.brentq(excess, np.log(least), np.log(most), xtol=1e-3)))

    def _typical_amount(self, signature: Signature, size: int) -> float:
        """Amount [SI] that leaves the typical gap after recalibration; infinite where bounds forbid it."""
        key = id(signature), size
        if key not in self._typical:
            self._typical[key] = self._smallest(signature, size, self._gap, self._excess)
        return self._typical[key]

    def _beyond_nuisances(self, *labels: str) -> SignatureSubspaces:
        chosen = [self.signatures.of(label)[0] for label in labels]
        replaced = frozenset(name for signature in chosen for name in signature.candidate.replaces)
        if replaced not in self._subspaces:
            kept = self._kept(*chosen)
            jacobian, columns = self._chi2
            few = [
                replace(signature, columns=columns[id(signature)], origin=np.zeros(len(jacobian)))
                for signature in self.signatures.entries
            ]
            self._subspaces[replaced] = SignatureSubspaces(
                replace(self.signatures, jacobian=jacobian[:, kept], entries=few), self.settings.screening
            )
        return self._subspaces[replaced]

    def _mistaken(self, label: str, other: str) -> bool:
        """Whether `other` fits as well what `label` typically does, within all bounds.

        For every size that the effect has: an effect with a further one is more than the effect without. For at least
        half of the shapes and signs: a bias that may go both ways is mistaken for a friction that goes one way.
        """
        own = self.signatures.of(label)
        for size, p in enumerate(own[0].amplitudes):
            amounts = [(signature, self._typical_amount(signature, size)) for signature in own]
            signs = (1.0, -1.0) if p.low < 0.0 else (1.0,)
            mistaken = [
                self._fitted(signature, size, sign * amount, other) < self.settings.decision.min_delta_bic
                for signature, amount in amounts
                if np.isfinite(amount)
                for sign in signs
            ]
            if not mistaken or 2 * sum(mistaken) < len(mistaken):
                return False
        return True

    def _fitted(self, signature: Signature, size: int, amount: float, other: str) -> float:
        """chi2 that `other` leaves of an effect that is there."""
        jacobian, columns = self._chi2
        left = []
        for rival in self.signatures.of(other):
            kept = self._kept(rival)
            low, high = self._room(kept)
            rival_low, rival_high = bounds_of(rival.amplitudes)
            matrix = np.hstack([jacobian[:, kept], columns[id(rival)]])
            bounds = np.concatenate([low, rival_low]), np.concatenate([high, rival_high])
            left.append(bounded_step(matrix, -amount * columns[id(signature)][:, size], *bounds)[1])
        return min(left)
