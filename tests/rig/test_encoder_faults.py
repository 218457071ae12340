"""An encoder on a soft or a loose coupling, and one whose disc is not centred."""

import math
from pathlib import Path

import numpy as np
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.config.channels import channel_kinds
from jointgap.config.scenario import MotorDrive
from jointgap.core.sites import SLIDER_CRANK
from jointgap.rig.model import build_model
from jointgap.rig.sensors import Faults
from tests.rig.campaigns import samples, written
from tests.rig.rigs import campaign, chosen, mechanism, read, recorded, rig, seen

FRICTION = 4.0  # N
PLAY = math.radians(1.2)
ECCENTRICITY, PHASE = math.radians(0.25), math.radians(40.0)
READ = ("time", "crank_angle", "crank_torque", "slider_acceleration")
MIRRORED = [name for name, kind in channel_kinds(SLIDER_CRANK).items() if kind.mirrored]
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
    """A campaign of three runs with Coulomb friction, whose encoder errs by `law` of angle and
    torque."""
    hidden = [{"name": "slider_coulomb_friction", "parameters": {"force_N": FRICTION}}]
    if drive == "measured_angle":
        hidden.append({"name": "speed_fluctuation", "parameters": {"ratio": 0.03, "order": 2}})
    rng, runs = np.random.default_rng(seed), {}
    for run, rpm in {"slow": 200.0, "mid": 300.0, "fast": 400.0}.items():
        speed = rpm * math.pi / 30
        options = {
            "revolutions": 8,
            "samples_per_revolution": 90,
            "start_angle": rng.uniform(0.0, math.tau),
        }
        seen = samples(*hidden, speed=speed, **options).iloc[2 * 90 :]
        table = seen[[*READ]].copy()
        table["crank_angle"] += law(seen["crank_angle"], seen["crank_torque"])
        table["crank_angle"] += math.radians(0.05) * rng.standard_normal(len(table))
        for channel in READ[2:]:
            table[channel] += 0.01 * table[channel].std() * rng.standard_normal(len(table))
        runs[run] = speed, table
    return written(folder, runs, drive=drive)


MOTOR = {"stall_torque": 60.0, "no_load_speed": 50.0, "inertia": 0.05}
DRIVES = {
    "constant_speed": {"speeds": (15.0, 20.0)},
    "motor": {"drive": "motor", "motor": MOTOR, "speeds": (40.0, 45.0)},
    "measured_angle": {"drive": "measured_angle"},
}
CLOCKWISE = {"direction": "clockwise"}


def faulty(law, drive: str, run: dict):
    """A campaign and its readings with an encoder error of `law`; and the exact crank angles,
    by run."""
    rig_campaign = campaign(
        mechanism(), READ, sensors={"crank_angle": {"noise": 1e-6}}, run=run, **DRIVES[drive]
    )
    simulated = (
        {"dropped": 12, "drive": MotorDrive(kind="motor", **MOTOR)} if drive == "motor" else {}
    )
    # no sample where the torque is 0
    measurements = recorded(rig_campaign, start_angle=0.03, **simulated)
    exact, side = {}, -1.0 if run else 1.0
    for name, item in measurements.runs.items():
        exact[name] = item.crank_angle.copy()
        item.crank_angle[:] += side * law(
            side * item.crank_angle, side * item.channels["crank_torque"]
        )
        for channel in MIRRORED:
            if run and channel in item.channels:
                item.channels[channel] *= -1.0
    return build_model(rig_campaign, measurements), measurements, exact


@pytest.mark.parametrize(
    "fault, drive, run",
    [
        (LAWS[0], "constant_speed", CLOCKWISE),
        (LAWS[1], "constant_speed", {}),
        (LAWS[2], "constant_speed", CLOCKWISE),
        (LAWS[0], "motor", {}),
        (LAWS[2], "motor", CLOCKWISE),
        (LAWS[2], "measured_angle", CLOCKWISE),
    ],
)
def test_an_encoder_fault_changes_the_reading_by_its_law_alone(fault, drive, run):
    effect, law = fault
    model, _, _ = faulty(law, drive, run)
    # the smooth angle is weak at its ends
    inside = slice(20, -20) if drive == "measured_angle" else slice(None)

    def away(result):
        """Largest error: of an angle in 0.1 rad, of other channels in standard deviations."""
        sizes = {
            name: 0.1 if name == "crank_angle" else np.std(values)
            for name, values in seen(model).items()
        }
        return max(
            np.abs((result[name] - seen(model)[name])[inside]).max() / size
            for name, size in sizes.items()
        )

    assert away(read(model, effect)) < 1e-3 < 3e-3 < away(read(model))


@pytest.mark.parametrize("fault", LAWS)
@pytest.mark.parametrize("run", [CLOCKWISE])
def test_an_encoder_fault_can_be_removed_from_a_record_with_torque(fault, run):
    (label, values), law = fault
    model, measurements, exact = faulty(law, "constant_speed", run)
    faults = Faults([(chosen(model, label), values)], -1.0 if run else 1.0, {})
    corrected = faults.corrected(measurements.runs["slow"]).crank_angle
    assert corrected == pytest.approx(exact["slow"], abs=1e-6)


def test_an_encoder_fault_is_a_candidate_if_it_is_observable():
    couplings, off_centre = {"encoder_windup", "encoder_backlash"}, {"encoder_eccentricity"}

    def offered(model):
        return {item.name for item in model.candidates} & (couplings | off_centre)

    rig_campaign = campaign(mechanism())
    assert offered(rig()) == couplings | off_centre
    # before anything is measured
    assert offered(build_model(rig_campaign)) == couplings | off_centre
    assert (
        offered(rig(drive="measured_angle", sensors={"crank_angle": {"noise": 1e-6}})) == off_centre
    )
    # an angle that was computed
    assert offered(build_model(rig_campaign, recorded(rig_campaign))) == set()
    assert offered(rig(channels=("time", "crank_angle"))) == set()  # as a fluctuating speed would
    assert offered(build_model(campaign(mechanism(("crank_pin",))))) == off_centre  # chaotic


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "drive", "parameters"),
    [
        (LAWS[0], "constant_speed", {"stiffness_N_m_rad": 60.0}),
        (LAWS[2], "measured_angle", {"amplitude_rad": ECCENTRICITY, "phase_rad": PHASE}),
    ],
    ids=["wind-up", "eccentricity of a measured angle that drives"],
)
def test_an_encoder_fault_and_friction_are_named_with_their_sizes(
    tmp_path, fault, drive, parameters
):
    (label, _), law = fault
    document = analyse(beside_friction(tmp_path, law, drive, 1), tmp_path / "results")
    result = {effect["name"]: effect["parameters"] for effect in document["effects"]}
    assert (document["verdict"], {*result}) == ("named", {"slider_coulomb_friction", label})
    for name, true in parameters.items():
        low, high = result[label][name]["interval_99"]
        assert low < true < high
        assert result[label][name]["value"] == pytest.approx(true, rel=0.05)
    assert document["gap"]["confirm"]["after"] == pytest.approx(1.0, abs=0.1)
