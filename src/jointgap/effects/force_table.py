"""A measured load on the slider: force or pressure over crank angle or time."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

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
    def _has_its_unit(cls, column: TableColumn | None, info: Any) -> TableColumn | None:
        if column is not None:
            try:
                unit_factor(column.unit, _SI[info.field_name])
            except ValueError as error:
                raise ValueError(f"unit = '{column.unit}' {error}") from error
        return column

    def errors(self) -> Iterator[str]:
        for key, alternative in (("angle", "time"), ("force", "pressure")):
            if (getattr(self, key) is None) == (getattr(self, alternative) is None):
                yield (
                    f"requires either {key} or {alternative}, e.g. {key}: {{column: a, unit:"
                    f" {_SI[key]}}}"
                )
        if (self.pressure is None) != (self.bore is None):
            yield "pressure and bore require each other; give both, or the force"
        of_pressure = {"side", "pressure_zero", "pressure_gain"}
        if self.pressure is None and of_pressure & self.model_dump(exclude_defaults=True).keys():
            yield "side, pressure_zero, pressure_gain are only for a pressure; remove them"
        if self.period is not None and self.time is None:
            yield "period is only for a table over time (over the angle: 360 or 720 deg); remove it"


@register_effect(order=85)
class ForceTable(Effect):
    """A known periodic load, such as an indicator diagram, interpolated by a cubic spline."""

    ON, GROUP = "slide", "slider"
    LAW = (
        "F = table(theta) or table(t), periodic cubic spline; of a pressure F = -(p - p_ambient) pi"
        " bore^2 / 4, on the crank's side with the other sign"
    )
    WORDS = "a measured load on the {site}"
    PARAMETERS = ForceTableParameters
    SEVERAL = True

    @property
    def _is_there(self) -> bool:
        """Whether the file exists; otherwise the simulation raises the error."""
        return Path(self.parameters.file).is_file()

    def check(self, mechanism: Any) -> None:
        tables = [effect for effect in mechanism.effects if isinstance(effect, ForceTable)]
        if all(table._is_there for table in tables):
            records: Records = {"sites": {}, "tables": {}}
            for table in tables:
                table.compile_into(records)

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        parameters, (pieces, begin, period, _) = self.parameters, _table(self.parameters)
        sign, over_time = -1.0 if parameters.reversed else 1.0, parameters.time is not None
        if not over_time:
            begin += sign * parameters.zero
        add_table(records, self.BODY, Table(2 if over_time else 1, sign, begin, period, pieces))

    def largest_force(self, stroke: float) -> float:
        return float(np.abs(_table(self.parameters)[0][:, -1]).max()) if self._is_there else 0.0

    def remarks(self) -> tuple[str, ...]:
        """Outliers and thinning of the table."""
        return _table(self.parameters)[3] if self._is_there else ()

    def mirrored(self) -> Effect:
        parameters = self.parameters
        return self.with_parameters(reversed=not parameters.reversed, zero=-parameters.zero)


class Table(NamedTuple):
    """A periodic force on the slider as the equations of motion read it."""

    over: int  # 1: the crank angle, 2: time
    sign: float  # -1: over the angle that increases clockwise
    begin: float  # of the first piece and of the period [rad or s]
    period: float
    pieces: np.ndarray  # (k, 5) begin and cubic polynomial, highest power first [N]


def add_table(records: Records, body: str, table: Table) -> None:
    """Add a `table` of forces on a `body` to the `records` of the equations of motion, which have
    one: the sum of all."""
    tables = records["tables"].setdefault(body, [])
    if len(records["tables"]) > 1:
        raise InputError(
            f"effects: {' and '.join(records['tables'])} have force tables; only one body can have"
            " them: give the others as formulas"
        )
    tables.append(table)
    total = table if len(tables) == 1 else _sum(tables)
    site = records["sites"].setdefault(body, {})
    for key in ("over", "sign", "begin", "period"):
        site[f"table_{key}"] = getattr(total, key)
    records["table"] = total.pieces


def with_pressure_sensor(
    effects: Iterable[Effect], values: Mapping[str, float]
) -> tuple[Effect, ...]:
    """`effects` whose pressures have the zero and the gain in `values`, as far as they are
    there."""
    update = {key: values[key] for key in ("pressure_zero", "pressure_gain") if key in values}
    if not update:
        return tuple(effects)
    return tuple(
        effect.with_parameters(**update) if getattr(effect.parameters, "bore", None) else effect
        for effect in effects
    )


def _sum(tables: Sequence[Table]) -> Table:
    """The sum of periodic splines: the spline with the knots of all over their common period."""
    from scipy.interpolate import CubicSpline, PPoly

    if len({table.over for table in tables}) > 1:
        raise InputError(
            "slider_force_table: one load is over the crank angle and another one over time, which"
            " cannot be added; give all over the angle, or all over time"
        )
    periods = np.array([table.period for table in tables])
    multiples = np.arange(1, _MOST_PERIODS) * periods.max()
    ratios = multiples[:, None] / periods
    is_common = (np.abs(ratios - np.round(ratios)) < 1e-6).all(axis=1)
    if not is_common.any():
        listed = " and ".join(f"{period:.6g} s" for period in periods)
        raise InputError(
            f"slider_force_table: the periods {listed} have no common multiple; give the same"
            " period"
        )
    period = float(multiples[is_common.argmax()])
    knots = [np.array([0.0, period])]
    for table in tables:
        repetitions = np.arange(round(period / table.period))
        shifts = table.begin + table.period * repetitions
        positions = np.add.outer(shifts, table.pieces[:, 0]).ravel()
        knots.append(np.mod(table.sign * positions, period))
    knots = np.unique(np.concatenate(knots))
    knots = knots[np.append(np.diff(knots) > 1e-9 * period, True)]
    knots[0] = 0.0
    if knots.size - 1 > MOST_ROWS:
        knots = np.linspace(0.0, period, MOST_ROWS + 1)
    force = np.zeros(knots.size)
    for table in tables:
        breaks = np.append(table.pieces[:, 0], table.period)
        spline = PPoly(table.pieces[:, 1:].T, breaks, extrapolate="periodic")
        force += spline(table.sign * knots - table.begin)
    force[-1] = force[0]
    total = CubicSpline(knots, force, bc_type="periodic")
    return Table(tables[0].over, 1.0, 0.0, period, _pieces(total))


def _pieces(spline: "CubicSpline | PPoly") -> np.ndarray:
    return np.column_stack([spline.x[:-1], spline.c.T])


#: Pieces (k, 5) of the force [N] over one period (begin and cubic polynomial, highest power first),
#: begin of the first and period [rad or s], remarks.
_Table = tuple[np.ndarray, float, float, tuple[str, ...]]


def _table(parameters: ForceTableParameters) -> _Table:
    try:
        changed = Path(parameters.file).stat().st_mtime_ns
    except OSError as error:
        raise InputError(
            f"slider_force_table: file {parameters.file} cannot be read ({error.strerror})"
        ) from error
    # the sensor's zero and gain vary in a fit: the file is read without them
    zero, gain = parameters.pressure_zero, parameters.pressure_gain
    update = {"pressure_zero": 0.0, "pressure_gain": 1.0}
    pieces, begin, period, remarks = _read_table(parameters.model_copy(update=update), changed)
    if parameters.pressure is not None:
        pieces = corrected(pieces, parameters, zero, gain)
    return pieces, begin, period, remarks


def piston_area(parameters: Any) -> float:
    """Area [m^2] on which a pressure acts along -x: negative on the side of the crank."""
    return (-0.25 if parameters.side == "crank" else 0.25) * math.pi * parameters.bore**2


def corrected(pieces: np.ndarray, parameters: Any, zero: float, gain: float) -> np.ndarray:
    """The `pieces` of a force by a pressure p as read, for the pressure ``gain p + zero``."""
    if zero == 0.0 and gain == 1.0:
        return pieces
    pieces = np.hstack([pieces[:, :1], gain * pieces[:, 1:]])
    offset = (1.0 - gain) * parameters.ambient_pressure - zero
    pieces[:, -1] += offset * piston_area(parameters)
    return pieces


@lru_cache(64)
def _read_table(parameters: ForceTableParameters, _changed: int) -> _Table:
    from scipy.interpolate import CubicSpline

    x_key = "angle" if parameters.time is None else "time"
    y_key = "force" if parameters.pressure is None else "pressure"
    path = Path(parameters.file)
    x, y, rows = _read_columns(parameters, path, x_key, y_key)

    def error(key: str, text: str) -> InputError:
        return InputError(f"{path}, column {getattr(parameters, key).column}{text}")

    if x.size < _LEAST_ROWS:
        raise error(x_key, f": {x.size} rows; give {_LEAST_ROWS} rows of one period or more")
    is_repeated = (np.diff(x) == 0.0) & (np.abs(np.diff(y)) <= _CLOSED * np.ptp(y))
    keep = np.append(True, ~is_repeated)
    x, y, rows = x[keep], y[keep], rows[keep]
    if (falls := np.flatnonzero(np.diff(x) <= 0.0)).size:
        row = rows[falls[0] + 1]
        raise error(x_key, f", row {row}: not increasing; give one period in increasing order")
    remarks = _outliers(y, rows, path, getattr(parameters, y_key), _SI[y_key])
    if y_key == "pressure":
        if parameters.ambient_pressure > 0.0 and (below := np.flatnonzero(y < 0.0)).size:
            text = "negative absolute pressure; give 'ambient_pressure: 0' for gauge pressures"
            raise error(y_key, f", row {rows[below[0]]}: {text}")
        y = (parameters.ambient_pressure - y) * piston_area(parameters)
    span, step = x[-1] - x[0], float(np.median(np.diff(x)))
    periods = (parameters.period or span,) if x_key == "time" else (math.tau, 2.0 * math.tau)
    fitting = [
        period
        for period in periods
        if (1.0 - 1e-6) * period - _GAP * step <= span <= (1.0 + 1e-6) * period
    ]
    if not fitting and x_key == "time":
        text = f": the rows span {span:.6g} s, but the period is {periods[0]:.6g} s"
        raise error(x_key, f"{text}; correct one of them")
    if not fitting:
        raise error(
            x_key,
            f": the rows span {math.degrees(span):.6g} deg in steps of {math.degrees(step):.3g},"
            " neither 360 nor 720 deg; give one full period, or correct the unit of the angle",
        )
    period, difference, limit = float(fitting[0]), abs(y[-1] - y[0]), _CLOSED * np.ptp(y)
    is_closed = span > (1.0 - 1e-6) * period  # the last row is the first one of the next period
    if not is_closed:
        limit = max(limit, _GAP * np.abs(np.diff(y)).max())
    if difference > limit:
        raise error(
            y_key,
            f": not periodic: begin and end differ by {difference:.4g} N on the slider, the range"
            f" is {np.ptp(y):.4g} N; give one full period, averaged over cycles",
        )
    if is_closed:
        x, y = x[:-1], y[:-1]
    knots = np.append(x - x[0], period)
    spline = CubicSpline(knots, np.append(y, y[0]), bc_type="periodic")
    if x.size > MOST_ROWS:
        spline, deviation = _thinned(spline, period)
        remarks += (
            f"{path}: {rows.size} rows are thinned to a spline of {spline.x.size - 1} pieces; it"
            f" deviates from the spline through all rows by at most {deviation:.2g} N,"
            f" {100.0 * deviation / (np.ptp(y) or 1.0):.2g} % of the range",
        )
    return _pieces(spline), float(x[0]), period, remarks


def _read_columns(
    parameters: ForceTableParameters, path: Path, *keys: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two columns in SI, and the row numbers, of the rows that have both."""
    columns = [getattr(parameters, key) for key in keys]
    table = read_columns(path, [column.column for column in columns], Csv())
    values = []
    for key, column in zip(keys, columns, strict=True):
        factor = unit_factor(column.unit, _SI[key])
        if unit := table.other_unit(column.column, factor, _SI[key]):
            raise InputError(
                f"{path}, column {column.column}: the row below the headings says '{unit}', but"
                f" {key}.unit is '{column.unit}'; correct one of them"
            )
        values.append(table.values[column.column] * factor)
    is_finite = np.isfinite(values).all(axis=0)
    return values[0][is_finite], values[1][is_finite], table.rows[is_finite]


def _outliers(
    y: np.ndarray, rows: np.ndarray, path: Path, column: TableColumn, si_unit: str
) -> tuple[str, ...]:
    """A remark if values are far from their neighbours."""
    from jointgap.core.outliers import spikes

    outliers = spikes(y)
    if not outliers.size:
        return ()
    value = y[outliers[0]] / unit_factor(column.unit, si_unit)
    more = f" and {outliers.size - 1} more" if outliers.size > 1 else ""
    return (
        f"{path}, column {column.column}, row {rows[outliers[0]]}{more}: {value:g} {column.unit} is"
        " far from its neighbours; if misread, leave the cell empty",
    )


def _thinned(full: "CubicSpline", period: float) -> "tuple[PPoly, float]":
    """The periodic spline with a knot at every n-th row, fitted to all rows by least squares; its
    largest difference from the `full` one at and between the rows.
    """
    from scipy.interpolate import PPoly, splrep

    rows = full.x[:-1]
    knots = rows[:: -(-rows.size // MOST_ROWS)]
    fitted = PPoly.from_spline(splrep(full.x, full(full.x), t=knots[1:], task=-1, per=True))
    spline = PPoly(fitted.c[:, 3:-3], fitted.x[3:-3])  # without the pieces outside the period
    points = np.concatenate([rows, 0.5 * (rows + full.x[1:])])
    return spline, float(np.abs(spline(points) - full(points)).max())
