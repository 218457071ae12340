"""A measured load on the slider: force or pressure over crank angle or time."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

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
_MOST_PERIODS = 64  # of a table over time within the common period of several
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
        None,
        description="time of the simulation or of the runs' records, instead of the angle",
        examples=[None],
    )
    force: TableColumn | None = Field(
        None,
        description="force on the slider along +x, towards the farthest-out position",
        examples=[None],
    )
    pressure: TableColumn | None = Field(
        None,
        description="absolute pressure of the gas beyond the slider, instead of the force",
        examples=[{"column": "pressure", "unit": "bar"}],
    )
    bore: PositiveLength | None = Field(
        None, description="diameter on which the pressure acts", examples=["70 mm"]
    )
    ambient_pressure: quantity("Pa", ge=0) = Field(
        101325.0,
        description="pressure on the slider's other side; 0 for gauge pressures",
        examples=["1 bar"],
    )
    side: Literal["head", "crank"] = Field(
        "head",
        description="crank: the pressure acts on the slider's side towards the crank",
        examples=["head"],
    )
    pressure_zero: quantity("Pa") = Field(
        0.0, description="added to each pressure", examples=["0 bar"]
    )
    pressure_gain: quantity("", gt=0) = Field(
        1.0, description="factor on each pressure", examples=[1.0]
    )
    zero: Angle = Field(
        0.0, description="crank angle at which the table's angle is 0", examples=["0 deg"]
    )
    reversed: bool = Field(
        False,
        description="whether the table's angle increases clockwise",
        examples=[False],
    )
    period: quantity("s", gt=0) | None = Field(
        None,
        description="period of a table over time whose last row does not repeat the first",
        examples=[None],
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
                raise ValueError(
                    f"requires either {one} or {other}, e.g. {one}: {{column: a, unit: {_SI[one]}}}"
                )
        if (self.pressure is None) != (self.bore is None):
            raise ValueError("pressure and bore require each other; give both, or the force")
        of_pressure = {
            key: getattr(self, key) for key in ("side", "pressure_zero", "pressure_gain")
        }
        if self.pressure is None and of_pressure != {
            key: type(self).model_fields[key].default for key in of_pressure
        }:
            raise ValueError(f"{', '.join(of_pressure)} are only for a pressure; remove them")
        if self.period is not None and self.time is None:
            raise ValueError(
                "period is only for a table over time (over the angle: 360 or 720 deg); remove it"
            )
        return self


@register_effect(order=85)
class SliderForceTable(Effect):
    """A known periodic load, such as an indicator diagram, interpolated by a cubic spline."""

    GROUP, SITE = "slider", "slider"
    LAW = (
        "F = table(theta) or table(t), periodic cubic spline; of a pressure F = -(p - p_ambient) pi"
        " bore^2 / 4, on the crank's side with the other sign"
    )
    WORDS = "a measured load on the slider"
    PARAMETERS = ForceTableParameters
    SEVERAL = True

    def check(self, mechanism: Any) -> None:
        tables = [one for one in mechanism.effects if isinstance(one, SliderForceTable)]
        if all(
            Path(one.parameters.file).is_file() for one in tables
        ):  # otherwise the simulation raises the error
            records: Records = {"effects": {}, "tables": {}}
            for one in tables:
                one.compile_into(records)

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        given, (pieces, begin, period, _) = self.parameters, _table(self.parameters)
        sign, timed = -1.0 if given.reversed else 1.0, given.time is not None
        begin += 0.0 if timed else sign * given.zero
        add_table(records, Table(2 if timed else 1, sign, begin, period, pieces))

    def largest_force(self, stroke: float) -> float:
        there = Path(self.parameters.file).is_file()  # otherwise the simulation raises the error
        return float(np.abs(_table(self.parameters)[0][:, -1]).max()) if there else 0.0

    def remarks(self) -> tuple[str, ...]:
        """Outliers and thinning of the table."""
        return _table(self.parameters)[3] if Path(self.parameters.file).is_file() else ()

    def mirrored(self) -> Effect:
        return self.with_parameters(
            reversed=not self.parameters.reversed, zero=-self.parameters.zero
        )


class Table(NamedTuple):
    """A periodic force on the slider as the equations of motion read it."""

    over: int  # 1: the crank angle, 2: time
    sign: float  # -1: over the angle that increases clockwise
    begin: float  # of the first piece and of the period [rad or s]
    period: float
    pieces: np.ndarray  # (k, 5) begin and cubic polynomial, highest power first [N]


def add_table(records: Records, table: Table) -> None:
    """Add a `table` to the `records` of the equations of motion, which have one: the sum of all."""
    listed = records["tables"].setdefault("listed", [])
    listed.append(table)
    known = table if len(listed) == 1 else _sum(listed)
    stated = {f"table_{key}": getattr(known, key) for key in ("over", "sign", "begin", "period")}
    records["effects"] |= stated | {"on_slider": True}
    records["tables"]["slider_table"] = known.pieces


def with_pressure_sensor(
    effects: Iterable[Effect], values: Mapping[str, float]
) -> tuple[Effect, ...]:
    """`effects` whose pressures have the zero and the gain in `values`, as far as they are
    there."""
    given = {key: values[key] for key in ("pressure_zero", "pressure_gain") if key in values}
    if not given:
        return tuple(effects)
    return tuple(
        one.with_parameters(**given) if getattr(one.parameters, "bore", None) else one
        for one in effects
    )


def _sum(tables: Sequence[Table]) -> Table:
    """The sum of periodic splines: a spline with the knots of all over their common period."""
    from scipy.interpolate import CubicSpline, PPoly

    if len({table.over for table in tables}) > 1:
        raise InputError(
            "slider_force_table: one load is over the crank angle and another one over time, which"
            " cannot be added; give all over the angle, or all over time"
        )
    longest = max(table.period for table in tables)
    period = next(
        (n * longest for n in range(1, _MOST_PERIODS) if _repeats(n * longest, tables)), None
    )
    if period is None:
        stated = " and ".join(f"{table.period:.6g} s" for table in tables)
        raise InputError(
            f"slider_force_table: the periods {stated} have no common multiple; give the same"
            " period"
        )
    splines, knots = [], [np.array([0.0, period])]
    for table in tables:
        ends = np.append(table.pieces[:, 0], table.period)
        splines.append(PPoly(table.pieces[:, 1:].T, ends))
        places = table.sign * (
            ends[:-1]
            + table.begin
            + table.period * np.arange(round(period / table.period))[:, None]
        )
        knots.append(np.mod(places, period).ravel())
    knots = np.unique(np.concatenate(knots))
    knots = knots[np.append(np.diff(knots) > 1e-9 * period, True)]
    knots[0] = 0.0

    def derivatives(places: np.ndarray) -> np.ndarray:
        """Coefficients (4, n) of the sum about `places` (n,), highest power first."""
        found = np.zeros((4, places.size))
        for table, spline in zip(tables, splines, strict=True):
            at = np.mod(table.sign * places - table.begin, table.period)
            for order in range(4):
                found[3 - order] += table.sign**order * spline(at, order) / math.factorial(order)
        return found

    if knots.size - 1 > MOST_ROWS:
        knots = np.linspace(0.0, period, MOST_ROWS + 1)
        values = derivatives(knots[:-1])[3]
        spline = CubicSpline(knots, np.append(values, values[0]), bc_type="periodic")
        return Table(tables[0].over, 1.0, 0.0, period, np.column_stack([knots[:-1], spline.c.T]))
    half = 0.5 * np.diff(knots)
    a, b, c, d = derivatives(
        knots[:-1] + half
    )  # in the middle, where no knot is, and from there to the begin
    pieces = (
        a,
        b - 3 * a * half,
        c - 2 * b * half + 3 * a * half**2,
        d - c * half + b * half**2 - a * half**3,
    )
    return Table(tables[0].over, 1.0, 0.0, period, np.column_stack([knots[:-1], *pieces]))


def _repeats(period: float, tables: Sequence[Table]) -> bool:
    return all(abs(period / each.period - round(period / each.period)) < 1e-6 for each in tables)


#: Pieces (k, 5) of the force [N] over one period (begin and cubic polynomial, highest power first),
#: begin of the first and period [rad or s], remarks.
_Table = tuple[np.ndarray, float, float, tuple[str, ...]]


def _table(given: ForceTableParameters) -> _Table:
    try:
        changed = Path(given.file).stat().st_mtime_ns
    except OSError as error:
        raise InputError(
            f"slider_force_table: file {given.file} cannot be read ({error.strerror})"
        ) from error
    plain = {
        key: type(given).model_fields[key].default for key in ("pressure_zero", "pressure_gain")
    }
    pieces, *others = _read_table(given.model_copy(update=plain), changed)
    if given.pressure is not None:
        pieces = corrected(pieces, given, given.pressure_zero, given.pressure_gain)
    return pieces, *others


def piston_area(given: Any) -> float:
    """Area [m^2] on which a pressure acts along -x: negative on the side of the crank."""
    return (-0.25 if given.side == "crank" else 0.25) * math.pi * given.bore**2


def corrected(pieces: np.ndarray, given: Any, zero: float, gain: float) -> np.ndarray:
    """The `pieces` of a force by a pressure p as read, for the pressure ``gain p + zero``."""
    if zero == 0.0 and gain == 1.0:
        return pieces
    pieces = np.hstack([pieces[:, :1], gain * pieces[:, 1:]])
    pieces[:, -1] += ((1.0 - gain) * given.ambient_pressure - zero) * piston_area(given)
    return pieces


@lru_cache(64)
def _read_table(given: ForceTableParameters, _changed: int) -> _Table:
    from scipy.interpolate import CubicSpline

    from jointgap.core.outliers import spikes

    over, load = (
        ("angle" if given.time is None else "time"),
        ("force" if given.pressure is None else "pressure"),
    )
    path, stated = Path(given.file), {key: getattr(given, key) for key in (over, load)}
    columns = read_columns(path, [stated[over].column, stated[load].column], Csv())

    def wrong(key: str, text: str) -> InputError:
        return InputError(f"{path}, column {stated[key].column}{text}")

    factors = {key: unit_factor(stated[key].unit, _SI[key]) for key in (over, load)}
    for key, factor in factors.items():
        if other := columns.other_unit(stated[key].column, factor, _SI[key]):
            text = (
                f"the row below the headings says '{other}', but {key}.unit is '{stated[key].unit}'"
            )
            raise wrong(key, f": {text}; correct one of them")
    place, value = (columns.values[stated[key].column] * factor for key, factor in factors.items())
    kept = np.isfinite(place) & np.isfinite(value)
    place, value, rows = place[kept], value[kept], columns.rows[kept]
    if place.size < _LEAST_ROWS:
        raise wrong(over, f": {place.size} rows; give {_LEAST_ROWS} rows of one period or more")
    again = (
        np.flatnonzero(
            (np.diff(place) == 0.0) & (np.abs(np.diff(value)) <= _CLOSED * np.ptp(value))
        )
        + 1
    )
    place, value, rows = (np.delete(each, again) for each in (place, value, rows))
    if (falls := np.flatnonzero(np.diff(place) <= 0.0)).size:
        raise wrong(
            over, f", row {rows[falls[0] + 1]}: not increasing; give one period in increasing order"
        )
    odd, remarks = spikes(value), ()
    if odd.size:
        shown = f"{value[odd[0]] / factors[load]:g} {stated[load].unit}"
        others = f" and {odd.size - 1} more" if odd.size > 1 else ""
        text = (
            f"row {rows[odd[0]]}{others}: {shown} is far from its neighbours; if misread, leave the"
            " cell empty"
        )
        remarks += (f"{path}, column {stated[load].column}, {text}",)
    if load == "pressure":
        if given.ambient_pressure > 0.0 and (below := np.flatnonzero(value < 0.0)).size:
            text = "negative absolute pressure; give 'ambient_pressure: 0' for gauge pressures"
            raise wrong(load, f", row {rows[below[0]]}: {text}")
        value = (given.ambient_pressure - value) * piston_area(given)
    span, step = place[-1] - place[0], float(np.median(np.diff(place)))
    periods = (math.tau, 2.0 * math.tau) if given.time is None else (given.period or span,)
    fitting = [
        one for one in periods if one * (1.0 - 1e-6) - _GAP * step <= span <= one * (1.0 + 1e-6)
    ]
    if not fitting and given.time is not None:
        raise wrong(
            over,
            f": the rows span {span:.6g} s, but the period is {periods[0]:.6g} s; correct one of"
            " them",
        )
    if not fitting:
        text = (
            f": the rows span {math.degrees(span):.6g} deg in steps of {math.degrees(step):.3g},"
            " neither 360 nor 720"
        )
        raise wrong(over, f"{text} deg; give one full period, or correct the unit of the angle")
    period = float(fitting[0])
    apart, most = abs(value[-1] - value[0]), _CLOSED * np.ptp(value)
    repeats = span > (1.0 - 1e-6) * period  # the last row is the first one of the next period
    if apart > (most if repeats else max(most, _GAP * np.abs(np.diff(value)).max())):
        text = f": not periodic: begin and end differ by {apart:.4g} N on the slider, the range is"
        raise wrong(
            load, f"{text} {np.ptp(value):.4g} N; give one full period, averaged over cycles"
        )
    if repeats:
        place, value = place[:-1], value[:-1]
    spline = CubicSpline(
        np.append(place - place[0], period), np.append(value, value[0]), bc_type="periodic"
    )
    if place.size > MOST_ROWS:
        spline, error = _thinned(spline, period)
        remarks += (
            (
                f"{path}: {rows.size} rows are thinned to a spline of {spline.x.size - 1} pieces;"
                f" it deviates from the spline through all rows by at most {error:.2g} N,"
                f" {100.0 * error / (np.ptp(value) or 1.0):.2g} % of the range"
            ),
        )
    return np.column_stack([spline.x[:-1], spline.c.T]), float(place[0]), period, remarks


def _thinned(full: "CubicSpline", period: float) -> "tuple[PPoly, float]":
    """The periodic spline with a knot at every n-th row, fitted to all rows by least squares; its
    largest difference from the `full` one at and between the rows.
    """
    from scipy.interpolate import PPoly, make_lsq_spline

    place, margin = (
        full.x[:-1],
        20,
    )  # knots before and after the period, beyond which the ends have no influence
    stride = -(-place.size // MOST_ROWS)
    knots = np.append(place[::stride], period)
    outside = np.concatenate(
        [knots[-margin - 1 : -1] - period, knots, knots[1 : margin + 1] + period]
    )
    rows = np.concatenate([place - period, place, place + period])
    rows = rows[(rows >= outside[0]) & (rows <= outside[-1])]
    fit = make_lsq_spline(
        rows, full(rows), np.concatenate([outside[:1].repeat(3), outside, outside[-1:].repeat(3)])
    )
    pieces = PPoly.from_spline(fit)
    first = int(np.searchsorted(pieces.x, 0.0, side="right")) - 1
    spline = PPoly(pieces.c[:, first : first + knots.size - 1], knots)
    between = np.concatenate([place, 0.5 * (full.x[:-1] + full.x[1:])])
    return spline, float(np.abs(spline(between) - full(between)).max())
