# Part of `make paper`, and of `make sweep` for scenarios with a section infer_settings: for which settings the paper's printed
# numbers come out.


rule infer_settings:
    input:
        lambda wildcards: expand(
            rules.sweep_designs.output.designs, part=parts_of_sweep(wildcards.scenario), allow_missing=True
        ),
    output:
        multiext("results/{scenario}/infer_settings/summary", ".md", ".html"),
        "results/{scenario}/infer_settings/nearest_scenario.yaml",
        f"results/{{scenario}}/{INFERRED_DESIGNS_PATH}",
        settings=place(INFERRED_SETTINGS),
    log:
        "results/{scenario}/logs/infer_settings.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "infer-settings"),
        code=digest_of("infer-settings"),
        designs=subpath(input[0], parent=True),
        folder=subpath(output[0], parent=True),
    message:
        "{wildcards.scenario}: the settings that the paper did not print"
    shell:
        "jointgap infer-settings --options {params.options:q} --designs {params.designs:q} --folder {params.folder:q}"
        " > {log:q} 2>&1"
