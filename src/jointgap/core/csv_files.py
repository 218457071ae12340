"""Columns of numbers from a file of samples, CSV or Parquet, with the place of each number for messages."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.parquet import is_as_written
from jointgap.section import Section

SEPARATORS = ("\t", ";", ",", "|", " ")
_COMMENT = "#"
_PARQUET = b"PAR1"
_ARCHIVES = {
    b"PK\x03\x04": "a spreadsheet or an archive",
    b"\x1f\x8b": "compressed",
    b"\xd0\xcf\x11\xe0": "a spreadsheet",
}
_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?$")
_DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")
_MOST_ABOVE = 1000  # lines among which the headings are looked for
_MAX_UNIT_LENGTH = 15  # characters
_MAX_TEXT_LENGTH = 60  # characters of a text that are shown


class Csv(Section):
    """How text files of samples are written."""

    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = Field(
        None, description="character between columns; null: detected"
    )
    decimal: Literal[".", ","] | None = Field(None, description="decimal mark; null: detected")
    skip_rows: Annotated[int, Field(ge=0)] | None = Field(
        None, description="lines of the file above the headings; null: the headings are found by their names"
    )

    @model_validator(mode="after")
    def _marks_differ(self):
        if self.separator is not None and (self.separator == self.decimal or self.separator in '"#\n\r.0123456789'):
            raise ValueError(f"separator {self.separator!r} cannot part columns; write one such as ';' or '\\t'")
        return self


@dataclass(frozen=True)
class Columns:
    """Numbers of a file by column."""

    values: dict[str, np.ndarray]  # As written; NaN where the file has a gap
    rows: np.ndarray  # Line of the file (CSV) or row counted from 1 (Parquet) of each sample, for messages
    units: dict[str, str]  # What a row of units below the headings says, brackets removed; empty without one
    remarks: tuple[str, ...] = ()  # What was skipped or converted
    is_dated: bool = False  # Whether the times were dates, and are now seconds since the first


def read_columns(path: Path, wanted: Sequence[str], form: Csv, clock: str = "") -> Columns:
    """The columns `wanted` of a file."""
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # a zero byte in the name is a ValueError
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({why}); check 'file' of the run") from error
    for start, kind in _ARCHIVES.items():
        if content.startswith(start):
            raise InputError(f"{path}: is {kind}; save the samples as CSV or Parquet")
    if content.startswith(_PARQUET) or path.suffix == ".parquet":
        columns = _parquet(path, wanted, clock)
    else:
        columns = _csv(path, _decoded(path, content), wanted, form, clock)
    if not columns.rows.size:
        raise InputError(f"{path}: holds headings but no samples; give the file of the measurement")
    return columns


def _decoded(path: Path, content: bytes) -> str:
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"{path}, row {line}: is not text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    if "\x00" in text:
        line = text[: text.index("\x00")].count("\n") + 1
        raise InputError(f"{path}, row {line}: holds a zero byte, so it is damaged or no text; save it as CSV in UTF-8")
    return text


def _csv(path: Path, text: str, wanted: Sequence[str], form: Csv, clock: str) -> Columns:
    numbered = [(number, line) for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1) if line.strip()]
    skipped = form.skip_rows or 0
    lines = [(n, line) for n, line in numbered if n > skipped and not line.lstrip().startswith(_COMMENT)]
    if not lines:
        what = f"has no rows below the {skipped} of csv.skip_rows" if skipped else "is empty"
        raise InputError(f"{path}: {what}; give a table with headings and samples")
    place, separator = _place_of_headings(lines, wanted, form)
    _check_quotes(path, lines[place:])
    header_row, header = lines[place]
    headings = _split(header, separator)
    while headings and not headings[-1]:  # the row of headings ends with a separator
        headings.pop()
    also = "" if set(wanted) & set(headings) else "; where the headings are in another row, give csv.skip_rows"
    hidden = _hidden_headings(numbered, header_row, wanted)
    _check_headings(f"{path}, row {header_row}", headings, wanted, hidden, also)
    remarks = ()
    if place and form.skip_rows is None:
        skipped_lines = "1 line" if place == 1 else f"{place} lines"
        remarks = (f"{path}: the headings are in row {header_row}; {skipped_lines} above them skipped",)
    table = _cells(path, lines[place + 1 :], separator, headings, header_row)
    cells = {column: table[headings.index(column)].str.strip() for column in wanted}
    rows = np.array([number for number, _ in lines[place + 1 :]], dtype=np.int64)
    units = _row_of_units(cells)
    if units:
        rows, cells = rows[1:], {column: texts.iloc[1:] for column, texts in cells.items()}
    dates = _seconds(path, clock, cells[clock], rows) if clock else None
    decimal = form.decimal or _decimal(path, cells, rows)
    values = {
        column: _numbers(path, column, texts, rows, decimal)
        for column, texts in cells.items()
        if dates is None or column != clock
    }
    if dates is not None:
        values[clock], remark = dates
        remarks = (*remarks, remark)
    return Columns(values, rows, units, remarks, is_dated=dates is not None)


def _check_quotes(path: Path, lines: list[tuple[int, str]]) -> None:
    for number, line in lines:
        if line.count('"') % 2 or len(line) > csv.field_size_limit():
            raise InputError(
                f"{path}, row {number}: a quotation mark is not closed, or the row has no end; mend the row"
            )


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _place_of_headings(lines: list[tuple[int, str]], wanted: Sequence[str], form: Csv) -> tuple[int, str]:
    """Index of the headings among `lines`, and the separator: of the first line that has all columns `wanted`, else of
    the one with most of them. With `skip_rows` stated it is the first line.
    """
    found, best = (0, form.separator or SEPARATORS[0]), (-1, 0)
    for place, (_, line) in enumerate(lines[: _MOST_ABOVE if form.skip_rows is None else 1]):
        for mark in (form.separator,) if form.separator else SEPARATORS:
            cells = _split(line[: csv.field_size_limit()], mark)
            matched = len(set(wanted) & set(cells))
            # without any match the line is not moved, and the separator is the one that makes most cells
            if matched > best[0] or (matched == best[0] and place == found[0] and len(cells) > best[1]):
                found, best = (place, mark), (matched, len(cells))
        if best[0] == len(set(wanted)):
            break
    return found


def _hidden_headings(numbered: list[tuple[int, str]], header_row: int, wanted: Sequence[str]) -> str:
    """What to do where the headings stand in a comment, as some programs write them."""
    for number, line in numbered:
        if number >= header_row:
            break
        bare = line.lstrip(f" {_COMMENT}")[: csv.field_size_limit()]
        if line.lstrip().startswith(_COMMENT) and any(set(wanted) <= set(_split(bare, mark)) for mark in SEPARATORS):
            return f"row {number} has them in a comment: remove the '{_COMMENT}' there"
    return ""


def _check_headings(where: str, headings: Sequence[str], wanted: Sequence[str], fix: str = "", also: str = "") -> None:
    for column in wanted:
        if column not in headings:
            hint = fix or did_you_mean(column, (_shortened(heading) for heading in headings if heading)) + also
            raise InputError(f"{where}: has no column '{column}' among its headings; {hint}")
        if list(headings).count(column) > 1:
            raise InputError(f"{where}: has the column '{column}' twice; name each column differently")


def _cells(
    path: Path, lines: list[tuple[int, str]], separator: str, headings: list[str], header_row: int
) -> pd.DataFrame:
    """Texts below the headings, by the number of the column; every row must be as long as the headings."""
    width = len(headings)
    if separator == " ":
        lines = [(row, " ".join(line.split())) for row, line in lines]
    lengths = [len(_split(line, separator)) if '"' in line else line.count(separator) + 1 for _, line in lines]
    for (row, line), length in zip(lines, lengths, strict=True):
        if length != width and (length < width or any(_split(line, separator)[width:])):
            fix = "mend the row"
            if len(set(lengths)) == 1 and length < width:
                fix = "all rows have as many; remove the heading too many"
            elif separator == "," and length == 2 * width:
                fix = "where decimals have a comma too, write another separator between the columns, such as ';'"
            raise InputError(
                f"{path}, row {row}: has {length} cells, but there are {width} headings in row {header_row} (separator "
                f"{separator!r}); {fix}, or give csv.skip_rows, csv.separator and csv.decimal"
            )
    names = range(max([width, *lengths]))
    if not lines:
        return pd.DataFrame(columns=names, dtype=str)
    text = StringIO("\n".join(line for _, line in lines))
    try:
        table = pd.read_csv(text, sep=separator, header=None, names=names, dtype=str, na_filter=False,
                            skipinitialspace=True, skip_blank_lines=False)  # fmt: skip
    except pd.errors.ParserError:
        table = None
    if table is None or len(table) != len(lines):  # a quotation mark joins two rows
        row = next(row for row, line in lines if '"' in line)
        raise InputError(f"{path}, row {row}: quotation marks from here on join rows; mend or remove them")
    return table


def _row_of_units(cells: dict[str, pd.Series]) -> dict[str, str]:
    """Units from a first row that holds short text and no number in any wanted column; {} where it is a row of samples.

    A row of empty cells is a row of samples: a gap.
    """
    first = {column: texts.iloc[0] for column, texts in cells.items() if len(texts)}
    if not any(first.values()) or any(_is_number(text) or len(text) > _MAX_UNIT_LENGTH for text in first.values()):
        return {}
    return {column: text.strip("[]() ") for column, text in first.items()}


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _decimal(path: Path, cells: dict[str, pd.Series], rows: np.ndarray) -> str:
    """The decimal mark: a comma where any number has one, and then none may have a point."""
    commas = ((column, np.flatnonzero(texts.str.fullmatch(_COMMA_NUMBER))) for column, texts in cells.items())
    comma = next(((column, places[0]) for column, places in commas if places.size), None)
    if comma is None:
        return "."
    first = f"{path}, column {comma[0]}, row {rows[comma[1]]}: '{cells[comma[0]].iloc[comma[1]]}' has a decimal comma"
    for column, texts in cells.items():
        for place in np.flatnonzero(texts.str.contains(".", regex=False) & ~texts.str.contains(",", regex=False)):
            if _is_number(texts.iloc[place]):
                raise InputError(
                    f"{first}, but '{texts.iloc[place]}' in column {column}, row {rows[place]} a point; write one of "
                    "them throughout"
                )
    return ","


def _seconds(path: Path, column: str, stamps: pd.Series, rows: np.ndarray) -> tuple[np.ndarray, str] | None:
    """Seconds since the first of the dates in a `column`, and a remark; None where it does not begin with a date."""
    written = stamps.notna() & (stamps != "")
    first = next(iter(stamps[written]), None)
    if isinstance(first, str) and _DATE.match(first):
        stamps = stamps.str.replace(",", ".", regex=False)
    elif not isinstance(first, pd.Timestamp):
        return None
    dates = pd.to_datetime(stamps.where(written), format="ISO8601", utc=True, errors="coerce")
    if (wrong := np.flatnonzero(written & dates.isna())).size:
        text = _shortened(stamps.iloc[wrong[0]])
        raise InputError(
            f"{path}, column {column}, row {rows[wrong[0]]}: '{text}' is not a date; write all of the column as "
            "2026-03-01T12:00:00.125"
        )
    elapsed = (dates - dates[written].iloc[0]).dt.total_seconds().to_numpy(dtype=float)
    return elapsed, f"{path}, column {column}: dates are read as seconds since {first}"


def _numbers(path: Path, column: str, texts: pd.Series, rows: np.ndarray, decimal: str) -> np.ndarray:
    # float() would take '1_000'; a point beside a decimal comma would be a mark for thousands
    odd = texts.str.contains("_", regex=False)
    plain = texts
    if decimal == ",":
        odd |= texts.str.contains(".", regex=False)
        plain = texts.str.replace(",", ".", regex=False)
    plain = plain.mask(odd, "x").mask(texts == "", "nan")
    try:
        values = plain.to_numpy(dtype=float)
    except ValueError:
        place = next(place for place, text in enumerate(plain) if not _is_number(text) or "," in text)
        text = texts.iloc[place]
        stamp = "; write times as numbers or as ISO dates such as 2026-03-01T12:00:00.125" if ":" in text else ""
        raise InputError(
            f"{path}, column {column}, row {rows[place]}: '{_shortened(text)}' is not a number; "
            f"correct it, or leave the cell empty where nothing was measured{stamp}"
        ) from None
    return _finite(path, column, values, rows)


def _finite(path: Path, column: str, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    if (infinite := np.flatnonzero(np.isinf(values))).size:
        raise InputError(
            f"{path}, column {column}, row {rows[infinite[0]]}: is infinite; correct it, or leave the cell empty "
            "where nothing was measured"
        )
    return values


def _parquet(path: Path, wanted: Sequence[str], clock: str) -> Columns:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if is_as_written(path) is False:
        raise _unreadable(path, "its bytes are not those that were written")
    try:
        headings = pq.read_schema(path).names
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    _check_headings(str(path), headings, wanted)
    try:
        table = pq.read_table(path, columns=list(wanted), page_checksum_verification=True)
        values, dates = {}, None
        for column in wanted:
            kind = table.schema.field(column).type
            if column == clock and pa.types.is_timestamp(kind):
                dates = _seconds(path, column, table.column(column).to_pandas(), np.arange(1, table.num_rows + 1))
                values[column] = np.full(table.num_rows, np.nan) if dates is None else dates[0]
                continue
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
                raise InputError(f"{path}, column {column}: holds {kind}, not numbers; write it as numbers")
            numbers = table.column(column).cast(pa.float64(), safe=False)
            values[column] = numbers.to_numpy().astype(float)
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from error
    rows = np.arange(1, table.num_rows + 1)
    values = {column: _finite(path, column, numbers, rows) for column, numbers in values.items()}
    return Columns(values, rows, {}, (dates[1],) if dates else (), is_dated=dates is not None)


def _unreadable(path: Path, error: Exception | str) -> InputError:
    return InputError(f"{path}: cannot be read as Parquet ({_shortened(str(error))}); write the file again")


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[:_MAX_TEXT_LENGTH]}..."
