"""One stage, one record: what it reads and writes, and the function that does it."""

import ast
import hashlib
import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.core.schema import TABLES, Table

if TYPE_CHECKING:
    from jointgap.config import Scenario

_ROOT = Path(__file__).parent.parent


@cache
def code_digest(function: Callable[..., Any], *tables: Table) -> str:
    """Twelve hexadecimal digits over what a function of this package runs (jointgap's own code, not its
    dependencies), and over `tables` and those that this code names.
    """
    own, modules = code_of(function)
    digest, named = hashlib.sha256(own.encode()), {*tables, *_tables_in(own)}
    for name in sorted(modules):
        source = source_of(name)
        named |= _tables_of(name)
        digest.update(name.encode() + source.read_bytes())
        data = source.parent.glob("templates/*" if source.name == "__init__.py" else f"{source.stem}.yaml")
        for file in sorted(data):  # templates, and the data of a module, are code too
            digest.update(file.name.encode() + file.read_bytes())
    for table in sorted(map(repr, named)):
        digest.update(table.encode())
    return digest.hexdigest()[:12]


def _tables_in(code: str) -> frozenset[Table]:
    return frozenset(TABLES[word.lower()] for word in re.findall("[A-Z_]+", code) if word.lower() in TABLES)


@cache
def _tables_of(module: str) -> frozenset[Table]:
    return _tables_in(source_of(module).read_text(encoding="utf-8"))


def code_of(function: Callable[..., Any]) -> tuple[str, frozenset[str]]:
    """The code that a function runs."""
    own = _used(ast.parse(source_of(function.__module__.removeprefix("jointgap.")).read_bytes()), function.__name__)
    return "\n".join(map(ast.unparse, own)), frozenset().union(*map(closure, _imported(own)))


@cache
def closure(module: str) -> frozenset[str]:
    """`module` and all modules of the package that it imports, directly or not."""
    seen, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += _imports_of(name) - seen
    return frozenset(seen)


@cache
def source_of(module: str) -> Path:
    """File of a module, or of a package's face."""
    place = _ROOT.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@cache
def _imports_of(module: str) -> frozenset[str]:
    return _imported([ast.parse(source_of(module).read_bytes())]) | ({module.rpartition(".")[0]} - {""})


def _imported(nodes: Iterable[ast.AST]) -> frozenset[str]:
    """Modules of the package that the code in `nodes` imports; all of a room from which one is taken by its name."""
    names: set[str] = set()
    for node in (inner for root in nodes for inner in ast.walk(root)):
        if isinstance(node, ast.ImportFrom):
            package, _, base = (node.module or "").partition(".")
            if package == "jointgap":
                names |= {base, *(f"{base}.{alias.name}".strip(".") for alias in node.names)}
        elif isinstance(node, ast.JoinedStr) and isinstance(start := node.values[0], ast.Constant):
            if room := re.fullmatch(r"jointgap\.(\w+)\.", start.value):  # f"jointgap.designs.{name}"
                names |= {f"{room[1]}.{file.stem}" for file in (_ROOT / room[1]).glob("[!_]*.py")}
    return frozenset(name for name in names if name and source_of(name).is_file())


def _used(module: ast.Module, name: str) -> list[ast.stmt]:
    """The statements of a module that define `name`, and all that these use of the module."""
    defined: dict[str, ast.stmt] = {}
    typed_only = [inner for statement in module.body if isinstance(statement, ast.If) for inner in statement.body]
    for statement in (*typed_only, *module.body):
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            defined[statement.name] = statement
        elif isinstance(statement, ast.Import | ast.ImportFrom):
            defined |= {(alias.asname or alias.name).partition(".")[0]: statement for alias in statement.names}
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
            defined |= {node.id: statement for node in targets if isinstance(node.ctx, ast.Store)}
    used, waiting = {}, [name]
    while waiting:
        statement = defined.get(waiting.pop())
        if statement is not None and statement not in used:
            used[statement] = None
            waiting += [node.id for node in ast.walk(statement) if isinstance(node, ast.Name)]
            waiting += _quoted_in_annotations(statement)
    return sorted(used, key=lambda statement: statement.lineno)


def _quoted_in_annotations(statement: ast.stmt) -> Iterator[str]:
    """Names in quoted annotations. Other texts, such as the name of a section of the configuration, mean no code."""
    for node in ast.walk(statement):
        for annotation in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            for inner in ast.walk(annotation) if annotation is not None else ():
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                    yield from re.findall(r"[A-Za-z_]\w*", inner.value)


class Option:
    """An option of a stage's command; it stands in the annotation of the argument that it fills.

    `settings` are those of `click.option`; their type is "file", "folder", or the least whole number.
    """

    def __init__(self, *flags: str, **settings: Any):
        self.flags, self.settings = flags, settings


Workers = Annotated[
    int | None, Option("--workers", type=1, help="Runs side by side; as many as there are cores when absent.")
]


@dataclass(frozen=True)
class Stage:
    """A stage of a scenario or of a campaign; its command, its rule and its line in the docs follow from it."""

    name: str  # of the subcommand
    function: Callable[..., str | None]
    reads: tuple[Table, ...] = ()  # each with its place in the folder of results
    writes: tuple[Table, ...] = ()
    files: tuple[str, ...] = ()  # what it writes besides tables, or the first of many files in a folder
    sections: tuple[
        str, ...
    ] = ()  # the sections of a scenario that it depends on; a change elsewhere does not rerun it
    does: str = ""  # what the workflow says of its job
    after: tuple[str, ...] = ()  # stages whose files it takes in too
    job: str = ""  # the stage in whose job it runs, in the same process; its own when empty
    memory: int = 2000  # of its job [MB]
    minutes: int = 30
    threads: int = 1
    publishes: bool = False  # to MLflow, one job after the other

    @property
    def command_options(self) -> dict[str, Option]:
        """Options of its command, besides those of every stage, by the argument that each fills."""
        return {
            name: option
            for name, annotation in self.function.__annotations__.items()
            for option in getattr(annotation, "__metadata__", ())
        }

    @property
    def help(self) -> str:
        """What it does: the docstring of its function."""
        return inspect.getdoc(self.function) or ""

    @property
    def description(self) -> str:
        """What it does, in a line."""
        return self.help.partition("\n\n")[0].replace("\n", " ")

    @property
    def digest(self) -> str:
        """Twelve digits that change with the code that the stage runs, and with the tables that it reads and writes."""
        return code_digest(self.function, *self.reads, *self.writes)

    def options(self, scenario: "Scenario") -> str:
        """What it reads of a scenario, as JSON text in SI: the value of its ``--options``."""
        return scenario.model_dump_json(include=set(self.sections), by_alias=True)

    def outputs(self, part: int | str = 0) -> list[str]:
        """Paths that it writes within its folder of results; of a stage that has parts, those of `part`."""
        return [path.replace("{part}", str(part)) for path in (*(table.path for table in self.writes), *self.files)]


class Stages(dict[str, Stage]):
    """Stages by name, in the order in which they follow each other."""

    def stage(self, **record: Any) -> Callable[[Callable[..., str | None]], Callable[..., str | None]]:
        """A decorator that records a function as the next stage; `record` holds attributes of `Stage`."""

        def keep(function: Callable[..., str | None]) -> Callable[..., str | None]:
            name = function.__name__.replace("_", "-")
            self[name] = Stage(name, function, **record)
            return function

        return keep

    def jobs(self) -> dict[str, list[Stage]]:
        """The stages that the workflow runs, by the job that they run in."""
        jobs: dict[str, list[Stage]] = {}
        for stage in self.values():
            if stage.does:
                jobs.setdefault(stage.job or stage.name, []).append(stage)
        return jobs

    def needed_for(self, name: str) -> list[str]:
        """The stage `name` and all whose tables it is made from, in their order; the others only add to it."""
        wanted: set[str] = set()
        needed: list[str] = []
        for stage in reversed(self.values()):
            if stage.name == name or not wanted.isdisjoint(table.path for table in stage.writes):
                wanted |= {table.path for table in stage.reads}
                needed.append(stage.name)
        return needed[::-1]

    def written_by(self, *names: str) -> tuple[Table, ...]:
        """Tables that the stages `names` write."""
        return tuple(table for name in names for table in self[name].writes)
