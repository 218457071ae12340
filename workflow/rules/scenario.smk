# The stages of a scenario. What they read and write stands in their records (jointgap.scenario.stages), and as a
# picture in docs/workflow.md.


# Never run: the rules of the stages inherit from it.
rule scenario_stage:
    output:
        "results/{scenario}/<stage>/inherited",
    log:
        "results/{scenario}/logs/<stage>.log",
    benchmark:
        "results/{scenario}/benchmarks/<stage>.tsv"
    pathvars:
        stage="scenario_stage",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        results=subpath(output[0], ancestor=2),
        more=[],
    message:
        "{wildcards.scenario}: {rule}"
    shell:
        "jointgap {params.stage} --options {params.options:q} --results {params.results:q} {params.more:q} > {log:q} 2>&1"


use rule scenario_stage as simulate with:
    output:
        **written_by("simulate"),
    pathvars:
        stage="simulate",
    params:
        **of_stage("simulate"),
    message:
        "{wildcards.scenario}: simulate the contact"


use rule scenario_stage as surrogate with:
    input:
        **read_by("surrogate"),
    output:
        **written_by("surrogate"),
    pathvars:
        stage="surrogate/{output}",
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        **of_stage("surrogate"),
        results=subpath(output[0], ancestor=3),
        more=lambda wildcards: ["--output-name", wildcards.output],
    message:
        "{wildcards.scenario}: train the network of {wildcards.output}"


use rule scenario_stage as clearance with:
    input:
        **read_by("clearance"),
    output:
        **written_by("clearance"),
    pathvars:
        stage="surrogate/clearance",
    resources:
        mem_mb=3000,
        runtime=20,
    params:
        **of_stage("clearance"),
        results=subpath(output[0], ancestor=3),
    message:
        "{wildcards.scenario}: train the second surrogate"


use rule scenario_stage as kinematics with:
    input:
        **read_by("kinematics"),
    output:
        **written_by("kinematics"),
    pathvars:
        stage="kinematics",
    params:
        **of_stage("kinematics"),
    message:
        "{wildcards.scenario}: kinematics from networks and simulation"


use rule scenario_stage as optimise with:
    input:
        **read_by("optimise"),
    output:
        **written_by("optimise"),
    pathvars:
        stage="optimise",
    params:
        **of_stage("optimise"),
    message:
        "{wildcards.scenario}: optimise the link lengths"


use rule scenario_stage as figures with:
    input:
        **read_by("figures"),
    output:
        [drawn(name, ending) for name in FIGURES for ending in ("png", "svg", "parquet")],
    pathvars:
        stage="figures",
    params:
        **of_stage("figures"),
    message:
        "{wildcards.scenario}: draw the figures"


use rule scenario_stage as animation with:
    input:
        trajectory=rules.simulate.output.trajectory,
    output:
        gif=drawn("animation", "gif"),
        data=drawn("animation", "parquet"),
    pathvars:
        stage="animation",
    params:
        **of_stage("figures"),
        more=["--figure", "animation"],
    message:
        "{wildcards.scenario}: animate"


use rule scenario_stage as explore with:
    input:
        **read_by("explore"),
    output:
        page=f"results/{{scenario}}/{IMPACTS_PAGE}",
    pathvars:
        stage="explore",
    params:
        **of_stage("explore"),
    message:
        "{wildcards.scenario}: a page to zoom into the impacts"


use rule scenario_stage as compare with:
    input:
        **read_by("compare"),
        siblings=lambda wildcards: expand(
            rules.optimise.output.optimise_resimulated, scenario=siblings(wildcards.scenario)
        ),
    output:
        table="results/{scenario}/comparison.parquet",
        text="results/{scenario}/comparison.md",
        page="results/{scenario}/comparison.html",
    pathvars:
        stage="compare",
    params:
        **of_stage("compare"),
        results=subpath(output.table, parent=True),
        more=lambda wildcards: named_options("--beside", siblings(wildcards.scenario), "compare"),
    message:
        "{wildcards.scenario}: compare with the paper"


use rule scenario_stage as summarise with:
    input:
        **read_by("summarise"),
        figures=rules.figures.output,
        animation=rules.animation.output.gif,
    output:
        known="results/{scenario}/summary.json",
        text="results/{scenario}/summary.md",
        page="results/{scenario}/summary.html",
    pathvars:
        stage="summarise",
    params:
        **of_stage("summarise"),
        results=subpath(output.known, parent=True),
    message:
        "{wildcards.scenario}: put what came out on one page"


use rule scenario_stage as track with:
    input:
        **read_by("track"),
        figures=rules.figures.output,
        animation=rules.animation.output.gif,
    output:
        published="results/{scenario}/track/published.json",
    benchmark:
        "results/{scenario}/track/benchmark.tsv"
    pathvars:
        stage="track",
    # The store is one file: publishing one scenario after the other waits less than locking does.
    resources:
        mlflow_store=1,
        mem_mb=2000,
        runtime=20,
    params:
        **of_stage("track"),
        more=lambda wildcards, output: [
            *("--scenario", wildcards.scenario, "--published", output.published),
            *("--store", str(Path(output.published).parents[2])),
        ],
    message:
        "{wildcards.scenario}: publish to MLflow"


rule overview:
    input:
        tables=expand(rules.compare.output.table, scenario=LOOSE),
        figures=expand(drawn("resimulation", "png"), scenario=LOOSE),
    output:
        table="results/overview.parquet",
        text="results/overview.md",
        page="results/overview.html",
    log:
        "results/logs/overview.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        scenarios=lambda wildcards: named_options("--scenario", LOOSE, "overview"),
        code=digest_of("overview"),
        results=subpath(output.table, parent=True),
    message:
        "all scenarios: put side by side"
    shell:
        "jointgap overview --results {params.results:q} {params.scenarios:q} > {log:q} 2>&1"
