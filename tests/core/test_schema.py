"""Tables in schemas/*.yaml, and what `jointgap describe NAME` shows of them."""

import pytest
import yaml

from jointgap.core.errors import InputError
from jointgap.core.schema import SCHEMAS, TABLES, describe


def test_schemas_are_plain_yaml():
    for path in SCHEMAS.glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        assert yaml.safe_load(text) == yaml.load(text, yaml.CSafeLoader), path


def test_columns_have_a_description_a_known_kind_and_numbers_a_unit():
    for table in TABLES.values():
        assert len(set(table.names)) == len(table.columns), table.name
        for column in table.columns:
            is_text = column.kind in ("text", "category", "bool")
            assert is_text or column.kind in ("float", "int"), (table.name, column)
            is_group = column.name.startswith("{")
            assert is_group or (column.description and (column.unit or is_text)), column


def test_a_table_is_described_with_its_columns():
    title, rows = describe("trajectory")
    assert title.endswith("(simulate/trajectory.parquet)")
    assert rows[0] == ("column", "unit", "description")
    assert ("time", "s", "time since the start") in rows


def test_a_column_is_described_with_the_tables_that_have_it():
    _, rows = describe("crank_angle")
    assert {"trajectory", "events"} <= {table for table, _, _ in rows}


@pytest.mark.parametrize(
    "name, hint", [("crank_angel", "did you mean 'crank_angle'"), ("qzx", "reference/tables.md")]
)
def test_an_unknown_name_gets_a_suggestion(name, hint):
    with pytest.raises(InputError, match=hint):
        describe(name)
