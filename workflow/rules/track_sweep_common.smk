# What scenarios ask of many designs, and what of their configuration belongs to the run that is published of it.

from functools import cache

# What is made for each stage of many designs: files, none where a scenario does not ask for it.
MADE_OF_MANY_DESIGNS = {
    "sweep": made_of_sweep,
    "sensitivity": made_decided,
    "infer-settings": made_inferred,
    "optimise-robust": made_robust,
    "design-networks": made_networks,
    "compare-searches": made_compared,
}


@cache
def made_of_many_designs(name):
    """Files of a scenario by stage, of those stages that it asks for."""
    made = {stage: of(name) for stage, of in MADE_OF_MANY_DESIGNS.items()}
    return {stage: files for stage, files in made.items() if files}


def made_to_track(name):
    """Every file that a scenario asks of many designs."""
    return [file for files in made_of_many_designs(name).values() for file in files]


def made_of_sweeps():
    """Every file that the scenarios ask of many designs, and what says that it is published; one at least has to ask for some."""
    asking = [name for name in SCENARIOS if made_of_many_designs(name)]
    if not asking:
        refuse("sweep.parameters: no scenario names any; give them ranges or lists, as in config/sweep.yaml")
    published = expand([str(path) for path in rules.track_sweep.output], scenario=asking)
    return [*(file for name in asking for file in made_to_track(name)), *published]


def tracked_options(wildcards):
    """What is published of a scenario's configuration, as a file: sections that nothing was made of need not go with the others."""
    sections = {
        section
        for stage in made_of_many_designs(wildcards.scenario)
        for section in SCENARIO_STAGES[stage].sections
    }
    return kept_options(
        wildcards.scenario,
        SCENARIOS[wildcards.scenario].model_dump_json(include={"description", *sections}, by_alias=True),
    )
