"""Effects of zero size, and any combination of effects."""

import re

import numpy as np
import pytest

from jointgap.effects import EFFECTS
from jointgap.effects.base import example
from jointgap.motion.integrate import integrate
from jointgap.motion.sampling import fill_samples
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import ALL, LUGRE, MOTOR, effect, mechanism, options

SIZE = re.compile(
    "accel|force_N|torque_N_m|damping_N|drag|coefficient$|stiffness_N|unbalance|mass_kg|ratio$|offset_m"
)
OTHERS = ("pin_restitution", "common_pin_restitution", "rod_flexibility")
COMPARED = "time slider_position rod_angle r2 r3 crank_torque guide_force frame_force_x".split()
NOTHING = [
    one
    | {"parameters": one["parameters"] | {key: 0.0 for key in one["parameters"] if SIZE.match(key)}}
    for one in map(example, EFFECTS.values())
    if one["name"] not in OTHERS and any(map(SIZE.match, one["parameters"]))
]


@pytest.mark.parametrize("nothing", NOTHING)
def test_an_effect_of_zero_size_changes_nothing(nothing, worst):
    degrees = options(samples_per_revolution=90)
    without, with_it = (
        simulate(mechanism(*effects), degrees).samples for effects in ([], [nothing])
    )
    without, with_it = without[COMPARED][:12], with_it[COMPARED][:12]
    size = without.abs().max()
    deviation = ((with_it - without).abs().max() / size.where(size > 0, 1.0)).max()
    # A fluctuation of no size is still the other drive: rounding, which the first contacts amplify.
    worst("effect of no size", deviation, 1e-6 if nothing["name"] == "speed_fluctuation" else 1e-14)


OWN = {f"{joint}_clearance": effect(f"{joint}_clearance", clearance_m=5e-4) for joint in ALL}
OWN["pin_friction"] = effect("pin_friction", "piston_pin", coefficient=0.1)
OWN["lubricated_joint"] = effect("lubricated_joint", "crank_pin", viscosity_Pa_s=0.4, length_m=0.02)
OWN["discovered_slider_force"] = effect("discovered_slider_force", formula="-0.2*v*|v|")


def test_any_combination_runs_without_recompiling():
    every = [OWN.get(name, example(one)) for name, one in EFFECTS.items()]
    random = np.random.default_rng(5)
    still = [one for one in every if one["name"] != "speed_fluctuation"]
    strong = {"drive": MOTOR | {"stall_torque": 600.0}}  # enough for all loads at once
    for some, drive in ((random.permutation(every), {}), (random.permutation(still), strong)):
        chosen = options(revolutions=1, samples_per_revolution=36, tolerance=1e-8, **drive)
        loose = ["crank_pin", *(joint for joint in ALL[::2] if random.random() < 0.6)]
        simulate(mechanism(*some, loose=loose, **LUGRE), chosen)
    assert len(integrate.signatures) == 1
    assert len(fill_samples.signatures) == 1
