# Not part of `make run`: `make sweep` simulates and measures the designs of every scenario whose section sweep names parameters.

import json

from jointgap.sweep.parts import part_name, parts


def swept_scenarios():
    """Scenarios with parameters to sweep; there has to be one, and each sweep has to be possible, before anything runs."""
    names = [name for name, scenario in SCENARIOS.items() if scenario.sweep.parameters]
    if not names:
        raise WorkflowError(
            "sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml"
        )
    try:
        for name in names:
            parts_of_sweep(name)
    except InputError as error:
        raise WorkflowError(str(error)) from None
    return names


def parts_of_sweep(name):
    """First design and number of designs of each part, by the part's name."""
    from jointgap.sweep.design_of_experiments import designs_of  # loads scipy

    number = designs_of(SCENARIOS[name]).number
    return {part_name(i): part for i, part in enumerate(parts(number, SCENARIOS[name].sweep.designs_per_job))}


def made_of_sweep(name):
    """Every file that rules make of a scenario's sweep."""
    paths = [str(path) for path in (*rules.sweep_designs.output, *rules.sweep.output)]
    return [file for path in paths for file in expand(path, scenario=name, part=parts_of_sweep(name))]


def part_options(wildcards):
    """What a part depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    scenario, sections = SCENARIOS[wildcards.scenario], set(SCENARIO_STAGES["sweep-designs"].sections)
    options = json.loads(scenario.model_dump_json(include=sections, by_alias=True))
    options["sweep"].pop("designs_per_job")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))


rule swept:
    input:
        lambda wildcards: whole(path for name in swept_scenarios() for path in made_of_sweep(name)),
    message:
        "all designs of the sweeps are measured"


rule sweep_designs:
    output:
        designs="results/{scenario}/sweep/designs/{part}.parquet",
    log:
        "results/{scenario}/logs/sweep_{part}.log",
    wildcard_constraints:
        part=r"part_\d+",
    conda:
        "../envs/jointgap.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=part_options,
        code=SCENARIO_STAGES["sweep-designs"].digest,
        part=lambda wildcards: parts_of_sweep(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: sweep, {wildcards.part}"
    shell:
        "jointgap sweep-designs --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --designs {output.designs:q} --workers {threads} > {log:q} 2>&1"


rule sweep:
    input:
        lambda wildcards: expand(
            rules.sweep_designs.output.designs, part=parts_of_sweep(wildcards.scenario), allow_missing=True
        ),
    output:
        multiext("results/{scenario}/sweep/summary", ".md", ".html"),
    log:
        "results/{scenario}/logs/sweep.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "sweep"),
        code=SCENARIO_STAGES["sweep"].digest,
        folder=subpath(output[0], parent=True),
    message:
        "{wildcards.scenario}: what the sweep measured"
    shell:
        "jointgap sweep --options {params.options:q} --folder {params.folder:q} > {log:q} 2>&1"
