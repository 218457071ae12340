"""Files of samples are read as they are written, or refused with file, column, row and what to
do."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core.csv_files import Csv, read_columns
from jointgap.core.errors import InputError

WANTED = ("t", "x")
T, X = [0.0, 0.5, 1.0], [1.25, np.nan, -3e-3]
PLAIN = "0,1.25\n0.5,\n1,-3e-3\n"


@pytest.fixture
def read(tmp_path):
    """Columns of a file with this content, or with this table in Parquet."""

    def columns(content, wanted=WANTED, clock=None, **form):
        path = tmp_path / "run.csv"
        if isinstance(content, pd.DataFrame):
            content.to_parquet(path)  # known by its content, whatever its name
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        return read_columns(path, wanted, Csv(**form), **({"clock": clock} if clock else {}))

    return columns


FORMS = [
    f"t,x\n{PLAIN}",
    "t;x\n0;1,25\n0,5;\n1;-3e-3\n",
    "t\tx\n0\t1.25\n0.5\tNaN\n1\t-0.003\n",
    "t|x\r0|1.25\r0.5|nan\r1|-3E-3",
    "t   x\n0   1.25\n0.5 nan\n  1 -3e-3\n",
    f"\ufefft,x\n{PLAIN}",
    "# rig A\n\nt,x\n# a break\n0,1.25\n\n0.5,\n1,-3e-3\n",
    '"t","x"\n"0","1.25"\n"0.5",""\n"1","-3e-3"\n',
    '"t"; "x"\n0; "1,25"\n0,5; \n1; -3e-3\n',
    "t,x,\n0,1.25,\n0.5,,\n1,-3e-3,\n",
    "t,x\n0,1.25,\n0.5,,\n1,-3e-3\n",
    f"t,x\n[s],[mm]\n{PLAIN}",
    "t;x\n0;1,25\n0,5;\n1;-3e-3\n".encode("utf-16"),
    f'Model,AB12\nLength 5" pipe\nRecord Length,3\n\nt,x\n{PLAIN}',
    "Rig A\nt;comment;x\n0;good;1,25\n0,5;none;\n1;;-3e-3\n",
    f"t,x,\n{PLAIN}",
]


@pytest.mark.parametrize("content", FORMS)
def test_tables_are_read_with_any_separator_and_decimal_mark(read, content):
    values = read(content).values
    np.testing.assert_array_equal(values["t"], T)
    np.testing.assert_array_equal(values["x"], X)


def test_a_stated_separator_and_decimal_mark_are_used_instead_of_detected_ones(read):
    columns = read("t,x:x\n0:1\n1:2,5\n", wanted=("x",), separator=":", decimal=",")
    np.testing.assert_array_equal(columns.values["x"], [1.0, 2.5])


def test_rows_are_lines_of_the_file_and_units_and_headings_are_where_they_are(read, tmp_path):
    assert read("# rig\nt,x\n\n0,1\n# break\n1,2\n").rows.tolist() == [4, 6]
    # the last one is a gap
    for row, units in (("[s],(mm)\n", {"t": "s", "x": "mm"}), ("", {}), (",\n", {})):
        assert read(f"t,x\n{row}0,1\n").units == units
    result = read("Model,AB12\nFirmware,1.12\n\nt,x\n0,1\n1,2\n")
    assert result.rows.tolist() == [5, 6]
    assert result.remarks == (
        f"{tmp_path}/run.csv: the headings are in row 4; 2 lines above them skipped",
    )
    old_and_new = "t,x\nold,headings\nt,x\n0,1\n1,2\n"
    result = read(old_and_new, skip_rows=2)
    assert (result.rows.tolist(), result.remarks) == ([4, 5], ())
    for rows, words in (
        (1, "row 2: has no column 't'"),
        (9, "no rows below the 9 of csv.skip_rows"),
    ):
        with pytest.raises(InputError, match=words):
            read(old_and_new, skip_rows=rows)


@pytest.mark.parametrize(
    "stamps",
    [
        ("2026-03-01T12:00:00.000", "2026-03-01T12:00:00.500", "2026-03-01T12:00:01.000"),
        ("2026-03-01 23:59:59,5", "2026-03-02 00:00:00", "2026-03-02 00:00:00,5"),
        ("2026-03-01T12:00:00+01:00", "2026-03-01T11:00:00.5Z", "2026-03-01T12:00:01+01:00"),
    ],
)
def test_dates_are_seconds_since_the_first(read, stamps):
    rows = "".join(f"{stamp};{x}\n" for x, stamp in enumerate(stamps))
    columns = read(f"t;x\n{rows}", clock="t")
    assert columns.began is not None
    assert "dates are converted to seconds since 2026-03-01" in columns.remarks[0]
    np.testing.assert_allclose(columns.values["t"], T, atol=1e-12)
    with pytest.raises(InputError, match=r"column t, row 2: '2026.* is not a number"):
        read(f"t;x\n{rows}")  # of a channel that is no time


def test_a_missing_date_is_a_gap_and_a_wrong_one_is_refused(read):
    dates = pd.to_datetime(["2026-03-01T12:00:00", None, "2026-03-01T12:00:01"])
    result = read(pd.DataFrame({"t": dates, "x": [1.0, 2.0, 3.0]}), clock="t")
    np.testing.assert_array_equal(result.values["t"], [0.0, np.nan, 1.0])
    for date in ("yesterday", "2026-13-01"):
        with pytest.raises(InputError, match=f"column t, row 3: '{date}' is not a date"):
            read(f"t,x\n2026-03-01T12:00:00,1\n{date},2\n", clock="t")


def test_parquet_is_read_by_its_content_whatever_its_name_and_kind_of_number(read):
    for kind in (float, np.float32, "int16", "Float64"):
        result = read(pd.DataFrame({"t": [0, 1, 2], "x": [3, 4, 5]}).astype({"x": kind}))
        np.testing.assert_array_equal(result.values["x"], [3.0, 4.0, 5.0])
        assert result.rows.tolist() == [1, 2, 3]
    gap = read(pd.DataFrame({"t": [0.0, 1.0], "x": pd.array([3, None], dtype="Int64")}))
    np.testing.assert_array_equal(gap.values["x"], [3.0, np.nan])


NO_TABLES = [
    ("", "is empty"),
    ("t,x\n", "has headings but no samples"),
    ("time,x\n0,1\n", "row 1 ~ no column 't' ~ known here: time, x"),
    ("t,xx\n0,1\n", "no column 'x' ~ did you mean 'xx'"),
    ("# t,x\n0,1\n1,2\n", "no column 't' ~ row 1 has them in a comment: remove the '#'"),
    ("t,x,x\n0,1,2\n", "has the column 'x' twice"),
    ("t,x\n0,1\n0.5,broken\n", "column x, row 3 ~ 'broken' is not a number ~ leave the cell empty"),
    *(
        (f"t,x\n0,1\n0.5,{number}\n", "column x, row 3 ~ infinite")
        for number in ("inf", "1e999", 2000 * "1")
    ),
    (
        "t;x\n0;1,5\n0,5;1.5\n",
        "column x, row 3: '1.5' is not a number ~ a decimal comma ~ everywhere",
    ),
    ("t,x\n0,1\n0.5\n", "row 3: has 1 cells, but there are 2 headings"),
    (
        "t,x,y\n0,1\n1,2\n",
        "row 2: has 2 cells ~ all rows have the same number; remove the additional heading",
    ),
    ("t,x\n0,0,1,5\n0,5,1,5\n", "row 2: has 4 cells ~ decimals have a comma too ~ such as ';'"),
    (
        "t,x\n12:00:01,1\n",
        "column t, row 2: '12:00:01' is not a number ~ as ISO dates such as 2026-",
    ),
    ("t,x\n0,1\n0,5,1,5\n", "row 3: has 4 cells ~ csv.separator and csv.decimal"),
    ('t,x\n0,1\n0.5,"1\n1,2\n', "row 3: a quotation mark is not closed"),
    (b"t,x\n0,1\n\xff,1\n", "row 3 ~ is not text in UTF-8 ~ save it as UTF-8"),
    (b"PK\x03\x04....", "a spreadsheet or an archive ~ save the samples as CSV or Parquet"),
    (b"PAR1....", "cannot be read as Parquet"),
    (pd.DataFrame({"t": [0.0], "x": ["a"]}), "column x ~ string, not numbers"),
    (pd.DataFrame({"t": [0.0], "x": [True]}), "column x ~ bool, not numbers"),
    (pd.DataFrame({"t": [0.0, 1.0], "x": [1.0, np.inf]}), "column x, row 2 ~ infinite"),
    (pd.DataFrame({"t": [], "x": []}, dtype=float), "no samples"),
]


@pytest.mark.parametrize("content, words", NO_TABLES)
def test_a_file_without_a_table_of_numbers_is_refused_with_place_and_fix(
    read, tmp_path, content, words
):
    with pytest.raises(InputError) as error:
        read(content)
    assert str(error.value).startswith(str(tmp_path / "run.csv"))
    assert all(word in str(error.value) for word in words.split(" ~ "))


@pytest.mark.parametrize("name", ["nowhere.csv", "."])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(tmp_path / name, WANTED, Csv())
