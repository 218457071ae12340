rule kinematics:
    input:
        **read_from("simulate", "surrogate", "clearance"),
    output:
        **written_by("kinematics"),
    log:
        "results/{scenario}/logs/kinematics.log",
    benchmark:
        "results/{scenario}/benchmarks/kinematics.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        options=options("kinematics"),
        code=SCENARIO_STAGES["kinematics"].digest,
        results=subpath(input.trajectory, ancestor=2),
    message:
        "{wildcards.scenario}: kinematics from networks and simulation"
    shell:
        "jointgap kinematics --options {params.options:q} --results {params.results:q} > {log:q} 2>&1"
