"""Run all benchmarks, or some modules; print one table and write results/bench.json."""

import argparse
import importlib
import json
import pkgutil
from pathlib import Path

from rich.console import Console
from rich.table import Table

import benchmarks


def collect(names: list[str]) -> list[dict]:
    """Rows of all modules that measure something, or of those named."""
    rows = []
    for module in sorted(module.name for module in pkgutil.iter_modules(benchmarks.__path__)):
        if module == "__main__" or (names and module not in names):
            continue
        measure = getattr(importlib.import_module(f"benchmarks.{module}"), "measure", None)
        if measure is not None:
            print(f"measuring {module} ...", flush=True)
            rows += measure()
    return rows


def verdict(row: dict) -> str:
    """A reach is an upper bound; a row without one is a fact to know."""
    if row["measured"] is None:
        return "not measured"
    if row["reach"] is None:
        return ""
    return "met" if row["measured"] <= row["reach"] else "missed"


def number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def table(rows: list[dict]) -> Table:
    """One line per row; the peers are measured in the same run."""
    result = Table(title="jointgap, measured")
    for name in ("what", "reach", "measured"):
        result.add_column(name, justify="left" if name == "what" else "right")
    for name in ("unit", "verdict", "peers"):
        result.add_column(name)
    for row in rows:
        peers = ", ".join(f"{name} {number(value)}" for name, value in row.get("peers", {}).items())
        result.add_row(
            row["what"],
            number(row["reach"]),
            number(row["measured"]),
            row["unit"],
            verdict(row),
            peers,
        )
    return result


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("module", nargs="*", help="measure only these modules of the folder")
    chosen = parser.parse_args().module
    rows = collect(chosen)
    Console(width=160).print(table(rows))
    if not chosen:  # a part must not stand for the whole
        path = Path("results/bench.json")
        path.parent.mkdir(exist_ok=True)
        path.write_text(
            json.dumps([{**row, "verdict": verdict(row)} for row in rows], indent=2) + "\n"
        )
        print(f"written to {path}")


if __name__ == "__main__":
    main()
