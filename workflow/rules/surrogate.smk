rule surrogate:
    input:
        trajectory=rules.simulate.output.trajectory,
    output:
        fit=place("fit"),
        history=place("fit_history"),
        errors=place("fit_errors"),
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
        code=SCENARIO_STAGES["surrogate"].digest,
    message:
        "{wildcards.scenario}: train the network of {wildcards.output}"
    shell:
        "jointgap surrogate --options {params.options:q} --trajectory {input.trajectory:q} --output-name {wildcards.output}"
        " --fit {output.fit:q} --history {output.history:q} --errors {output.errors:q} > {log:q} 2>&1"


rule clearance:
    input:
        trajectory=rules.simulate.output.trajectory,
    output:
        fit=place("clearance_fit"),
        errors=place("fit_errors", output="clearance"),
    log:
        "results/{scenario}/logs/surrogate/clearance.log",
    benchmark:
        "results/{scenario}/benchmarks/surrogate/clearance.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=3000,
        runtime=20,
    params:
        options=options("surrogate"),
        code=SCENARIO_STAGES["surrogate"].digest,
    message:
        "{wildcards.scenario}: train the second surrogate"
    shell:
        "jointgap clearance --options {params.options:q} --trajectory {input.trajectory:q}"
        " --fit {output.fit:q} --errors {output.errors:q} > {log:q} 2>&1"
