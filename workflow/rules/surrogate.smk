rule surrogate:
    input:
        trajectory=rules.simulate.output.trajectory,
    output:
        **written_by("surrogate"),
    log:
        "results/{scenario}/logs/surrogate/{output}.log",
    benchmark:
        "results/{scenario}/benchmarks/surrogate/{output}.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        options=options("surrogate"),
        code=code_digest("surrogate"),
    message:
        "{wildcards.scenario}: train the network of {wildcards.output}"
    shell:
        "jointgap surrogate --options {params.options:q} --trajectory {input.trajectory:q} --output-name {wildcards.output}"
        " --fit {output.fit:q} --history {output.fit_history:q} --errors {output.fit_errors:q} > {log:q} 2>&1"
