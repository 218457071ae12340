rule track:
    input:
        **read_from("simulate", "surrogate", "clearance", "kinematics", "optimise"),
        comparison=rules.compare.output.table,
        figures=rules.figures.output,
        animation=rules.animation.output.gif,
    output:
        published="results/{scenario}/track/published.json",
    log:
        "results/{scenario}/logs/track.log",
    conda:
        "../envs/jointgap.yaml"
    # The store is one file: publishing one scenario after the other waits less than locking does.
    resources:
        mlflow_store=1,
        mem_mb=2000,
        runtime=20,
    params:
        options=options("track"),
        code=SCENARIO_STAGES["track"].digest,
        results=subpath(input.comparison, parent=True),
        store=subpath(input.comparison, ancestor=2),
    message:
        "{wildcards.scenario}: publish to MLflow"
    shell:
        "jointgap track --options {params.options:q} --results {params.results:q} --scenario {wildcards.scenario}"
        " --store {params.store:q} --published {output.published:q} > {log:q} 2>&1"
