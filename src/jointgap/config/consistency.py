"""What has to hold between a mechanism and what is done with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointgap.errors import InputError

if TYPE_CHECKING:
    from jointgap.config.mechanism_config import Mechanism
    from jointgap.config.scenario import Simulate

TOLERANCE_SHARE = 1e-4
"""Largest local error of positions as a share of a clearance: with more, steps jump over contacts."""

_ROUNDING = 1e-9  # relative: a clearance is the difference of two radii


def check_tolerance(mechanism: Mechanism, options: Simulate) -> None:
    """Whether the steps resolve the clearances.

    Parameters
    ----------
    mechanism : Mechanism
        Its effects applied.
    options : Simulate

    Raises
    ------
    InputError
        The tolerance is more than `TOLERANCE_SHARE` of the smallest clearance of a loose joint.
    """
    if not mechanism.loose:
        return
    name = min(mechanism.loose, key=mechanism.clearance)
    clearance = mechanism.clearance(name)
    if options.tolerance > TOLERANCE_SHARE * clearance * (1 + _ROUNDING):
        raise InputError(
            f"simulate.tolerance {options.tolerance:g} m is more than {TOLERANCE_SHARE:g} of the clearance {clearance:g} m of "
            f"{name}, the smallest of the loose joints: steps would jump over contacts; give {TOLERANCE_SHARE * clearance:.3g} m "
            "at most, or make the joint ideal"
        )


def check_drive(mechanism: Mechanism, options: Simulate) -> None:
    """Whether the effects go with the drive.

    Raises
    ------
    InputError
        A prescribed fluctuation of a speed that is not prescribed, or otherwise.
    """
    if mechanism.effect("speed_fluctuation") and options.drive.kind != "constant":
        raise InputError(
            f"mechanism.effects: speed_fluctuation goes with simulate.drive.kind constant alone, not with "
            f"{options.drive.kind}, whose speed is not prescribed so; leave out one of them"
        )
