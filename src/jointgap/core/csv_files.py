"""Columns of numbers from a CSV or Parquet file, with the row of each number for messages."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.section import ConfigModel
from jointgap.core.units import respelled, unit_factor

SEPARATORS = ("\t", ";", ",", "|", " ")
_BINARY = (
    b"PK\x03\x04",
    b"\x1f\x8b",
    b"\xd0\xcf\x11\xe0",
)  # first bytes of archives and spreadsheets
_DATE = re.compile(r"\d{4}-\d\d-\d\d")
_COMMA_NUMBER = r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?"
_MOST_ABOVE = 1000  # lines searched for the headings
_MAX_UNIT_LENGTH = 15  # characters
_MAX_TEXT_LENGTH = 60  # characters of a text in messages


class Csv(ConfigModel):
    """Format of text files of samples."""

    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = Field(
        None, description="character between columns; null: detected"
    )
    decimal: Literal[".", ","] | None = Field(None, description="decimal mark; null: detected")
    skip_rows: Annotated[int, Field(ge=0)] | None = Field(
        None,
        description="number of lines above the headings; null: the headings are detected by name",
    )

    @model_validator(mode="after")
    def _marks_differ(self):
        if self.separator is not None and (
            self.separator == self.decimal or self.separator in '"#\n\r.0123456789'
        ):
            raise ValueError(
                f"separator {self.separator!r} cannot separate columns; write one such as ';' or"
                " '\\t'"
            )
        return self


@dataclass(frozen=True)
class Columns:
    """Numbers of a file by column."""

    values: dict[str, np.ndarray]  # As in the file; NaN for gaps
    rows: (
        np.ndarray
    )  # Line of the file (CSV) or row counted from 1 (Parquet) of each sample, for messages
    units: dict[str, str]  # From a row of units below the headings, without brackets
    remarks: tuple[str, ...] = ()  # Skipped or converted content
    began: pd.Timestamp | None = (
        None  # The first of times that were dates, converted to seconds since it
    )

    def other_unit(self, column: str, factor: float, unit: str) -> str | None:
        """The unit of a column in the row of units, where its factor to the SI `unit` is not
        `factor`."""
        written = self.units.get(column)
        try:
            written_factor = (
                unit_factor(respelled(written, unit) or written, unit) if written else factor
            )
        except Exception:  # unknown to pint
            return None
        return None if np.isclose(written_factor, factor, rtol=1e-6) else written


def read_columns(
    path: Path, columns: Sequence[str], form: Csv, clock: str = "", partly: bool = False
) -> Columns:
    """The columns `columns` of a file; dates in the column `clock` become seconds. `partly`: the
    clock and those of the others that the file has.
    """
    content = _content(path)
    if _is_parquet(path, content):
        texts, units, remarks = _parquet(path, columns, clock, partly), {}, ()
    else:
        text = _decoded(path, content)
        texts, units, remarks = _csv(path, text, columns, form, clock if partly else "")
    if texts.empty:
        raise InputError(f"{path}: has headings but no samples; give the file of the measurement")
    start, dates, remark = _seconds(path, texts[clock]) if clock else (None, None, "")
    numbers = {column: texts[column] for column in texts if dates is None or column != clock}
    decimal = form.decimal or _decimal(numbers)
    values = {column: _numbers(path, cells, decimal) for column, cells in numbers.items()}
    if dates is not None:
        values[clock], remarks = dates, (*remarks, remark)
    return Columns(values, texts.index.to_numpy(), units, remarks, start)


def find_headings(path: Path) -> list[str]:
    """The headings of a file, found without their names: the row above the numbers, or above a row
    of units."""
    content = _content(path)
    if _is_parquet(path, content):
        import pyarrow.parquet as pq

        return pq.read_schema(path).names
    lines, _ = _lines(_decoded(path, content))
    lines = list(lines.values())[:_MOST_ABOVE]

    def merit(rows: Sequence[Sequence[str]]) -> int:
        return sum(max(_numbers_less_texts(row), 0) for row in rows)

    rows = max(([_split(line, mark) for line in lines] for mark in SEPARATORS), key=merit)
    ((width, _),) = Counter(len(row) for row in rows if _numbers_less_texts(row) > 0).most_common(
        1
    ) or [(0, 0)]
    data = next(
        (n for n, row in enumerate(rows) if _numbers_less_texts(row) > 0 and len(row) == width), 0
    )
    if not data:
        raise InputError(
            f"{path}: has no headings above its numbers; write a line with the name of each column"
        )
    above = [
        row for row in rows[:data] if len(row) >= width - 1 and not any(map(_is_number, row))
    ] or rows[:data]
    below = [cell.strip("[]() ") for cell in above[-1]]
    has_units = len(above) > 1 and all(text in ("", "-", "1") or respelled(text) for text in below)
    return [name for name in above[-2 if has_units else -1] if name]


def _numbers_less_texts(cells: Sequence[str]) -> int:
    """Number of cells with a number or a date, less that of cells with other text."""
    return sum(1 if _DATE.match(cell) or _is_number(cell) else -1 for cell in cells if cell)


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # a zero byte in the name is a ValueError
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({why}); check the name of the file") from error
    if content.startswith(_BINARY):
        raise InputError(
            f"{path}: is a spreadsheet or an archive; save the samples as CSV or Parquet"
        )
    return content


def _is_parquet(path: Path, content: bytes) -> bool:
    return content.startswith(b"PAR1") or path.suffix == ".parquet"


def _decoded(path: Path, content: bytes) -> str:
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
        if "\x00" not in text:
            return text
        text_before = text[: text.index("\x00")].encode()
    except UnicodeDecodeError as error:
        text_before = content[: error.start]
    row = text_before.count(b"\n") + 1
    raise InputError(
        f"{path}, row {row}: is not text in UTF-8 (byte {len(text_before)}); save it as UTF-8"
    )


def _csv(
    path: Path, text: str, columns: Sequence[str], form: Csv, clock: str
) -> tuple[pd.DataFrame, dict[str, str], tuple[str, ...]]:
    """Texts of the `wanted` columns by line of the file, units, and remarks."""
    lines, comments = _lines(text)
    lines = {number: line for number, line in lines.items() if number > (form.skip_rows or 0)}
    if not lines:
        problem = (
            f"has no rows below the {form.skip_rows} of csv.skip_rows"
            if form.skip_rows
            else "is empty"
        )
        raise InputError(f"{path}: {problem}; give a table with headings and samples")
    header_row, separator = _place_of_headings(lines, columns, form)
    headings = _split(lines[header_row], separator)
    while headings and not headings[-1]:  # a trailing separator
        headings.pop()
    hidden = [
        n
        for n, line in comments.items()
        if any(set(columns) <= set(_split(line, m)) for m in SEPARATORS)
    ]
    fix = f"row {hidden[0]} has them in a comment: remove the '#'" if hidden else ""
    also = (
        ""
        if set(columns) & set(headings)
        else "; if the headings are in another row, give csv.skip_rows"
    )
    columns = _present(f"{path}, row {header_row}", headings, columns, clock, fix, also)
    above = sum(number < header_row for number in lines)
    remarks = ()
    if above and form.skip_rows is None:
        skipped = "1 line" if above == 1 else f"{above} lines"
        remarks = (f"{path}: the headings are in row {header_row}; {skipped} above them skipped",)
    rows = {
        number: _cells(line, separator) for number, line in lines.items() if number > header_row
    }
    for number, cells in rows.items():
        if lines[number].count('"') % 2:
            raise InputError(
                f"{path}, row {number}: a quotation mark is not closed; correct the row"
            )
        if len(cells) < len(headings) or any(map(str.strip, cells[len(headings) :])):
            fix = _fix_of_length(
                len(cells),
                len(headings),
                separator,
                all(len(r) == len(cells) for r in rows.values()),
            )
            raise InputError(
                f"{path}, row {number}: has {len(cells)} cells, but there are {len(headings)}"
                f" headings in row {header_row} (separator {separator!r}); {fix}, or give"
                " csv.skip_rows, csv.separator and csv.decimal"
            )
    places = {column: headings.index(column) for column in columns}
    texts = {column: [cells[n].strip() for cells in rows.values()] for column, n in places.items()}
    table = pd.DataFrame(texts, index=list(rows), dtype=str)
    cells_below = [] if table.empty else [text.strip("[]() ") for text in table.iloc[0]]
    if not any(cells_below) or any(
        _is_number(text) or len(text) > _MAX_UNIT_LENGTH for text in cells_below
    ):
        return table, {}, remarks
    return table.iloc[1:], dict(zip(columns, cells_below, strict=True)), remarks


def _lines(text: str) -> tuple[dict[int, str], dict[int, str]]:
    """Lines that are not empty, by number: rows and comments."""
    lines = {
        number: line for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1) if line.strip()
    }
    comments = {
        number: line.lstrip(" #") for number, line in lines.items() if line.lstrip().startswith("#")
    }
    return {number: line for number, line in lines.items() if number not in comments}, comments


def _fix_of_length(length: int, width: int, separator: str, all_alike: bool) -> str:
    if length < width and all_alike:
        return "all rows have the same number; remove the additional heading"
    if separator == "," and length == 2 * width:
        return (
            "if decimals have a comma too, use another separator between the columns, such as ';'"
        )
    return "correct the row"


def _split(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in _cells(line, separator)]


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.replace('"', "").split()
    if '"' not in line:
        return line.split(separator)
    return next(
        csv.reader([line[: csv.field_size_limit()]], delimiter=separator, skipinitialspace=True)
    )


def _place_of_headings(lines: dict[int, str], columns: Sequence[str], form: Csv) -> tuple[int, str]:
    """Row of the headings and separator: the first line with the most `wanted` columns, and the
    separator that gives the most cells; with `skip_rows` the first line.
    """
    rows = list(lines)[: _MOST_ABOVE if form.skip_rows is None else 1]

    def merit(place: tuple[int, str]) -> tuple[int, int, int]:
        row, separator = place
        cells = _split(lines[row], separator)
        return len(set(columns) & set(cells)), -row, len(cells)

    return max(((row, mark) for row in rows for mark in form.separator or SEPARATORS), key=merit)


def _present(
    where: str,
    headings: Sequence[str],
    columns: Sequence[str],
    clock: str,
    fix: str = "",
    also: str = "",
) -> list[str]:
    """The `columns` among the `headings`; InputError where one is missing, except those besides a
    `clock`."""
    for column in columns:
        if column not in headings and clock in ("", column):
            hint = (
                fix
                or did_you_mean(column, (_shortened(heading) for heading in headings if heading))
                + also
            )
            raise InputError(f"{where}: has no column '{column}' among its headings; {hint}")
        if list(headings).count(column) > 1:
            raise InputError(f"{where}: has the column '{column}' twice; give each its own heading")
    return [column for column in columns if column in headings]


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _decimal(cells: dict[str, pd.Series]) -> str:
    """The decimal mark: a comma if any number has one."""
    texts = [column for column in cells.values() if not pd.api.types.is_numeric_dtype(column)]
    return "," if any(column.str.fullmatch(_COMMA_NUMBER).any() for column in texts) else "."


def _seconds(path: Path, stamps: pd.Series) -> tuple[pd.Timestamp | None, np.ndarray | None, str]:
    """The first date in a column, the seconds since it, and a remark; None if the column does not
    begin with a date."""
    written = stamps.notna() & (stamps != "")
    first_stamp = next(iter(stamps[written]), None)
    if isinstance(first_stamp, str) and _DATE.match(first_stamp):
        stamps = stamps.str.replace(",", ".", regex=False)
    elif not isinstance(first_stamp, pd.Timestamp):
        return None, None, ""
    dates = pd.to_datetime(stamps.where(written), format="ISO8601", utc=True, errors="coerce")
    if (wrong := stamps[written & dates.isna()]).size:
        raise InputError(
            f"{path}, column {stamps.name}, row {wrong.index[0]}: '{_shortened(wrong.iloc[0])}' is"
            " not a date; write the whole column as 2026-03-01T12:00:00.125"
        )
    began = dates[written].iloc[0]
    elapsed = (dates - began).dt.total_seconds().to_numpy(dtype=float)
    return (
        began,
        elapsed,
        f"{path}, column {stamps.name}: dates are converted to seconds since {first_stamp}",
    )


def _numbers(path: Path, cells: pd.Series, decimal: str) -> np.ndarray:
    """Numbers of a column: from texts of a CSV file, or numbers of a Parquet file."""
    where = f"{path}, column {cells.name}, row"
    fix = "correct it, or leave the cell empty if nothing was measured"
    plain = cells
    if not pd.api.types.is_numeric_dtype(cells):
        # float() would accept '1_000'; a point in addition to a decimal comma would be a thousands
        # separator
        odd = cells.str.contains("[_.]" if decimal == "," else "_")
        plain = cells.str.replace(",", ".", regex=False) if decimal == "," else cells
        plain = plain.mask(odd, "x").mask(cells == "", "nan")
    try:
        values = plain.to_numpy(dtype=float)
    except ValueError:
        place = next(
            place for place, text in enumerate(plain) if not _is_number(text) or "," in text
        )
        text = cells.iloc[place]
        if ":" in text:
            fix += "; write times as numbers or as ISO dates such as 2026-03-01T12:00:00.125"
        elif decimal == "," and "." in text:
            fix += "; other numbers have a decimal comma: use the same mark everywhere"
        raise InputError(
            f"{where} {cells.index[place]}: '{_shortened(text)}' is not a number; {fix}"
        ) from None
    if (infinite := cells.index[np.isinf(values)]).size:
        raise InputError(f"{where} {infinite[0]}: is infinite; {fix}")
    return values


def _parquet(path: Path, columns: Sequence[str], clock: str, partly: bool) -> pd.DataFrame:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        table = file.read(columns=[name for name in columns if name in file.schema_arrow.names])
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read as Parquet ({_shortened(str(error))}); write the file again"
        ) from error
    series = {}
    for column in _present(str(path), file.schema_arrow.names, columns, clock if partly else ""):
        cells, kind = table.column(column), table.schema.field(column).type
        if pa.types.is_decimal(kind):
            cells = cells.cast(pa.float64())
        elif column == clock and pa.types.is_timestamp(kind) and cells.null_count < len(cells):
            pass  # dates
        elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            raise InputError(
                f"{path}, column {column}: contains {kind}, not numbers; write it as numbers"
            )
        series[column] = cells.to_pandas()
    return pd.DataFrame(series).set_index(pd.RangeIndex(1, table.num_rows + 1))


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[:_MAX_TEXT_LENGTH]}..."
