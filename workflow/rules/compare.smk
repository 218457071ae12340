rule compare:
    input:
        **read_from("simulate", "surrogate", "kinematics", "optimise"),
    output:
        table="results/{scenario}/comparison.parquet",
        text="results/{scenario}/comparison.md",
        page=report(
            "results/{scenario}/comparison.html",
            caption="../report/comparison.rst",
            category="{scenario}",
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
        code=code_digest("compare"),
        results=subpath(output.table, parent=True),
    message:
        "{wildcards.scenario}: compare with the paper"
    shell:
        "jointgap compare --options {params.options:q} --results {params.results:q} > {log:q} 2>&1"
