"""Stages: their inputs, outputs, options and function."""

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
    """Twelve hexadecimal digits of the package's code that a function runs (without dependencies),
    and of `tables` and those used in the code.
    """
    own, modules = code_of(function)
    digest, named = hashlib.sha256(own.encode()), {*tables, *_tables_in(own)}
    for name in sorted(modules):
        source = source_of(name)
        named |= _tables_of(name)
        digest.update(name.encode() + source.read_bytes())
        data = source.parent.glob(
            "templates/*" if source.name == "__init__.py" else f"{source.stem}.yaml"
        )
        for file in sorted(data):  # templates and data files count as code
            digest.update(file.name.encode() + file.read_bytes())
    for table in sorted(map(repr, named)):
        digest.update(table.encode())
    return digest.hexdigest()[:12]


def _tables_in(code: str) -> frozenset[Table]:
    return frozenset(
        TABLES[word.lower()] for word in re.findall("[A-Z_]+", code) if word.lower() in TABLES
    )


@cache
def _tables_of(module: str) -> frozenset[Table]:
    return _tables_in(source_of(module).read_text(encoding="utf-8"))


def code_of(function: Callable[..., Any]) -> tuple[str, frozenset[str]]:
    """The code that a function runs, and the modules that it imports."""
    own = _used(
        ast.parse(source_of(function.__module__.removeprefix("jointgap.")).read_bytes()),
        function.__name__,
    )
    return "\n".join(map(ast.unparse, own)), frozenset().union(*map(closure, _imported(own)))


@cache
def closure(module: str) -> frozenset[str]:
    """`module` and all modules of the package that it imports, directly or indirectly."""
    seen, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += _imports_of(name) - seen
    return frozenset(seen)


@cache
def source_of(module: str) -> Path:
    """File of a module or package."""
    place = _ROOT.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@cache
def _imports_of(module: str) -> frozenset[str]:
    return _imported([ast.parse(source_of(module).read_bytes())]) | (
        {module.rpartition(".")[0]} - {""}
    )


def _imported(nodes: Iterable[ast.AST]) -> frozenset[str]:
    """Modules of the package imported by the code in `nodes`; all of a room with a computed module
    name."""
    names: set[str] = set()
    for node in (inner for root in nodes for inner in ast.walk(root)):
        if isinstance(node, ast.ImportFrom):
            package, _, base = (node.module or "").partition(".")
            if package == "jointgap":
                names |= {base, *(f"{base}.{alias.name}".strip(".") for alias in node.names)}
        elif isinstance(node, ast.JoinedStr) and isinstance(start := node.values[0], ast.Constant):
            if room := re.fullmatch(
                r"jointgap\.(\w+)\.", start.value
            ):  # f"jointgap.designs.{name}"
                names |= {f"{room[1]}.{file.stem}" for file in (_ROOT / room[1]).glob("[!_]*.py")}
    return frozenset(name for name in names if name and source_of(name).is_file())


def _used(module: ast.Module, name: str) -> list[ast.stmt]:
    """The statements of a module that define `name`, and all that they use from the module."""
    defined: dict[str, ast.stmt] = {}
    typed_only = [
        inner
        for statement in module.body
        if isinstance(statement, ast.If)
        for inner in statement.body
    ]
    for statement in (*typed_only, *module.body):
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            defined[statement.name] = statement
        elif isinstance(statement, ast.Import | ast.ImportFrom):
            defined |= {
                (alias.asname or alias.name).partition(".")[0]: statement
                for alias in statement.names
            }
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
    """Names in quoted annotations; other texts, such as names of sections, are not code."""
    for node in ast.walk(statement):
        for annotation in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            for inner in ast.walk(annotation) if annotation is not None else ():
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                    yield from re.findall(r"[A-Za-z_]\w*", inner.value)


class Option:
    """Annotation of a stage function's argument: an option of its command.

    `settings` are those of `click.option`, with type "file", "folder", or the smallest integer.
    """

    def __init__(self, *flags: str, **settings: Any):
        self.flags, self.settings = flags, settings


Workers = Annotated[
    int | None, Option("--workers", type=1, help="Parallel runs; the number of cores by default.")
]


@dataclass(frozen=True)
class Stage:
    """A stage of a scenario or of a campaign; command, workflow rule and documentation are
    generated from it."""

    name: str  # of the subcommand
    function: Callable[..., str | None]
    reads: tuple[Table, ...] = ()  # with their paths in the folder of results
    writes: tuple[Table, ...] = ()
    files: tuple[
        str, ...
    ] = ()  # output files besides tables, or the first of many files in a folder
    sections: tuple[str, ...] = ()  # sections of the scenario that it depends on
    does: str = ""  # message of its job in the workflow
    after: tuple[str, ...] = ()  # stages whose files it also includes
    job: str = ""  # stage in whose process it runs; by default its own
    memory: int = 2000  # of its job [MB]
    minutes: int = 30
    threads: int = 1
    publishes: bool = False  # to MLflow; such jobs run one at a time

    @property
    def command_options(self) -> dict[str, Option]:
        """Options of its command, besides the common ones, by argument."""
        return {
            name: option
            for name, annotation in self.function.__annotations__.items()
            for option in getattr(annotation, "__metadata__", ())
        }

    @property
    def help(self) -> str:
        """The docstring of its function."""
        return inspect.getdoc(self.function) or ""

    @property
    def description(self) -> str:
        """The first paragraph of `help`, on one line."""
        return self.help.partition("\n\n")[0].replace("\n", " ")

    @property
    def digest(self) -> str:
        """Twelve digits of the code of the stage and of the tables that it reads and writes."""
        return code_digest(self.function, *self.reads, *self.writes)

    def options(self, scenario: "Scenario") -> str:
        """Its sections of a scenario as JSON text in SI, for ``--options``."""
        return scenario.model_dump_json(include=set(self.sections), by_alias=True)

    def outputs(self, part: int | str = 0) -> list[str]:
        """Paths of its outputs in the folder of results; for a stage with parts, those of
        `part`."""
        return [
            path.replace("{part}", str(part))
            for path in (*(table.path for table in self.writes), *self.files)
        ]


class Stages(dict[str, Stage]):
    """Stages by name, in order of execution."""

    def stage(
        self, **record: Any
    ) -> Callable[[Callable[..., str | None]], Callable[..., str | None]]:
        """A decorator that registers a function as the next stage; `record` contains attributes of
        `Stage`."""

        def keep(function: Callable[..., str | None]) -> Callable[..., str | None]:
            name = function.__name__.replace("_", "-")
            self[name] = Stage(name, function, **record)
            return function

        return keep

    def jobs(self) -> dict[str, list[Stage]]:
        """The stages that the workflow runs, by job."""
        jobs: dict[str, list[Stage]] = {}
        for stage in self.values():
            if stage.does:
                jobs.setdefault(stage.job or stage.name, []).append(stage)
        return jobs

    def needed_for(self, name: str) -> list[str]:
        """The stage `name` and all stages that its tables depend on, in order."""
        wanted: set[str] = set()
        needed: list[str] = []
        for stage in reversed(self.values()):
            if stage.name == name or not wanted.isdisjoint(table.path for table in stage.writes):
                wanted |= {table.path for table in stage.reads}
                needed.append(stage.name)
        return needed[::-1]

    def written_by(self, *names: str) -> tuple[Table, ...]:
        """Tables written by the stages `names`."""
        return tuple(table for name in names for table in self[name].writes)
