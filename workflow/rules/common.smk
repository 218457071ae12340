# Shared by the rules: validated scenarios and campaigns, and input files, commands and options of each stage.

import json
from functools import cache
from hashlib import sha256
from pathlib import Path

from jointgap.campaign.campaign_files import campaigns
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core.code_digest import code_digest
from jointgap.config import Constraints, check_all_sections, resolve
from jointgap.core.files import write_text
from jointgap.core.joints import JOINT_NUMBERS, outputs
from jointgap.core.progress import parts
from jointgap.core.schema import OPTIMISE_RESIMULATED as RESIMULATED
from jointgap.designs.stages import DESIGN_STAGES, studies_of
from jointgap.paper.compare import looseness_variants
from jointgap.scenario.stages import SCENARIO_STAGES, drawn, stages_of

STAGES = SCENARIO_STAGES | DESIGN_STAGES
SCENARIO, CAMPAIGN = "results/{scenario}", "results/campaigns/{campaign}"

# Folders that are searched for mechanism files: current folder, folder of the configuration, folder of the workflow.
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
    CAMPAIGNS = campaigns(config.get("campaigns", []), FOLDERS)
    if any(scenario.optimise.constraints != Constraints() for scenario in SCENARIOS.values()):
        from jointgap.lengths.region import check_constraints  # loads scipy

        check_constraints(SCENARIOS)
except InputError as error:
    raise WorkflowError(str(error)) from None

# Scenarios that are compared with the paper and with each other.
COMPARED = [name for name, scenario in SCENARIOS.items() if "compare" in stages_of(scenario)]
CAMPAIGN_ARGUMENTS = [text for name in CAMPAIGNS for text in ("--campaign", name)]

# Figures of each stage; each gives a PNG, an SVG and a Parquet file. Figures of the networks are additional and not listed.
FIGURES = {"figures": drawn(False)}


# Names of logs and benchmark files of stages with several jobs.
LOG_NAMES = {"surrogate": "surrogate/{output}"}


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(outputs(JOINT_NUMBERS)),
    campaign="|".join(CAMPAIGNS) or "-",


def stored_options(scenario, text):
    """File with the JSON `text`; its name contains the digest of the text, so that a job reruns if the options change."""
    path = Path(
        ".snakemake", "options", f"{scenario}-{sha256(text.encode()).hexdigest()[:12]}.json"
    )
    if not path.is_file():
        write_text(path, text)
    return str(path)


def options_file(scenario, stage):
    """File with the sections of a scenario that a stage reads."""
    return stored_options(scenario, STAGES[stage].options(SCENARIOS[scenario]))


def digest_of_drive(wildcards):
    """For params: digest of the file of a measured drive."""
    return getattr(SCENARIOS[wildcards.scenario].simulate.drive, "content", "")


def option_arguments(flag, scenarios, stage):
    """For params: arguments with name and options file of each scenario."""
    return [text for name in scenarios for text in (flag, name, options_file(name, stage))]


def siblings(scenario):
    """Scenarios that differ from this one only in their loose joints."""
    return [name for name in looseness_variants(scenario, SCENARIOS) if name != scenario]


def outputs_of(stages, folder):
    """Patterns of the files that stages write to a folder."""
    paths = []
    for stage in stages:
        pictures = [
            f"figures/{name}.{kind}"
            for name in FIGURES.get(stage.name, ())
            for kind in ("png", "svg", "parquet")
        ]
        paths += [*stage.outputs(), *pictures]
    return [f"{folder}/{path}" for path in dict.fromkeys(paths)]


def scenario_files(name, patterns):
    """Files of a scenario from patterns with {output}."""
    names = outputs(SCENARIOS[name].mechanism.applied().loose) or [""]
    return list(dict.fromkeys(expand(patterns, scenario=name, output=names)))


def campaign_files(name, patterns):
    """Files of a campaign from patterns."""
    return list(dict.fromkeys(expand(patterns, campaign=name)))


def inputs_of_scenario_job(stage):
    """For input: tables and files of earlier stages that a stage of a scenario reads."""
    if stage.name in DESIGN_STAGES:
        read = (
            design_files
            if stage.publishes
            else datasets if "sweep" in stage.sections else lambda name: []
        )
        return lambda wildcards: read(wildcards.scenario)

    def files(wildcards):
        name = wildcards.scenario
        stages = [SCENARIO_STAGES[stage_name] for stage_name in stages_of(SCENARIOS[name])]
        written = outputs_of(stages, SCENARIO)
        paths = [path for table in stage.reads if (path := f"{SCENARIO}/{table.path}") in written]
        paths += outputs_of([earlier for earlier in stages if earlier.name in stage.after], SCENARIO)
        compared = siblings(name) if stage.name == "compare" else ()
        return [
            *scenario_files(name, paths),
            *(f"results/{sibling}/{RESIMULATED.path}" for sibling in compared),
        ]

    return files


def inputs_of_campaign_job(stages):
    """For input: campaign file, mechanism file, measured runs, and tables of earlier jobs."""
    earlier = [CAMPAIGN_STAGES[name] for stage in stages for name in stage.after]
    paths = [f"{CAMPAIGN}/{table.path}" for stage in stages for table in stage.reads]
    paths += outputs_of(earlier, CAMPAIGN)
    written = outputs_of(stages, CAMPAIGN)

    def files(wildcards):
        campaign = CAMPAIGNS[wildcards.campaign]
        data = campaign.data if stages[0].name == "measure" else ()
        return [
            *campaign.plan,
            *data,
            *campaign_files(wildcards.campaign, [path for path in paths if path not in written]),
        ]

    return files


def command_of_scenario(stage):
    """For params: command of a stage of a scenario."""
    name = stage.name

    def command(wildcards):
        scenario = wildcards.scenario
        options = (
            published_options(scenario) if name == "track-sweep" else options_file(scenario, name)
        )
        more = ["--results", f"results/{scenario}"]
        more += ["--output-name", wildcards.output] if name == "surrogate" else []
        more += ["--workers", stage.threads] if stage.threads > 1 else []
        more += option_arguments("--beside", siblings(scenario), name) if name == "compare" else []
        return [name, "--options", options, *more]

    return command


def command_of_campaign(stages):
    """For params: the command of a job of a campaign."""
    stage = stages[0]

    def command(wildcards):
        campaign = wildcards.campaign
        more = ["--go-on"] if stage.name in ("identify", "show") else []
        more += ["--anyway"] if stage.name == "identify" and config.get("anyway") else []
        more += ["--workers", stage.threads] if stage.threads > 1 else []
        file, folder = CAMPAIGNS[campaign].campaign, f"results/campaigns/{campaign}"
        return [stage.name, file, "--folder", folder, *more]

    return command


def all_scenario_files(wildcards=None):
    """Files of all scenarios. Checks sections that only networks and optimisation need."""
    files = ["results/overview.parquet"] if len(COMPARED) > 1 else []
    for name, scenario in SCENARIOS.items():
        try:
            check_all_sections(scenario, name)
        except InputError as error:
            refuse(error)
        stages = [SCENARIO_STAGES[stage_name] for stage_name in stages_of(scenario)]
        files += scenario_files(name, outputs_of(stages, SCENARIO))
    return files


def all_campaign_files(wildcards=None):
    """Files of all campaigns."""
    stages = [stage for job in CAMPAIGN_STAGES.jobs().values() for stage in job]
    return [path for name in CAMPAIGNS for path in campaign_files(name, outputs_of(stages, CAMPAIGN))]


def digest_of_report(wildcards):
    """For params: digest of the code of the report."""
    return code_digest("app.report", "write_report")


def digest_of_overview(wildcards):
    """For params: digest of the code of the overview."""
    return code_digest("scenario.overview", "write_overview")


@cache
def designs_of_sweep(name):
    """First design and number of designs of each job of a sweep; empty without parameters."""
    sweep = SCENARIOS[name].sweep
    if not sweep.parameters:
        return {}
    from jointgap.designs.dataset import check_folder  # loads scipy
    from jointgap.designs.sampling import designs_of

    check_folder(
        designs_of(SCENARIOS[name]), Path("results", name, "sweep/designs"), sweep.designs_per_job
    )
    return parts(sweep.designs, sweep.designs_per_job)


def datasets(name):
    return [f"results/{name}/sweep/designs/{part}.parquet" for part in designs_of_sweep(name)]


@cache
def studies(name):
    """Stages on many designs that a scenario requests; infeasible requests end the workflow."""
    try:
        designs_of_sweep(name)
        return studies_of(SCENARIOS[name], checked=True)
    except InputError as error:
        refuse(f"scenario {name}: {error}")


def design_files(name):
    """Files of the stages on many designs of a scenario."""
    stages = [DESIGN_STAGES[stage] for stage in studies(name)]
    return [*datasets(name), *scenario_files(name, outputs_of(stages, SCENARIO))]


def part_options(wildcards):
    """Options file of a job of a sweep; without the number of designs of a Sobol sequence, which can be extended."""
    options = json.loads(DESIGN_STAGES["sweep-designs"].options(SCENARIOS[wildcards.scenario]))
    options["sweep"].pop("designs_per_job")
    options["sweep"].pop("trajectories")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return stored_options(wildcards.scenario, json.dumps(options))


def published_options(name):
    """Options file with the published sections of a scenario: those of the requested stages."""
    sections = {
        "description",
        *(section for stage in studies(name) for section in DESIGN_STAGES[stage].sections),
    }
    return stored_options(name, SCENARIOS[name].model_dump_json(include=sections, by_alias=True))


def all_sweep_files(wildcards):
    """Files of the stages on many designs of all scenarios, and their publishing summaries."""
    names = [name for name in SCENARIOS if studies(name)]
    if not names:
        refuse(
            "sweep.parameters: no scenario has any; give them ranges or lists, as in config/sweep.yaml"
        )
    published = [f"results/{name}/track_sweep/published.json" for name in names]
    return [*(file for name in names for file in design_files(name)), *published]
