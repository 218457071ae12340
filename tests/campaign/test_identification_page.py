"""What docs/identification.md shows can be used as it stands."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.figures import FIGURES
from jointgap.campaign.plan import preflight_summary, preflight_tables
from jointgap.config.load import load_campaign
from jointgap.rig.read_files import read_measurements
from tests.campaign.verdicts import VERDICTS

PAGE = Path("docs/identification.md").read_text(encoding="utf-8")
NUMBER = r"(?<![A-Za-z0-9_])\d+\.?\d*(?:e-?\d+)?"


def test_its_campaign_file_and_its_columns_are_read(tmp_path):
    header, campaign = (
        re.search(f"```{start}", PAGE, re.DOTALL)[1]
        for start in (r"\n(t,.*?)```", r"yaml\n(.*?)```")
    )
    (tmp_path / "campaign.yaml").write_text(campaign)
    (tmp_path / "mechanism.yaml").write_text(Path("config/mechanisms/erkaya2009.yaml").read_text())
    time = np.arange(2000) * 5e-4
    for run, rpm in (("slow", 200.0), ("mid", 400.0), ("fast", 600.0)):
        angle = rpm * 6.0 * time
        turned = np.radians(angle)
        frame = pd.DataFrame(
            {"t": time, "theta": angle % 360.0, "acc": np.cos(turned), "torque": np.sin(turned)}
        )
        assert list(frame.columns) == header.splitlines()[0].split(",")
        frame.to_csv(tmp_path / f"{run}.csv", index=False)
    measured = read_measurements(load_campaign(tmp_path / "campaign.yaml"))
    assert list(measured.runs) == ["slow", "mid", "fast"]
    assert np.isclose(measured.runs["slow"].channels["slider_acceleration"][0], 9.80665)


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
