"""What docs/identification.md shows can be used as it stands."""

import re
from pathlib import Path

import pytest

from jointgap.campaign.figures import FIGURES
from jointgap.campaign.plan import preflight_summary, preflight_tables
from jointgap.config.load import load_campaign
from tests.campaign.verdicts import VERDICTS

PAGE = Path("docs/identification.md").read_text(encoding="utf-8")
NUMBER = r"(?<![A-Za-z0-9_])\d+\.?\d*(?:e-?\d+)?"


@pytest.mark.integration
def test_the_preflight_that_it_prints_is_what_comes_out(tmp_path):
    mechanism = "config/mechanisms/ideal_joints.yaml"
    assert f"`{mechanism}` as its mechanism" in PAGE
    (tmp_path / "campaign.yaml").write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1])
    (tmp_path / "mechanism.yaml").write_text(Path(mechanism).read_text())
    found = preflight_tables(load_campaign(tmp_path / "campaign.yaml"), 0.01)
    printed = preflight_summary(**found, advice=None).splitlines()
    shown = re.search(r"```\n(Smallest detectable size.*?)```", PAGE, re.DOTALL)[1].splitlines()
    shown = [line for line in shown if line != "  ..." and not line.startswith("A further ")]
    places = {re.sub(NUMBER, "#", line): place for place, line in enumerate(printed)}
    found_at = [places[re.sub(NUMBER, "#", line)] for line in shown]
    assert found_at == sorted(found_at)
    for line, place in zip(shown, found_at, strict=True):
        said, true = (
            [float(number) for number in re.findall(NUMBER, text)]
            for text in (line, printed[place])
        )
        assert said == pytest.approx(true, rel=0.01), printed[place]


def test_it_names_every_figure_and_every_verdict():
    assert all(f"*{name}*" in PAGE for name in FIGURES)
    assert all(f"| `{verdict}` |" in PAGE for verdict in VERDICTS)
