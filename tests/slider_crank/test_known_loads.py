"""Known loads of a campaign: tables of single runs, pressures in the record, a brake, and their uncertain sizes."""

from math import pi
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.rig.model import SliderCrankModel
from tests.rows import each
from tests.slider_crank.campaigns import model_of, samples, written
from tests.slider_crank.rigs import read, seen

BORE = "60 mm"
RPM = {"slow": 200.0, "mid": 350.0, "fast": 500.0}
PER_TURN, TURNS = 100, 6
AREA = pi * 0.06**2 / 4
COULOMB = {"name": "slider_coulomb_friction", "parameters": {"force_N": 4.0}}


def compressor(degrees: np.ndarray, level: float = 1.0) -> np.ndarray:
    """Gauge pressure [bar]; 0 deg: the slider is farthest out."""
    return level * np.exp(-(((np.mod(degrees + 150.0, 360.0) - 150.0) / 40.0) ** 2)) + 0.2


def engine(degrees: np.ndarray, level: float = 1.0) -> np.ndarray:
    """Gauge pressure [bar] of a four-stroke engine, fired at 0 deg of every second turn."""
    after = np.mod(degrees + 360.0, 720.0) - 375.0
    return 0.1 + level * (np.exp(-((after / 35.0) ** 2)) + 0.3 * np.exp(-(((after + 10.0) / 80.0) ** 2)))


def table(folder: Path, name: str, pressure, span: float = 360.0, **keys) -> dict:
    """The entry of a table of a gauge `pressure` [bar] over one period."""
    degrees = np.arange(0.0, span, 1.0)
    pd.DataFrame({"deg": degrees, "bar": pressure(degrees)}).to_csv(folder / f"{name}.csv", index=False)
    columns = {"angle": {"column": "deg", "unit": "deg"}, "pressure": {"column": "bar", "unit": "bar"}}
    of = {"file": str(folder / f"{name}.csv"), "bore": BORE, "ambient_pressure": 0.0} | columns | keys
    return {"name": "slider_force_table", "parameters": of}


def rig(folder: Path, effects: dict, pressure=None, hidden=(COULOMB,), noise=0.01, keys=None, **options) -> Path:
    """A campaign file of three runs with true `effects` by run, `hidden` ones, and a column of the `pressure` [bar]
    over the angle [deg] of each run.
    """
    rng, runs = np.random.default_rng(3), {}
    for run, rpm in RPM.items():
        asked = {"speed": rpm * pi / 30, "revolutions": TURNS + 2, "samples_per_revolution": PER_TURN} | options
        shown = samples(*hidden, *effects[run], **asked).iloc[-TURNS * PER_TURN :]
        record = shown[["time", "crank_angle", "crank_torque"]].copy()
        record["crank_torque"] += noise * record["crank_torque"].std() * rng.standard_normal(len(record))
        if pressure is not None:
            bar = pressure[run](np.degrees(shown["crank_angle"]))
            record["cylinder_pressure"] = 1e5 * (bar + noise * bar.std() * rng.standard_normal(len(bar)))
        record["crank_angle"] = np.radians(np.round(np.degrees(record["crank_angle"]), 2))
        runs[run] = shown["crank_speed"].mean(), record
    path = written(folder, runs, **{"nuisance": {}} | (keys or {}))
    text = path.read_text()
    path.write_text(text.replace("unit: Pa", f"unit: Pa\n    bore: {BORE}\n    ambient_pressure: 0 bar"))
    return path


def with_loads(path: Path, loads: dict) -> Path:
    """The campaign file with the `loads` of its runs."""
    import yaml

    content = yaml.safe_load(path.read_text())
    for run in content["runs"]:
        run["effects"] = loads[run["id"]]
    path.write_text(yaml.safe_dump(content))
    return path


LEVELS = {"slow": 1.0, "mid": 2.0, "fast": 3.0}


def furthest(model: SliderCrankModel) -> float:
    """Largest difference between read and simulated torque of all runs, over its standard deviation."""
    pairs = [(read(model, run=run)["crank_torque"], seen(model, run)["crank_torque"]) for run in RPM]
    return max(float(np.abs(one - other).max() / np.std(other)) for one, other in pairs)


@each("cycle, span", [(compressor, 360.0), (engine, 720.0)])
def test_every_run_has_the_pressure_of_its_own_table_or_of_its_record(tmp_path, cycle, span):
    of = {run: lambda degrees, level=level: cycle(degrees, level) for run, level in LEVELS.items()}
    loads = {run: [table(tmp_path, f"p_{run}", of[run], span)] for run in RPM}
    path = rig(tmp_path, loads, hidden=(), noise=0.0)
    assert furthest(model_of(path)) > 0.2
    assert furthest(model_of(with_loads(path, loads))) < 1e-3
    assert furthest(model_of(rig(tmp_path, loads, of, hidden=(), noise=0.0))) < 1e-2
