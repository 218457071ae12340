# What the rules share: the scenarios of the configuration, typed and checked, and what each stage reads of them.

from pathlib import Path

from snakemake.exceptions import WorkflowError

from jointgap.config import options_for, resolve
from jointgap.errors import InputError
from jointgap.figures.catalogue import ANIMATION, CATALOGUE, FIGURES
from jointgap.provenance import code_digest
from jointgap.results import PLACES, parts, tables_of
from jointgap.tables import OUTPUTS

try:
    SCENARIOS = resolve(config, (Path(), Path(workflow.current_basedir).parent.parent))
except InputError as error:
    raise WorkflowError(str(error)) from None


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(OUTPUTS),


def options(stage):
    """For params: the part of the scenario's configuration that the stage reads, as JSON."""
    return lambda wildcards: options_for(SCENARIOS[wildcards.scenario], stage)


def scenarios_with_options(stage):
    """For params: every scenario with what the stage reads of it, as arguments."""
    return [
        text
        for name, scenario in SCENARIOS.items()
        for text in ("--scenario", name, options_for(scenario, stage))
    ]


def written_by(stage):
    """For output: the tables of a stage, by name."""
    return {name: f"results/{{scenario}}/{place}" for name, place in tables_of(stage).items()}


def place(table, **wildcards):
    """Where one table of a scenario lies; `wildcards` fills in the output."""
    return expand(f"results/{{scenario}}/{PLACES[table]}", **wildcards, allow_missing=True)[0]


def read_from(*stages):
    """For input: the tables of stages, by name; all eight outputs where there is a table for each."""
    return {
        name: expand(path, output=parts(name), allow_missing=True) if "{output}" in path else path
        for stage in stages
        for name, path in written_by(stage).items()
    }


def reported(name, figure, ending):
    """For output: one figure with its caption and its place in the report."""
    return report(
        f"results/{{scenario}}/figures/{name}.{ending}",
        caption=f"../report/{name}.rst",
        category="{scenario}",
        subcategory=figure.category,
        labels={"figure": figure.title},
    )
