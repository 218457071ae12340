"""A campaign file that has changed since its data were read is told so, before anything is computed from them."""

import pytest

from benchmarks.project import ROOT
from jointgap.campaign import stages
from jointgap.campaign.state import CampaignState
from jointgap.core.errors import InputError

ACCELERATION = "  slider_acceleration: {column: acc_g, unit: g_n}\n"
MID = "  - {id: mid,  file: demonstration/mid.csv,  speed: 280 rpm, role: identify}\n"


@pytest.fixture
def read(tmp_path):
    """The text of a campaign file whose data have been read, and a function that goes on with another text."""
    there = ROOT / "config/campaigns/demonstration.yaml"
    text = there.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    text += f"folder: '{there.parent}'\n"
    path, folder = tmp_path / "campaign.yaml", tmp_path / "results"
    path.write_text(text)
    stages.measure(CampaignState(path, folder), pictures=False)

    def go_on(changed):
        path.write_text(changed)
        return CampaignState(path, folder)

    return text, go_on


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (ACCELERATION, "", 'channels.slider_acceleration.column: "acc_g" then, absent now'),
        (MID, "", 'runs.mid.file: "demonstration/mid.csv" then, absent now'),
        (MID, MID + MID.replace("mid", "other"), 'runs.other.file: absent then, "demonstration/other.csv" now'),
        ("g_n}", "m/s^2}", 'channels.slider_acceleration.unit: "g_n" then, "m/s^2" now'),
        ("role: identify", "role: split", 'runs.slow.role: "identify" then, "split" now'),
        ("role: identify", "role: identify, direction: clockwise", 'then, "clockwise" now'),
        ("slider_mass: 5 %, ", "", "nuisance.slider_mass: 0.05 then, absent now"),
        ("noise: 0.1}", "noise: {slow: 0.1}}", "channels.crank_angle.noise: 0.1 then, absent now"),
        ("nuisance: {slider_mass: 5 %, rod_mass: 5 %}", "", "nuisance.slider_mass: 0.05 then, absent now"),
        ("/ideal_joints.yaml", "/erkaya2009.yaml", "mechanism."),
    ],
)
def test_what_has_changed_in_the_file_is_named_with_the_command_that_reads_it(read, old, new, words):
    text, go_on = read
    assert old in text
    with pytest.raises(InputError, match="run `jointgap measure` on it again, and the stages after it") as caught:
        _ = go_on(text.replace(old, new, 1)).measurements
    assert words in str(caught.value)


def test_runs_in_another_order_are_other_data(read):
    text, go_on = read
    with pytest.raises(InputError, match="other order"):
        _ = go_on(text.replace(MID, "").replace("runs:\n", f"runs:\n{MID}")).measurements


def test_another_name_or_comment_leaves_the_data_what_they_are(read):
    text, go_on = read
    renamed = go_on(text.replace("name: demonstration", "name: another # of the same rig"))
    assert set(renamed.measurements.runs) == {"slow", "mid", "fast"}
