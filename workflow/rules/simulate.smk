rule simulate:
    output:
        **written_by("simulate"),
    log:
        "results/{scenario}/logs/simulate.log",
    benchmark:
        "results/{scenario}/benchmarks/simulate.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        options=options("simulate"),
        code=SCENARIO_STAGES["simulate"].digest,
    message:
        "{wildcards.scenario}: simulate the contact"
    shell:
        "jointgap simulate --options {params.options:q}"
        " --trajectory {output.trajectory:q} --events {output.events:q} > {log:q} 2>&1"
