"""Contacts: impulse, peak force and duration of events; modes of samples."""

import numpy as np
import pytest

from jointgap.motion.integrate import EVENT
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import ALL, LUGRE, PINS, free_impact, mechanism, options
from tests.motion.quadrature import motion

COLUMN = {name: i for i, name in enumerate(EVENT)}
MASS, HIT = 0.773, 0.3


@pytest.mark.parametrize("restitution", (0.1, 0.9))
def test_the_impulse_of_a_free_impact_is_the_change_of_momentum(restitution, worst):
    made = mechanism(law="exact_restitution", restitution=restitution)
    _, (impact, separation) = free_impact(made, MASS, HIT)
    assert impact[COLUMN["approach_speed"]] == pytest.approx(HIT, rel=1e-12)
    exact = MASS * HIT * (1 + restitution)
    worst("impulse of a free impact", abs(separation[COLUMN["impulse"]] / exact - 1), 1e-8)
    assert separation[COLUMN["maxima"]] == 1


def contacts(moved):
    """Impulse and peak of each finished contact, from events and from samples."""
    events, times = moved.run.events, moved.sampled(moved.run.times)
    for joint, name in enumerate(moved.model.loose):
        own = events[events[:, COLUMN["joint"]] == joint]
        force = np.maximum(moved[f"{name}_normal_force"], 0.0)
        for impact, separation in zip(own[::2], own[1::2], strict=False):
            inside = (times[:, 8] > impact[0]) & (times[:, 8] < separation[0])
            recorded = separation[COLUMN["impulse"]], separation[COLUMN["peak_force"]]
            yield *recorded, moved.steps(force)[inside].sum(), force[inside].max()


@pytest.mark.parametrize(
    "keys, tolerance, bounds",
    [
        ({"loose": ALL}, 1e-14, (1e-5, 1e-2)),
        (LUGRE, 1e-14, (1e-5, 1e-2)),
        # long steps with near misses in them
        ({"loose": ALL, "restitution": 0.9}, 1e-8, (5e-3, 5e-2)),
    ],
)
def test_impulse_and_peak_match_the_normal_force(keys, tolerance, bounds, worst):
    ended = list(contacts(motion(mechanism(**keys), revolutions=0.25, tolerance=tolerance)))
    assert len(ended) > 3
    for recorded, recorded_peak, impulse, peak in ended:
        end, off = f", tolerance {tolerance} m", abs(recorded / impulse - 1)
        worst(f"impulse over integral of force{end}", off, bounds[0])
        worst(f"peak force over densest sample{end}", abs(recorded_peak / peak - 1), bounds[1])


def test_contact_modes_agree_with_events():
    """An impact has one deepest point; a longer contact has more."""
    run = simulate(mechanism(friction=0.1), options(samples_per_revolution=36000))
    for joint in PINS:
        own, time = run.events[run.events.joint == joint], run.samples.time.to_numpy()
        label = run.samples[f"{joint}_mode"].to_numpy()
        wanted = np.full(time.size, "flight", dtype=object)
        begins, ends = own[own.event == "impact"].time, own[own.event == "separation"]
        for begin, end, maxima in zip(
            begins, [*ends.time, np.inf], [*ends.maxima, np.inf], strict=False
        ):
            wanted[(time >= begin) & (time <= end)] = "impact" if maxima <= 1 else "contact"
        assert set(wanted) == {"flight", "impact", "contact"}
        away = np.abs(time[:, None] - own.time.to_numpy()).min(axis=1) > 1e-12
        assert (label == wanted)[away].all()
