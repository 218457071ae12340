# What the rules share: the scenarios and campaigns of the configuration, typed and checked, and what each stage reads of them.

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

# Scenarios that are compared with the paper, and so with each other.
COMPARED = [name for name, scenario in SCENARIOS.items() if "compare" in stages_of(scenario)]
CAMPAIGNS_SHOWN = [text for name in CAMPAIGNS for text in ("--campaign", name)]

# Names of the figures that a job draws, each as a picture, a drawing and a table; where there are networks it draws theirs too.
FIGURES = {"figures": drawn(False)}


# Names of logs and measured costs of jobs of which there are several, or that would be mixed up.
PLACES = {
    "surrogate": "surrogate/{output}",
    "fit": "fit_{part}",
    "pair": "pair_{part}",
}


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(outputs(JOINT_NUMBERS)),
    campaign="|".join(CAMPAIGNS) or "-",


def kept_options(scenario, text):
    """`text`, JSON, as a file: its name changes with what it holds, and with nothing else."""
    path = Path(
        ".snakemake", "options", f"{scenario}-{sha256(text.encode()).hexdigest()[:12]}.json"
    )
    if not path.is_file():
        write_text(path, text)
    return str(path)


def options_file(scenario, stage):
    """What a stage reads of a scenario's configuration, as a file."""
    return kept_options(scenario, STAGES[stage].options(SCENARIOS[scenario]))


def digest_of_drive(wildcards):
    """For params: changes with the file of a measured drive."""
    return getattr(SCENARIOS[wildcards.scenario].simulate.drive, "content", "")


def named_options(flag, scenarios, stage):
    """For params: scenarios, each with the file of its options, as arguments."""
    return [text for name in scenarios for text in (flag, name, options_file(name, stage))]


def siblings(scenario):
    """The scenarios that differ from this one in nothing but which joints are loose."""
    return [name for name in looseness_variants(scenario, SCENARIOS) if name != scenario]


def made_by(stages, folder):
    """Patterns of what stages write in `folder`."""
    paths = []
    for stage in stages:
        pictures = [
            f"figures/{name}.{kind}"
            for name in FIGURES.get(stage.name, ())
            for kind in ("png", "svg", "parquet")
        ]
        paths += [*stage.outputs(), *pictures]
    return [f"{folder}/{path}" for path in dict.fromkeys(paths)]


def of_scenario(name, patterns):
    """Files of a scenario; of those of which each output has its own, all."""
    own = outputs(SCENARIOS[name].mechanism.applied().loose) or [""]
    return list(dict.fromkeys(expand(patterns, scenario=name, output=own)))


def of_campaign(name, patterns):
    """Files of a campaign; of those of which each part of the fits has its own, all."""
    return list(dict.fromkeys(expand(patterns, campaign=name, part=range(CAMPAIGNS[name].parts))))


def read_by_scenario(stage):
    """For input: what a stage of a scenario reads, of the stages that the scenario goes through."""
    if stage.name in DESIGN_STAGES:
        read = (
            made_of_designs
            if stage.publishes
            else datasets if "sweep" in stage.sections else lambda name: []
        )
        return lambda wildcards: read(wildcards.scenario)

    def files(wildcards):
        name = wildcards.scenario
        gone_through = [SCENARIO_STAGES[one] for one in stages_of(SCENARIOS[name])]
        made = made_by(gone_through, SCENARIO)
        read = [path for table in stage.reads if (path := f"{SCENARIO}/{table.path}") in made]
        read += made_by([one for one in gone_through if one.name in stage.after], SCENARIO)
        beside = siblings(name) if stage.name == "compare" else ()
        return [
            *of_scenario(name, read),
            *(f"results/{other}/{RESIMULATED.path}" for other in beside),
        ]

    return files


def read_by_campaign(stages):
    """For input: the campaign file, its mechanism, what the stages of a job read and do not write, and the measured runs."""
    others = [CAMPAIGN_STAGES[name] for stage in stages for name in stage.after]
    read = [f"{CAMPAIGN}/{table.path}" for stage in stages for table in stage.reads] + made_by(
        others, CAMPAIGN
    )
    own = made_by(stages, CAMPAIGN)

    def files(wildcards):
        campaign = CAMPAIGNS[wildcards.campaign]
        data = campaign.data if stages[0].name in ("measure", "preflight") else ()
        return [
            *campaign.plan,
            *data,
            *of_campaign(wildcards.campaign, [path for path in read if path not in own]),
        ]

    return files


def command_of_scenario(stage):
    """For params: the command of a stage of a scenario, with the file of its options: what that holds reruns the stage."""
    name = stage.name

    def command(wildcards):
        scenario = wildcards.scenario
        options = (
            published_options(scenario) if name == "track-sweep" else options_file(scenario, name)
        )
        more = ["--results", f"results/{scenario}"]
        more += ["--output-name", wildcards.output] if name == "surrogate" else []
        more += ["--workers", stage.threads] if stage.threads > 1 else []
        more += named_options("--beside", siblings(scenario), name) if name == "compare" else []
        return [name, "--options", options, *more]

    return command


def command_of_campaign(stages):
    """For params: the command of a job of a campaign, with its part of the fits."""
    name = stages[0].name

    def command(wildcards):
        campaign = CAMPAIGNS[wildcards.campaign]
        more = ["--go-on"] if name in ("preflight", "conclude") else []
        more += ["--part", wildcards.part] if name in ("fit", "pair") else []
        more += ["--parts", campaign.parts] if name in ("fit", "pair", "conclude") else []
        more += ["--anyway"] if name == "recalibrate" and config.get("anyway") else []
        return [
            name,
            campaign.plan[0],
            "--folder",
            f"results/campaigns/{wildcards.campaign}",
            *more,
        ]

    return command


def every_scenario(wildcards=None):
    """Every file of every scenario. A sweep goes without what learning and optimising need, so that is checked here."""
    files = ["results/overview.parquet"] if len(COMPARED) > 1 else []
    for name, scenario in SCENARIOS.items():
        try:
            check_all_sections(scenario, name)
        except InputError as error:
            refuse(error)
        files += of_scenario(
            name, made_by([SCENARIO_STAGES[one] for one in stages_of(scenario)], SCENARIO)
        )
    return files


def every_campaign(wildcards=None):
    """Every file of every campaign."""
    stages = [stage for job in CAMPAIGN_STAGES.jobs().values() for stage in job]
    return [path for name in CAMPAIGNS for path in of_campaign(name, made_by(stages, CAMPAIGN))]


def digest_of_report(wildcards):
    """Changes with the code of the report."""
    return code_digest("app.report", "write_report")


def digest_of_overview(wildcards):
    """Changes with the code of the comparison of the scenarios."""
    return code_digest("scenario.overview", "write_overview")


@cache
def designs_of_sweep(name):
    """First design and number of designs of each job of a scenario's sweep; none where it names no parameters."""
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
def asked(name):
    """The stages on many designs that a scenario asks for; what is asked has to be possible, before anything runs."""
    try:
        designs_of_sweep(name)
        return studies_of(SCENARIOS[name], checked=True)
    except InputError as error:
        refuse(f"scenario {name}: {error}")


def made_of_designs(name):
    """Every file that a scenario asks of many designs."""
    stages = [DESIGN_STAGES[stage] for stage in asked(name)]
    return [*datasets(name), *of_scenario(name, made_by(stages, SCENARIO))]


def part_options(wildcards):
    """What a job depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    options = json.loads(DESIGN_STAGES["sweep-designs"].options(SCENARIOS[wildcards.scenario]))
    options["sweep"].pop("designs_per_job")
    options["sweep"].pop("trajectories")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))


def published_options(name):
    """What is published of a scenario's configuration, as a file: sections that nothing was made of need not go with the others."""
    sections = {
        "description",
        *(one for stage in asked(name) for one in DESIGN_STAGES[stage].sections),
    }
    return kept_options(name, SCENARIOS[name].model_dump_json(include=sections, by_alias=True))


def made_of_sweeps(wildcards):
    """Every file that the scenarios ask of many designs, and what says that it is published; one at least has to ask for some."""
    asking = [name for name in SCENARIOS if asked(name)]
    if not asking:
        refuse(
            "sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml"
        )
    published = [f"results/{name}/track_sweep/published.json" for name in asking]
    return [*(file for name in asking for file in made_of_designs(name)), *published]
