# What the rules share: the scenarios and campaigns of the configuration, typed and checked, and what each stage reads of them.

import json
import sys
from hashlib import sha256
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from jointgap.campaign.campaign_files import campaigns
from jointgap.paper.compare import looseness_variants
from jointgap.config import Constraints, check_whole, resolve
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.progress import parts
from jointgap.scenario.figures_catalogue import FIGURES
from jointgap.scenario.results import parts_of
from jointgap.scenario.stages import IMPACTS_PAGE, SCENARIO_STAGES
from jointgap.tables import INFERRED_DESIGNS_PATH, INFERRED_SETTINGS, SENSITIVITY_TABLES, outputs, write_text

# Where files of mechanisms are looked for: here, beside the configuration, in the workflow's folder.
FOLDERS = (
    Path(),
    *(Path(file).parent for file in workflow.overwrite_configfiles or ()),
    Path(workflow.current_basedir).parent.parent,
)
for folder in map(str, FOLDERS):
    if "{" in folder or "}" in folder:
        raise WorkflowError(
            f"the folder {folder} has a brace in its path, which Snakemake takes for a wildcard; rename it"
        )
try:
    SCENARIOS = resolve(config, FOLDERS, whole=False)
    CAMPAIGNS = campaigns(config.get("campaigns", []), FOLDERS, config.get("fit_parts"))
    if any(scenario.optimise.constraints != Constraints() for scenario in SCENARIOS.values()):
        from jointgap.lengths.region import check_constraints  # loads scipy

        check_constraints(SCENARIOS)
except InputError as error:
    raise WorkflowError(str(error)) from None

# Where all joints are ideal there is nothing to learn: such a scenario is simulated and animated.
LOOSE = [name for name, scenario in SCENARIOS.items() if scenario.mechanism.applied().loose]


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(outputs(JOINT_NUMBERS)),
    campaign="|".join(CAMPAIGNS) or "-",


def refuse(error):
    """End here, as the commands do: of an error in an input function Snakemake shows where the function stands."""
    sys.exit(f"jointgap: error: {error}")


def options_file(scenario, stage):
    """What a stage reads of a scenario's configuration, as a file: its name changes with what it holds, and with nothing else."""
    return kept_options(scenario, SCENARIO_STAGES[stage].options(SCENARIOS[scenario]))


def check_as_its_job(stage, name, check):
    """End here where a stage cannot do what a scenario asks, by the function `check` of what its job reads: sections that are left
    to their defaults have to go with the others too.
    """
    from jointgap.config import Scenario
    from jointgap.config.load import validate

    try:
        read = json.loads(SCENARIO_STAGES[stage].options(SCENARIOS[name]))
        check(validate(Scenario, read, "its configuration"))
    except InputError as error:
        refuse(f"scenario {name}: {error}")


def kept_options(scenario, text):
    """`text`, JSON, as a file of that name."""
    path = Path(".snakemake", "options", f"{scenario}-{sha256(text.encode()).hexdigest()[:12]}.json")
    if not path.is_file():
        write_text(path, text)
    return str(path)


def of_stage(stage):
    """For params: what a stage is called, the file of its options, and digests of the file of a measured drive and of its code; a
    change in these runs it again.
    """
    return {
        "stage": stage,
        "options": lambda wildcards: options_file(wildcards.scenario, stage),
        "drive": lambda wildcards: getattr(SCENARIOS[wildcards.scenario].simulate.drive, "content", ""),
        "code": digest_of(stage),
    }


def digest_of(stage):
    """For params: the digest of a stage's code, found where a job asks for it; those of all stages take a second."""
    return lambda wildcards: SCENARIO_STAGES[stage].digest


def named_options(flag, scenarios, stage):
    """For params: scenarios, each with the file of its options, as arguments."""
    return [text for name in scenarios for text in (flag, name, options_file(name, stage))]


def siblings(scenario):
    """The scenarios that differ from this one in nothing but which joints are loose."""
    return [name for name in looseness_variants(scenario, SCENARIOS) if name != scenario]


def place(table):
    """Where a table of a scenario lies."""
    return f"results/{{scenario}}/{table.path}"


def written_by(stage):
    """For output: the tables that a stage writes, by name."""
    return {table.name: place(table) for table in SCENARIO_STAGES[stage].writes}


def read_by(stage):
    """For input: the tables that a stage reads, by name; of one of which each output has its own, all of them."""
    tables = {}
    for table in SCENARIO_STAGES[stage].reads:
        tables.setdefault(table.name, of_each_output(table) if "{output}" in table.path else place(table))
    return tables


def of_each_output(table):
    """For input: the files of a table of which there is one for each output."""

    def files(wildcards):
        outputs = parts_of(table, SCENARIOS[wildcards.scenario].mechanism)
        return expand(place(table), scenario=wildcards.scenario, output=outputs)

    return files


def made_of_scenario(name):
    """Every file that rules make of a scenario; of one whose joints are all ideal, its simulation and animation."""
    # A sweep goes without what learning and optimising need.
    try:
        check_whole(SCENARIOS[name], name)
    except InputError as error:
        refuse(error)
    learned = outputs(SCENARIOS[name].mechanism.applied().loose)
    made = [rules.simulate, rules.animation]
    if name in LOOSE:
        made += [
            rules.surrogate,
            rules.clearance,
            rules.kinematics,
            rules.optimise,
            rules.figures,
            rules.explore,
            rules.compare,
            rules.summarise,
            rules.track,
        ]
    paths = [str(path) for rule in made for path in rule.output]
    return [
        file
        for path in paths
        for file in expand(path, scenario=name, output=learned if "{output}" in path else "")
    ]


def drawn(name, ending):
    """For output: where a figure of a scenario lies."""
    return f"results/{{scenario}}/figures/{name}.{ending}"
