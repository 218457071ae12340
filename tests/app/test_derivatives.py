"""Derivatives of simulated motions against differences of simulations with small tolerances."""

import numpy as np
import pytest

import jointgap as jg
from tests.motion.test_loose_slide import published

pytestmark = pytest.mark.filterwarnings("ignore:All-NaN")

STEPS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5)  # Shares of the parameter
SIMULATED = {"revolutions": 1, "samples_per_revolution": 48, "tolerance": "1e-13 m"}


@pytest.fixture(scope="module")
def crank():
    return jg.load_mechanism("erkaya2009")


@pytest.fixture(scope="module")
def four_bar():
    """With one loose joint, whose motion can be predicted over a revolution."""
    linkage = jg.load_mechanism("four_bar")
    return jg.change(linkage, {"joints.A.loose": False, "joints.C.loose": False})


def changed(mechanism, key: str, value: float, drive: dict) -> dict[str, np.ndarray]:
    """Samples with another number at a key."""
    if key.partition(".")[0] in ("speed", "drive"):
        drive = drive | {key: value}
    else:
        mechanism = jg.change(mechanism, {key: value})
    return jg.simulate(mechanism, **SIMULATED, **drive).samples


def check(mechanism, key: str, value: float, within: float, **drive) -> None:
    """Each derivative by the number at a key is that of the best of several differences."""
    drive = {"speed": "200 rpm"} | drive
    run = jg.simulate(mechanism, derivatives=[key], **SIMULATED, **drive)
    assert len(run.events) > 10
    derivative = run.derivatives[key]
    assert len(derivative) == len(run.samples)
    numbers = run.samples.select_dtypes("number").columns
    assert set(derivative) == set(numbers)
    best = {name: np.inf for name in numbers if np.isfinite(run.samples[name]).any()}
    for share in STEPS:
        ahead, behind = (
            changed(mechanism, key, value * (1 + sign * share), drive) for sign in (1, -1)
        )
        for name in best:
            change = (ahead[name] - behind[name]).to_numpy()
            secant = change / (2 * share * value)
            if np.nanmax(np.abs(change), initial=0.0) <= 1e-12 * np.nanmax(np.abs(ahead[name])):
                best[name] = min(best[name], np.nanmax(np.abs(derivative[name]), initial=0.0))
                continue
            error = np.nanmax(np.abs(derivative[name] - secant)) / np.nanmax(np.abs(secant))
            best[name] = min(best[name], error)
    assert max(best.values()) < within, max(best, key=best.get)


@pytest.mark.parametrize(
    "key",
    [
        "rod.length",
        "slider.mass",
        "joints.crank_pin.clearance",
        "joints.crank_pin.contact.friction",
        "joints.crank_pin.contact.restitution",
        "speed",
    ],
)
def test_of_a_slider_crank_through_impacts(key, crank):
    values = {
        "rod.length": crank.rod.length,
        "slider.mass": crank.slider.mass,
        "joints.crank_pin.clearance": crank.clearance("crank_pin"),
        "joints.crank_pin.contact.friction": crank.joint("crank_pin").contact.friction,
        "joints.crank_pin.contact.restitution": crank.joint("crank_pin").contact.restitution,
        "speed": 200 * np.pi / 30,
    }
    check(crank, key, values[key], 1e-3)


def test_of_a_clockwise_crank(crank):
    check(crank, "slider.mass", crank.slider.mass, 1e-3, speed="-200 rpm")


def test_with_bristles(crank):
    lugre = {"friction_law": "lugre", "bristle_stiffness": 1e5, "bristle_damping": 300.0}
    lugre |= {"static_friction": 0.06, "stribeck_speed": 0.01, "viscous_friction": 0.0}
    contacts = {f"joints.{joint}.contact": lugre for joint in ("crank_pin", "piston_pin")}
    # friction rises within a sample's distance of each impact
    check(jg.change(crank, contacts), "slider.mass", crank.slider.mass, 1e-2)


def test_with_a_motor(crank):
    motor = jg.MotorDrive(stall_torque="20 N*m", no_load_speed="300 rpm", inertia="0.1 kg*m^2")
    check(crank, "slider.mass", crank.slider.mass, 5e-3, drive=motor)


@pytest.mark.parametrize(
    "key", ["bodies.coupler.mass", "bodies.rocker.length", "joints.B.clearance"]
)
def test_of_a_four_bar_through_impacts(key, four_bar):
    values = {
        "bodies.coupler.mass": four_bar.bodies["coupler"].mass,
        "bodies.rocker.length": four_bar.bodies["rocker"].length,
        "joints.B.clearance": four_bar.joints["B"].clearance,
    }
    check(four_bar, key, values[key], 3e-3)


def test_of_a_clockwise_four_bar(four_bar):
    mass = four_bar.bodies["rocker"].mass
    check(four_bar, "bodies.rocker.mass", mass, 3e-3, speed="-200 rpm")


def test_with_a_free_crank(four_bar):
    free = jg.FreeDrive(inertia="5 kg*m^2")
    check(four_bar, "bodies.rocker.mass", four_bar.bodies["rocker"].mass, 5e-3, drive=free)
    check(four_bar, "speed", 200 * np.pi / 30, 3e-3, drive=free)


def test_of_a_loose_slide():
    linkage = published(friction=0.1)
    check(linkage, "bodies.rod.mass", linkage.bodies["rod"].mass, 3e-3, speed="600 rpm")
    check(
        linkage, "joints.guide.clearance", linkage.joints["guide"].clearance, 3e-3, speed="600 rpm"
    )


def test_of_ideal_joints_agree_with_differences():
    ideal = jg.load_mechanism("erkaya2009")
    ideal = jg.change(ideal, {f"joints.{name}": "ideal" for name in ideal.loose})
    run = jg.simulate(ideal, speed="200 rpm", derivatives=["rod.length"])
    ahead, behind = (
        jg.simulate(
            jg.change(ideal, {"rod.length": ideal.rod.length + sign * 1e-6}), speed="200 rpm"
        )
        for sign in (1, -1)
    )
    secant = (ahead.samples["crank_torque"] - behind.samples["crank_torque"]) / 2e-6
    np.testing.assert_allclose(
        run.derivatives["rod.length"]["crank_torque"], secant, atol=1e-6 * np.abs(secant).max()
    )


def test_a_remark_says_that_derivatives_of_a_chaotic_motion_hold_for_tiny_changes_only(crank):
    calm, chaotic = (
        jg.simulate(mechanism, speed=speed, samples_per_revolution=36, derivatives=["slider.mass"])
        for mechanism, speed in (
            (crank, "200 rpm"),
            (jg.change(crank, {"friction": 0.0}), "300 rpm"),
        )
    )
    assert not any("Derivatives" in remark for remark in calm.remarks)
    assert any("Derivatives by slider.mass: a change by" in remark for remark in chaotic.remarks)


def test_units_are_those_of_the_samples_over_that_of_the_number(crank):
    run = jg.simulate(
        crank,
        speed="200 rpm",
        samples_per_revolution=12,
        derivatives=["mechanism.slider.mass", "joints.crank_pin.contact.friction", "rod.length"],
    )
    by_mass, by_friction, by_length = run.derivatives.values()
    assert by_mass.attrs["units"]["crank_torque"] == "N*m/kg"
    assert by_friction.attrs["units"]["crank_torque"] == "N*m"
    assert by_length.attrs["units"]["slider_position"] == "1"
    assert by_length.attrs["units"]["rod_angle"] == "rad/m"


@pytest.mark.parametrize(
    "keys, message",
    [
        ("rod.length", r"derivatives: is text.*\['rod.length'\]"),
        (["rod.lenght"], r"rod\.lenght.*length"),
        (["joints.crank_pin.contact"], "joints.crank_pin.contact: is not a number"),
        (["start_angle"], "start_angle"),
        ([3], "derivatives: 3 is not a key"),
    ],
)
def test_a_key_without_derivative_is_refused(keys, message, crank):
    with pytest.raises(jg.InputError, match=message):
        jg.simulate(crank, speed="200 rpm", derivatives=keys)
