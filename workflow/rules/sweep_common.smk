# What the rules of sweeps share: which scenarios are swept, their parts, and what each part depends on.

import json
from functools import cache


@cache
def swept_scenarios():
    """Scenarios with parameters to sweep; each sweep has to be possible, before anything runs."""
    from jointgap.designs.designs_to_parquet import check_folder  # loads scipy

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
    from jointgap.designs.design_of_experiments import designs_of  # loads scipy

    return designs_of(SCENARIOS[name])


@cache
def parts_of_sweep(name):
    """First design and number of designs of each part, by the part's name."""
    return parts(SCENARIOS[name].sweep.designs, SCENARIOS[name].sweep.designs_per_job)


def made_of_sweeps():
    """Every file that the scenarios ask of many designs, and what says that it is published; one at least has to ask for some."""
    check_inferences()
    tracked = [name for name in SCENARIOS if made_to_track(name)]
    made = [path for name in tracked for path in (*made_to_track(name), *tracked_of_sweep(name))]
    made += [path for name in SCENARIOS for path in (*made_networks(name), *made_compared(name))]
    if not made:
        refuse("sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml")
    return made


def check_inferences():
    """What the paper did not say can be inferred of each scenario that asks for it, before anything runs."""
    from jointgap.paper_settings.infer_settings import check_infer_settings  # loads scipy

    for name, scenario in SCENARIOS.items():
        if scenario.infer_settings is not None:
            try:
                check_infer_settings(scenario)
            except InputError as error:
                refuse(f"scenario {name}: {error}")


def made_of_sweep(name):
    """Every file that rules make of a scenario's sweep."""
    paths = [str(path) for path in (*rules.sweep_designs.output, *rules.sweep.output)]
    paths += map(str, rules.sensitivity.output if SCENARIOS[name].sensitivity is not None else ())
    paths += map(str, rules.infer_settings.output if SCENARIOS[name].infer_settings is not None else ())
    return [file for path in paths for file in expand(path, scenario=name, part=parts_of_sweep(name))]


def part_options(wildcards):
    """What a part depends on, as a file: how many designs there are is no part of it where a sequence can be grown."""
    scenario, sections = SCENARIOS[wildcards.scenario], set(SCENARIO_STAGES["sweep-designs"].sections)
    options = json.loads(scenario.model_dump_json(include=sections, by_alias=True))
    options["sweep"].pop("designs_per_job")
    if options["sweep"]["design"] == "sobol":
        options["sweep"].pop("number")
    return kept_options(wildcards.scenario, json.dumps(options))
