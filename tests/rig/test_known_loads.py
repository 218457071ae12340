"""Known loads of a campaign: tables of single runs, pressures in the record, a brake, and their
uncertain sizes."""

from math import pi
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.model import LinkageModel
from jointgap.rig.read_files import read_measurements
from tests.rig.campaigns import MECHANISM, model_of, samples, written
from tests.rig.rigs import read, seen

BORE = "60 mm"
RPM = {"slow": 200.0, "mid": 350.0, "fast": 500.0}
PER_TURN, TURNS = 100, 6
COULOMB = {"name": "slider_coulomb_friction", "parameters": {"force_N": 4.0}}


def compressor(degrees: np.ndarray, level: float = 1.0) -> np.ndarray:
    """Gauge pressure [bar]; 0 deg: the slider is farthest out."""
    return level * np.exp(-(((np.mod(degrees + 150.0, 360.0) - 150.0) / 40.0) ** 2)) + 0.2


def engine(degrees: np.ndarray, level: float = 1.0) -> np.ndarray:
    """Gauge pressure [bar] of a four-stroke engine, fired at 0 deg of every second turn."""
    after = np.mod(degrees + 360.0, 720.0) - 375.0
    return 0.1 + level * (
        np.exp(-((after / 35.0) ** 2)) + 0.3 * np.exp(-(((after + 10.0) / 80.0) ** 2))
    )


def table(folder: Path, name: str, pressure, span: float = 360.0, **keys) -> dict:
    """The entry of a table of a gauge `pressure` [bar] over one period."""
    degrees = np.arange(0.0, span, 1.0)
    pd.DataFrame({"deg": degrees, "bar": pressure(degrees)}).to_csv(
        folder / f"{name}_table.csv", index=False
    )
    columns = {
        "angle": {"column": "deg", "unit": "deg"},
        "pressure": {"column": "bar", "unit": "bar"},
    }
    of = (
        {"file": str(folder / f"{name}_table.csv"), "bore": BORE, "ambient_pressure": 0.0}
        | columns
        | keys
    )
    return {"name": "slider_force_table", "parameters": of}


def brake(torque: float, speed: float) -> dict:
    """The entry of a water brake."""
    own = {"torque_N_m": torque, "reference_speed_rad_s": speed, "exponent": 2.0}
    return {"name": "crank_brake", "parameters": own}


def rig(
    folder: Path,
    effects: dict,
    pressure=None,
    hidden=(COULOMB,),
    noise=0.01,
    motors=None,
    true=MECHANISM,
    **keys,
):
    """A campaign file of three runs with true `effects` by run, `hidden` ones, and a column of the
    `pressure` [bar] over the angle [deg] of each run. `motors` by run drive the crank until it has
    settled.
    """
    rng, runs = np.random.default_rng(3), {}
    read = ("crank_speed",) if motors and keys["drive"] == "motor" else ("crank_torque",)
    for run, rpm in RPM.items():
        turns = TURNS + (2 if motors is None else 200)
        asked = {"speed": rpm * pi / 30, "revolutions": turns, "samples_per_revolution": PER_TURN}
        asked |= {"drive": motors[run]} if motors else {}
        shown = samples(*hidden, *effects[run], mechanism=true, **asked).iloc[-TURNS * PER_TURN :]
        record = shown[["time", "crank_angle", *read]].copy()
        for name in read:
            record[name] += noise * record[name].std() * rng.standard_normal(len(record))
        if pressure is not None:
            bar = pressure[run](np.degrees(shown["crank_angle"]))
            record["cylinder_pressure"] = 1e5 * (
                bar + noise * bar.std() * rng.standard_normal(len(bar))
            )
        read_angle = np.degrees(record["crank_angle"]) + noise * rng.standard_normal(len(record))
        record["crank_angle"] = np.radians(np.round(read_angle, 2))
        runs[run] = shown["crank_speed"].mean(), record
    path = written(folder, runs, **{"nuisance": {}} | keys)
    text = path.read_text()
    path.write_text(
        text.replace("unit: Pa", f"unit: Pa\n    bore: {BORE}\n    ambient_pressure: 0 bar")
    )
    return path


def changed(path: Path, keys: dict, without: str = "") -> Path:
    """The campaign file with the `keys` of its runs, `without` a channel."""
    content = yaml.safe_load(path.read_text())
    content["runs"] = [run | keys[run["id"]] for run in content["runs"]]
    content["channels"].pop(without, None)
    path.write_text(yaml.safe_dump(content))
    return path


def with_loads(path: Path, loads: dict) -> Path:
    """The campaign file with the `loads` of its runs."""
    return changed(path, {run: {"effects": own} for run, own in loads.items()})


LEVELS = {"slow": 1.0, "mid": 2.0, "fast": 3.0}


def furthest(model: LinkageModel) -> float:
    """Largest difference between read and simulated torque of all runs, over its standard
    deviation."""
    pairs = [
        (read(model, run=run)["crank_torque"], seen(model, run)["crank_torque"]) for run in RPM
    ]
    return max(float(np.abs(item - second).max() / np.std(second)) for item, second in pairs)


@pytest.mark.parametrize("cycle, span", [(compressor, 360.0), (engine, 720.0)])
def test_the_pressure_of_a_run_is_that_of_its_table_or_record(tmp_path, cycle, span):
    of = {run: lambda degrees, level=level: cycle(degrees, level) for run, level in LEVELS.items()}
    loads = {run: [table(tmp_path, f"p_{run}", of[run], span)] for run in RPM}
    path = rig(tmp_path, loads, hidden=(), noise=0.0)
    assert furthest(model_of(path)) > 0.2
    assert furthest(model_of(with_loads(path, loads))) < 1e-3
    path = rig(tmp_path, loads, of, hidden=(), noise=0.0)
    assert furthest(model_of(path)) < 1e-2
    for run in RPM:  # seen from behind
        record = pd.read_csv(tmp_path / f"{run}.csv")
        record[["crank_angle", "crank_torque"]] *= -1.0
        record.to_csv(tmp_path / f"{run}.csv", index=False)
        loads[run][0]["parameters"]["reversed"] = True
    clockwise = {run: {"direction": "clockwise"} for run in RPM}
    assert furthest(model_of(changed(path, clockwise))) < 1e-2
    own = {run: keys | {"effects": loads[run]} for run, keys in clockwise.items()}
    assert furthest(model_of(changed(path, own, without="cylinder_pressure"))) < 1e-3


SPRING = {"name": "slider_spring", "parameters": {"stiffness_N_m": 1.0, "rest_position_m": 0.1}}
NO_FILE = {"name": "slider_force_table", "parameters": {"file": "none.csv"}}


@pytest.fixture
def gas(tmp_path):
    """A campaign with the pressure of a gas in its records: its file, content, and a reader of
    changed content."""
    load = table(tmp_path, "gas", compressor)
    path = rig(tmp_path, {run: [load] for run in RPM}, dict.fromkeys(RPM, compressor), hidden=())
    content = yaml.safe_load(path.read_text())

    def read(run=None, channel=None, **keys):
        if run is not None:
            keys["runs"] = [content["runs"][0] | run, *content["runs"][1:]]
        if channel is not None:
            pressure = content["channels"]["cylinder_pressure"] | channel
            keys["channels"] = content["channels"] | {"cylinder_pressure": pressure}
        path.write_text(yaml.safe_dump(content | keys))
        return load_campaign(path)

    return read


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"run": {"effects": [SPRING]}}, "slider_spring is no load of a single run"),
        (
            {
                "run": {"effects": [brake(1.0, 9.0)]},
                "mechanism": {**MECHANISM, "effects": [brake(1.0, 20.0)]},
            },
            "(?s)crank_brake.*more than once",
        ),
        ({"run": {"effects": [NO_FILE]}}, "slider_force_table"),
        ({"channel": {"bore": None}}, "requires bore"),
        ({"channel": {"noise": 1}}, "a pressure is a known load"),
        ({"nuisance": {"pressure_zero": "5 %"}}, "pressure_zero is 0, so a percentage is not"),
    ],
)
def test_impossible_loads_are_refused(gas, keys, words):
    with pytest.raises(InputError, match=words):
        gas(**keys)


def test_implausible_pressures_and_nuisances_without_effect_are_reported(gas, tmp_path):
    remarks = read_measurements(gas(channel={"unit": "mPa"})).remarks
    assert any("largest pressure is only" in remark for remark in remarks)
    campaign = gas(nuisance={"crank_inertia": "20 %"})
    assert campaign.model_copy(update={"drive": "measured_angle"}).idle_nuisances == ()
    (remark,) = [text for text in read_measurements(campaign).remarks if "crank_inertia" in text]
    assert "requires drive: motor or measured_angle and is ignored" in remark
    record = pd.read_csv(tmp_path / "slow.csv")
    record["cylinder_pressure"] -= 5e4
    record.to_csv(tmp_path / "slow.csv", index=False)
    with pytest.raises(InputError, match=r"column cylinder_pressure, row .*negative absolute"):
        read_measurements(gas(channel={"ambient_pressure": "1 bar"}))


def test_an_engine_settles_at_the_speed_where_brake_and_gas_balance(tmp_path):
    gas = table(tmp_path, "gas", lambda degrees: engine(degrees, 4.0), 720.0)
    steady = {"revolutions": 2, "samples_per_revolution": PER_TURN}
    work = -samples(gas, speed=30.0, **steady)["crank_torque"].iloc[1:].mean()
    flywheel = {"kind": "motor", "stall_torque": 0.0, "no_load_speed": 80.0, "inertia": 0.3}
    settled = samples(
        gas, brake(8.0, 40.0), speed=40.0, drive=flywheel, **steady | {"revolutions": 80}
    )
    taken = 8.0 * (settled["crank_speed"].tail(2 * PER_TURN) / 40.0) ** 2
    assert taken.mean() == pytest.approx(work, rel=5e-3)


def coulomb_alone(found: dict, force: float = 4.0) -> None:
    """Only the hidden friction is named, with its size, and the held-out run is followed within its
    noise."""
    assert (found["verdict"], [item["name"] for item in found["effects"]]) == (
        "named",
        ["slider_coulomb_friction"],
    )
    size = found["effects"][0]["parameters"]["force_N"]
    low, high = size["interval_90"]
    assert size["value"] == pytest.approx(force, rel=0.05)
    # the interval of 99 %: one draw of the noise
    assert abs(size["value"] - force) < 1.6 * 0.5 * (high - low)
    assert found["gap"]["confirm"]["after"] == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_friction_is_identified_with_tables_of_single_runs(tmp_path):
    loads = {
        run: [table(tmp_path, run, lambda at, level=level: engine(at, level), 720.0)]
        for run, level in LEVELS.items()
    }
    coulomb_alone(analyse(with_loads(rig(tmp_path, loads), loads), tmp_path / "results"))
    text = (tmp_path / "results/mechanism.yaml").read_text()
    assert "#   run slow: slider_force_table, slow_table.csv" in text


@pytest.mark.slow
def test_friction_is_identified_with_a_recorded_pressure_of_unknown_zero(tmp_path):
    """The sensor's gain is wrong too; its zero is another one in each run."""
    of = {
        run: lambda degrees, level=level: compressor(degrees, level)
        for run, level in LEVELS.items()
    }
    loads = {run: [table(tmp_path, run, of[run])] for run in RPM}
    zeros = {"slow": 0.2, "mid": -0.1, "fast": 0.3}
    seen_as = {run: lambda at, run=run: (of[run](at) - zeros[run]) / 1.06 for run in RPM}
    path = rig(
        tmp_path, loads, seen_as, nuisance={"pressure_zero": "0.5 bar", "pressure_gain": "10 %"}
    )
    result = analyse(path, tmp_path / "results")
    coulomb_alone(result)
    low, high = result["nuisances"]["pressure_gain"]["interval_90"]
    assert low - 0.005 < 1.06 < high + 0.005
    for run in ("slow", "mid"):
        assert result["nuisances"][f"pressure_zero@{run}"]["value"] == pytest.approx(
            1e5 * zeros[run], abs=2e3
        )


@pytest.mark.slow  # the motor's settling makes a simulation last
def test_friction_and_flywheel_inertia_are_identified_with_a_motor(tmp_path):
    """A brake sets the speed of each run, which varies within a turn by the load of a
    compressor."""
    true = {**MECHANISM, "crank": MECHANISM["crank"] | {"inertia": 0.04}}
    gas = table(tmp_path, "gas", lambda degrees: compressor(degrees, 0.3))
    stated = {**MECHANISM, "crank": MECHANISM["crank"] | {"inertia": 0.03}, "effects": [gas]}
    motor = {"stall_torque": 60.0, "no_load_speed": 55.0}
    brakes = {
        run: brake(torque, 40.0) for run, torque in {"slow": 60.0, "mid": 20.0, "fast": 2.0}.items()
    }
    loads = {run: [gas, brakes[run]] for run in RPM}
    keys = {
        "drive": "motor",
        "motor": motor,
        "mechanism": stated,
        "nuisance": {"crank_inertia": "50 %"},
    }
    path = rig(
        tmp_path, loads, motors=dict.fromkeys(RPM, {"kind": "motor"} | motor), true=true, **keys
    )
    result = analyse(with_loads(path, {run: [brakes[run]] for run in RPM}), tmp_path / "results")
    coulomb_alone(result)
    size = result["nuisances"]["crank_inertia"]
    assert size["value"] == pytest.approx(0.04, rel=0.05)
