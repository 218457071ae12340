"""Ensembles, growth and statistics from the command line."""

import json

import pandas as pd
import pytest
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from tests.dynamics.cases import mechanism

SIMULATE = {"revolutions": 3, "samples_per_revolution": 360, "tolerance": 1e-9}


def asked(**sections) -> str:
    made = mechanism(friction=0.2).model_dump()
    return json.dumps({"mechanism": made, "simulate": SIMULATE, "surrogate": {"training_points": 37}} | sections)


def call(*arguments):
    done = CliRunner().invoke(cli, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_an_ensemble_is_simulated_and_what_failed_is_told(tmp_path):
    vary = {"friction": [0.1, 0.2], "simulate.speed": [60, 70]}
    output = call("ensemble", "--options", asked(ensemble={"vary": vary, "members": 3}), "--folder", tmp_path)
    assert "12 runs, 0 failed" in output
    runs = pd.read_parquet(tmp_path / "runs.parquet")
    assert set(zip(runs["friction"], runs["simulate.speed"], strict=True)) == {
        (f, w) for f in (0.1, 0.2) for w in (60, 70)
    }
    units = parquet.describe(tmp_path / "samples.parquet").set_index("column")["unit"]
    assert (units["r2_x"], units["r2_x_dot"]) == ("m", "m/s")


def test_growth_prints_its_verdict_and_writes_its_table(tmp_path):
    output = call("growth", "--options", asked(), "--growth", tmp_path / "growth.parquet")
    assert "samples can be compared throughout" in output
    assert len(parquet.read(schema.GROWTH, tmp_path / "growth.parquet")) == 3 * 360 + 1
    for change in ("0 m", "1 s", "much"):
        with pytest.raises(InputError, match="--change"):
            call("growth", "--options", asked(), "--growth", tmp_path / "growth.parquet", "--change", change)


def test_statistics_of_a_simulated_motion_are_printed_and_written(tmp_path):
    motion = ["--trajectory", tmp_path / "motion.parquet", "--events", tmp_path / "events.parquet"]
    call("simulate", "--options", asked(), *motion)
    output = call("cycles", "--options", asked(), *motion, "--folder", tmp_path / "cycles", "--angle", "90 deg")
    assert "from revolution 2 on: " in output and "crank_pin: flight" in output
    section = parquet.read(schema.POINCARE_SECTION, tmp_path / "cycles/section.parquet")
    assert list(section["revolution"]) == [2, 3, 2, 3]
    for table, name in (
        (schema.JOINT_REVOLUTIONS, "revolutions"),
        (schema.IMPACT_DISTRIBUTION, "impacts"),
        (schema.ECCENTRICITY, "eccentricity"),
    ):
        assert len(parquet.read(table, tmp_path / f"cycles/{name}.parquet")) > 0
