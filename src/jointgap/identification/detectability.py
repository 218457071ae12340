"""What one set of samples can tell of each effect, from signatures alone: how small it may be, and what it is mistaken for."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize, stats

from jointgap.identification.fit import bounds_of
from jointgap.identification.gauss_newton import bounded_step, compress_rows
from jointgap.identification.screening import Signature, Signatures
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.signature_subspaces import SignatureSubspaces

GAP = 1.5
"""Whitened gap after recalibration that a clearly visible effect causes."""

POWER = 0.9

_MOST_STEPS = 1000.0  # of an unbounded size: an effect that has to be larger is as good as invisible
_SLACK = 4.0  # on what cosines alone say, before bounds are looked at


class Detectability:
    """Signatures of all candidates about the nominal model, over the samples of some channels of some runs.

    Parameters
    ----------
    known : Signatures
    lengths : sequence of int
        Samples of each channel of each run, in order.
    counts : sequence of int
        How many samples there are of each in truth, over which those at hand repeat.
    rate : float
        False alarms allowed over all candidates.
    """

    def __init__(
        self,
        known: Signatures,
        lengths: Sequence[int],
        counts: Sequence[int],
        rate: float,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.known, self.rate, self.settings = known, rate, settings
        self.size = sum(counts)
        self.labels = list(dict.fromkeys(one.candidate.label for one in known.found))
        self._subspaces: dict[frozenset, SignatureSubspaces] = {}
        blocks = [known.jacobian, *(one.columns for one in known.found)]
        weight = np.repeat(np.sqrt(np.divide(counts, lengths)), lengths)[:, None]
        share = np.repeat((len(lengths) * np.array(lengths)) ** -0.5, lengths)[:, None]
        # The same in few rows: as chi2 sees them, and as the gap does, in which each channel of each run counts the same.
        self._chi2 = self._by_signature(compress_rows(*(weight * block for block in blocks)))
        self._gap = self._by_signature(compress_rows(*(share * block for block in blocks)))

    def _by_signature(self, blocks):
        return blocks[0], {id(one): block for one, block in zip(self.known.found, blocks[1:], strict=True)}

    def part(self, rows: np.ndarray, lengths: Sequence[int], counts: Sequence[int]) -> "Detectability":
        """The survey of some of the rows, of which `lengths` belong to each channel of each run, that stand for `counts`."""
        known = self.known
        found = [replace(one, columns=one.columns[rows], origin=one.origin[rows]) for one in known.found]
        fewer = replace(known, jacobian=known.jacobian[rows], residual=known.residual[rows], found=found)
        return Detectability(fewer, lengths, counts, self.rate, self.settings)

    def detectable_size(self, label: str) -> float:
        """Size that is found with a probability of 90 %, in the unit of the first size; infinite where none is.

        The median over the shapes to start from. Of an effect that is a nuisance's own parameter, it lies beyond its range; of one
        that is told by finite sizes, it is no less than what these speak for.
        """
        return self._usual(
            label, [self._smallest(s, 0, self._chi2, self._noncentrality(s)) for s in self.known.of(label)]
        )

    def typical_size(self, label: str) -> float:
        """Size that leaves a gap of `GAP` after recalibration, as `detectable_size`."""
        return self._usual(label, [self._smallest(s, 0, self._gap, GAP**2 - 1.0) for s in self.known.of(label)])

    def _usual(self, label: str, sizes: list[float]) -> float:
        """Of the sizes that the signatures of one effect say: their median, or the least where each holds for other sizes."""
        finite = any(one.amplitudes[0].key in one.shape_parameters for one in self.known.of(label))
        return float(min(sizes) if finite else np.median(sizes))

    def cosine(self, label: str, other: str) -> float:
        """Largest cosine of anything that the two effects change, beyond what nuisances can."""
        both = self._beyond_nuisances(label, other)
        return max((both.cosine(space, other) for space in both.of[label]), default=0.0)

    def merged(self, labels: Sequence[str]) -> list[list[str]]:
        """Classes of effects that stand for each other at a typical size, in the order of `labels`."""
        group = {label: {label} for label in labels}
        for i, label in enumerate(labels):
            for other in labels[i + 1 :]:
                near = (1.0 - self.cosine(label, other) ** 2) * self.size * (
                    GAP**2 - 1.0
                ) < _SLACK * self.settings.decision.min_delta_bic
                if near and self._mistaken(label, other) and self._mistaken(other, label):
                    joined = group[label] | group[other]
                    for one in joined:
                        group[one] = joined
        classes = []
        for label in labels:
            if len(group[label]) > 1 and sorted(group[label], key=labels.index) not in classes:
                classes.append(sorted(group[label], key=labels.index))
        return classes

    def _noncentrality(self, one: Signature) -> float:
        """Of the gain in chi2, so that it exceeds with `POWER` what the search among all candidates asks for."""
        dimensions = len(one.amplitudes)
        asked = max(
            stats.chi2.isf(self.rate / len(self.labels), dimensions),
            len(one.coordinates) * np.log(self.size) + self.settings.decision.min_delta_bic,
        )
        return float(
            optimize.brentq(lambda much: stats.ncx2.sf(asked, dimensions, much) - POWER, 1e-6, 20 * asked + 50)
        )

    def _kept(self, *signatures: Signature) -> list[int]:
        """Places of the nuisances that no effect replaces."""
        replaced = {name for one in signatures for name in one.candidate.replaces}
        return [i for i, p in enumerate(self.known.parameters) if p.name not in replaced]

    def _room(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        low, high = bounds_of([self.known.parameters[i] for i in kept])
        return low - self.known.values[list(kept)], high - self.known.values[list(kept)]

    def _left(self, one: Signature, size: int, amount: float, measure) -> float:
        """What recalibration cannot take up of an effect that is there, squared."""
        jacobian, columns = self._chi2
        effect = -amount * columns[id(one)][:, size]
        step, _ = bounded_step(jacobian, effect, *self._room(range(jacobian.shape[1])))
        jacobian, columns = measure
        return float(np.sum((jacobian @ step - amount * columns[id(one)][:, size]) ** 2))

    def _smallest(self, one: Signature, size: int, measure, target: float) -> float:
        """Amount of which at least `target` is left; infinite where bounds forbid it. A secant says nothing below its reach."""
        p = one.amplitudes[size]
        if p.key in one.shape_parameters and self._left(one, size, one.valid_range(p)[0], measure) >= target:
            return float(one.valid_range(p)[0])
        reach = [abs(bound) for bound in (p.low, p.high) if np.isfinite(bound) and bound != 0.0]
        most = max(reach) if np.isfinite(p.high) and reach else _MOST_STEPS * p.step
        whole = float(np.sum(measure[1][id(one)][:, size] ** 2))
        if whole == 0.0 or self._left(one, size, most, measure) < target:
            return float("inf")
        least = min(np.sqrt(target / whole), most)

        def excess(logarithm: float) -> float:
            return self._left(one, size, float(np.exp(logarithm)), measure) - target

        if least == most or excess(np.log(least)) >= 0.0:
            return float(least)
        return float(np.exp(optimize.brentq(excess, np.log(least), np.log(most), xtol=1e-3)))

    def _beyond_nuisances(self, *labels: str) -> SignatureSubspaces:
        chosen = [self.known.of(label)[0] for label in labels]
        replaced = frozenset(name for one in chosen for name in one.candidate.replaces)
        if replaced not in self._subspaces:
            kept = self._kept(*chosen)
            jacobian, columns = self._chi2
            few = [replace(one, columns=columns[id(one)], origin=np.zeros(len(jacobian))) for one in self.known.found]
            self._subspaces[replaced] = SignatureSubspaces(replace(self.known, jacobian=jacobian[:, kept], found=few))
        return self._subspaces[replaced]

    def _mistaken(self, label: str, other: str) -> bool:
        """Whether `other` fits as well what `label` typically does, within all bounds.

        For every size that the effect has: an effect with a further one is more than the effect without. For at least half of
        the shapes and signs: a bias that may go both ways is mistaken for a friction that goes one way.
        """
        known = self.known.of(label)
        for size, p in enumerate(known[0].amplitudes):
            amounts = [(one, self._smallest(one, size, self._gap, GAP**2 - 1.0)) for one in known]
            signs = (1.0, -1.0) if p.low < 0.0 else (1.0,)
            mistaken = [
                self._fitted(one, size, sign * amount, other) < self.settings.decision.min_delta_bic
                for one, amount in amounts
                if np.isfinite(amount)
                for sign in signs
            ]
            if not mistaken or 2 * sum(mistaken) < len(mistaken):
                return False
        return True

    def _fitted(self, one: Signature, size: int, amount: float, other: str) -> float:
        """chi2 that `other` leaves of an effect that is there."""
        jacobian, columns = self._chi2
        left = []
        for rival in self.known.of(other):
            kept = self._kept(rival)
            low, high = self._room(kept)
            rival_low, rival_high = bounds_of(rival.amplitudes)
            matrix = np.hstack([jacobian[:, kept], columns[id(rival)]])
            bounds = np.concatenate([low, rival_low]), np.concatenate([high, rival_high])
            left.append(bounded_step(matrix, -amount * columns[id(one)][:, size], *bounds)[1])
        return min(left)
