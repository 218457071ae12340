"""One stage, one record: what it reads, what it writes, the options it depends on, and the function that does it."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jointgap.stages.code_digest import code_digest
from jointgap.tables import Table

if TYPE_CHECKING:  # loads pydantic
    from jointgap.config import Scenario


@dataclass(frozen=True)
class Stage:
    """A stage of a scenario or of a campaign."""

    name: str  # Of the subcommand, and of the folder of its results
    function: Callable[..., str | None]
    reads: tuple[Table, ...] = ()  # Each with its place in the folder of results
    writes: tuple[Table, ...] = ()  # Each with its place in the folder of results
    files: tuple[str, ...] = ()  # What it writes besides tables, or the first of many files in a folder
    sections: tuple[str, ...] = ()  # The sections of a scenario that it depends on

    @property
    def help(self) -> str:
        """What it does: the docstring of its function, without its section of parameters."""
        return (inspect.getdoc(self.function) or "").partition("\n\nParameters\n")[0]

    @property
    def description(self) -> str:
        """What it does, in a line."""
        return self.help.partition("\n\n")[0].replace("\n", " ")

    @property
    def digest(self) -> str:
        """Twelve digits that change with the code that the stage runs."""
        return code_digest(self.function)

    def options(self, scenario: "Scenario") -> str:
        """What it reads of a scenario, as JSON text in SI: the value of its ``--options``."""
        return scenario.model_dump_json(include=set(self.sections), by_alias=True)

    def outputs(self, part: int | str = 0) -> list[str]:
        """Paths that it writes within its folder of results; of a stage that has parts, those of `part`."""
        return [path.replace("{part}", str(part)) for path in (*(table.path for table in self.writes), *self.files)]


class Stages(dict[str, Stage]):
    """Stages by name, in the order in which they follow each other."""

    def stage(
        self,
        reads: tuple[Table, ...] = (),
        writes: tuple[Table, ...] = (),
        files: tuple[str, ...] = (),
        sections: tuple[str, ...] = (),
    ) -> Callable[[Callable[..., str | None]], Callable[..., str | None]]:
        """A decorator that records a function as the next stage."""

        def record(function: Callable[..., str | None]) -> Callable[..., str | None]:
            name = function.__name__.replace("_", "-")
            self[name] = Stage(name, function, reads, writes, files, sections)
            return function

        return record

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
