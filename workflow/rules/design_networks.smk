# Networks that know the design: part of `make sweep` for each scenario whose section design_networks says what a design varies.


use rule scenario_stage as design_networks with:
    output:
        **written_by("design-networks"),
        files=[f"results/{{scenario}}/{file}" for file in SCENARIO_STAGES["design-networks"].files],
    pathvars:
        stage="design_networks",
    threads: 8
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        **of_stage("design-networks"),
        results=subpath(output[0], ancestor=2),
        more=lambda wildcards, threads: ["--workers", threads],
    message:
        "{wildcards.scenario}: networks that know the design"
