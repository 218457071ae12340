"""Damaged files of samples, CSV and Parquet, and damaged tables of results: a clear error, or numbers as written."""

import base64
import io
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drills.documents import ROOT
from drills.harness import Answers, Case, Complaint, Sweep, crashed, unclear
from drills.plain_quantities import read as read_quantity

_CLEAR = "ends in a clear error or samples"
_SAME = "samples that are read are those written"
_TABLE = "a damaged table of results is refused or read as written"

COUNT, SPEED = 96, 200.0  # samples; rpm
HEADINGS = {"time": "t", "crank_angle": "theta", "slider_acceleration": "a", "crank_torque": "M"}
UNITS = {
    "time": ("ms", 1e-3),
    "crank_angle": ("deg", math.pi / 180.0),
    "slider_acceleration": ("m/s^2", 1.0),
    "crank_torque": ("N*m", 1.0),
}

_NUMBER = re.compile(r"[-+−]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?$", re.ASCII)
_UNSURE = object()
"""A cell of which nobody can say what it means."""


def prepare() -> None:
    """Load what reads samples."""
    import pyarrow.parquet  # noqa: F401

    from jointgap import tables  # noqa: F401
    from jointgap.config.load import load_campaign  # noqa: F401
    from jointgap.rig.read_files import read_measurements  # noqa: F401


def _samples(random: np.random.Generator) -> dict[str, np.ndarray]:
    """A rig at constant speed, in the units of `UNITS`."""
    turns = 3.0
    angle = 0.3 + np.arange(COUNT) * turns * math.tau / COUNT
    return {
        "t": np.arange(COUNT) * turns * 6e4 / SPEED / COUNT,
        "theta": np.degrees(angle) % 360.0,
        "a": 60.0 * np.cos(angle) + 15.0 * np.cos(2 * angle) + 0.1 * random.normal(size=COUNT),
        "M": 2.0 * np.sin(angle) + 0.01 * random.normal(size=COUNT),
    }


class _Sheet:
    """A CSV file on its way: headings, cells as text, and how they are written."""

    def __init__(self, random: np.random.Generator):
        self.random = random
        digits = int(random.integers(3, 10))
        self.headings = ["t", "theta", "a", "M"]
        samples = _samples(random)
        self.cells = [[f"{samples[name][row]:.{digits}f}" for name in self.headings] for row in range(COUNT)]
        self.separator, self.decimal = self.one_of([",", ";", "\t", ";", ","]), "."
        self.ending, self.head, self.extra = "\n", "", []
        if random.random() < 0.15:
            self.decimal, self.separator = ",", self.one_of([";", "\t"])

    def one_of(self, choices):
        return choices[int(self.random.integers(len(choices)))]

    def row(self) -> int:
        return int(self.random.integers(len(self.cells)))

    def column(self) -> int:
        return int(self.random.integers(len(self.headings)))

    def text(self) -> str:
        lines = [self.separator.join(self.headings)]
        for cells in self.cells:
            lines.append(
                self.separator.join(
                    cell.replace(".", ",") if self.decimal == "," and _NUMBER.match(cell) else cell for cell in cells
                )
            )
        for at, line in self.extra:
            lines.insert(min(at, len(lines)), line)
        return self.head + self.ending.join(lines) + self.ending


_CELLS = [
    "", " ", "nan", "NaN", "NA", "N/A", "null", "None", "-", "--", "?", "inf", "-inf", "1e400", "-9999", "-999.25",
    "9999", "1e30", "99999999", "1,5", "1.5", "1,234.5", "1.234,5", "1 234.5", "1'234.5", "1_000", "−1.5", "–1.5",
    "1.5 mm", "1.5%", "0x10", "1d3", "1e3", "1E+2", "+1.5", ".5", "5.", "1.2.3", "١٫٥", "１.5", "³", "x", "#REF!", "#",
    '"1.5"', '"1,5"', '"', "'1.5", "=1+1", "TRUE", "2026-03-01", "12:30:45", "1.5\u00a0", "\u00a01.5", "\u20091.5",
    "1.5\ufeff", "1.5;", "1.5\t", "\x00", "\x1b[31m",
]  # fmt: skip


def _cell(sheet: _Sheet) -> None:
    text = sheet.one_of(_CELLS)
    for _ in range(int(sheet.one_of([1, 1, 2, 10]))):
        sheet.cells[sheet.row()][sheet.column()] = text


def _column_of(sheet: _Sheet) -> None:
    """A whole column in another notation."""
    place, change = sheet.column(), sheet.one_of([
        lambda c: c.replace("-", "−"), lambda c: c + " mm", lambda c: c.replace(".", ","), lambda c: "1.0",
        lambda c: "", lambda c: f'"{c}"', lambda c: f"{float(c):e}" if _NUMBER.match(c) else c,
        lambda c: c.split(".")[0],
    ])  # fmt: skip
    for cells in sheet.cells:
        if place < len(cells):
            cells[place] = change(cells[place])


def _lost_cell(sheet: _Sheet) -> None:
    cells = sheet.cells[sheet.row()]
    if cells:
        del cells[int(sheet.random.integers(len(cells)))]


def _one_more(sheet: _Sheet) -> None:
    sheet.cells[sheet.row()].insert(sheet.column(), sheet.one_of(["1.5", "", "x"]))


def _doubled(sheet: _Sheet) -> None:
    at = sheet.row()
    sheet.cells.insert(sheet.one_of([at, sheet.row()]), list(sheet.cells[at]))


def _disordered(sheet: _Sheet) -> None:
    one, other = sheet.row(), sheet.row()
    sheet.cells[one], sheet.cells[other] = sheet.cells[other], sheet.cells[one]


def _reversed(sheet: _Sheet) -> None:
    sheet.cells.reverse()


def _gone(sheet: _Sheet) -> None:
    first = sheet.row()
    del sheet.cells[first : first + int(sheet.one_of([1, 5, 30, 90]))]
    if not sheet.cells:
        sheet.cells.append(["1.0"] * len(sheet.headings))


def _exchanged(sheet: _Sheet) -> None:
    one, other = sheet.column(), sheet.column()
    sheet.headings[one], sheet.headings[other] = sheet.headings[other], sheet.headings[one]


def _heading(sheet: _Sheet) -> None:
    sheet.headings[sheet.column()] = sheet.one_of(
        ["t", "theta", " theta", "Theta", '"theta"', "theta [deg]", "", "x", "M\u00a0", "\ufeffM", "1.5", "M;"]
    )


def _line(sheet: _Sheet) -> None:
    """A line that is no row of samples."""
    names = sheet.separator.join(sheet.headings)
    line = sheet.one_of([
        "", "# note", names, f"#{names}", sheet.separator * 3, sheet.separator.join(["ms", "deg", "m/s^2", "N*m"]),
        sheet.separator.join(["s", "rad", "g_n", "mN*m"]), "end", "   ", "\x1a", "--",
    ])  # fmt: skip
    sheet.extra.append((sheet.one_of([0, 1, 2, sheet.row(), 10**6]), line))


def _endings(sheet: _Sheet) -> None:
    sheet.ending = sheet.one_of(
        ["\r\n", "\r", "\n\n", "\n\r", "\x0b", "\x0c", "\u2028", "\x85", f"{sheet.separator}\n"]
    )


def _separator(sheet: _Sheet) -> None:
    sheet.separator = sheet.one_of([" ", "  ", "|", ", ", " ; ", ":", "\t\t", "/"])


def _decimals(sheet: _Sheet) -> None:
    """Decimal commas, in some rows or all, whatever parts the columns."""
    rows = range(len(sheet.cells)) if sheet.random.random() < 0.5 else [sheet.row() for _ in range(3)]
    for row in rows:
        sheet.cells[row] = [cell.replace(".", ",") for cell in sheet.cells[row]]


def _front(sheet: _Sheet) -> None:
    sheet.head = sheet.one_of(
        ["\ufeff", "\n\n", "sep=;\n", "Rig 7\n", "# Rig 7\n# 2026\n", "\ufeff\ufeff", " ", "PK", "PAR1"]
    )


_DAMAGE: list[tuple[Callable[[_Sheet], None], float]] = [
    (_cell, 6), (_column_of, 2), (_lost_cell, 1), (_one_more, 1), (_doubled, 1), (_disordered, 1), (_reversed, 0.3),
    (_gone, 1), (_exchanged, 1), (_heading, 1), (_line, 2), (_endings, 1), (_separator, 1), (_decimals, 1),
    (_front, 1),
]  # fmt: skip
_ENCODINGS = ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252"]


def make(random: np.random.Generator) -> Case:
    """A file of one of three kinds, with damage."""
    kind = random.random()
    return _csv(random) if kind < 0.6 else _parquet(random) if kind < 0.8 else _table(random)


def _csv(random: np.random.Generator) -> Case:
    sheet, weights = _Sheet(random), np.array([weight for _, weight in _DAMAGE])
    for _ in range(int(random.integers(0, 4))):
        _DAMAGE[int(random.choice(len(_DAMAGE), p=weights / weights.sum()))][0](sheet)
    content, torn = sheet.text().encode("utf-8"), False
    if random.random() < 0.1:
        content = sheet.text().encode(sheet.one_of(_ENCODINGS), "replace")
    if random.random() < 0.15:
        content, torn = _torn(content, random), True
    truth = (
        None
        if torn
        else {"headings": sheet.headings, "cells": sheet.cells, "separator": sheet.separator, "decimal": sheet.decimal}
    )
    suffix = sheet.one_of(["csv", "csv", "csv", "txt", "parquet"] if random.random() < 0.1 else ["csv"])
    return {"kind": "csv", "suffix": suffix, "content": base64.b64encode(content).decode(), "truth": truth}


def _torn(content: bytes, random: np.random.Generator) -> bytes:
    at = int(random.integers(len(content)))
    kind = int(random.integers(5))
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + bytes([content[at] ^ (1 << int(random.integers(8)))]) + content[at + 1 :]
    if kind == 2:
        return content[:at] + random.bytes(int(random.integers(1, 9))) + content[at:]
    if kind == 3:
        return content[:at] + bytes(512) + content[at + 512 :]
    return content[at:] + content[:at]


def _parquet(random: np.random.Generator) -> Case:
    """A Parquet file with pages that have checksums, as ours have; its types and values odd, its bytes damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    samples = _samples(random)
    arrays = {name: pa.array(values) for name, values in samples.items()}
    name = list(arrays)[int(random.integers(4))]
    odd = int(random.integers(12))
    changes = {
        1: lambda: pa.array(samples[name].astype(np.float32)),
        2: lambda: pa.array(np.round(samples[name]).astype(np.int32)),
        3: lambda: pa.array([f"{value}" for value in samples[name]]),
        4: lambda: pa.array(samples[name]).cast(pa.decimal128(20, 6), safe=False),
        5: lambda: pa.array([None if row % 7 == 3 else value for row, value in enumerate(samples[name])]),
        6: lambda: pa.array(np.where(np.arange(COUNT) == 5, np.inf, samples[name])),
        7: lambda: pa.array(np.where(np.arange(COUNT) == 5, np.nan, samples[name])),
        8: lambda: pa.array((samples[name] * 1e3).astype(np.int64)).cast(pa.timestamp("us")),
        9: lambda: pa.array([bool(value > 0) for value in samples[name]]),
        10: lambda: pa.array([[value] for value in samples[name]]),
        11: lambda: pa.nulls(COUNT, pa.float64()),
    }
    if odd in changes:
        arrays[name] = changes[odd]()
    table = pa.table(arrays)
    if random.random() < 0.1:
        table = table.drop_columns([name]) if random.random() < 0.5 else table.append_column(name, arrays["a"])
    stream = io.BytesIO()
    codec = ["none", "snappy", "zstd", "gzip"][int(random.integers(4))]
    pq.write_table(
        table, stream, compression=codec, write_page_checksum=True, row_group_size=int(random.choice([20, 1000]))
    )
    content, torn = stream.getvalue(), random.random() < 0.5
    if torn:
        content = _torn(content, random)
    truth = {heading: _plain(table, heading) for heading in samples}
    suffix = ["parquet", "parquet", "csv"][int(random.integers(3))]
    return {"kind": "parquet", "suffix": suffix, "content": base64.b64encode(content).decode(), "truth": truth}


def _plain(table, heading: str) -> list[float | None] | None:
    """A column as numbers; None where it holds none, or is there twice."""
    import pyarrow as pa

    if table.column_names.count(heading) != 1:
        return None
    column = table.column(heading)
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        return None
    values = [None if value is None else float(value) for value in column.to_pylist()]
    return (
        [None if value is None or math.isnan(value) else value for value in values]
        if not any(value in (math.inf, -math.inf) for value in values)
        else None
    )


def _table(random: np.random.Generator) -> Case:
    return {"kind": "table", "seed": int(random.integers(2**31)), "rows": int(random.choice([3, 200, 20000]))}


# ----------------------------------------------------------------------------------------------------------------------
# judging


def judge(case: Case, folder: Path) -> Answers:
    """Read the file as the campaign's reader does."""
    from jointgap.config.campaign_file import Campaign
    from jointgap.core.errors import InputError
    from jointgap.rig.read_files import read_measurements

    if case["kind"] == "table":
        return _judged_table(case, folder)
    path = folder / f"run.{case['suffix']}"
    path.write_bytes(base64.b64decode(case["content"]))
    campaign = Campaign.model_validate(_campaign(path))
    try:
        measured = read_measurements(campaign)
    except InputError as error:
        return {_CLEAR: unclear(str(error), path.name)}
    except Exception as error:
        return {_CLEAR: crashed(error)}
    return {_CLEAR: None, _SAME: compare(case, measured.runs["one"])}


def _campaign(path: Path) -> dict:
    from jointgap.config.load import load_mechanism

    return {
        "name": "drill",
        "mechanism": load_mechanism(ROOT / "config/mechanisms/ideal_joints.yaml").model_dump(),
        "runs": [{"id": "one", "file": path.name, "speed": SPEED * math.tau / 60.0, "role": "split"}],
        "channels": {name: {"column": column, "unit": UNITS[name][0]} for name, column in HEADINGS.items()},
        "folder": path.parent,
    }


def compare(case: Case, recording) -> Complaint | None:
    """Whether the samples of a `recording` are those of the file; of a torn CSV file nobody can say."""
    held = {"time": recording.time, "crank_angle": recording.crank_angle, **recording.channels}
    if not (np.isfinite(held["time"]).all() and (np.diff(held["time"]) > 0).all()):
        return Complaint("times are read that do not rise", repr(held["time"][:5]))
    if case["truth"] is None:
        return None
    truth = _of_cells(case["truth"]) if case["kind"] == "csv" else case["truth"]
    if isinstance(truth, Complaint):
        return truth
    for column in HEADINGS.values():
        if truth.get(column) is None:
            return Complaint("a column that holds no numbers is read", column)
    kept = [row for row, time in enumerate(truth["t"]) if time is not None]
    if len(kept) != recording.time.size:
        return Complaint("samples are lost or made up", f"{recording.time.size} read, {len(kept)} written")
    for name, column in HEADINGS.items():
        if complaint := _other(name, held[name], [truth[column][row] for row in kept], UNITS[name][1]):
            return complaint
    return None


def _other(name: str, ours: np.ndarray, written: list, factor: float) -> Complaint | None:
    for row, (value, cell) in enumerate(zip(ours, written, strict=True)):
        if cell is _UNSURE:
            continue
        if cell is None or math.isnan(value):
            if not (cell is None and math.isnan(value)):
                return Complaint("a gap is filled or made", f"{name}, sample {row}: {value!r}, written {cell!r}")
            continue
        wanted = cell * factor
        off = value - wanted
        if name == "crank_angle":  # continuous, so whole turns are added
            off -= math.tau * round(off / math.tau)
        if abs(off) > 1e-9 * max(abs(wanted), abs(value)) + 1e-15:
            return Complaint(
                "a sample is read as another number", f"{name}, sample {row}: {value!r}, written {wanted!r}"
            )
    return None


def _of_cells(sheet: dict) -> dict[str, list | None] | Complaint:
    """Numbers of a sheet by heading, as a person reads them; None in gaps."""
    headings = [heading.strip().strip('"').strip("\ufeff").strip() for heading in sheet["headings"]]
    columns: dict[str, list | None] = {}
    for column in HEADINGS.values():
        if headings.count(column) != 1:
            return Complaint("a heading that is missing or there twice is read", column)
        place = headings.index(column)
        rows = [row for row in sheet["cells"] if any(cell.strip() for cell in row)]
        if any(len(row) < len(headings) or any(cell.strip() for cell in row[len(headings) :]) for row in rows):
            return Complaint("rows of another length than the headings are read", column)
        numbers = [number(row[place], sheet["decimal"]) for row in rows]
        if any(value is math.inf for value in numbers):
            cell = next(row[place] for row, value in zip(rows, numbers, strict=True) if value is math.inf)
            return Complaint("a cell that is no number is read", f"{column}: {cell!r}")
        columns[column] = numbers
    return columns


def number(cell: str, decimal: str = "."):
    """What a cell says: a float, None for a gap, `_UNSURE` where people differ, infinity where it is no number."""
    text = cell.strip().strip('"').strip().strip("\ufeff").replace("−", "-")
    if text in ("", "nan", "NaN"):
        return None
    if text.count(",") == 1 and "." not in text and _NUMBER.match(text.replace(",", ".")):
        whole, _, part = text.partition(",")
        return (
            _UNSURE
            if len(part) == 3 and decimal == "." and whole.strip("+-") not in ("", "0")
            else float(text.replace(",", "."))
        )
    if re.fullmatch(r"[-+]?\d{1,3}([,' _]\d{3})+(\.\d*)?|[-+]?\d{1,3}(\.\d{3})+,\d*", text):
        return _UNSURE
    if not text.isascii():
        return value if (value := read_quantity(text, "").value) is not None else math.inf
    if not _NUMBER.match(text):
        return math.inf
    return float(text)


def _judged_table(case: Case, folder: Path) -> Answers:
    """A table of results with a byte changed, in its data or its foot."""
    import pandas as pd

    from jointgap import tables
    from jointgap.core.errors import InputError

    random, path = np.random.default_rng(case["seed"]), folder / "trajectory.parquet"
    kinds = {
        "float": lambda: random.normal(size=case["rows"]),
        "int": lambda: random.integers(0, 9, case["rows"]),
        "bool": lambda: [True] * case["rows"],
    }
    frame = pd.DataFrame(
        {column.name: kinds.get(column.kind, lambda: ["text"] * case["rows"])() for column in tables.TRAJECTORY.columns}
    )
    tables.write(tables.TRAJECTORY, frame, path)
    good = tables.read(tables.TRAJECTORY, path)
    path.write_bytes(_torn(path.read_bytes(), random))
    try:
        read = tables.read(tables.TRAJECTORY, path)
    except InputError as error:
        return {_TABLE: unclear(str(error), path.name)}
    except Exception as error:
        return {_TABLE: crashed(error)}
    return {
        _TABLE: None
        if read.equals(good)
        else Complaint("a damaged table is read as other numbers", f"{case['rows']} rows")
    }


SWEEP = Sweep("data_files", 2000, make, judge, prepare)
DRILL = SWEEP.drill()
