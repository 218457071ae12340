"""What is wrong with a campaign is said in words that need no Python, and nothing is said that is not so."""

from datetime import date

import pytest

from jointgap.config import read_yaml
from jointgap.config.campaign import RESERVED_IDS, Campaign
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from tests.config.mechanisms import PAPER
from tests.config.test_campaign import CAMPAIGN

RUN = {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "split"}
GOOD = CAMPAIGN | {"mechanism": read_yaml(PAPER), "runs": [RUN], "nuisance": {}}
GOOD["channels"] = {key: {k: v for k, v in one.items() if k != "noise"} for key, one in GOOD["channels"].items()}


def told(**over) -> list[str]:
    """What is said of the campaign with `over` laid on it, a line each."""
    with pytest.raises(InputError) as caught:
        validate(Campaign, GOOD | over, "rig.yaml")
    return str(caught.value).splitlines()


def test_the_campaign_without_a_mistake_is_accepted():
    assert validate(Campaign, GOOD, "rig.yaml").runs[0].id == "slow"


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({"runs": "x"}, "runs = 'x': must be a list"),
        ({"runs": RUN}, "runs: must be a list"),
        ({"runs": [3]}, "runs.0 = 3: must be a mapping of keys to values"),
        ({"runs": []}, "runs = []: must have at least 1 item"),
        (
            {"mechanism": 3},
            "mechanism = 3: must be the path of a mechanism file, or a mapping of keys to values",
        ),
        ({"folder": None}, "folder = None: must be a path, written as text"),
        ({"csv": 3}, "csv = 3: must be a mapping of keys to values"),
        ({"motor": 3}, "motor = 3: must be a mapping of keys to values"),
        ({"drive": 3}, "drive = 3: must be 'constant_speed', 'measured_angle' or 'motor'"),
        (
            {"name": "a b"},
            "name = 'a b': use letters, digits, '_' and '-' only, for files or folders are called so",
        ),
        ({"name": 3.5}, "name = 3.5: must be text; write it in quotation marks"),
        ({"name": True}, "name = True: must be text; write it in quotation marks"),
        (
            {"name": date(2026, 5, 1)},
            "name = datetime.date(2026, 5, 1): must be text; write it in quotation marks",
        ),
        ({"name": None}, "name = None: must be text"),
        ({"name": ["a"]}, "name = ['a']: must be text"),
        ({"name": ""}, "name = '': must have at least 1 character"),
        (
            {"channels": {"time": {"column": "t", "unit": "s", "reads_gravity": "no idea"}}},
            "channels.time.reads_gravity = 'no idea': must be true or false",
        ),
    ],
)
def test_a_value_of_the_wrong_kind_is_told_what_is_expected(over, words):
    assert told(**over) == [f"rig.yaml: {words}"]


def test_the_only_run_is_not_called_absent_where_one_of_its_keys_is_wrong():
    assert told(runs=[RUN | {"speed": "3 m"}]) == [
        "rig.yaml: runs.0.speed = '3 m': has the unit 'meter' and needs rad/s or a unit that converts to it"
    ]


@pytest.mark.parametrize("name", RESERVED_IDS)
def test_no_run_takes_the_name_of_another_result(name):
    assert told(runs=[RUN | {"id": name}]) == [
        f"rig.yaml: runs.0: id '{name}' would be taken for another result of that name; choose another id"
    ]
