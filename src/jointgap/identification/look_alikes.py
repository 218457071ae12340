"""Before anything is measured: which effects on which motion depends roughly look alike in features of the cycle.

Linear signatures (`jointgap.identification.preflight`) say nothing of a joint that became loose. So the search of
the analysis (`jointgap.identification.rough_search`) is rehearsed: each such effect in turn is taken as true, and it
and all others are searched. Two look alike where the true one explains so little more than the other that the search
would not drop it. Simulations tell of all channels at once, so with each further channel the same can be asked.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.core.candidates import FAST, Candidate, Model
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.features import CycleFeatures
from jointgap.identification.noise import Key
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.rough_search import Box, drawn_about
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings


def look_alikes(
    model: Model,
    planned: Collection[Key],
    noise: Mapping[Key, Noise],
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> pd.DataFrame:
    """How far each two effects that are searched by features are apart, and which further channels would part them."""
    rehearsal, rows = _Rehearsal(model, planned, noise, settings), []
    for truth in rehearsal.truths:
        rehearsal.search(truth, truth.label)
        for other in rehearsal.others_of(truth):
            rehearsal.search(truth, other)
            lead, parted_by = rehearsal.lead(truth, other), []
            if lead.is_small:
                leads = rehearsal.leads_with_further_channels(truth, other)
                parting = [channel for channel in leads if not leads[channel].is_small]
                parted_by = sorted(parting, key=lambda channel: leads[channel].share, reverse=True)
            rows.append((truth.label, other, truth.size, truth.unit, lead.share, lead.is_small, parted_by))
    return pd.DataFrame(rows, columns=["true", "other", "size", "unit", "lead_share", "alike", "parted_by"])


@dataclass(frozen=True)
class _Lead:
    """By how much the true effect is ahead of another."""

    share: float  # of what it explains
    is_small: bool


@dataclass(frozen=True)
class _Truth:
    """What would be measured of an effect."""

    label: str
    size: float  # SI
    unit: str
    measured: np.ndarray  # (n,) whitened, beyond the model as it stands, with noise


@dataclass
class _Points:
    """Where a candidate was simulated."""

    candidate: Candidate
    box: Box
    places: list[np.ndarray]
    changes: list[np.ndarray]  # (n,) each, whitened


class _Rehearsal:
    """Searches for effects of which each in turn is taken as true. What was simulated for one serves all."""

    def __init__(
        self, model: Model, planned: Collection[Key], noise: Mapping[Key, Noise], settings: IdentificationSettings
    ):
        self._problem, self._settings = Problem(model, noise, planned=True, settings=settings), settings
        channels = {channel for _, channel in planned}
        self._channels = list(dict.fromkeys(part.series.channel for part in self._problem.parts))
        self._planned = np.array([channel in channels for channel in self._channels])
        self._generator = np.random.default_rng(settings.rough_search.seed)
        self._noise = self._generator.standard_normal(self._problem.size)
        searched = [one for one in model.candidates if one.search_range and not one.is_perturbation]
        if len(searched) < 2 or self._problem.has_statistics:
            searched = []
        self.truths = [truth for candidate in searched for truth in self._truths_of(candidate)]
        self._points = {
            candidate.label: _Points(candidate, Box(candidate, self._problem.parameters((candidate,))), [], [])
            for candidate in searched
        }
        if self.truths:
            for points in self._points.values():
                self._simulate(points, points.box.spread(settings.rough_search, self._generator))
        enough = settings.rough_search.elite  # hardly any can be simulated where friction makes journals whirl
        self._points = {label: points for label, points in self._points.items() if len(points.places) >= enough}
        self.truths = [truth for truth in self.truths if truth.label in self._points]

    def others_of(self, truth: _Truth) -> list[str]:
        """Labels of the other effects that are searched."""
        return [label for label in self._points if label != truth.label]

    def _truths_of(self, candidate: Candidate) -> Iterator[_Truth]:
        """A candidate at sizes at which what is measured rings, so that it would be searched by features."""
        guess = {f"{candidate.label}.{key}": value for key, value in candidate.initial_guesses[0].items()}
        first = next(p for p in candidate.coordinates if p.key in candidate.amplitudes)
        for size in np.geomspace(*candidate.search_range, self._settings.look_alikes.sizes).tolist():
            change = self._change(candidate, {**guess, f"{candidate.label}.{first.key}": size})
            if change is None:
                continue
            measured = change + self._noise
            planned = [channel for channel, is_planned in zip(self._channels, self._planned, strict=True) if is_planned]
            features = CycleFeatures(self._problem, measured, planned)
            if features.rough_share > self._settings.rough_search.min_rough_share:
                yield _Truth(candidate.label, size, first.unit, measured)

    def _change(self, candidate: Candidate, values: Mapping[str, float], numerics: int = 0) -> np.ndarray | None:
        """What an effect changes (n,), whitened; None where it cannot be simulated."""
        nominal = {p.key: p.nominal for p in self._problem.parameters((candidate,))}
        try:
            return -self._problem.residual(nominal | values, (candidate,), numerics=numerics)
        except (InputError, SimulationError):
            return None

    def _simulate(self, points: _Points, places: Iterable[np.ndarray]) -> None:
        """Add further places to an effect's points, those at which it can be simulated."""
        for place in places:
            change = self._change(points.candidate, points.box.values(place), FAST)
            if change is not None:
                points.places.append(place)
                points.changes.append(change)

    def _misfits(self, features: CycleFeatures, changes: Iterable[np.ndarray]) -> np.ndarray:
        """Of the features that each change leaves, by channel: (changes, channels)."""
        found = []
        for change in changes:
            of_runs = [features.misfit_by_channel(change, run) for run in self._problem.runs]
            found.append([sum(one.get(channel, 0.0) for one in of_runs) for channel in self._channels])
        return np.reshape(found, (-1, len(self._channels)))

    def search(self, truth: _Truth, label: str) -> None:
        """Simulate an effect about the points whose features are nearest to a truth's in the planned channels."""
        features, settings = CycleFeatures(self._problem, truth.measured), self._settings.rough_search
        points = self._points[label]
        for _ in range(self._settings.look_alikes.rounds):
            found = self._misfits(features, points.changes) @ self._planned
            elite = [points.places[i] for i in np.argsort(found, kind="stable")[: settings.elite]]
            places, _ = drawn_about(elite, settings, self._generator)
            self._simulate(points, places)

    def lead(self, truth: _Truth, other: str) -> _Lead:
        """By how much less another effect explains of the features of a truth than itself, in the planned channels."""
        return self._leads(truth, other, [self._planned])[0]

    def leads_with_further_channels(self, truth: _Truth, other: str) -> dict[str, _Lead]:
        """The same with each channel that is not planned, at the points that are there."""
        further = [place for place, planned in enumerate(self._planned) if not planned]
        heard = [self._planned | (np.arange(len(self._channels)) == place) for place in further]
        return dict(zip([self._channels[i] for i in further], self._leads(truth, other, heard), strict=True))

    def _leads(self, truth: _Truth, other: str, heard: Sequence[np.ndarray]) -> list[_Lead]:
        """Leads at the points that are there, in each of some sets of channels, (channels,) bool arrays."""
        features, settings = CycleFeatures(self._problem, truth.measured), self._settings.rough_search
        own, others = (self._misfits(features, self._points[label].changes) for label in (truth.label, other))
        absent, leads = self._misfits(features, [np.zeros(self._problem.size)]), []
        for channels in heard:
            least = (own @ channels).min()
            lead = (others @ channels).min() - least
            share = lead / max((absent @ channels).item() - least, 1e-9)
            leads.append(_Lead(share, share < settings.eliminated_share or lead < settings.min_misfit_ahead))
        return leads
