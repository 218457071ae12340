# A rule for each job of a campaign, generated from the stages in `src/jointgap/campaign/stages.py`. verdict.json contains the costs.


for name, stages in CAMPAIGN_STAGES.jobs().items():
    first = stages[0]

    rule:
        name:
            f"campaign_{name.removesuffix('-campaign')}"
        input:
            inputs_of_campaign_job(stages),
        output:
            outputs_of(stages, CAMPAIGN),
        log:
            f"{CAMPAIGN}/logs/{name.replace('-', '_')}.log",
        conda:
            "../envs/jointgap.yaml"
        threads: first.threads
        resources:
            mem_mb=max(stage.memory for stage in stages),
            runtime=first.minutes,
            mlflow_store=int(first.publishes),
        params:
            command=command_of_campaign(stages),
            code=lambda wildcards, stages=stages: [stage.digest for stage in stages],
        message:
            f"campaign {{wildcards.campaign}}: {first.does}"
        shell:
            "jointgap {params.command:q} > {log:q} 2>&1"
