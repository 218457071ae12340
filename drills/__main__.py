"""Go through the drills, print one table and write it as Markdown; exit code 1 if anything failed."""

import argparse
import importlib
import json
import pkgutil
import shutil
import sys
import time
import traceback
from pathlib import Path

import drills
from drills.harness import Complaint, Drill, Failure, Row, Sitting, keep

FOLDER = Path("results/drills")
"""Of the table and of the failures; git ignores it."""


def found() -> dict[str, Drill]:
    """All drills, by name."""
    modules = (importlib.import_module(f"drills.{module.name}") for module in pkgutil.iter_modules(drills.__path__))
    found = (getattr(module, "DRILL", None) for module in modules if module.__name__ != "drills.__main__")
    return {drill.name: drill for drill in found if drill is not None}


def gone_through(drill: Drill, sitting: Sitting) -> list[Row]:
    """Rows of a drill; one with a failure where it broke off, so that the others go on."""
    try:
        return drill.run(sitting)
    except Exception as error:
        traceback.print_exc()
        what = f"{drill.name}: goes through to its end"
        return [
            Row(what, 1, [Failure(what, Complaint("a drill breaks off", str(error)[:1000]), 0, {})], seed=sitting.seed)
        ]


def page(rows: list[Row], kept: dict[tuple[str, str], list[Path]]) -> str:
    """The table of all rows, and the kinds of failures with the files of their inputs, as Markdown."""
    lines = ["| drill | cases | failures | seconds | seed |", "| --- | ---: | ---: | ---: | ---: |"]
    for row in rows:
        remark = f" ({row.remark})" if row.remark else ""
        lines.append(f"| {row.what}{remark} | {row.count} | {len(row.failures)} | {row.seconds:.0f} | {row.seed} |")
    failed = [row for row in rows if row.failures]
    if failed:
        lines += ["", "| failures | kind | input |", "| ---: | --- | --- |"]
    for row in failed:
        drill = row.what.partition(":")[0]
        for kind, count in row.kinds.most_common():
            files = ", ".join(f"`{file}`" for file in kept.get((drill, kind), ()))
            lines.append(f"| {count} | {drill}: {_cell(kind)} | {files} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def replay(paths: list[Path], known: dict[str, Drill]) -> bool:
    """Judge the kept inputs of failures again; whether all are mended."""
    mended = True
    for path in paths:
        content = json.loads(path.read_text(encoding="utf-8"))
        judge = known[content["drill"]].judge
        if judge is None:
            print(f"{path}: python -m drills {content['drill']} --seed {content['seed']} goes through it again")
            mended = False
            continue
        for question, complaint in judge(content["case"]).items():
            mended &= complaint is None
            print(f"{path}: {question}: {'yes' if complaint is None else ': '.join(complaint)}")
    return mended


def main() -> None:
    known = found()
    parser = argparse.ArgumentParser(prog="python -m drills", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="DRILL", help=f"only these of {', '.join(known)}")
    parser.add_argument("--seed", type=int, default=0, help="another seed makes other cases (default 0)")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the cases to go through (default 1.0)")
    parser.add_argument("--replay", nargs="+", type=Path, metavar="FILE", help="judge kept inputs of failures again")
    given = parser.parse_args()
    if unknown := [name for name in given.names if name not in known]:
        parser.error(f"no drill {', '.join(unknown)}; there are {', '.join(known)}")
    if given.replay:
        sys.exit(not replay(given.replay, known))

    sitting, rows, kept = Sitting(given.seed, given.scale), [], {}
    if not given.names:
        shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    table = FOLDER / ("table.md" if not given.names else f"{'-'.join(given.names)}.md")
    for name, drill in known.items():
        if given.names and name not in given.names:
            continue
        print(f"drill {name} ...", flush=True)
        began = time.monotonic()
        own = gone_through(drill, sitting)
        kept |= keep(name, own, given.seed, FOLDER / "failures")
        failures = sum(len(row.failures) for row in own)
        print(f"drill {name}: {failures} failures, {time.monotonic() - began:.0f} s", flush=True)
        rows += own
        table.write_text(page(rows, kept), encoding="utf-8")  # what is found so far outlives a drill that is stopped
    print(page(rows, kept), end="")
    print(f"written to {table}")
    sys.exit(any(row.failures for row in rows))


if __name__ == "__main__":
    main()
