"""A measured load on the slider: force or pressure over crank angle or time."""

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from jointgap.core.csv_files import Csv, read_columns
from jointgap.core.errors import InputError
from jointgap.core.section import ConfigModel
from jointgap.core.units import Angle, PositiveLength, quantity, unit_factor
from jointgap.effects.base import Effect, Records, register_effect

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline, PPoly

#: Pieces of a table's spline (0.2 deg over 720 deg: 3600); longer tables are thinned.
MOST_ROWS = 4096

_LEAST_ROWS = 8
_CLOSED = 0.02  # [1, of the range] largest difference between begin and end of a table
_GAP = 3.0  # [1, of the median step] largest gap between the last row and the next period
_SI = {"angle": "rad", "time": "s", "force": "N", "pressure": "Pa"}


class TableColumn(ConfigModel):
    """A column of a table of loads."""

    column: str = Field(min_length=1, description="heading of the column")
    unit: str = Field(description="unit, such as deg, s, N, kN, bar or MPa")


class ForceTableParameters(ConfigModel):
    """Parameters of ``slider_force_table``."""

    file: str = Field(
        min_length=1,
        description="CSV or Parquet file of one period; path relative to the file with the effect",
        examples=["examples/compressor_indicator.csv"],
    )
    angle: TableColumn | None = Field(
        None,
        description="crank angle, 0 with the slider farthest out; the period is 360 or 720 deg",
        examples=[{"column": "angle", "unit": "deg"}],
    )
    time: TableColumn | None = Field(
        None, description="time of the simulation or of the runs' records, instead of the angle", examples=[None]
    )
    force: TableColumn | None = Field(
        None, description="force on the slider along +x, towards the farthest-out position", examples=[None]
    )
    pressure: TableColumn | None = Field(
        None,
        description="absolute pressure of the gas beyond the slider, instead of the force",
        examples=[{"column": "pressure", "unit": "bar"}],
    )
    bore: PositiveLength | None = Field(None, description="diameter on which the pressure acts", examples=["70 mm"])
    ambient_pressure: quantity("Pa", ge=0) = Field(
        101325.0, description="pressure on the slider's other side; 0 for gauge pressures", examples=["1 bar"]
    )
    zero: Angle = Field(0.0, description="crank angle at which the table's angle is 0", examples=["0 deg"])
    reversed: bool = Field(
        False,
        description="whether the table's angle increases clockwise",
        examples=[False],
    )
    period: quantity("s", gt=0) | None = Field(
        None, description="period of a table over time whose last row does not repeat the first", examples=[None]
    )

    @field_validator(*_SI)
    @classmethod
    def _has_its_unit(cls, given: TableColumn | None, info: Any) -> TableColumn | None:
        if given is not None:
            try:
                unit_factor(given.unit, _SI[info.field_name])
            except ValueError as error:
                raise ValueError(f"unit = '{given.unit}' {error}") from error
        return given

    @model_validator(mode="after")
    def _says_one_load(self):
        for one, other in (("angle", "time"), ("force", "pressure")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(f"requires either {one} or {other}, e.g. {one}: {{column: a, unit: {_SI[one]}}}")
        if (self.pressure is None) != (self.bore is None):
            raise ValueError("pressure and bore require each other; give both, or the force")
        if self.period is not None and self.time is None:
            raise ValueError("period is only for a table over time (over the angle: 360 or 720 deg); remove it")
        return self


@register_effect(order=85)
class SliderForceTable(Effect):
    """A known periodic load, such as an indicator diagram, interpolated by a cubic spline."""

    GROUP, SITE = "slider", "slider"
    LAW = "F = table(theta) or table(t), periodic cubic spline; of a pressure F = -(p - p_ambient) pi bore^2 / 4"
    WORDS = "a measured load on the slider"
    PARAMETERS = ForceTableParameters

    def check(self, mechanism: Any) -> None:
        if Path(self.parameters.file).is_file():  # otherwise the simulation raises the error
            _table(self.parameters)

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        given, (pieces, begin, period, _) = self.parameters, _table(self.parameters)
        sign, timed = -1.0 if given.reversed else 1.0, given.time is not None
        begin += 0.0 if timed else sign * given.zero
        stated = {"table_over": 2 if timed else 1, "table_sign": sign, "table_begin": begin, "table_period": period}
        records["effects"] |= stated
        records["tables"]["slider_table"] = pieces

    def largest_force(self, stroke: float) -> float:
        there = Path(self.parameters.file).is_file()  # otherwise the simulation raises the error
        return float(np.abs(_table(self.parameters)[0][:, -1]).max()) if there else 0.0

    def remarks(self) -> tuple[str, ...]:
        """Outliers and thinning of the table."""
        return _table(self.parameters)[3] if Path(self.parameters.file).is_file() else ()

    def mirrored(self) -> Effect:
        return self.with_parameters(reversed=not self.parameters.reversed, zero=-self.parameters.zero)


#: Pieces (k, 5) of the force [N] over one period (begin and cubic polynomial, highest power first), begin of the first
#: and period [rad or s], remarks.
_Table = tuple[np.ndarray, float, float, tuple[str, ...]]


def _table(given: ForceTableParameters) -> _Table:
    try:
        changed = Path(given.file).stat().st_mtime_ns
    except OSError as error:
        raise InputError(f"slider_force_table: file {given.file} cannot be read ({error.strerror})") from error
    return _read_table(given, changed)


@lru_cache(16)
def _read_table(given: ForceTableParameters, _changed: int) -> _Table:
    from scipy.interpolate import CubicSpline

    from jointgap.core.outliers import spikes

    over, load = ("angle" if given.time is None else "time"), ("force" if given.pressure is None else "pressure")
    path, stated = Path(given.file), {key: getattr(given, key) for key in (over, load)}
    columns = read_columns(path, [stated[over].column, stated[load].column], Csv())

    def wrong(key: str, text: str) -> InputError:
        return InputError(f"{path}, column {stated[key].column}{text}")

    factors = {key: unit_factor(stated[key].unit, _SI[key]) for key in (over, load)}
    for key, factor in factors.items():
        if other := columns.other_unit(stated[key].column, factor, _SI[key]):
            text = f"the row below the headings says '{other}', but {key}.unit is '{stated[key].unit}'"
            raise wrong(key, f": {text}; correct one of them")
    place, value = (columns.values[stated[key].column] * factor for key, factor in factors.items())
    kept = np.isfinite(place) & np.isfinite(value)
    place, value, rows = place[kept], value[kept], columns.rows[kept]
    if place.size < _LEAST_ROWS:
        raise wrong(over, f": {place.size} rows; give {_LEAST_ROWS} rows of one period or more")
    again = np.flatnonzero((np.diff(place) == 0.0) & (np.abs(np.diff(value)) <= _CLOSED * np.ptp(value))) + 1
    place, value, rows = (np.delete(each, again) for each in (place, value, rows))
    if (falls := np.flatnonzero(np.diff(place) <= 0.0)).size:
        raise wrong(over, f", row {rows[falls[0] + 1]}: not increasing; give one period in increasing order")
    odd, remarks = spikes(value), ()
    if odd.size:
        shown = f"{value[odd[0]] / factors[load]:g} {stated[load].unit}"
        others = f" and {odd.size - 1} more" if odd.size > 1 else ""
        text = f"row {rows[odd[0]]}{others}: {shown} is far from its neighbours; if misread, leave the cell empty"
        remarks += (f"{path}, column {stated[load].column}, {text}",)
    if load == "pressure":
        if given.ambient_pressure > 0.0 and (below := np.flatnonzero(value < 0.0)).size:
            text = "negative absolute pressure; give 'ambient_pressure: 0' for gauge pressures"
            raise wrong(load, f", row {rows[below[0]]}: {text}")
        value = (given.ambient_pressure - value) * 0.25 * math.pi * given.bore**2
    span, step = place[-1] - place[0], float(np.median(np.diff(place)))
    periods = (math.tau, 2.0 * math.tau) if given.time is None else (given.period or span,)
    fitting = [one for one in periods if one * (1.0 - 1e-6) - _GAP * step <= span <= one * (1.0 + 1e-6)]
    if not fitting and given.time is not None:
        raise wrong(over, f": the rows span {span:.6g} s, but the period is {periods[0]:.6g} s; correct one of them")
    if not fitting:
        text = f": the rows span {math.degrees(span):.6g} deg in steps of {math.degrees(step):.3g}, neither 360 nor 720"
        raise wrong(over, f"{text} deg; give one full period, or correct the unit of the angle")
    period = float(fitting[0])
    apart, most = abs(value[-1] - value[0]), _CLOSED * np.ptp(value)
    repeats = span > (1.0 - 1e-6) * period  # the last row is the first one of the next period
    if apart > (most if repeats else max(most, _GAP * np.abs(np.diff(value)).max())):
        text = f": not periodic: begin and end differ by {apart:.4g} N on the slider, the range is"
        raise wrong(load, f"{text} {np.ptp(value):.4g} N; give one full period, averaged over cycles")
    if repeats:
        place, value = place[:-1], value[:-1]
    spline = CubicSpline(np.append(place - place[0], period), np.append(value, value[0]), bc_type="periodic")
    if place.size > MOST_ROWS:
        spline, error = _thinned(spline, period)
        remarks += (
            f"{path}: {rows.size} rows are thinned to a spline of {spline.x.size - 1} pieces; it deviates from the "
            f"spline through all rows by at most {error:.2g} N, {100.0 * error / (np.ptp(value) or 1.0):.2g} % of the "
            "range",
        )
    return np.column_stack([spline.x[:-1], spline.c.T]), float(place[0]), period, remarks


def _thinned(full: "CubicSpline", period: float) -> "tuple[PPoly, float]":
    """The periodic spline with a knot at every n-th row, fitted to all rows by least squares; its largest difference
    from the `full` one at and between the rows.
    """
    from scipy.interpolate import PPoly, make_lsq_spline

    place, margin = full.x[:-1], 20  # knots before and after the period, beyond which the ends have no influence
    stride = -(-place.size // MOST_ROWS)
    knots = np.append(place[::stride], period)
    outside = np.concatenate([knots[-margin - 1 : -1] - period, knots, knots[1 : margin + 1] + period])
    rows = np.concatenate([place - period, place, place + period])
    rows = rows[(rows >= outside[0]) & (rows <= outside[-1])]
    fit = make_lsq_spline(rows, full(rows), np.concatenate([outside[:1].repeat(3), outside, outside[-1:].repeat(3)]))
    pieces = PPoly.from_spline(fit)
    first = int(np.searchsorted(pieces.x, 0.0, side="right")) - 1
    spline = PPoly(pieces.c[:, first : first + knots.size - 1], knots)
    between = np.concatenate([place, 0.5 * (full.x[:-1] + full.x[1:])])
    return spline, float(np.abs(spline(between) - full(between)).max())
