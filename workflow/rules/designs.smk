# Sweeps and their studies (`make sweep`, `make paper`).


# `update` keeps the existing file, so that an extended sweep keeps its designs.
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
        code=lambda wildcards: STAGES["sweep-designs"].digest,
        part=lambda wildcards: designs_of_sweep(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: sweep, {wildcards.part}"
    shell:
        "jointgap sweep-designs --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --results results/{wildcards.scenario} --designs {output:q} --workers 1 > {log:q} 2>&1"


rule swept:
    input:
        all_sweep_files,
    message:
        "all sweeps are complete"
