"""The stages from noise to decision on a mechanism in closed form, made once."""

from dataclasses import dataclass

import pytest

from jointgap.campaign.outcome import Outcome, outcome_of
from jointgap.core.candidates import Model
from jointgap.identification.baseline import Baseline, recalibrate
from jointgap.identification.decide import decide
from jointgap.identification.fit import Fit
from jointgap.identification.noise import NoiseEstimate, degrees_of_freedom, noise_of_model
from jointgap.identification.search import STEPS, Search
from jointgap.identification.thresholds import Screening, screen_candidates
from tests.identification.toy import toy

TRUTH = 3.0  # N


@dataclass(frozen=True)
class Chain:
    """Results of the stages."""

    model: Model
    noise: dict[tuple[str, str], NoiseEstimate]
    recalibrated: Baseline
    screening: Screening
    fits: list[Fit]
    outcome: Outcome


@pytest.fixture(scope="session")
def chain() -> Chain:
    """Coulomb friction is hidden; the speeds are stated a little wrong."""
    model = toy({"coulomb": {"force_N": TRUTH}}, {"slider_mass": 0.51}, noise=0.03, seed=3)
    found = noise_of_model(model)
    base = recalibrate(model, found)
    screening = screen_candidates(base, 0.01, degrees_of_freedom(found))
    search = Search(base, *screening, STEPS).run()
    fits = [fit for labels, fit in search.fits.items() if labels]
    outcome = outcome_of(decide(search), search.seconds)
    return Chain(model, base.problem.noise, base, screening, fits, outcome)
