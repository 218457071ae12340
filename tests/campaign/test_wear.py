"""Wear from measured files to the trend: a joint whose clearance grows from date to date."""

from datetime import date, timedelta

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.config import Mechanism, Simulate
from jointgap.config.load import load_campaign
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TREND, TREND_GROWTH
from jointgap.dynamics.simulation import simulate
from jointgap.effects import EFFECTS
from jointgap.rig import model

pytestmark = pytest.mark.slow  # four campaigns with a loose joint, 30 CPU-seconds each

DAYS, GROWTH = np.array([0, 30, 60, 90]), 1.03  # of the clearance from one date to the next
SETTLED, KEPT, STEPS = 6, 3, 960  # revolutions, and samples of each, of which the file has every eighth
ANGLE_NOISE = 0.1  # deg
TORQUE_NOISE = 0.03  # of what the torque varies by


def measured(mechanism, speed, random):
    """One run as a data logger would write it, with noise of the encoder and of the torque."""
    options = Simulate(speed=speed, revolutions=SETTLED + KEPT, samples_per_revolution=STEPS, tolerance=1e-10)
    kept = simulate(mechanism, options).samples.iloc[SETTLED * STEPS + 7 : -1 : 8]
    torque = kept["crank_torque"] + random.normal(0.0, TORQUE_NOISE * kept["crank_torque"].std(), len(kept))
    angle = np.degrees(kept["crank_angle"]) + random.normal(0.0, ANGLE_NOISE, len(kept))
    return pd.DataFrame({"t": kept["time"] - kept["time"].iloc[0], "theta": angle, "M": torque})


def write_campaign(place, number):
    """A campaign of the rig on one of the dates, and its clearance [m]."""
    nominal = yaml.safe_load((ROOT / "config/mechanisms/erkaya2009.yaml").read_text())
    nominal["joints"]["piston_pin"] = "ideal"
    runs = [("slow", 150, "identify"), ("fast", 200, "confirm")]
    content = {
        "name": f"date-{number}",
        "date": date(2026, 1, 1) + timedelta(days=int(DAYS[number])),
        "mechanism": nominal,
        "runs": [
            {"id": run, "file": f"{run}-{number}.csv", "speed": f"{rpm} rpm", "role": role} for run, rpm, role in runs
        ],
        "channels": {
            "time": {"column": "t", "unit": "s"},
            "crank_angle": {"column": "theta", "unit": "deg", "noise": ANGLE_NOISE},
            "crank_torque": {"column": "M", "unit": "N*m"},
        },
    }
    file = place / f"date-{number}.yaml"
    file.write_text(yaml.safe_dump(content))
    campaign = load_campaign(file)
    rig = campaign.mechanism.model_dump()
    clearance = campaign.mechanism.clearance("crank_pin") * GROWTH ** (number + 1)
    rig["joints"]["crank_pin"]["bearing_radius"] = rig["joints"]["crank_pin"]["journal_radius"] + clearance
    random = np.random.default_rng([7, number])
    for run in campaign.runs:
        readings = measured(Mechanism.model_validate(rig), run.speed, random)
        readings.to_csv(place / run.file, index=False)
    return file, clearance


def test_a_clearance_that_grows_by_3_percent_a_date_is_followed_from_the_files_to_the_rate(tmp_path, monkeypatch):
    # which effects it is told from is the subject of other tests; two that are not there save minutes
    few = ("crank_pin_clearance", "crank_viscous_friction", "slider_viscous_friction")
    monkeypatch.setattr(model, "EFFECTS", {name: EFFECTS[name] for name in few})
    written = [write_campaign(tmp_path, number) for number in range(len(DAYS))]
    files, truth = [str(file) for file, _ in written], np.array([clearance for _, clearance in written])
    results, out = tmp_path / "results", ResultsFolder(tmp_path / "trend")
    for number, file in enumerate(files):
        CliRunner().invoke(cli, ["analyse", file, "--folder", str(results / f"date-{number}")], catch_exceptions=False)
    command = ["trend", *files, "--results", str(results), "--folder", str(out.path)]
    said = CliRunner().invoke(cli, command, catch_exceptions=False).output
    assert "clearance in the crank pin: grew by" in said
    sizes = out.read(TREND)
    assert list(sizes["source"]) == ["named"] * len(DAYS)
    assert sizes["value"].to_numpy() == pytest.approx(truth, rel=0.005)
    (growth,) = out.read(TREND_GROWTH).to_dict("records")
    assert growth["rate"] == pytest.approx(np.polyfit(DAYS, truth, 1)[0], rel=0.1)
