"""Stages: their inputs, outputs, options and function."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.core.code_digest import code_digest
from jointgap.core.errors import InputError
from jointgap.core.schema import Table

if TYPE_CHECKING:
    from pydantic import BaseModel


class Option:
    """Annotation of a stage function's argument: an option of its command.

    A flag without dashes is a positional argument. `settings` are those of `click.option`, with
    type "file", "folder", or the smallest integer.
    """

    def __init__(self, *flags: str, **settings: Any):
        self.flags, self.settings = flags, settings


def options_of(function: Callable[..., Any]) -> dict[str, Option]:
    """Options of the annotated arguments of a function, by argument."""
    return {
        name: option
        for name, annotation in function.__annotations__.items()
        for option in getattr(annotation, "__metadata__", ())
    }


Workers = Annotated[
    int | None, Option("--workers", type=1, help="Parallel runs; the number of cores by default.")
]


ScenarioOptions = Annotated[
    str,
    Option(
        "--options",
        required=True,
        help="The scenario: path of a YAML or JSON file (config/README.md), or JSON text.",
    ),
]
ResultsOption = Annotated[
    Path,
    Option(
        "--results",
        type="folder",
        required=True,
        help="Folder of the scenario's results, which is read and written.",
    ),
]


@dataclass(frozen=True)
class Stage:
    """A stage: ``function(state, **options)``; command, workflow rule and documentation are
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
        module = self.function.__module__.removeprefix("jointgap.")
        return code_digest(module, self.function.__name__, *self.reads, *self.writes)

    def options(self, scenario: "BaseModel") -> str:
        """Its sections of a scenario as JSON text in SI, for ``--options``."""
        return scenario.model_dump_json(include=set(self.sections), by_alias=True)

    def outputs(self, **parts: Any) -> list[str]:
        """Paths of its outputs in the folder of results, with `parts` in place of ``{part}`` and
        ``{output}``."""
        paths = [*(table.path for table in self.writes), *self.files]
        for name, value in parts.items():
            paths = [path.replace(f"{{{name}}}", str(value)) for path in paths]
        return paths


def run_stage(stage: Stage, state: Any, **options: Any) -> str | None:
    """Run a stage if its outputs can be written; `state` is a `ResultsFolder`."""
    state.check_writable(*stage.outputs(**options))
    try:
        return stage.function(state, **options)
    except InputError as error:
        raise state.located(error) from error


class Stages(dict[str, Stage]):
    """Stages by name, in order of execution.

    Attributes
    ----------
    open_state : callable
        Opens the first argument of the stages: what they read and write.
    run : callable
        Runs a stage: ``run(stage, state, **options)``.

    Annotated arguments of both are options of every command.
    """

    def __init__(self, open_state: Callable[..., Any], run: Callable[..., Any] = run_stage):
        super().__init__()
        self.open_state, self.run = open_state, run

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

    def written_by(self, *names: str) -> tuple[Table, ...]:
        """Tables written by the stages `names`."""
        return tuple(table for name in names for table in self[name].writes)
