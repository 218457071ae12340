rule figures:
    input:
        **read_from("simulate", "surrogate", "clearance", "kinematics", "optimise"),
    output:
        expand("results/{{scenario}}/figures/{figure}.{ending}", figure=FIGURES, ending=["svg", "parquet"]),
        **{name: reported(name, figure, "png") for name, figure in CATALOGUE.items()},
    log:
        "results/{scenario}/logs/figures.log",
    benchmark:
        "results/{scenario}/benchmarks/figures.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        options=options("figures"),
        code=SCENARIO_STAGES["figures"].digest,
        results=subpath(input.trajectory, ancestor=2),
        folder=subpath(output[0], parent=True),
    message:
        "{wildcards.scenario}: draw the figures"
    shell:
        "jointgap figures --options {params.options:q} --results {params.results:q} --folder {params.folder:q} > {log:q} 2>&1"


rule animation:
    input:
        trajectory=rules.simulate.output.trajectory,
    output:
        gif=reported("animation", ANIMATION, "gif"),
        data="results/{scenario}/figures/animation.parquet",
    log:
        "results/{scenario}/logs/animation.log",
    benchmark:
        "results/{scenario}/benchmarks/animation.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        options=options("figures"),
        code=SCENARIO_STAGES["figures"].digest,
        results=subpath(input.trajectory, ancestor=2),
        folder=subpath(output.gif, parent=True),
    message:
        "{wildcards.scenario}: animate"
    shell:
        "jointgap figures --figure animation --options {params.options:q} --results {params.results:q}"
        " --folder {params.folder:q} > {log:q} 2>&1"
