"""Derivatives of a simulated motion by numbers of its mechanism or drive."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.variations import change, number_at
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT
from jointgap.core.schema import TRAJECTORY
from jointgap.core.units import quotient
from jointgap.motion import linkage, slider_crank
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Columns, Model
from jointgap.motion.sensitivity import Varied, derivatives
from jointgap.motion.simulation import crank_angles, mirrored_drive, observed

_STEP = 1e-7  # [1] Of differences by a number, over it
_CLEARANCE_STEP = 1e-12  # [m] Largest change of a clearance in one: penetrations are small
_UNPREDICTABLE = 1e4  # [1] Clearances by which a pin would move, over the share of a number
_OF_DRIVE = ("speed", "drive")


class _Case(NamedTuple):
    """What is simulated."""

    mechanism: Mechanism | LinkageFile
    options: Simulate
    perturbation: np.ndarray | None = None

    def number(self, key: str) -> tuple[float, str]:
        """The number at a key, and its unit; the clearance of a pin follows from its radii."""
        if key.partition(".")[0] in _OF_DRIVE:
            return number_at(self.options, key, f"derivatives: {key}")
        if (name := self._pin(key)) is not None:
            return self.mechanism.joint(name).clearance, "m"
        return number_at(self.mechanism, key, f"derivatives: {key}")

    def with_number(self, key: str, value: float) -> "_Case":
        """With another number at a key."""
        if key.partition(".")[0] in _OF_DRIVE:
            return self._replace(options=change(self.options, {key: value}))
        return self._replace(mechanism=change(self.mechanism, {key: value}))

    def _pin(self, key: str) -> str | None:
        """The loose revolute joint whose clearance is at a key."""
        first, _, rest = key.partition(".")
        name, _, last = rest.partition(".")
        if first == "joints" and last == "clearance" and name in self.mechanism.loose:
            return name if hasattr(self.mechanism.joint(name), "journal_radius") else None
        return None

    @property
    def is_clockwise(self) -> bool:
        return self.options.speed < 0

    def model(self) -> tuple[Model, np.ndarray]:
        """The model and its start, of the mirror image if the crank turns clockwise."""
        mechanism, options, perturbation = self
        if self.is_clockwise:
            mechanism = mechanism.applied().mirrored()
            options = mirrored_drive(options)
            if perturbation is not None:
                perturbation = slider_crank.mirrored(perturbation)
        if isinstance(mechanism, LinkageFile):
            model = linkage.linkage_model(mechanism, options)
            return model, model.start()
        model = slider_crank.model_of(mechanism, options)
        return model, slider_crank.start_state(model, perturbation)


def derivatives_of(
    mechanism: Mechanism | LinkageFile,
    options: Simulate,
    keys: Sequence[str],
    perturbation: np.ndarray | None = None,
) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """Derivatives of the samples of `jointgap.simulate` by the numbers at `keys`, see there; and
    remarks on those that hold for tiny changes only."""
    if isinstance(keys, str):
        raise InputError(f"derivatives: is text, not a list of keys; write ['{keys}']")
    keys = tuple(keys)
    for key in keys:
        if not isinstance(key, str):
            raise InputError(f"derivatives: {key!r} is not a key, such as 'rod.length'")
    if not keys:
        return {}, ()
    case = _Case(mechanism, options, perturbation)
    model, start = case.model()
    varied, units, values = [], [], []
    for given in keys:
        key = given.removeprefix("mechanism.").removeprefix("simulate.")
        value, unit = case.number(key)
        varied.append(_varied(case, model, key, value))
        units.append(unit)
        values.append(value)
    is_linkage = isinstance(mechanism, LinkageFile)
    of_column = {column.name: column.unit for column in TRAJECTORY.columns}
    of_column = model.units if is_linkage else of_column

    def seen(model: Model, motion: Samples) -> Columns:
        columns = observed(model, motion)
        if is_linkage:
            return linkage.published(model, columns)
        return {name: columns[name] for name in of_column if name in columns}

    angles = crank_angles(mirrored_drive(options) if case.is_clockwise else options)
    found = derivatives(model, start, angles, options.tolerance, varied, seen)
    tables, remarks, turned = {}, [], set()
    if case.is_clockwise:
        turned = (
            linkage.turned_by_mirror(mechanism, of_column)
            if is_linkage
            else {name for name in of_column if slider_crank.turns_sign(name)}
        )
        turned |= {"transmission_angle"}
    for key, unit, value, columns in zip(keys, units, values, found, strict=True):
        signs = {name: -1.0 if name in turned else 1.0 for name in columns}
        table = pd.DataFrame({name: signs[name] * values for name, values in columns.items()})
        table.attrs["units"] = {name: quotient(of_column.get(name, ""), unit) for name in table}
        tables[key] = table
        remarks += _remark(model, key, value, columns)
    return tables, tuple(remarks)


def _remark(model: Model, key: str, value: float, columns: Columns) -> list[str]:
    """A remark if a tiny change of the number at a key moves a pin through its clearance."""
    size = abs(value) or 1.0
    moved = [
        size * float(np.nanmax(np.abs(columns[name]))) / model.bearings[pin].clearance
        for pin in model.pins
        for name in (f"r_{pin}", f"r{JOINT[pin].number}" if pin in JOINT else "")
        if name in columns
    ]
    largest = max(moved, default=0.0)
    if not largest > _UNPREDICTABLE:
        return []
    return [
        f"Derivatives by {key}: a change by {1.0 / largest:.0e}{' of its value' if value else ''}"
        " would move a pin"
        " through its clearance. The motion is chaotic; its derivatives hold for smaller changes"
        " only. Simulate fewer revolutions, or compare statistics of several starts."
    ]


def _varied(case: _Case, model: Model, key: str, value: float) -> Varied:
    """The model with the number at a key increased by a small step, or decreased at its upper
    limit."""
    step = _STEP * (abs(value) or 1.0)
    for _ in range(2):
        try:
            there, start = case.with_number(key, value + step).model()
        except InputError:
            step = -step
            there, start = case.with_number(key, value + step).model()
        if there.variant is not model.variant or there.states != model.states:
            raise InputError(
                f"derivatives: {key} = {value:g}: next to this value the motion has other"
                " equations; give a slightly different value"
            )
        wider = [
            abs(there.bearings[name].clearance - model.bearings[name].clearance)
            for name in model.contacts
        ]
        largest = max(wider, default=0.0)
        if largest <= _CLEARANCE_STEP:
            break
        step *= _CLEARANCE_STEP / largest
    return Varied(there, start, step)
