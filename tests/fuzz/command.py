"""Damaged YAML files, and checks of commands on them."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import yaml
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from tests.command import jointgap

fuzz = settings(
    derandomize=True,
    max_examples=50,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

numbers = st.sampled_from(
    [-1, 0, 1e400, float("nan"), 10**400, "7 furlongs", "5 %", "1,5", "9" * 40 + " m"]
)
others = st.sampled_from(
    [None, True, "", [], {}, b"\xff", {1: 2}, [[1]], {"a": {"b": 1}}, "x" * 500, "\x1b[31m"]
)
junk = numbers | others | st.text(max_size=6) | st.integers() | st.dates()
scraps = st.sampled_from(
    ["", "\t", ":", "- ", "{", "]", "'", "&a ", "*a ", "!!x ", "\x07", "é", "\n", "<<: "]
)


def works_or_is_refused(file: Path, *words: str) -> str | None:
    """Output of a command; None if it ends with exit code 2 and an error that contains the file."""
    done = jointgap(*words)
    if done.returncode == 0:
        return done.stdout
    assert done.returncode == 2 and done.stdout == ""
    lines = done.stderr.splitlines()
    assert any(line.startswith("jointgap: error: ") and str(file) in line for line in lines), lines
    assert "Traceback" not in done.stderr and "\x1b" not in done.stderr
    return None


def check_tables(folder: Path) -> None:
    """Every table below `folder` can be read; hidden files are unfinished."""
    for path in folder.rglob("*.parquet"):
        if not path.name.startswith("."):
            pq.read_table(path)


def places(node: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths to every value of a nested structure."""
    if path:
        yield path
    children = enumerate(node) if isinstance(node, list) else ()
    children = node.items() if isinstance(node, dict) else children
    for key, child in children:
        yield from places(child, (*path, key))


def changed(node: Any, path: tuple, change: Callable[[Any, Any], object]) -> Any:
    """A copy of `node` with `change(container, key)` done at `path`."""
    copy = dict(node) if isinstance(node, dict) else list(node)
    if len(path) == 1:
        change(copy, path[0])
    else:
        copy[path[0]] = changed(node[path[0]], path[1:], change)
    return copy


def replaced(node: Any, path: tuple, value: Any) -> Any:
    """A copy of `node` with another value at `path`."""
    return changed(node, path, lambda container, key: container.__setitem__(key, value))


def renamed(node: Any, path: tuple, name: Any) -> Any:
    """A copy of `node` with another key at `path`; an entry of a list is removed."""

    def change(container: Any, key: Any) -> None:
        removed = container.pop(key)
        if isinstance(container, dict):
            container[name] = removed

    return changed(node, path, change)


def damaged(good: dict) -> st.SearchStrategy[str]:
    """Texts of a YAML file in which a value is replaced, a key is lost or renamed, or some
    characters are others."""
    paths, text = st.sampled_from(list(places(good))), yaml.safe_dump(good)

    def texts(change, changes):
        def text(path, new):
            return yaml.safe_dump(change(good, path, new), allow_unicode=True)

        return st.builds(text, paths, changes)

    values, keys = texts(replaced, junk), texts(renamed, st.text(max_size=6) | st.integers())
    starts, lengths = st.integers(0, len(text) - 1), st.integers(0, 30)
    scrapped = st.builds(
        lambda at, length, scrap: text[:at] + scrap + text[at + length :], starts, lengths, scraps
    )
    return values | keys | scrapped
