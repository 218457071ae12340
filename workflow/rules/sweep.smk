# Not part of `make run`: `make sweep` simulates and measures the designs of every scenario whose section sweep names parameters,
# and makes what other sections ask of many designs.


rule swept:
    input:
        lambda wildcards: whole(made_of_sweeps()),
    message:
        "all designs of the sweeps are measured"


# A part that is there is not removed before its job: of a sweep that has grown its designs are kept.
rule sweep_designs:
    output:
        designs=update("results/{scenario}/sweep/designs/{part}.parquet"),
    log:
        "results/{scenario}/logs/sweep_{part}.log",
    wildcard_constraints:
        part=r"part_\d+",
    conda:
        "../envs/jointgap.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=part_options,
        code=digest_of("sweep-designs"),
        part=lambda wildcards: parts_of_sweep(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: sweep, {wildcards.part}"
    shell:
        "jointgap sweep-designs --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --designs {output.designs:q} --workers {threads} > {log:q} 2>&1"


rule sweep:
    input:
        lambda wildcards: expand(
            rules.sweep_designs.output.designs, part=parts_of_sweep(wildcards.scenario), allow_missing=True
        ),
    output:
        multiext("results/{scenario}/sweep/summary", ".md", ".html"),
    log:
        "results/{scenario}/logs/sweep.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "sweep"),
        code=digest_of("sweep"),
        folder=subpath(output[0], parent=True),
    message:
        "{wildcards.scenario}: what the sweep measured"
    shell:
        "jointgap sweep --options {params.options:q} --folder {params.folder:q} > {log:q} 2>&1"
