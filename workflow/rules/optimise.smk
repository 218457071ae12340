rule optimise:
    input:
        **read_from("simulate", "surrogate", "clearance"),
    output:
        **written_by("optimise"),
    log:
        "results/{scenario}/logs/optimise.log",
    benchmark:
        "results/{scenario}/benchmarks/optimise.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        options=options("optimise"),
        code=SCENARIO_STAGES["optimise"].digest,
        results=subpath(input.trajectory, ancestor=2),
    message:
        "{wildcards.scenario}: optimise the link lengths"
    shell:
        "jointgap optimise --options {params.options:q} --results {params.results:q} > {log:q} 2>&1"
