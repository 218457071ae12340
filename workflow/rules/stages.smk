# One rule for each stage of a scenario and for each job of a campaign, from the records of the stages: jointgap.scenario.stages
# and jointgap.campaign.stages say what they read and write. docs/workflow.md shows them as a picture.


for name, (stage,) in SCENARIO_STAGES.jobs().items():
    place = {"surrogate": "surrogate/{output}", "clearance": "surrogate/clearance"}.get(name, name)
    tables = {table.name: f"{SCENARIO}/{table.path}" for table in stage.writes}
    cost = "track/benchmark" if stage.publishes else f"benchmarks/{place}"

    rule:
        name:
            name.replace("-", "_")
        input:
            read_by_scenario(stage),
        output:
            *(path for path in made_by([stage], SCENARIO) if path not in tables.values()),
            **tables,
        log:
            f"results/{{scenario}}/logs/{place}.log",
        benchmark:
            f"results/{{scenario}}/{cost}.tsv"
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
    cost = "track/benchmark" if stages[0].publishes else f"benchmarks/{place}"

    rule:
        name:
            f"campaign_{name.removesuffix('-campaign')}"
        input:
            read_by_campaign(stages),
        output:
            made_by(stages, CAMPAIGN),
        log:
            f"results/campaigns/{{campaign}}/logs/{place}.log",
        benchmark:
            f"results/campaigns/{{campaign}}/{cost}.tsv"
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
            code=lambda wildcards, stages=stages: [stage.digest for stage in stages],
        message:
            f"campaign {{wildcards.campaign}}: {stages[0].does.replace('{part}', '{wildcards.part}')}"
        shell:
            "jointgap {params.stage} {params.campaign:q} --folder {params.folder:q} {params.more:q} > {log:q} 2>&1"
