# Lengths that hold whatever is uncertain: part of `make sweep` for each scenario whose section optimise_robust says what that is.


use rule scenario_stage as optimise_robust with:
    output:
        **written_by("optimise-robust"),
        files=[f"results/{{scenario}}/{file}" for file in SCENARIO_STAGES["optimise-robust"].files],
    pathvars:
        stage="optimise_robust",
    threads: 8
    resources:
        mem_mb=2000,
        runtime=120,
    params:
        **of_stage("optimise-robust"),
        results=subpath(output[0], ancestor=2),
        more=lambda wildcards, threads: ["--workers", threads],
    message:
        "{wildcards.scenario}: robust lengths"
