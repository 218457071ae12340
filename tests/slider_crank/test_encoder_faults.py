"""An encoder on a soft or a loose coupling, and one whose disc is not centred."""

import math
from pathlib import Path

import numpy as np
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import headline
from jointgap.rig.recording import Recording
from jointgap.rig.sensors import Faults
from tests.rows import each
from tests.slider_crank.campaigns import samples, written
from tests.slider_crank.rigs import campaign, chosen, mechanism, read, recorded, rig

FRICTION = 4.0  # N
PLAY = math.radians(1.2)
ECCENTRICITY, PHASE = math.radians(0.25), math.radians(40.0)
READ = ("time", "crank_angle", "crank_torque", "slider_acceleration")
WINDUP = ("encoder_windup", {"compliance_rad_N_m": 1.0 / 60.0})
BACKLASH = ("encoder_backlash", {"play_rad": PLAY})
OFF_CENTRE = (
    "encoder_eccentricity",
    {"cosine": ECCENTRICITY * math.cos(PHASE), "sine": ECCENTRICITY * math.sin(PHASE)},
)
LAWS = [
    (WINDUP, lambda angle, torque: torque / 60.0),
    (BACKLASH, lambda angle, torque: 0.5 * PLAY * np.sign(torque)),
    (OFF_CENTRE, lambda angle, torque: ECCENTRICITY * np.cos(angle - PHASE)),
]


def beside_friction(folder: Path, law, drive: str, seed: int) -> Path:
    """A campaign of three runs with Coulomb friction, whose encoder errs by `law` of angle and torque."""
    hidden = [{"name": "slider_coulomb_friction", "parameters": {"force_N": FRICTION}}]
    if drive == "measured_angle":
        hidden.append({"name": "speed_fluctuation", "parameters": {"ratio": 0.03, "order": 2}})
    rng, runs = np.random.default_rng(seed), {}
    for run, rpm in {"slow": 200.0, "mid": 300.0, "fast": 400.0}.items():
        speed = rpm * math.pi / 30
        options = {"revolutions": 8, "samples_per_revolution": 90, "start_angle": rng.uniform(0.0, math.tau)}
        seen = samples(*hidden, speed=speed, **options).iloc[2 * 90 :]
        table = seen[[*READ]].copy()
        table["crank_angle"] += law(seen["crank_angle"], seen["crank_torque"])
        table["crank_angle"] += math.radians(0.05) * rng.standard_normal(len(table))
        for channel in READ[2:]:
            table[channel] += 0.01 * table[channel].std() * rng.standard_normal(len(table))
        runs[run] = speed, table
    return written(folder, runs, drive=drive)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "drive", "parameters"),
    [
        (LAWS[0], "constant_speed", {"stiffness_N_m_rad": 60.0}),
        (LAWS[1], "constant_speed", {"play_rad": PLAY}),
        (LAWS[2], "constant_speed", {"amplitude_rad": ECCENTRICITY, "phase_rad": PHASE}),
        (LAWS[2], "measured_angle", {"amplitude_rad": ECCENTRICITY, "phase_rad": PHASE}),
    ],
    ids=["wind-up", "backlash", "eccentricity", "eccentricity of a measured angle that drives"],
)
def test_a_fault_of_the_encoder_is_named_with_its_size_beside_friction(tmp_path, fault, drive, parameters):
    (label, _), law = fault
    document = analyse(beside_friction(tmp_path, law, drive, 1), tmp_path / "results")
    found = {effect["name"]: effect["parameters"] for effect in document["effects"]}
    assert (document["verdict"], {*found}) == ("named", {"slider_coulomb_friction", label})
    for name, true in parameters.items():
        low, high = found[label][name]["interval_90"]
        assert low < true < high
        assert found[label][name]["value"] == pytest.approx(true, rel=0.05)
    assert document["gap"]["confirm"]["after"] == pytest.approx(1.0, abs=0.1)
