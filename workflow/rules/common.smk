# What the rules share: the scenarios of the configuration, typed and checked, and what each stage reads of them.

from pathlib import Path

from snakemake.exceptions import WorkflowError

from jointgap.config import options_for, resolve
from jointgap.errors import InputError
from jointgap.figures.catalogue import CATALOGUE, FIGURES
from jointgap.provenance import code_digest
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


def reported_figures():
    """For output: each figure of a scenario, with its caption and its place in the report."""
    return {
        name: report(
            f"results/{{scenario}}/figures/{name}.png",
            caption=f"../report/{name}.rst",
            category="{scenario}",
            subcategory=figure.category,
            labels={"figure": figure.title},
        )
        for name, figure in CATALOGUE.items()
    }
