# One rule for each stage of a scenario and for each job of a campaign, from the records of the stages: jointgap.scenario.stages
# and jointgap.campaign.stages say what they read and write. docs/workflow.md shows them as a picture.

from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.figures_catalogue import CATALOGUE as CAMPAIGN_FIGURES

PICTURES = {
    "figures": [f"figures/{name}.{ending}" for name in FIGURES for ending in ("png", "svg", "parquet")],
    "conclude": [f"figures/{name}.{ending}" for name in CAMPAIGN_FIGURES for ending in ("png", "svg", "parquet")],
    "animate": ["figures/animation.gif", "figures/animation.parquet"],
}


def made_by(stages):
    """Paths that stages write, in the folder of a scenario or a campaign."""
    paths = [path for stage in stages for path in (*stage.outputs("{part}"), *PICTURES.get(stage.name, ()))]
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
    """For input: what a stage of a scenario reads."""
    others = [SCENARIO_STAGES[name] for name in stage.after]
    paths = [*(table.path for table in stage.reads), *made_by(others)]

    def files(wildcards):
        beside = siblings(wildcards.scenario) if stage.name == "compare" else ()
        return [
            *of_scenario(wildcards.scenario, paths),
            *(f"results/{name}/{RESIMULATED.path}" for name in beside),
        ]

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


for name, (stage,) in SCENARIO_STAGES.jobs().items():
    place = "surrogate/{output}" if name == "surrogate" else name

    rule:
        name:
            name.replace("-", "_")
        input:
            read_by_scenario(stage),
        output:
            in_scenario(made_by([stage])),
        log:
            f"results/{{scenario}}/logs/{place}.log",
        benchmark:
            f"results/{{scenario}}/benchmarks/{place}.tsv"
        conda:
            "../envs/jointgap.yaml"
        resources:
            mem_mb=stage.memory,
            runtime=stage.minutes,
            mlflow_store=int(stage.publishes),
        params:
            **of_stage(name),
            results="results/{scenario}",
            more=arguments_of_scenario(stage),
        message:
            f"{{wildcards.scenario}}: {stage.does.replace('{output}', '{wildcards.output}')}"
        shell:
            "jointgap {params.stage} --options {params.options:q} --results {params.results:q} {params.more:q} > {log:q} 2>&1"


for name, stages in CAMPAIGN_STAGES.jobs().items():
    place = f"{name}_{{part}}" if name in ("fit", "pair") else name

    rule:
        name:
            f"campaign_{name.removesuffix('-campaign')}"
        input:
            read_by_campaign(stages),
        output:
            in_campaign(made_by(stages)),
        log:
            f"results/campaigns/{{campaign}}/logs/{place}.log",
        benchmark:
            f"results/campaigns/{{campaign}}/benchmarks/{place}.tsv"
        conda:
            "../envs/jointgap.yaml"
        resources:
            mem_mb=stages[0].memory,
            runtime=stages[0].minutes,
            mlflow_store=int(stages[0].publishes),
        params:
            stage=stages[0].name,
            campaign=lambda wildcards: CAMPAIGNS[wildcards.campaign].plan[0],
            folder="results/campaigns/{campaign}",
            more=arguments_of_campaign(stages),
            code=digests_of(stages),
        message:
            f"campaign {{wildcards.campaign}}: {stages[0].does.replace('{part}', '{wildcards.part}')}"
        shell:
            "jointgap {params.stage} {params.campaign:q} --folder {params.folder:q} {params.more:q} > {log:q} 2>&1"
