"""A campaign file is guessed from measured files alone, with a comment for each guess and a mark
for each gap."""

import math
import shutil

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.config.channels import CHANNELS
from jointgap.config.load import load_campaign
from jointgap.config.yaml_files import FILL_IN
from jointgap.core.csv_files import find_headings
from jointgap.core.errors import InputError
from jointgap.core.units import unit_factor
from jointgap.rig.guess import new_mechanism, new_rig, words_and_unit
from jointgap.rig.read_files import read_measurements
from tests.rig.recorded_files import samples

TURN, RADIANS = (lambda deg: deg % 360.0), (lambda rad: (rad + math.pi) % math.tau - math.pi)
SENSORS = {"time": ("t", "s"), "crank_angle": ("th", "deg", TURN), "crank_torque": ("M", "N*m")}
RIGS = {
    "german": (
        {"time": ("Zeit [s]", "s"), "crank_angle": ("Kurbelwinkel [°]", "deg", TURN)}
        | {
            "crank_torque": ("Drehmoment [Nm]", "N*m"),
            "slider_acceleration": ("Beschleunigung [g]", "g_n"),
        },
        {"sep": ";", "decimal": ","},
    ),
    "din": (
        {"time": ("t / ms", "ms"), "crank_angle": ("phi / rad", "rad", RADIANS)}
        | {"crank_torque": ("M / Nm", "N*m"), "slider_position": ("s / mm", "mm")},
        {"sep": "\t"},
    ),
    "row of units": (
        {
            "time": ("t", "ms"),
            "crank_angle": ("th", "turn", lambda turns: turns % 1),
            "crank_speed": ("n", "rpm"),
        }
        | {"crank_torque": ("T", "lbf*ft"), "slider_velocity": ("v", "m/s")},
        {"units": "[msec],[rev],[RPM],[ft-lb],[m/s]"},
    ),
    "brackets": (
        {
            "time": ("Time(s)", "s"),
            "crank_angle": ("CrankAngle(deg)", "deg"),
            "crank_speed": ("CrankSpeed(RPM)", "rpm"),
        }
        | {
            "crank_torque": ("CrankTorque(N-m)", "N*m"),
            "slider_acceleration": ("PistonAcc(G)", "g_n"),
        },
        {"above": "Device: X\nRate,1000\n"},
    ),
    "suffixes": (
        {
            "time": ("time_s", "s"),
            "crank_angle": ("angle_rad", "rad"),
            "crank_speed": ("omega_rad_s", "rad/s"),
        }
        | {"crank_torque": ("torque_N_m", "N*m"), "slider_acceleration": ("acc_m_s2", "m/s^2")}
        | {"slider_position": ("x_mm", "mm")},
        {},
    ),
    "names of channels": ({name: (name, CHANNELS[name]) for name in samples(200)}, {}),
    "without times": (
        {
            "crank_angle": ("theta", "rad"),
            "slider_position": ("x", "m"),
            "crank_torque": ("M", "N*m"),
        },
        {},
    ),
    "clockwise": (
        {"time": ("t", "s"), "crank_angle": ("theta", "deg", lambda deg: -deg % 360)}
        | {"slider_position": ("x", "mm"), "crank_torque": ("M", "N*m")},
        {},
    ),
}
"""By channel: heading, unit, and what becomes of the values; options of the file."""


def written(folder, channels, runs=(200.0, 330.0, 600.0), above="", units="", **form):
    """Files of the rig in `tests.rig.recorded_files` at these speeds [rpm], with noise of 1 % and
    torques that grow."""
    random, files = np.random.default_rng(0), []
    for number, rpm in enumerate(runs):
        si, table = samples(rpm, count=360, turns=3.3), {}
        si["crank_torque"] = si["crank_torque"] * (rpm / 200.0) ** 2 + 0.3
        for name, (heading, unit, *change) in channels.items():
            values = si[name] / unit_factor(unit, CHANNELS[name])
            if name not in ("time", "crank_angle"):
                values = values + 0.01 * np.std(values) * random.standard_normal(values.size)
            table[heading] = change[0](values) if change else values
        text = pd.DataFrame(table).to_csv(index=False, float_format="%.6g", **form)
        headings, _, rows = text.partition("\n")
        files.append(folder / f"r{number}.csv")
        files[-1].write_text(
            f"{above}{headings}\n{units + chr(10) if units else ''}{rows}", encoding="utf-8"
        )
    return files


def guessed(folder, files, monkeypatch, name="rig"):
    """The campaign file that is guessed, as YAML and as text."""
    monkeypatch.chdir(folder)
    new_rig(files, name)
    text = (folder / f"{name}.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text), text


def check(content, channels):
    """All columns and units are right; `channels` are entries of a campaign file."""
    for name, entry in channels.items():
        guess = content["channels"][name]
        unit = f"turn/{guess['counts_per_turn']}" if "counts_per_turn" in guess else guess["unit"]
        factor, expected = (unit_factor(text, CHANNELS[name]) for text in (unit, entry["unit"]))
        assert guess["column"] == entry["column"]
        assert factor == pytest.approx(expected, rel=1e-9), guess


@pytest.mark.parametrize("name", RIGS)
def test_columns_units_and_speeds_are_guessed_from_headings_and_values(tmp_path, monkeypatch, name):
    channels, form = RIGS[name]
    content, text = guessed(tmp_path, written(tmp_path, channels, **form), monkeypatch)
    check(content, {key: {"column": entry[0], "unit": entry[1]} for key, entry in channels.items()})
    assert [run["role"] for run in content["runs"]] == ["identify", "identify", "confirm"]
    speeds = [run["speed"] for run in content["runs"]]
    if "time" in channels:
        rpm = [float(speed.removesuffix(" rpm")) for speed in speeds]
        assert rpm == pytest.approx([200, 330, 600], rel=5e-3)
    else:
        assert speeds == [FILL_IN] * 3
    directions = {run.get("direction") for run in content["runs"]}
    assert directions == {"clockwise" if name == "clockwise" else None}
    lines = [line for line in text.splitlines() if line.startswith("  ")]
    assert all("   # " in line or line.startswith("  #") for line in lines)


@pytest.mark.parametrize("name", ["demonstration", "demonstration_clearance"])
def test_the_campaign_files_of_the_examples_are_guessed_from_their_data(
    name, tmp_path, monkeypatch
):
    known = yaml.safe_load((ROOT / f"config/campaigns/{name}.yaml").read_text(encoding="utf-8"))
    files = [ROOT / "config/campaigns" / run["file"] for run in known["runs"]]
    content, _ = guessed(tmp_path, files, monkeypatch)
    check(content, known["channels"])
    assert [(run["id"], run["role"]) for run in content["runs"]] == [
        (run["id"], run["role"]) for run in known["runs"]
    ]


def test_signals_and_pressures_need_further_keys_and_texts_are_not_used(tmp_path, monkeypatch):
    files = written(
        tmp_path,
        SENSORS | {"crank_torque": ("I", "N*m"), "slider_acceleration": ("acc_V", "m/s^2")},
    )
    for file in files:
        table = pd.read_csv(file)
        pressure = 2.0 + np.sin(np.radians(table["th"]))
        table.assign(Index=range(len(table)), bar=pressure, state="OK", off=0.0).to_csv(
            file, index=False
        )
    content, text = guessed(tmp_path, files, monkeypatch)
    assert content["channels"]["crank_torque"] == {"column": "I", "unit": "A", "scale": FILL_IN}
    signal = {"column": "acc_V", "unit": "V", "scale": FILL_IN}
    assert content["channels"]["slider_acceleration"] == signal
    pressure = {"column": "bar", "unit": "bar", "bore": FILL_IN, "ambient_pressure": FILL_IN}
    assert content["channels"]["cylinder_pressure"] == pressure
    assert all(f'# column "{heading}"' in text for heading in ("Index", "state", "off")), text


def test_files_of_two_loggers_are_joined_by_their_names_and_one_run_is_split(tmp_path, monkeypatch):
    files = written(tmp_path, SENSORS, runs=(200.0, 600.0))
    for file in files:
        table = pd.read_csv(file)
        table[["t", "th"]].to_csv(file, index=False)
        table[["t", "M"]].to_csv(tmp_path / f"{file.stem}_daq.csv", index=False)
    files = sorted(tmp_path.glob("r*.csv"))
    content, _ = guessed(tmp_path, files, monkeypatch)
    assert [run["file"] for run in content["runs"]] == [
        ["r0.csv", "r0_daq.csv"],
        ["r1.csv", "r1_daq.csv"],
    ]
    assert content["channels"]["crank_torque"]["column"] == "M"
    # it does not show the offset of the clocks
    assert "encoder_zero" not in content["nuisance"]
    content, _ = guessed(tmp_path, files[:1], monkeypatch, "one")
    assert [run["role"] for run in content["runs"]] == ["split"]


def test_values_to_fill_in_are_reported_in_one_error(tmp_path, monkeypatch):
    files = written(tmp_path, SENSORS | {"slider_acceleration": ("acc", "m/s^2")})
    monkeypatch.chdir(tmp_path)
    assert (
        CliRunner().invoke(cli, ["new", "rig", *map(str, files)], catch_exceptions=False).exit_code
        == 0
    )
    mechanism = tmp_path / "rig_mechanism.yaml"
    with pytest.raises(
        InputError,
        match=r"rig_mechanism.yaml: crank.length, .* and gravity_direction are not filled in",
    ) as caught:
        load_campaign(tmp_path / "rig.yaml")
    assert len(caught.value.args) == 1
    values = yaml.safe_load(
        (ROOT / "config/mechanisms/ideal_joints.yaml").read_text(encoding="utf-8")
    )
    content = yaml.safe_load(mechanism.read_text(encoding="utf-8"))
    for body in ("crank", "rod", "slider"):
        assert content[body].keys() == values[body].keys()
    mechanism.write_text(yaml.safe_dump(content | values), encoding="utf-8")
    runs = read_measurements(load_campaign(tmp_path / "rig.yaml"), compared=False).runs
    assert runs.keys() == {"r0", "r1", "r2"}
    assert runs["r0"].channels.keys() == {"crank_torque", "slider_acceleration"}


@pytest.mark.slow
def test_two_files_of_samples_suffice_to_identify_the_effect(tmp_path, monkeypatch):
    guessed(
        tmp_path,
        [ROOT / f"config/campaigns/demonstration/{run}.csv" for run in ("slow", "fast")],
        monkeypatch,
    )
    shutil.copy(ROOT / "config/mechanisms/ideal_joints.yaml", "rig_mechanism.yaml")
    for stage in ("measure", "analyse"):
        done = CliRunner().invoke(cli, [stage, "rig.yaml"], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    assert "The model lacks Coulomb friction of the slider." in done.output


def test_existing_files_are_not_replaced_and_unusable_files_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = written(tmp_path, SENSORS, runs=(200.0, 600.0))
    new_rig(files)
    assert CliRunner().invoke(cli, ["new", "mechanism"], catch_exceptions=False).exit_code == 0
    before = {path: path.read_bytes() for path in tmp_path.glob("*.yaml")}
    (tmp_path / "numbers.csv").write_text("1,2\n3,4\n", encoding="utf-8")
    (tmp_path / "other.csv").write_text("a,b\n3,4\n5,6\n", encoding="utf-8")
    cases = [
        (files, "rig", "rig.yaml and rig_mechanism.yaml: already there.*--name"),
        (files, "../rig", "--name ../rig: use letters"),
        ([tmp_path / "numbers.csv"], "a", "numbers.csv: has no headings above its numbers; write"),
        ([files[0], tmp_path / "other.csv"], "a", "other.csv: has other headings than.*give"),
        ([tmp_path / "other.csv"], "a", "other.csv: no column with 12 different numbers"),
        ([tmp_path / "none.csv"], "a", "none.csv: cannot be read"),
    ]
    for paths, name, words in cases:
        with pytest.raises(InputError, match=words):
            new_rig(paths, name)
    with pytest.raises(InputError, match=r"mechanism\.yaml: already there.*--name"):
        new_mechanism()
    assert {path: path.read_bytes() for path in tmp_path.glob("*.yaml")} == before


@pytest.mark.parametrize(
    "heading, words, unit",
    [
        ("rocker_accel_rad_s2", "rocker accel", "rad/s2"),
        ("Torque [Nm]", "torque", "Nm"),
        ("M / Nm", "m", "Nm"),
        ("slider_acc_m_s2", "slider acc", "m/s2"),
        ("speed, rpm", "speed", "rpm"),
        ("rpm", "rpm", "rpm"),
        ("th", "th", ""),
        ("CrankAngle", "crank angle", ""),
        ("v_m_per_s", "v", "m/s"),
        ("Weg in mm", "weg", "mm"),
    ],
)
def test_a_heading_consists_of_words_and_a_unit(heading, words, unit):
    assert words_and_unit(heading) == (frozenset(words.split()), unit)


@pytest.mark.parametrize(
    "text, headings",
    [
        ("t;a\n0,1;2,3\n0,2;2,4\n", "t a"),
        ("t\ta\n[s]\t[N m]\n0,1\t2,3\n", "t a"),
        ("t,x,\n1,2,\n", "t x"),
        ("# c\nt, th, M\n0.1, 2.0, 3\n", "t th M"),
        ("Test,3\nt,th,ok\ns,deg,-\n0.1,2,yes\n0.2,,no\n", "t th ok"),
        ("a b c\n1 2 3\n", "a b c"),
        ("time,x\n2026-03-01T12:00:00,3\n", "time x"),
    ],
)
def test_headings_are_the_row_above_the_numbers_or_above_a_row_of_units(tmp_path, text, headings):
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    assert find_headings(tmp_path / "run.csv") == headings.split()
