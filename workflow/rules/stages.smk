# One rule for each job of a scenario, of its designs and of a campaign, from the records of the stages: `stages.py` of the rooms
# scenario, designs and campaign say what they read and write. docs/workflow.md shows them as a picture.


for name, stages in [
    *SCENARIO_STAGES.jobs().items(),
    *DESIGN_STAGES.jobs().items(),
    *CAMPAIGN_STAGES.jobs().items(),
]:
    first = stages[0]
    in_campaign = first.name in CAMPAIGN_STAGES
    folder, whose = (CAMPAIGN, "campaign {campaign}") if in_campaign else (SCENARIO, "{scenario}")
    place = PLACES.get(name, name.replace("-", "_"))
    tables = {table.name: f"{folder}/{table.path}" for table in first.writes if len(stages) == 1}
    cost = f"{Path(first.files[0]).parent}/benchmark" if first.publishes else f"benchmarks/{place}"

    rule:
        name:
            f"campaign_{name.removesuffix('-campaign')}" if in_campaign else name.replace("-", "_")
        input:
            read_by_campaign(stages) if in_campaign else read_by_scenario(first),
        output:
            *(path for path in made_by(stages, folder) if path not in tables.values()),
            **tables,
        log:
            f"{folder}/logs/{place}.log",
        benchmark:
            f"{folder}/{cost}.tsv"
        conda:
            "../envs/jointgap.yaml"
        threads: first.threads
        resources:
            mem_mb=first.memory,
            runtime=first.minutes,
            mlflow_store=int(first.publishes),
        params:
            command=command_of_campaign(stages) if in_campaign else command_of_scenario(first),
            drive="" if in_campaign else digest_of_drive,
            code=lambda wildcards, stages=stages: [stage.digest for stage in stages],
        message:
            f"{whose}: {first.does}".replace("{", "{wildcards.")
        shell:
            "jointgap {params.command:q} > {log:q} 2>&1"
