"""The force that the effects of a verdict add, along the motion of each run."""

import math
from collections.abc import Collection, Mapping

import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.dynamics.model.compile_parameters import parameters
from jointgap.dynamics.model.effect_laws import crank_losses, slider_force
from jointgap.dynamics.simulation import simulate
from jointgap.slider_crank.channel_kinematics import tolerance_for

_SAMPLES = 360  # of the one revolution that is shown
_SETTLES = 2  # revolutions


def missing_force(
    base: Mechanism, augmented: Mechanism, speeds: Mapping[str, float], clockwise: Collection[str] = ()
) -> pd.DataFrame:
    """Force on the slider and torque on the crank of the augmented model less those of the base, at the same motion.

    Effects that act otherwise (masses, lengths, clearances, sensors) leave both at zero.
    """
    parts = []
    for run, speed in speeds.items():
        if run not in clockwise:
            parts.append(_along(run, base, augmented, speed))
            continue
        behind = _along(run, base.applied().mirrored(), augmented.applied().mirrored(), speed).iloc[::-1]
        turned = {"crank_angle": math.tau - behind["crank_angle"], "crank_torque": -behind["crank_torque"]}
        parts.append(behind.assign(**turned))
    return pd.concat(parts, ignore_index=True)


def _along(run: str, base: Mechanism, augmented: Mechanism, speed: float) -> pd.DataFrame:
    options = Simulate(
        speed=speed,
        revolutions=_SETTLES + 1,
        samples_per_revolution=_SAMPLES,
        tolerance=tolerance_for(augmented.applied()),
    )
    samples = simulate(augmented, options).samples.tail(_SAMPLES + 1)
    places = samples[["slider_position", "slider_velocity", "crank_speed", "crank_angle", "time"]].to_numpy()
    guide = samples["guide_force"].to_numpy()
    after, before = parameters(augmented, options), parameters(base, options)
    pushes = [slider_force(after, n, *at) - slider_force(before, n, *at) for n, at in zip(guide, places, strict=True)]
    turns = [crank_losses(after, *at) - crank_losses(before, *at) for at in places]
    return pd.DataFrame(
        {
            "run": run,
            "crank_angle": samples["crank_angle"].to_numpy() - math.tau * _SETTLES,
            "slider_position": places[:, 0],
            "slider_velocity": places[:, 1],
            "slider_force": pushes,
            "crank_torque": turns,
        }
    )
