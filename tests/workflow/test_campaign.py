"""`make campaign` with somebody's own file, wherever it lies."""

import re

import pytest

from benchmarks.project import ROOT, run
from jointgap.campaign.stages import CAMPAIGN_STAGES

pytestmark = pytest.mark.integration


@pytest.fixture
def own(tmp_path):
    """A campaign file in a folder whose name is not easy to quote."""
    folder = tmp_path / "our rig's data"
    folder.mkdir()
    for place in (ROOT / "config/campaigns/demonstration").iterdir():
        (folder / place.name).write_bytes(place.read_bytes())
    (folder / "model.yaml").write_bytes((ROOT / "config/mechanisms/ideal_joints.yaml").read_bytes())
    text = (ROOT / "config/campaigns/demonstration.yaml").read_text()
    text = text.replace("demonstration/", "").replace("../mechanisms/ideal_joints.yaml", "model.yaml")
    (folder / "plan.yaml").write_text(text.replace("name: demonstration", "name: own"))
    return folder / "plan.yaml"


def planned(project, campaign) -> set[str]:
    """The jobs that `make campaign` would run."""
    done = run(project, "make", "--old-file=set-up", "campaign", f"CAMPAIGN={campaign}", "ARGS=--dry-run")
    assert done.returncode == 0, done.stderr
    return set(re.findall(r"^campaign_(\w+) +1$", done.stdout, re.MULTILINE))


def test_a_killed_campaign_goes_on_with_what_is_left(fresh_project, own):
    for stage in ("measure", "preflight", "noise", "recalibrate", "screen", "fit"):
        for table in CAMPAIGN_STAGES[stage].outputs():
            place = fresh_project / "results/campaigns/own" / table
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
    assert planned(fresh_project, own) == {"pair", "decide", "reoptimise", "conclude", "track", "report"}


def test_a_campaign_that_cannot_be_used_ends_with_its_mend_and_no_traceback(fresh_project, own):
    own.write_text(own.read_text().replace("role: confirm", "role: confrim"))
    done = run(fresh_project, "make", "--old-file=set-up", "campaign", f"CAMPAIGN={own}")
    said = done.stdout + done.stderr
    assert done.returncode != 0
    assert re.search(rf"{re.escape(str(own))}: .*role.*confirm", said)
    assert "Traceback" not in said
