"""A slide with clearance: a block between two walls, in contact at its corners."""

import math

import numpy as np
import pytest

from jointgap.config import Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.errors import InputError, SimulationError
from jointgap.effects import SLIDER_SIGN_SPEED
from jointgap.motion.integrate import EVENT
from jointgap.motion.linkage import linkage_model, simulate_linkage
from jointgap.motion.simulation import integrate_to_angles, observed

MASSES = {"crank": 0.038, "rod": 0.038, "slider": 0.076}
INERTIAS = {"crank": 7.4e-5, "rod": 5.9e-4, "slider": 2.7e-6}
CLEARANCE, WEIGHT = 1e-3, 9.81
FREE = {"kind": "free"}
FLIGHT = np.array(
    [  # time [s], crank angle [rad], its speed [rad/s], offset of the slide [m]
        [1e-4, 1.499527398808110e-02, 1.498622540581090e02, 4.339428977002263e-08],
        [2e-4, 2.996389318569084e-02, 1.494679889663642e02, 5.390623034721986e-07],
    ]
)
BOUNCES = np.array(
    [  # time [s], crank angle [rad], approach speed [m/s]
        [2.692502752021336e-03, 3.553044550277587e-01, 8.416123220329315e-01],
        [5.607797868073180e-03, 6.271086524700222e-01, 2.478942529033006e-01],
        [7.465635169572453e-03, 7.705848917082064e-01, 8.425061598413031e-02],
    ]
)
"""Of Flores, Leine and Glocker (Multibody Syst. Dyn. 23 (2010) 165-190): their equations without
friction, integrated from bounce to bounce of rigid walls with restitution 0.4."""


def published(stiffness=1e9, **contact) -> LinkageFile:
    """The slider-crank of Flores, Leine and Glocker."""
    wall = {"law": "exact_restitution", "restitution": 0.4, "friction": 0.0, "memory": "published"}
    content = {
        "frame": {"points": {"O": [0.0, 0.0]}},
        "bodies": {
            "crank": {"length": 0.153, "ends": ["O", "A"], "mass_centre": 0.0765},
            "rod": {"length": 0.306, "ends": ["A", "B"], "mass_centre": 0.153},
            "slider": {"points": {"B": [0.0, 0.0]}},
        },
        "joints": {
            "guide": {
                "slide": ["frame", "slider"],
                "length": 0.05,
                "width": 0.025,
                "clearance": CLEARANCE,
                "contact": wall | {"stiffness": stiffness} | contact,
            }
        },
        "drive": "O",
        "effects": [{"name": "gravity", "parameters": {"acceleration_m_s2": WEIGHT}}],
    }
    for name, body in content["bodies"].items():
        body |= {"mass": MASSES[name], "inertia": INERTIAS[name]}
    return validate(LinkageFile, content, "flores.yaml")


def run(file, revolutions=1, **keys):
    chosen = {"speed": 150.0, "drive": FREE, "samples_per_revolution": 360, "tolerance": 1e-12}
    return simulate_linkage(file, Simulate(revolutions=revolutions, **chosen | keys))


def test_the_block_flies_as_the_published_equations_say():
    chosen = Simulate(speed=150.0, drive=FREE, tolerance=1e-13)
    model = linkage_model(published(), chosen)
    angles = np.append(0.0, FLIGHT[:, 1])
    found = integrate_to_angles(model, model.start(), angles, chosen.tolerance)
    seen = observed(model, found)
    assert np.abs(found.times[1:] - FLIGHT[:, 0]).max() < 1e-14
    assert np.abs(seen["guide_offset"][1:] - FLIGHT[:, 3]).max() < 1e-12
    assert np.abs(seen["crank_speed"][1:] - FLIGHT[:, 2]).max() < 1e-9
    assert np.abs(seen["guide_tilt"]).max() == 0.0


def test_bounces_tend_to_those_of_rigid_walls():
    """Each delays the next by about the duration of a contact, which falls with stiffness^-0.4."""
    late = []
    for stiffness in (1e9, 1e11, 1e13):
        model = linkage_model(published(stiffness), Simulate(speed=150.0, drive=FREE))
        found = integrate_to_angles(model, model.start(), np.array([0.0, 0.82]), 1e-12)
        begun = found.events[found.events[:, EVENT.index("begins")] == 1]
        events = dict(zip(EVENT, begun.T, strict=True))
        upper = {1: events["joint"] == 0, 2: events["joint"] == 1}
        times = events["time"][upper[1]]
        # both corners of the upper side hit together
        assert np.abs(times - events["time"][upper[2]]).max() < 1e-12
        assert abs(times[0] - BOUNCES[0, 0]) < 1e-12
        assert events["approach_speed"][0] == pytest.approx(BOUNCES[0, 2], rel=1e-9)
        late.append(times[1:3] - BOUNCES[1:, 0])
    ratios = np.array(late[:-1]) / np.array(late[1:])
    assert np.abs(ratios / 100**0.4 - 1.0).max() < 0.1
    assert np.array(late[-1]).max() < 2e-5


def energy(samples):
    """Kinetic energy and that of the weight [J] at samples."""
    about_pivot = INERTIAS["crank"] + MASSES["crank"] * 0.0765**2
    total = 0.5 * about_pivot * samples["crank_speed"] ** 2
    total += MASSES["crank"] * WEIGHT * 0.0765 * np.sin(samples["crank_angle"])
    for name in ("rod", "slider"):
        square = samples[f"{name}_velocity_x"] ** 2 + samples[f"{name}_velocity_y"] ** 2
        total += 0.5 * MASSES[name] * square
        total += 0.5 * INERTIAS[name] * samples[f"{name}_angular_velocity"] ** 2
        total += MASSES[name] * WEIGHT * samples[f"{name}_position_y"]
    return total


def test_elastic_walls_without_friction_conserve_energy():
    model = linkage_model(published(), Simulate(speed=150.0, drive=FREE))
    for corner in model.contacts:
        model.bearings[corner].damping = 0.0
    angles = np.linspace(0.0, 4 * math.pi, 721)
    samples = observed(model, integrate_to_angles(model, model.start(), angles, 1e-12))
    total = energy(samples)[samples["guide_contacts"] == 0]
    assert samples["guide_contacts"].max() > 0 and total.size > 100
    assert np.ptp(total) < 2e-9 * total[0]


@pytest.mark.parametrize(
    "law, size, exponent", [("viscous_friction", 0.05, 2), ("coulomb_friction", 0.2, 1)]
)
def test_friction_along_a_loose_slide_takes_its_work_from_a_free_crank(law, size, exponent):
    key = "damping_N_s_m" if exponent == 2 else "force_N"
    rubbing = {"name": f"slider_{law}", "parameters": {key: size}}
    content = published().model_dump()
    content["effects"] = [*content["effects"], rubbing]
    model = linkage_model(LinkageFile.model_validate(content), Simulate(speed=150.0, drive=FREE))
    for corner in model.contacts:
        model.bearings[corner].damping = 0.0
    angles = np.linspace(0.0, 2 * math.pi, 14401)
    samples = observed(model, integrate_to_angles(model, model.start(), angles, 1e-12))
    speed, flies = samples["slider_velocity_x"], samples["guide_contacts"] == 0
    power = size * (speed**2 if exponent == 2 else speed * np.tanh(speed / SLIDER_SIGN_SPEED))
    steps = 0.5 * (power[1:] + power[:-1]) * np.diff(samples["time"])
    lost = np.append(0.0, np.cumsum(steps))
    kept = energy(samples) + lost
    assert samples["guide_contacts"].max() > 0
    assert np.ptp(kept[flies]) < 1e-5 * lost[-1] and lost[-1] > 0.01 * kept[0]


def test_friction_by_the_load_of_a_loose_slide_is_refused_as_its_contact_has_friction():
    rubbing = {"name": "slider_load_friction", "parameters": {"coefficient": 0.1}}
    content = published().model_dump() | {"effects": [rubbing]}
    with pytest.raises(InputError, match="slider_load_friction requires an ideal slide"):
        validate(LinkageFile, content, "flores.yaml")


def test_friction_tilts_the_block_and_takes_energy():
    file = published(friction=0.3, friction_speed=0.01)
    found = run(file, revolutions=2)
    samples = found.samples
    total = energy(samples)[samples["guide_contacts"] == 0].to_numpy()
    assert np.diff(total).max() < 1e-9 * total[0] and total[-1] < 0.99 * total[0]
    assert np.abs(samples["guide_tilt"]).max() > 1e-3
    assert found.events["joint"].nunique() >= 3
    reach = 0.5 * 0.05 * np.abs(np.sin(samples["guide_tilt"])) + np.abs(samples["guide_offset"])
    assert reach.max() < CLEARANCE + 1e-4  # it stays between the walls


def test_forces_of_the_walls_balance_the_block():
    samples = run(published(friction=0.3, friction_speed=0.01)).samples
    mass = MASSES["slider"]
    across = samples["guide_force"] - mass * WEIGHT + _of_pin(samples, "y")
    along = samples["guide_friction_force"] + _of_pin(samples, "x")
    turn = samples["guide_moment"]
    expected = {"x": mass * samples["slider_acceleration_x"]}
    expected["y"] = mass * samples["slider_acceleration_y"]
    largest = max(np.abs(each).max() for each in expected.values())
    assert np.abs(along - expected["x"]).max() < 1e-9 * largest
    assert np.abs(across - expected["y"]).max() < 1e-9 * largest
    spin = INERTIAS["slider"] * samples["slider_angular_acceleration"]
    assert np.abs(turn - spin).max() < 1e-9 * np.abs(spin).max()


def _of_pin(samples, axis):
    """Force on the slider in its ideal pin; the joint's body is the rod."""
    return -samples[f"B_force_{axis}"]


def test_a_clockwise_crank_gives_the_mirror_image():
    file = published(friction=0.3, friction_speed=0.01)
    ahead = run(file.mirrored())
    behind = run(file, speed=-150.0)
    for name in ("guide_offset", "guide_tilt", "guide_force", "slider_velocity_y"):
        assert (behind.samples[name] == -ahead.samples[name]).all(), name
    for name in ("guide_friction_force", "guide_contacts", "slider_position_x"):
        assert (behind.samples[name] == ahead.samples[name]).all(), name
    swapped = {1: 4, 2: 3, 3: 2, 4: 1}
    expected = [f"guide corner {swapped[int(name[-1])]}" for name in ahead.events["joint"]]
    assert list(behind.events["joint"]) == expected


def test_a_block_without_inertia_is_refused():
    content = published().model_dump()
    content["bodies"]["slider"]["inertia"] = None
    file = validate(LinkageFile, content, "flores.yaml")
    with pytest.raises(InputError, match=r"bodies\.slider: it turns; give its inertia"):
        run(file)


def test_a_free_crank_keeps_its_energy_without_friction():
    """A slide with a large clearance between ideal pins, never touched in a tenth of a turn."""
    file = published()
    samples = run(file, samples_per_revolution=3600).samples.iloc[:200]
    total = energy(samples)
    assert math.isclose(samples["crank_speed"].iloc[0], 150.0)
    assert np.ptp(total) < 1e-10 * total.iloc[0]


def test_a_clearance_beyond_the_block_is_refused():
    content = published().model_dump()
    content["joints"]["guide"]["clearance"] = 6e-3
    with pytest.raises(InputError, match=r"clearance 0\.006 m is more than 0\.2 of width 0\.025"):
        validate(LinkageFile, content, "flores.yaml")


def test_walls_that_give_way_are_reported():
    with pytest.raises(SimulationError, match=r"joints\.guide: a corner is .* inside its wall"):
        run(published(stiffness=1e4))


def test_a_free_crank_that_stops_is_reported():
    lift = published().model_copy(update={"gravity_direction": -math.pi})
    with pytest.raises(SimulationError, match=r"the free crank stops.*more torque, speed"):
        run(lift, speed=1.0)


def test_a_joint_may_be_called_after_the_frame():
    content = published().model_dump()
    content["bodies"]["frame_rod"] = content["bodies"].pop("rod")
    samples = run(validate(LinkageFile, content, "flores.yaml")).samples
    assert "frame_rod_angle" in samples and "frame_force_x" not in samples
