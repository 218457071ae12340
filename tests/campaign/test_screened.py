"""Tables of the screening meet the model that they were made with, or say that they are of another."""

from dataclasses import replace

import pytest

from jointgap.campaign.fits_on_disk import screened_frame, signatures_from_frames, signatures_to_frames
from jointgap.core.errors import InputError
from jointgap.identification.model_selection import shortlist_singles
from jointgap.identification.problem import Problem


class _Without:
    """A model from which one candidate is gone, as after a change of the mechanism file."""

    def __init__(self, model, label):
        self._model = model
        self.candidates = tuple(one for one in model.candidates if one.label != label)

    def __getattr__(self, name):
        return getattr(self._model, name)


def frames(chain):
    """Tables of the screening, by name."""
    signatures = chain.screening.signatures
    return signatures_to_frames(signatures, chain.recalibrated.base) | {
        "screened": screened_frame(signatures, shortlist_singles(signatures, chain.screening.limits))
    }


def test_an_effect_that_the_model_no_longer_lacks_is_named_with_the_stage_to_run_again(chain):
    tables = frames(chain)
    problem = Problem(_Without(chain.model, "viscous"), chain.noise)
    with pytest.raises(InputError, match=r"signatures\.parquet: holds viscous of another model.*run `jointgap noise`"):
        signatures_from_frames(tables, replace(chain.recalibrated, problem=problem))


def test_an_effect_whose_sizes_are_of_other_runs_is_named_too(chain):
    tables = frames(chain)
    derivatives = tables["signatures"]
    renamed = derivatives["name"].mask(derivatives["label"] == "coulomb", "force_N@other")
    with pytest.raises(InputError, match="holds coulomb of another model"):
        signatures_from_frames(tables | {"signatures": derivatives.assign(name=renamed)}, chain.recalibrated)
