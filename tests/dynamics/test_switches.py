"""Effects are off by default, at zero size they are as if off, and any combination runs without compiling anew."""

import numpy as np
import pytest

from jointgap.dynamics.integrate import integrate
from jointgap.dynamics.sampling import fill_samples
from jointgap.dynamics.simulation import simulate
from jointgap.effects import EFFECTS
from jointgap.effects.base import example
from tests.dynamics.cases import ALL, LUGRE, MOTOR, PINS, effect, mechanism, options

NOTHING = [
    effect("gravity", acceleration_m_s2=0.0),
    effect("slider_coulomb_friction", force_N=0.0),
    effect("slider_viscous_friction", damping_N_s_m=0.0),
    effect("slider_quadratic_drag", drag_N_s2_m2=0.0),
    effect("slider_stribeck_friction", force_N=0.0, stribeck_speed_m_s=1.0, stribeck_share=1.0),
    effect("slider_position_friction", force_N=0.0, tightest_position_m=0.5, length_m=0.3, varying_share=1.0),
    effect("slider_power_drag", force_N=0.0, speed_m_s=1.0, exponent=3.0),
    effect("slider_load_friction", coefficient=0.0),
    effect("slider_constant_force", force_N=0.0),
    effect("slider_spring", stiffness_N_m=0.0, rest_position_m=0.5),
    effect("slider_nonlinear_spring", stiffness_N_m=0.0, rest_position_m=0.5, length_m=0.1, cubic_share=1.0),
    effect("gas_pressure", force_N=0.0, dead_length_m=0.05, exponent=1.3),
    effect("harmonic_force", force_N=0.0, frequency_Hz=37.0, phase_rad=0.4),
    effect("pin_friction", "crank_pin", coefficient=0.0),
    effect("crank_coulomb_friction", torque_N_m=0.0),
    effect("crank_angle_friction", torque_N_m=0.0, varying_share=1.0),
    effect("crank_viscous_friction", damping_N_m_s=0.0),
    effect("crank_unbalance", unbalance_kg_m=0.0),
    effect("added_slider_mass", mass_kg=0.0),
    effect("speed_fluctuation", ratio=0.0, order=2),
    effect("slider_offset", offset_m=0.0),
    effect("link_length_error"),
    effect("discovered_slider_force", formula="0*v"),
    effect("discovered_crank_torque", formula="0*w"),
]
COMPARED = ["time", "slider_position", "rod_angle", "r2", "r3", "crank_torque", "guide_force", "frame_force_x"]


@pytest.mark.parametrize("loose", ((), PINS))
@pytest.mark.parametrize("nothing", NOTHING, ids=lambda one: one["name"])
def test_an_effect_of_no_size_changes_nothing(nothing, loose, worst):
    degrees = options(samples_per_revolution=90)
    without, with_it = (simulate(mechanism(*effects, loose=loose), degrees).samples for effects in ([], [nothing]))
    without, with_it = without[COMPARED][:12], with_it[COMPARED][:12]
    size = without.abs().max()
    deviation = ((with_it - without).abs().max() / size.where(size > 0, 1.0)).max()
    # A fluctuation of no size is still the other drive: rounding, which the first contacts amplify.
    worst("effect of no size", deviation, 1e-6 if nothing["name"] == "speed_fluctuation" else 1e-14)


@pytest.mark.parametrize(
    "drive", ({}, {"drive": MOTOR | {"stall_torque": 600.0}})
)  # strong enough for all loads at once
def test_any_combination_runs_through_and_nothing_is_compiled_anew(drive):
    effects = [example(one) for one in EFFECTS.values()]
    left_out = {"speed_fluctuation"} if drive else set()
    every = [one for one in effects if one["name"] not in left_out]
    every = [one | {"site": "piston_pin"} if one["name"] == "pin_friction" else one for one in every]
    clearances = {f"{joint}_clearance" for joint in ALL}
    chosen = options(revolutions=1, samples_per_revolution=36, tolerance=1e-9, **drive)
    random = np.random.default_rng(5)
    for count in (0, 1, 3, 6, 12, len(every)):
        some = [every[i] for i in random.choice(len(every), count, replace=False)]
        loose = [joint for joint in ALL if random.random() < 0.6]
        if any(one["name"] == "lubricated_joint" for one in some) and "crank_pin" not in loose:
            loose.append("crank_pin")
        for one in some:
            if one["name"] in clearances:
                one["parameters"] = {"clearance_m": 5e-4}
            if one["name"] == "discovered_slider_force":
                one["parameters"] = {"formula": "-a*v*|v|", "coefficients": {"a": 0.2}}
        simulate(mechanism(*some, loose=loose, **(LUGRE if count % 2 else {})), chosen)
    assert len(integrate.signatures) == 1
    assert len(fill_samples.signatures) == 1
