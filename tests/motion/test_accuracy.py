"""Accuracy of samples and events."""

import numpy as np
import pytest

from jointgap.contact.joints import FORCE_FREE
from jointgap.contact.normal_force import LAWS
from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of
from tests.motion import plain
from tests.motion.cases import (
    ALL,
    LUGRE,
    MOTOR,
    SPEED,
    integrated,
    mechanism,
    options,
    state_of,
)
from tests.motion.laws import impact_duration

DEGREES = np.arange(0.0, 45.5, 0.5)


def placed(model, run) -> np.ndarray:
    """Rod's mass centre and angle, slider's position at the samples, (n, 4)."""
    seen = observed(model, run)
    names = ("rod_position_x", "rod_position_y", "rod_angle", "slider_position")
    return np.array([seen[name] for name in names]).T


@pytest.mark.parametrize(
    "law, restitution, friction, friction_speed, reference",
    [("exact_restitution", 0.46, 0.1, 0.1, None), ("lankarani_nikravesh", 0.46, 0.2, 0.1, 0.02)],
)
def test_independent_code_gives_the_same_motion(
    worst, law, restitution, friction, friction_speed, reference
):
    memory = (
        {"memory": "published"} if reference is None else {"reference_approach_speed": reference}
    )
    made = mechanism(
        law=law, restitution=restitution, friction=friction, friction_speed=friction_speed, **memory
    )
    model, run = integrated(made, DEGREES, tolerance=1e-14)
    kept = None
    if reference is not None:
        duration = impact_duration(plain.STIFFNESS, 1.5, plain.ROD_MASS + plain.SLIDER_MASS, 1e-3)
        kept = 2.5 * duration, 2.5 * duration, reference
        # a contact whose memory has faded
        assert (run.times[-1] - run.begins[-1] > 5 * duration).any()
    law = LAWS[law](restitution), friction, friction_speed
    states, impacts = plain.simulate(np.radians(DEGREES), SPEED, *law, tolerance=1e-15, memory=kept)
    worst("plain scipy code, 45 deg [m]", np.abs(placed(model, run) - states[:, :4]).max(), 1e-10)
    ours = run.events[run.events[:, 2] == 1]
    assert len(ours) >= 5
    np.testing.assert_array_equal(ours[:, 1], impacts[:, 1])
    np.testing.assert_allclose(ours[:, 0], impacts[:, 0], rtol=1e-8)
    np.testing.assert_allclose(ours[:, 3], impacts[:, 2], rtol=1e-6)


@pytest.mark.slow
def test_independent_code_agrees_with_force_free_contacts(worst):
    degrees = np.arange(0.0, 221.0)
    made = mechanism(law="exact_restitution", restitution=0.1, memory="published")
    model, run = integrated(made, degrees, tolerance=1e-14)
    assert (run.modes == FORCE_FREE).any()
    states, impacts = plain.simulate(
        np.radians(degrees), SPEED, LAWS["exact_restitution"](0.1), 0.0, 1e-3, 1e-15
    )
    deviation = np.abs(placed(model, run) - states[:, :4]).max()
    worst("plain scipy code, 220 deg, e = 0.1 [m]", deviation, 1e-11)
    assert len(impacts) == (run.events[:, 2] == 1).sum()


@pytest.mark.parametrize(
    "keys, drive, end",
    [
        ({"restitution": 0.9, "law": "exact_restitution"}, {}, 25.0),
        ({"loose": ALL, "friction": 0.1}, {"drive": MOTOR}, 25.0),
        (LUGRE, {}, 25.0),
        ({"friction": 0.2, "friction_speed": 0.1}, {}, 90.0),  # the memory of a contact fades
    ],
)
def test_the_error_at_samples_falls_with_the_tolerance(worst, keys, drive, end):
    made = mechanism(**keys)

    def vectors(tolerance):
        model, run = integrated(made, np.linspace(0.0, end, 251), tolerance, **drive)
        return run.states[:, : 2 * len(model.loose)]

    exact, tolerances = vectors(1e-15), 10.0 ** -np.arange(8.0 if end < 90.0 else 9.0, 14.0)
    errors = [np.abs(vectors(tolerance) - exact).max() for tolerance in tolerances]
    worst(
        f"error at tolerance 1e-12 m, {end:.0f} deg [m]", errors[-2], 1e-9 if end < 90.0 else 1e-10
    )
    worst("error at tolerance 1e-13 m [m]", errors[-1], 1e-10)
    # the error is about proportional to the tolerance
    assert 0.7 < np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0] < 1.35


def test_samples_and_run_length_do_not_change_the_motion():
    made = mechanism(friction=0.1)
    coarse, fine, longer = (
        integrated(made, degrees, 1e-11)[1]
        for degrees in (np.arange(181), np.arange(1801) / 10, np.arange(361))
    )
    np.testing.assert_array_equal(fine.states[::10], coarse.states)
    np.testing.assert_array_equal(fine.events, coarse.events)
    np.testing.assert_array_equal(longer.states[:181], coarse.states)


FALL, THROW = 9.80665, 0.14
HEIGHT = THROW**2 / (2 * FALL)


def thrown(clearance):
    """Events of a body thrown upwards in a ring of that clearance; it turns near the top. The
    flight fits into one step."""
    made = mechanism(gravity=True)
    still = made.crank.model_copy(update={"length": 0.0, "mass_centre": 0.0})
    rod = made.rod.model_copy(update={"mass_centre": 0.0})
    made = made.model_copy(update={"crank": still, "rod": rod})
    model = model_of(made, options(speed=1.0))
    model.bearings["crank_pin"].clearance = clearance
    model.bearings["piston_pin"].clearance = 10.0
    upwards = (0.0, 0.0, 0.0, THROW)
    start = state_of(model, crank_pin=upwards, piston_pin=upwards)
    return integrate_to_angles(model, start, np.array([0.0, 1.5 * THROW / FALL]), 1e-12).events


@pytest.mark.parametrize("share", (1e-3, 1e-6, 1e-9))
def test_a_grazing_impact_between_steps_is_found_and_a_near_miss_is_not(share):
    events = thrown(HEIGHT * (1 - share))
    assert events.shape[0] == 2
    assert events[0, 0] == pytest.approx(THROW / FALL * (1 - np.sqrt(share)), rel=1e-6)
    assert events[0, 3] == pytest.approx(THROW * np.sqrt(share), rel=1e-2)
    assert thrown(HEIGHT * (1 + share)).shape[0] == 0
