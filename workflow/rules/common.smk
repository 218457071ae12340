# What the rules share: the scenarios and campaigns of the configuration, typed and checked, and what each stage reads of them.

import json
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path

from snakemake.exceptions import WorkflowError

from jointgap.campaign.campaign_files import campaigns
from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.paper.compare import looseness_variants
from jointgap.config import Constraints, Scenario, check_whole, resolve
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.progress import parts
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES, drawn, stages_of

STAGES = SCENARIO_STAGES | DESIGN_STAGES
from jointgap.core.joints import outputs
from jointgap.core.files import write_text
from jointgap.core.schema import OPTIMISE_RESIMULATED as RESIMULATED

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


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    output="|".join(outputs(JOINT_NUMBERS)),
    campaign="|".join(CAMPAIGNS) or "-",


def refuse(error):
    """End here, as the commands do: of an error in an input function Snakemake shows where the function stands."""
    sys.exit(f"jointgap: error: {error}")


def options_file(scenario, stage):
    """What a stage reads of a scenario's configuration, as a file: its name changes with what it holds, and with nothing else."""
    return kept_options(scenario, STAGES[stage].options(SCENARIOS[scenario]))


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
    return lambda wildcards: STAGES[stage].digest


def digests_of(stages):
    """The same of the stages of one job of a campaign."""
    return lambda wildcards: [stage.digest for stage in stages]


def digest_of_report(wildcards):
    """The same of the report."""
    from jointgap.app.report import write_report
    from jointgap.core.stage import code_digest

    return code_digest(write_report)


def named_options(flag, scenarios, stage):
    """For params: scenarios, each with the file of its options, as arguments."""
    return [text for name in scenarios for text in (flag, name, options_file(name, stage))]


def siblings(scenario):
    """The scenarios that differ from this one in nothing but which joints are loose."""
    return [name for name in looseness_variants(scenario, SCENARIOS) if name != scenario]


# Names of the figures that a job draws, each as a picture, a drawing and a table.
FIGURES = {"figures": drawn(False), "learned-figures": drawn(True), "conclude": CAMPAIGN_FIGURES}


def made_by(stages):
    """Paths that stages write, in the folder of a scenario or a campaign."""
    paths = []
    for stage in stages:
        pictures = expand(
            "figures/{name}.{ending}", name=FIGURES.get(stage.name, ()), ending=("png", "svg", "parquet")
        )
        paths += [*stage.outputs("{part}"), *pictures]
    return list(dict.fromkeys(paths))


def in_scenario(paths):
    return [f"results/{{scenario}}/{path}" for path in paths]


def in_campaign(paths):
    return [f"results/campaigns/{{campaign}}/{path}" for path in paths]


def of_scenario(name, paths):
    """`paths` of a scenario; of those of which each output has its own, all."""
    outputs_there = outputs(SCENARIOS[name].mechanism.applied().loose)
    return [
        file
        for path in in_scenario(paths)
        for file in expand(path, scenario=name, output=outputs_there if "{output}" in path else "")
    ]


def of_campaign(name, paths):
    """`paths` of a campaign; of those of which each part of the fits has its own, all."""
    return list(
        dict.fromkeys(
            file
            for path in in_campaign(paths)
            for file in expand(path, campaign=name, part=range(CAMPAIGNS[name].parts))
        )
    )


def read_by_scenario(stage):
    """For input: what a stage of a scenario reads, of the stages that the scenario goes through."""

    def files(wildcards):
        name = wildcards.scenario
        gone_through = [SCENARIO_STAGES[one] for one in stages_of(SCENARIOS[name])]
        made = {path for one in gone_through for path in one.outputs()}
        paths = [table.path for table in stage.reads if table.path in made]
        paths += made_by(one for one in gone_through if one.name in stage.after)
        beside = siblings(name) if stage.name == "compare" else ()
        return [*of_scenario(name, paths), *(f"results/{other}/{RESIMULATED.path}" for other in beside)]

    return files


def read_by_campaign(stages):
    """For input: the campaign file, its mechanism, what the stages of a job read and do not write, and the measured runs."""
    others = [CAMPAIGN_STAGES[name] for stage in stages for name in stage.after]
    own = made_by(stages)
    paths = [*(table.path for stage in stages for table in stage.reads), *made_by(others)]
    paths = [path for path in paths if path not in own]

    def files(wildcards):
        campaign = CAMPAIGNS[wildcards.campaign]
        data = campaign.data if stages[0].name in ("measure", "preflight") else ()
        return [*campaign.plan, *data, *of_campaign(wildcards.campaign, paths)]

    return files


def arguments_of_scenario(stage):
    """For params: what the command is told besides options and results."""

    def arguments(wildcards):
        if stage.name == "surrogate":
            return ["--output-name", wildcards.output]
        if stage.name == "figures":
            return [text for name in FIGURES["figures"] for text in ("--figure", name)]
        if stage.name == "compare":
            return named_options("--beside", siblings(wildcards.scenario), "compare")
        return []

    return arguments


def arguments_of_campaign(stages):
    """For params: the further stages of a job, and its part of the fits."""
    names = [stage.name for stage in stages]
    then = [text for name in names[1:] for text in ("--then", name)]
    adding = names[0] in ("preflight", "decide", "reoptimise", "conclude")

    def arguments(wildcards):
        more = ["--go-on"] if adding else []
        if names[0] in ("fit", "pair"):
            more += ["--part", wildcards.part]
        if names[0] in ("fit", "pair", "decide"):
            more += ["--parts", CAMPAIGNS[wildcards.campaign].parts]
        if names[0] == "noise" and config.get("anyway"):
            more.append("--anyway")
        return [*more, *then]

    return arguments


@cache
def designs_of_sweep(name):
    """The designs of a scenario's sweep, first design and number of designs of each job; none where it names no parameters."""
    if not SCENARIOS[name].sweep.parameters:
        return {}
    from jointgap.designs.run import check_folder  # loads scipy
    from jointgap.designs.sampling import designs_of

    sweep = SCENARIOS[name].sweep
    try:
        check_folder(
            designs_of(SCENARIOS[name]), Path("results", name, "sweep/designs"), sweep.designs_per_job
        )
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return parts(sweep.designs, sweep.designs_per_job)


def datasets(name):
    return [f"results/{name}/sweep/designs/{part}.parquet" for part in designs_of_sweep(name)]


@cache
def asked(name):
    """The stages on many designs that a scenario asks for; what is asked has to be possible, before anything runs."""
    scenario, swept = SCENARIOS[name], bool(designs_of_sweep(name))
    stages = ["sweep"] if swept else []
    if swept and scenario.sensitivity is not None:
        stages.append("sensitivity")
    try:
        if scenario.infer_settings is not None:
            from jointgap.designs.infer_settings import check_infer_settings

            check_infer_settings(scenario)
            stages.append("infer-settings")
        if scenario.optimise_robust.uncertain:
            from jointgap.designs.robust import check_robust

            # of what its job reads: sections that are left to their defaults have to go with the others too
            read = json.loads(DESIGN_STAGES["optimise-robust"].options(scenario))
            check_robust(validate(Scenario, read, "its configuration"))
            stages.append("optimise-robust")
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return stages


def made_of_designs(name):
    """Every file that a scenario asks of many designs."""
    stages = asked(name)
    files = of_scenario(name, made_by(DESIGN_STAGES[stage] for stage in stages))
    return [*(datasets(name) if "sweep" in stages else []), *files]


def part_options(wildcards):
    """What a job depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    options = json.loads(DESIGN_STAGES["sweep-designs"].options(SCENARIOS[wildcards.scenario]))
    options["sweep"].pop("designs_per_job")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))


def published_options(wildcards):
    """What is published of a scenario's configuration, as a file: sections that nothing was made of need not go with the others."""
    sections = {one for stage in asked(wildcards.scenario) for one in DESIGN_STAGES[stage].sections}
    wanted = {"description", *sections}
    return kept_options(
        wildcards.scenario, SCENARIOS[wildcards.scenario].model_dump_json(include=wanted, by_alias=True)
    )


def made_of_sweeps(wildcards):
    """Every file that the scenarios ask of many designs, and what says that it is published; one at least has to ask for some."""
    asking = [name for name in SCENARIOS if asked(name)]
    if not asking:
        refuse("sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml")
    published = [f"results/{name}/track_sweep/published.json" for name in asking]
    return whole([*(file for name in asking for file in made_of_designs(name)), *published])


def made_of_scenario(name):
    """Every file of a scenario; of one whose joints are all ideal, its simulation and animation."""
    # A sweep goes without what learning and optimising need.
    try:
        check_whole(SCENARIOS[name], name)
    except InputError as error:
        refuse(error)
    return of_scenario(name, made_by(SCENARIO_STAGES[one] for one in stages_of(SCENARIOS[name])))


def made_of_campaign(name):
    """Every file of a campaign."""
    return of_campaign(name, made_by(stage for stages in CAMPAIGN_STAGES.jobs().values() for stage in stages))


def every_scenario(wildcards=None):
    overview = ["results/overview.parquet"] if len(COMPARED) > 1 else []
    return whole([*(path for name in SCENARIOS for path in made_of_scenario(name)), *overview])


def every_campaign(wildcards=None):
    return whole(path for name in CAMPAIGNS for path in made_of_campaign(name))


CAMPAIGNS_SHOWN = [text for name in CAMPAIGNS for text in ("--campaign", name)]
