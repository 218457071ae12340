# What `make sweep` and `make paper` make of many designs: the sweep itself, and what other sections of a scenario ask.


import json
from functools import cache

from jointgap.core.progress import parts
from jointgap.designs.stages import studies_of


@cache
def designs_of_sweep(name):
    """First design and number of designs of each job of a scenario's sweep; none where it names no parameters."""
    sweep = SCENARIOS[name].sweep
    if not sweep.parameters:
        return {}
    from jointgap.designs.run import check_folder  # loads scipy
    from jointgap.designs.sampling import designs_of

    check_folder(designs_of(SCENARIOS[name]), Path("results", name, "sweep/designs"), sweep.designs_per_job)
    return parts(sweep.designs, sweep.designs_per_job)


def datasets(name):
    return [f"results/{name}/sweep/designs/{part}.parquet" for part in designs_of_sweep(name)]


@cache
def asked(name):
    """The stages on many designs that a scenario asks for; what is asked has to be possible, before anything runs."""
    try:
        designs_of_sweep(name)
        return studies_of(SCENARIOS[name], checked=True)
    except InputError as error:
        refuse(f"scenario {name}: {error}")


def made_of_designs(name):
    """Every file that a scenario asks of many designs."""
    stages = [DESIGN_STAGES[stage] for stage in asked(name)]
    return [*datasets(name), *of_scenario(name, made_by(stages, SCENARIO))]


def part_options(wildcards):
    """What a job depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    options = json.loads(DESIGN_STAGES["sweep-designs"].options(SCENARIOS[wildcards.scenario]))
    options["sweep"].pop("designs_per_job")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))


def published_options(name):
    """What is published of a scenario's configuration, as a file: sections that nothing was made of need not go with the others."""
    sections = {
        "description",
        *(one for stage in asked(name) for one in DESIGN_STAGES[stage].sections),
    }
    return kept_options(name, SCENARIOS[name].model_dump_json(include=sections, by_alias=True))


def made_of_sweeps(wildcards):
    """Every file that the scenarios ask of many designs, and what says that it is published; one at least has to ask for some."""
    asking = [name for name in SCENARIOS if asked(name)]
    if not asking:
        refuse("sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml")
    published = [f"results/{name}/track_sweep/published.json" for name in asking]
    return [*(file for name in asking for file in made_of_designs(name)), *published]


# A file that is there is not removed before its job: of a sweep that has grown its designs are kept.
rule sweep_designs:
    output:
        update("results/{scenario}/sweep/designs/{part}.parquet"),
    log:
        "results/{scenario}/logs/sweep_{part}.log",
    wildcard_constraints:
        part=r"part_\d+",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=part_options,
        code=lambda wildcards: STAGES["sweep-designs"].digest,
        part=lambda wildcards: designs_of_sweep(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: sweep, {wildcards.part}"
    shell:
        "jointgap sweep-designs --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --designs {output:q} --workers 1 > {log:q} 2>&1"


rule swept:
    input:
        made_of_sweeps,
    message:
        "all designs of the sweeps are measured"
