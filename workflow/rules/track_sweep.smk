# Part of `make sweep` and `make paper`: what a scenario asks of many designs becomes one run in MLflow, once all is there.


use rule scenario_stage as track_sweep with:
    input:
        lambda wildcards: made_to_track(wildcards.scenario),
    output:
        published="results/{scenario}/track_sweep/published.json",
    benchmark:
        "results/{scenario}/track_sweep/benchmark.tsv"
    pathvars:
        stage="track_sweep",
    # As for the rule track.
    resources:
        mlflow_store=1,
        mem_mb=2000,
        runtime=20,
    params:
        **of_stage("track-sweep") | {"options": tracked_options},
        results=subpath(output[0], ancestor=2),
        more=lambda wildcards, output: [
            *("--scenario", wildcards.scenario, "--published", output.published),
            *("--store", str(Path(output.published).parents[2])),
        ],
    message:
        "{wildcards.scenario}: publish the sweep to MLflow"
