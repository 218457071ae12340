"""The examples on measured data: with effects in synthetic recordings, and on the real ones."""

import os
import shutil
from pathlib import Path

import pandas as pd
import pytest

from examples.convert import EXAMPLES, write
from jointgap.axis.analyse import analyse_model
from jointgap.core.errors import InputError
from tests.examples.recordings import WRITERS
from tests.examples.recordings import write_pneumatic_piston as write_piston

AREA = 4.909e-4  # m^2, of the piston

HIDDEN = {
    "band_brake": {"play.play": 4e-3},
    "cycloidal_gear": {"play.play": 0.02618, "coulomb_friction.torque_N_m": 2.0},
    "emps": {"coulomb_friction.force_N": 20.0},
    "pendulum": {"coulomb_friction.torque_N_m": 0.15},
    "pneumatic_piston": {"load_friction.coefficient": 0.77e-5 / AREA},
}
"""Effects of the synthetic recordings by rig, with their sizes [SI]."""

FOUND = {
    "band_brake": {"play.play": (4.0e-3, 4.4e-3)},
    "cycloidal_gear": {"play.play": (0.036, 0.040)},
    "emps": {"coulomb_friction.force_N": (18.9, 21.4), "constant_force.force_N": (2.5, 4.0)},
    "pendulum": {"coulomb_friction.torque_N_m": (0.10, 0.17)},
    "pneumatic_piston": {"load_friction.coefficient": (0.012, 0.016)},
    "servo": {"load_friction.coefficient": (0.5, 0.7)},
}
"""Bounds of the sizes in the real recordings [SI]; what is known of the rigs: their READMEs."""


def analyse(rig: str, download: Path, folder: Path) -> dict:
    """The verdict on the example `rig` with the data of a `download`."""
    for name in ("model.py", "model.yaml"):
        shutil.copy(EXAMPLES / rig / name, folder)
    write(rig, download, folder)
    return analyse_model(folder, folder / "results", pictures=False)


def sizes(effects: list[dict]) -> dict[str, float]:
    """Value of each parameter of the effects."""
    return {
        f"{effect['name']}.{key}": estimate["value"]
        for effect in effects
        for key, estimate in effect["parameters"].items()
    }


@pytest.mark.integration
@pytest.mark.parametrize("rig", HIDDEN)
def test_hidden_effects_of_a_synthetic_recording_are_named_with_their_sizes(rig, tmp_path):
    WRITERS[rig](tmp_path)
    (tmp_path / "model").mkdir()
    verdict = analyse(rig, tmp_path, tmp_path / "model")
    assert verdict["verdict"].startswith("named"), verdict["because"]
    named = sizes(verdict["effects"])
    for key, size in HIDDEN[rig].items():
        assert named[key] == pytest.approx(size, rel=0.05), key


@pytest.mark.integration
@pytest.mark.parametrize("rig", FOUND)
def test_effects_of_the_real_recording_have_about_the_known_sizes(rig, tmp_path):
    variable = f"JOINTGAP_{rig.upper()}"
    if variable not in os.environ:
        pytest.skip(f"needs the download of {rig} ({EXAMPLES / rig / 'README.md'}) in {variable}")
    verdict = analyse(rig, Path(os.environ[variable]), tmp_path)
    found = sizes(verdict["effects"] or verdict["best_known"]["effects"])
    for key, (low, high) in FOUND[rig].items():
        assert low < found[key] < high, key


def test_a_folder_without_the_recordings_is_refused_with_their_address(tmp_path):
    for rig in WRITERS:
        with pytest.raises(InputError, match=rf"not the download of the example {rig}.*get it"):
            write(rig, tmp_path, tmp_path)
    with pytest.raises(InputError, match=r"no example 'crane'; the examples are band_brake, "):
        write("crane", tmp_path)


def test_recordings_are_converted_to_si_units(tmp_path):
    write_piston(tmp_path)
    table = pd.concat(pd.read_csv(path) for path in write("pneumatic_piston", tmp_path, tmp_path))
    assert table["position"].max() == pytest.approx(0.04, rel=0.01)
    assert table["pressure"].max() == pytest.approx(7.03e5, rel=0.01)
    assert table["force"].max() == pytest.approx(7.03e5 * AREA + 3.2 + 7 * 0.77, rel=0.01)
