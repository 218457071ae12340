# What the rules share: the scenarios and campaigns of the configuration, typed and checked, and what each stage reads of them.

from pathlib import Path

from snakemake.exceptions import WorkflowError

from jointgap.campaign.campaign_files import campaigns
from jointgap.paper.looseness_variants import looseness_variants
from jointgap.config import options_for, resolve
from jointgap.errors import InputError
from jointgap.joints import JOINT_NUMBERS
from jointgap.figures.catalogue import ANIMATION, CATALOGUE, FIGURES
from jointgap.stages.scenario_results import parts_of as parts_of_table
from jointgap.stages.scenario_stages import SCENARIO_STAGES
from jointgap.sweep.study_catalogue import FIGURES as STUDY_FIGURES
from jointgap.tables import TABLES, outputs, write_text

FOLDERS = (Path(), Path(workflow.current_basedir).parent.parent)
try:
    SCENARIOS = resolve(config, FOLDERS)
    CAMPAIGNS = campaigns(config.get("campaigns", []), FOLDERS, config.get("fit_parts"))
except InputError as error:
    raise WorkflowError(str(error)) from None

# Where all joints are ideal there is nothing to learn: such a scenario is simulated and animated.
LOOSE = [name for name, scenario in SCENARIOS.items() if scenario.mechanism.applied().loose]


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(outputs(JOINT_NUMBERS)),
    campaign="|".join(CAMPAIGNS) or "-",


def options(stage):
    """For params: the part of the scenario's configuration that the stage reads, as JSON."""
    return lambda wildcards: options_for(SCENARIOS[wildcards.scenario], stage)


def with_options(flag, names, stage):
    """For params: scenarios with what the stage reads of each, as arguments."""
    return [text for name in names for text in (flag, name, options_for(SCENARIOS[name], stage))]


def beside(wildcards):
    """The scenarios that differ from this one in nothing but which joints are loose."""
    return [name for name in looseness_variants(wildcards.scenario, SCENARIOS) if name != wildcards.scenario]


def written_by(stage):
    """For output: the tables of a stage, by name."""
    return {table.name: f"results/{{scenario}}/{table.path}" for table in SCENARIO_STAGES[stage].writes}


def place(table, **wildcards):
    """Where one table of a scenario lies; `wildcards` fills in the output."""
    return expand(f"results/{{scenario}}/{TABLES[table].path}", **wildcards, allow_missing=True)[0]


def read_from(*stages):
    """For input: the tables of stages, by name; all outputs of the loose joints where there is a table for each."""
    paths = {}
    for stage in stages:
        for name, path in written_by(stage).items():
            paths.setdefault(name, of_each_output(name, path) if "{output}" in path else path)
    return paths


def of_each_output(table, path):
    """For input: the files of a table of which there is one for each output."""

    def files(wildcards):
        mechanism = SCENARIOS[wildcards.scenario].mechanism
        return expand(path, scenario=wildcards.scenario, output=parts_of_table(TABLES[table], mechanism))

    return files


def section(wildcards):
    """For the report, which sorts its sections by name: the scenario, in the order in which scenarios are run."""
    place = list(SCENARIOS).index(wildcards.scenario) + 1
    return f"{place:0{len(str(len(SCENARIOS)))}}. {wildcards.scenario}"


def caption(name, text):
    """For the report, which takes captions as files only: one that holds `text`, from a catalogue of figures."""
    path = Path(".snakemake", "captions", f"{name}.rst").absolute()
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    return str(path)


def reported(name, figure, ending):
    """For output: one figure with its caption and its place in the report."""
    return report(
        f"results/{{scenario}}/figures/{name}.{ending}",
        caption=caption(name, figure.rst("scenario")),
        category=section,
        subcategory=figure.category,
        labels={"figure": figure.title},
    )
