# Part of `make sweep` for scenarios with a section sensitivity: which parameter of the sweep decides which measure.


rule sensitivity:
    input:
        lambda wildcards: expand(
            rules.sweep_designs.output.designs, part=parts_of_sweep(wildcards.scenario), allow_missing=True
        ),
    output:
        multiext("results/{scenario}/sensitivity/summary", ".md", ".html"),
        **{table.name: place(table) for table in SENSITIVITY_TABLES},
        figures=directory("results/{scenario}/sensitivity/figures"),
    log:
        "results/{scenario}/logs/sensitivity.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2500,
        runtime=30,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "sensitivity"),
        code=digest_of("sensitivity"),
        designs=subpath(input[0], parent=True),
        folder=subpath(output[0], parent=True),
    message:
        "{wildcards.scenario}: what decides the measures of the sweep"
    shell:
        "jointgap sensitivity --options {params.options:q} --designs {params.designs:q} --folder {params.folder:q}"
        " > {log:q} 2>&1"
