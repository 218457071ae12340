# Four ways to the best lengths: part of `make sweep` for each scenario with a section compare_searches.


use rule scenario_stage as compare_searches with:
    output:
        **written_by("compare-searches"),
        files=[f"results/{{scenario}}/{file}" for file in SCENARIO_STAGES["compare-searches"].files],
    pathvars:
        stage="compare_searches",
    threads: 8
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        **of_stage("compare-searches"),
        results=subpath(output[0], ancestor=2),
        more=lambda wildcards, threads: ["--workers", threads],
    message:
        "{wildcards.scenario}: four ways to the best lengths"
