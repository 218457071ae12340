"""The code of docs/how_to/own_model.md on synthetic data."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.axis.analyse import analyse_model
from tests.axis.folders import pendulum

PAGE = Path("docs/how_to/own_model.md").read_text(encoding="utf-8")
CODE = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
FOLDER = {"model.yaml": "yaml", "model.py": "py"}
NOISE = 0.05  # N
MASS = 10.3  # kg; the page's model says 10


@pytest.fixture
def outcome(tmp_path, monkeypatch):
    """The names defined by the page after its code has run on 30 cycles of two runs."""

    def run(force) -> dict:
        random = np.random.default_rng(1)
        for run, period in {"slow": 4.0, "fast": 2.0}.items():
            time, rate = np.arange(3000) * period / 100.0, 2.0 * np.pi / period
            speed = 0.1 * rate * np.cos(rate * time)
            acceleration = -0.1 * rate**2 * np.sin(rate * time)
            taken = MASS * acceleration - force(speed) + random.normal(0.0, NOISE, time.size)
            pd.DataFrame({"t": time, "force": taken}).to_csv(tmp_path / f"{run}.csv", index=False)
        monkeypatch.chdir(tmp_path)
        names: dict = {}
        exec(compile(CODE, "docs/how_to/own_model.md", "exec"), names)
        return names

    return run


def test_friction_is_named_with_least_squares_intervals(outcome):
    names = outcome(lambda speed: -2.0 * np.sign(speed))
    verdict, gaps = names["verdict"], names["gaps"]
    assert (verdict.verdict, verdict.chosen.label) == ("named", "slider_coulomb_friction"), (
        verdict.because
    )
    row = gaps[(gaps["role"] == "confirm") & (gaps["run"] == "all")].iloc[0]
    assert row["before"] > 5.0 and row["after"] == pytest.approx(1.0, abs=0.1)
    measured = next(series for series in names["model"].series if series.run == "slow")
    rate = 2.0 * np.pi / 4.0
    inertia = -0.1 * rate**2 * np.sin(rate * measured.time)
    friction = np.sign(np.cos(rate * measured.time))
    design = np.column_stack([inertia, friction])
    best = np.linalg.lstsq(design, measured.value)[0]
    errors = NOISE * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    estimates = names["estimates"]
    estimates = estimates["mass"], estimates["slider_coulomb_friction"]["force_N"]
    for estimate, value, error in zip(estimates, best, errors, strict=True):
        assert estimate["value"] == pytest.approx(value, abs=0.1 * error)
        assert estimate["sd"] == pytest.approx(error, rel=0.1)
        assert estimate["interval_90"] == pytest.approx(
            [value - 1.645 * error, value + 1.645 * error], abs=0.3 * error
        )
    assert names["disagreement"].remark == ""


def test_only_the_mass_is_found_without_effects(outcome):
    verdict = outcome(lambda speed: 0.0)["verdict"]
    assert verdict.verdict == "parameters_only", verdict.because
    assert verdict.chosen.mapping["mass"] == pytest.approx(MASS, rel=0.01)


def test_an_unlisted_law_is_found_as_a_formula(outcome):
    names = outcome(lambda speed: -400.0 * speed**3)
    assert names["verdict"].verdict == "unexplained"
    decision = names["found"].decision
    assert re.match(r"no listed effect .* slider force = -\d+(\.\d+)?\*v\^3", decision.because)
    coefficient = decision.chosen.mapping["discovered_slider_force[v^3].coefficient"]
    assert (decision.verdict, coefficient) == ("named", pytest.approx(-400.0, rel=0.05))


def test_a_force_absent_from_the_held_out_run_is_not_named(outcome):
    names = outcome(
        lambda speed: -2.0 * np.sign(speed) if np.max(np.abs(speed)) < 0.2 else 0.0 * speed
    )
    verdict = names["verdict"]
    assert (verdict.verdict, verdict.best_known.label) == ("unexplained", "slider_coulomb_friction")
    assert names["prediction"].test.outcome == "rises" and verdict.chosen is verdict.base


def test_the_folder_of_the_page_is_a_model_that_lacks_friction(tmp_path):
    folder = pendulum(tmp_path / "model")
    for file, language in FOLDER.items():
        (block,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
        (folder / file).write_text(block.replace("column: angle", "column: position"))
    verdict = analyse_model(folder, tmp_path / "results", pictures=False)
    names = {effect["name"] for effect in verdict["effects"]}
    assert names == {"coulomb_friction", "viscous_friction"}, verdict["because"]
