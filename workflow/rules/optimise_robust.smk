# Lengths that hold whatever is uncertain: part of `make sweep` for each scenario whose section optimise_robust says what that is.


def made_robust(name):
    """Every file of a scenario's robust lengths; what is asked has to be possible, before anything runs."""
    if not SCENARIOS[name].optimise_robust.uncertain:
        return []
    from jointgap.robust_lengths.optimise_robust import check_robust  # loads scipy

    try:
        check_robust(SCENARIOS[name])
    except InputError as error:
        raise WorkflowError(f"scenario {name}: {error}") from None
    return [str(path) for path in rules.optimise_robust.output]


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
