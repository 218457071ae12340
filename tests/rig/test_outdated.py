"""A campaign file that has changed since its data were read is told so, before anything is computed from them."""

import pytest

from jointgap.errors import InputError
from jointgap.rig import rig_model
from tests.rig.rigs import campaign, mechanism, recorded

FEW = ("time", "crank_angle", "crank_torque")


@pytest.fixture(scope="module")
def read():
    return recorded(campaign(mechanism(), FEW))


def changed(**over):
    own = campaign(mechanism(), FEW)
    return own.model_copy(update={key: change(getattr(own, key)) for key, change in over.items()})


@pytest.mark.parametrize(
    ("over", "words"),
    [
        (
            {"runs": lambda runs: (*runs, runs[0].model_copy(update={"id": "other", "file": "other.csv"}))},
            "runs: 'other' is not among the data that were read",
        ),
        (
            {"channels": lambda own: own | {"guide_force": own["crank_torque"]}},
            "channels: guide_force is not among the data that were read of run 'slow'",
        ),
        (
            {"runs": lambda runs: (runs[0], runs[1].model_copy(update={"role": "identify"}))},
            "runs: 'fast' has the role identify, but its data were read with the role confirm",
        ),
    ],
)
def test_what_is_new_in_the_file_is_named_with_the_command_that_reads_it(read, over, words):
    with pytest.raises(InputError, match="run `jointgap measure` on it again, and the stages after it") as caught:
        rig_model(changed(**over), read)
    assert words in str(caught.value)


@pytest.mark.parametrize("clock", ["time", "crank_angle"])
def test_a_clock_that_was_not_read_is_no_less_a_channel(clock):
    without = recorded(campaign(mechanism(), tuple(name for name in FEW if name != clock)))
    with pytest.raises(InputError, match=f"channels: {clock} is not among the data"):
        rig_model(campaign(mechanism(), FEW), without)


def test_what_is_no_longer_in_the_file_is_passed_over(read):
    fewer = changed(channels=lambda own: own | {}, runs=lambda runs: runs[:1])
    assert {series.run for series in rig_model(fewer, read).series} == {"slow"}
