# What `make sweep` and `make paper` make of many designs: the sweep itself, and what other sections of a scenario ask.


# A file that is there is not removed before its job: of a sweep that has grown its designs are kept.
rule sweep_designs:
    output:
        update("results/{scenario}/sweep/designs/{part}.parquet"),
    log:
        "results/{scenario}/logs/sweep_{part}.log",
    wildcard_constraints:
        part=r"part_\d+",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=part_options,
        code=digest_of("sweep-designs"),
        part=lambda wildcards: designs_of_sweep(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: sweep, {wildcards.part}"
    shell:
        "jointgap sweep-designs --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --designs {output:q} --workers 1 > {log:q} 2>&1"


for name in ("sweep", "sensitivity", "infer-settings", "optimise-robust"):
    place = name.replace("-", "_")
    robust = name == "optimise-robust"

    rule:
        name:
            place
        input:
            [] if robust else lambda wildcards: datasets(wildcards.scenario),
        output:
            in_scenario(made_by([DESIGN_STAGES[name]])),
        log:
            f"results/{{scenario}}/logs/{place}.log",
        conda:
            "../envs/jointgap.yaml"
        threads: 8 if robust else 1
        resources:
            mem_mb=2500,
            runtime=120 if robust else 60,
        params:
            **of_stage(name),
            arguments={
                "sweep": ["--folder", "results/{scenario}/sweep"],
                "optimise-robust": ["--results", "results/{scenario}", "--workers", "8"],
            }.get(
                name,
                [
                    "--designs",
                    "results/{scenario}/sweep/designs",
                    "--folder",
                    f"results/{{scenario}}/{place}",
                ],
            ),
        message:
            f"{{wildcards.scenario}}: {name}"
        shell:
            "jointgap {params.stage} --options {params.options:q} {params.arguments:q} > {log:q} 2>&1"


rule track_sweep:
    input:
        lambda wildcards: made_of_designs(wildcards.scenario),
    output:
        "results/{scenario}/track_sweep/published.json",
    log:
        "results/{scenario}/logs/track_sweep.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mlflow_store=1,
        runtime=20,
    params:
        **of_stage("track-sweep") | {"options": published_options},
        results="results/{scenario}",
    message:
        "{wildcards.scenario}: publish the sweep to MLflow"
    shell:
        "jointgap track-sweep --options {params.options:q} --results {params.results:q} > {log:q} 2>&1"


rule swept:
    input:
        made_of_sweeps,
    message:
        "all designs of the sweeps are measured"
