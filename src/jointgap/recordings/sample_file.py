"""Columns of numbers from a file of samples, CSV or Parquet, with the place of each number for messages."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jointgap.config.campaign_file import Csv
from jointgap.errors import InputError, did_you_mean
from jointgap.tables.digest import is_as_written

SEPARATORS = ("\t", ";", ",", "|", " ")
_COMMENT = "#"
_PARQUET = b"PAR1"
_ARCHIVES = {
    b"PK\x03\x04": "a spreadsheet or an archive",
    b"\x1f\x8b": "compressed",
    b"\xd0\xcf\x11\xe0": "a spreadsheet",
}
_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?$")
_MAX_UNIT_LENGTH = 15  # characters
_MAX_TEXT_LENGTH = 60  # characters of a text that are shown


@dataclass(frozen=True)
class Columns:
    """Numbers of a file by column.

    Attributes
    ----------
    values : dict of str to (n,) array
        As written; NaN where the file has a gap.
    rows : (n,) array of int
        Line of the file (CSV) or row counted from 1 (Parquet) of each sample, for messages.
    units : dict of str to str
        What a row of units below the headings says, brackets removed; empty without one.
    """

    values: dict[str, np.ndarray]
    rows: np.ndarray
    units: dict[str, str]


def read_columns(path: Path, wanted: Sequence[str], form: Csv) -> Columns:
    """The columns `wanted` of a file.

    Parameters
    ----------
    path : Path
    wanted : sequence of str
        Headings.
    form : Csv
        Separator and decimal mark, where the campaign states them.

    Raises
    ------
    InputError
        No such file, another format, a column missing or there twice, text or an infinite value among numbers, rows of
        another length than the headings, no samples; with file, column, row and what to do.
    """
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:  # a zero byte in the name is a ValueError
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({why}); check 'file' of the run") from error
    for start, kind in _ARCHIVES.items():
        if content.startswith(start):
            raise InputError(f"{path}: is {kind}; save the samples as CSV or Parquet")
    if content.startswith(_PARQUET) or path.suffix == ".parquet":
        columns = _parquet(path, wanted)
    else:
        columns = _csv(path, _decoded(path, content), wanted, form)
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


def _csv(path: Path, text: str, wanted: Sequence[str], form: Csv) -> Columns:
    numbered = [(number, line) for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1) if line.strip()]
    lines = [(number, line) for number, line in numbered if not line.lstrip().startswith(_COMMENT)]
    if not lines:
        raise InputError(f"{path}: is empty; give a table with headings and samples")
    for number, line in lines:
        if line.count('"') % 2 or len(line) > csv.field_size_limit():
            raise InputError(
                f"{path}, row {number}: a quotation mark is not closed, or the row has no end; mend the row"
            )
    header_row, header = lines[0]
    separator = form.separator or max(SEPARATORS, key=lambda mark: _matched_columns(_split(header, mark), wanted))
    headings = _split(header, separator)
    _check_headings(f"{path}, row {header_row}", headings, wanted, _hidden_headings(numbered, header_row, wanted))
    places = {column: headings.index(column) for column in wanted}
    rows = np.array([number for number, _ in lines[1:]], dtype=np.int64)
    cells = _cells(path, lines[1:], separator, len(headings), places)
    units = _row_of_units(cells)
    if units:
        rows, cells = rows[1:], {column: texts[1:] for column, texts in cells.items()}
    decimal = form.decimal or _decimal(path, cells, rows)
    return Columns(
        {column: _numbers(path, column, texts, rows, decimal) for column, texts in cells.items()}, rows, units
    )


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _matched_columns(headings: list[str], wanted: Sequence[str]) -> tuple[int, int]:
    """How well a separator parts the headings: columns found, then columns at all."""
    return len(set(wanted) & set(headings)), len(headings)


def _hidden_headings(numbered: list[tuple[int, str]], header_row: int, wanted: Sequence[str]) -> str:
    """What to do where the headings stand in a comment, as some programs write them."""
    for number, line in numbered:
        if number >= header_row:
            break
        bare = line.lstrip(f" {_COMMENT}")[: csv.field_size_limit()]
        if any(set(wanted) <= set(_split(bare, mark)) for mark in SEPARATORS):
            return f"row {number} has them in a comment: remove the '{_COMMENT}' there"
    return ""


def _check_headings(where: str, headings: Sequence[str], wanted: Sequence[str], fix: str) -> None:
    for column in wanted:
        if column not in headings:
            hint = fix or did_you_mean(column, (_shortened(heading) for heading in headings if heading))
            raise InputError(f"{where}: has no column '{column}' among its headings; {hint}")
        if list(headings).count(column) > 1:
            raise InputError(f"{where}: has the column '{column}' twice; name each column differently")


def _cells(
    path: Path, lines: list[tuple[int, str]], separator: str, width: int, places: dict[str, int]
) -> dict[str, list[str]]:
    """Texts of the wanted columns; every row must be as long as the headings."""
    if any(mark in line for _, line in lines for mark in (" ", '"')):
        parsed = (_split(line, separator) for _, line in lines)  # row by row, lest a quotation mark join two of them
    else:
        parsed = csv.reader((line for _, line in lines), delimiter=separator)
    cells: dict[str, list[str]] = {column: [] for column in places}
    for (row, _), line in zip(lines, parsed, strict=True):
        if len(line) != width and (len(line) < width or any(cell.strip() for cell in line[width:])):
            raise InputError(
                f"{path}, row {row}: has {len(line)} cells, but there are {width} headings (separator {separator!r}); "
                "mend the row, or give csv.separator and csv.decimal"
            )
        for column, place in places.items():
            cells[column].append(line[place].strip())
    return cells


def _row_of_units(cells: dict[str, list[str]]) -> dict[str, str]:
    """Units from a first row that holds short text and no number in any wanted column; {} where it is a row of samples.

    A row of empty cells is a row of samples: a gap.
    """
    first = {column: texts[0] for column, texts in cells.items() if texts}
    if not any(first.values()) or any(_is_number(text) or len(text) > _MAX_UNIT_LENGTH for text in first.values()):
        return {}
    return {column: text.strip("[]() ") for column, text in first.items()}


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _decimal(path: Path, cells: dict[str, list[str]], rows: np.ndarray) -> str:
    """The decimal mark: a comma where any number has one, and then none may have a point."""
    comma = point = None
    for column, texts in cells.items():
        for row, text in zip(rows, texts, strict=True):
            if comma is None and "," in text and _COMMA_NUMBER.match(text):
                comma = (column, row, text)
            elif point is None and "." in text and _is_number(text) and "," not in text:
                point = (column, row, text)
    if comma and point:
        raise InputError(
            f"{path}, column {comma[0]}, row {comma[1]}: '{comma[2]}' has a decimal comma, but '{point[2]}' in column "
            f"{point[0]}, row {point[1]} a point; write one of them throughout"
        )
    return "," if comma else "."


def _numbers(path: Path, column: str, texts: list[str], rows: np.ndarray, decimal: str) -> np.ndarray:
    values = np.empty(len(texts))
    for index, text in enumerate(texts):
        try:
            # float() would take '1_000'; a point beside a decimal comma would be a mark for thousands
            if "_" in text or (decimal == "," and "." in text):
                raise ValueError
            values[index] = float(text.replace(",", ".") if decimal == "," else text) if text else math.nan
        except ValueError as error:
            raise InputError(
                f"{path}, column {column}, row {rows[index]}: '{_shortened(text)}' is not a number; "
                "correct it, or leave the cell empty where nothing was measured"
            ) from error
    return _finite(path, column, values, rows)


def _finite(path: Path, column: str, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    if (infinite := np.flatnonzero(np.isinf(values))).size:
        raise InputError(
            f"{path}, column {column}, row {rows[infinite[0]]}: is infinite; correct it, or leave the cell empty "
            "where nothing was measured"
        )
    return values


def _parquet(path: Path, wanted: Sequence[str]) -> Columns:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if is_as_written(path) is False:
        raise _unreadable(path, "its bytes are not those that were written")
    try:
        headings = pq.read_schema(path).names
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    _check_headings(str(path), headings, wanted, "")
    try:
        table = pq.read_table(path, columns=list(wanted), page_checksum_verification=True)
        values = {}
        for column in wanted:
            kind = table.schema.field(column).type
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
                raise InputError(f"{path}, column {column}: holds {kind}, not numbers; write it as numbers")
            numbers = table.column(column).cast(pa.float64(), safe=False)
            values[column] = numbers.to_numpy().astype(float)
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from error
    rows = np.arange(1, table.num_rows + 1)
    return Columns({column: _finite(path, column, numbers, rows) for column, numbers in values.items()}, rows, {})


def _unreadable(path: Path, error: Exception | str) -> InputError:
    return InputError(f"{path}: cannot be read as Parquet ({_shortened(str(error))}); write the file again")


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[:_MAX_TEXT_LENGTH]}..."
