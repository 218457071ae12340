# What the rules of sweeps share: which scenarios are swept, their parts, and what each part depends on.

import json
from functools import cache


@cache
def swept_scenarios():
    """Scenarios with parameters to sweep; each sweep has to be possible, before anything runs."""
    from jointgap.designs.run import check_folder  # loads scipy

    names = [name for name, scenario in SCENARIOS.items() if scenario.sweep.parameters]
    for name in names:
        try:
            folder = Path("results", name, "sweep/designs")
            check_folder(designs_of_sweep(name), folder, SCENARIOS[name].sweep.designs_per_job)
        except InputError as error:
            refuse(f"scenario {name}: {error}")
    return names


@cache
def designs_of_sweep(name):
    """The designs of a scenario's sweep."""
    from jointgap.designs.sampling import designs_of  # loads scipy

    return designs_of(SCENARIOS[name])


@cache
def parts_of_sweep(name):
    """First design and number of designs of each part, by the part's name."""
    return parts(SCENARIOS[name].sweep.designs, SCENARIOS[name].sweep.designs_per_job)


def made_of_sweep(name):
    """Every file of a scenario's sweep."""
    if name not in swept_scenarios():
        return []
    paths = [str(path) for path in (*rules.sweep_designs.output, *rules.sweep.output)]
    return [file for path in paths for file in expand(path, scenario=name, part=parts_of_sweep(name))]


def part_options(wildcards):
    """What a part depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    options = json.loads(SCENARIO_STAGES["sweep-designs"].options(SCENARIOS[wildcards.scenario]))
    options["sweep"].pop("designs_per_job")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))
