# A rule for each job of a scenario and of its designs, generated from the stages in `stages.py` of the rooms scenario and designs.
# docs/workflow.md shows them as a diagram.


for name, stages in [*SCENARIO_STAGES.jobs().items(), *DESIGN_STAGES.jobs().items()]:
    first = stages[0]
    place = LOG_NAMES.get(name, name.replace("-", "_"))
    tables = {table.name: f"{SCENARIO}/{table.path}" for table in first.writes if len(stages) == 1}
    cost = f"{Path(first.files[0]).parent}/benchmark" if first.publishes else f"benchmarks/{place}"

    rule:
        name:
            name.replace("-", "_")
        input:
            inputs_of_scenario_job(first),
        output:
            *(path for path in outputs_of(stages, SCENARIO) if path not in tables.values()),
            **tables,
        log:
            f"{SCENARIO}/logs/{place}.log",
        benchmark:
            f"{SCENARIO}/{cost}.tsv"
        conda:
            "../envs/jointgap.yaml"
        threads: first.threads
        resources:
            mem_mb=first.memory,
            runtime=first.minutes,
            mlflow_store=int(first.publishes),
        params:
            command=command_of_scenario(first),
            drive=digest_of_drive,
            code=lambda wildcards, stages=stages: [stage.digest for stage in stages],
        message:
            f"{{scenario}}: {first.does}".replace("{", "{wildcards.")
        shell:
            "jointgap {params.command:q} > {log:q} 2>&1"
