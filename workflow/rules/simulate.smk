rule simulate:
    output:
        trajectory="results/{scenario}/simulate/trajectory.parquet",
        events="results/{scenario}/simulate/events.parquet",
    params:
        options=options("simulate"),
        code=code_digest("simulate"),
    log:
        "results/{scenario}/logs/simulate.log",
    benchmark:
        "results/{scenario}/benchmarks/simulate.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1000,
        runtime=10,
    shell:
        "jointgap simulate --options {params.options:q} --trajectory {output.trajectory:q} --events {output.events:q} > {log:q} 2>&1"
