rule compare:
    input:
        **read_from("simulate", "surrogate", "clearance", "kinematics", "optimise"),
        beside=lambda wildcards: expand(place("optimise_resimulated"), scenario=beside(wildcards)),
    output:
        table="results/{scenario}/comparison.parquet",
        text="results/{scenario}/comparison.md",
        page=report(
            "results/{scenario}/comparison.html",
            caption="../report/comparison.rst",
            category=section,
            subcategory="Comparison",
            labels={"figure": "The paper's numbers and claims beside ours"},
        ),
    log:
        "results/{scenario}/logs/compare.log",
    benchmark:
        "results/{scenario}/benchmarks/compare.tsv"
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        options=options("compare"),
        beside=lambda wildcards: with_options("--beside", beside(wildcards), "compare"),
        code=SCENARIO_STAGES["compare"].digest,
        results=subpath(output.table, parent=True),
    message:
        "{wildcards.scenario}: compare with the paper"
    shell:
        "jointgap compare --options {params.options:q} --results {params.results:q} {params.beside:q} > {log:q} 2>&1"


rule overview:
    input:
        expand(rules.compare.output.table, scenario=LOOSE),
    output:
        table="results/overview.parquet",
        text="results/overview.md",
        page=report(
            "results/overview.html",
            caption="../report/overview.rst",
            category="0. All scenarios",
            labels={"figure": "The scenarios side by side"},
        ),
    log:
        "results/logs/overview.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        scenarios=with_options("--scenario", LOOSE, "compare"),
        code=SCENARIO_STAGES["compare"].digest,
        results=subpath(output.table, parent=True),
    message:
        "all scenarios: put side by side"
    shell:
        "jointgap overview --results {params.results:q} {params.scenarios:q} > {log:q} 2>&1"
