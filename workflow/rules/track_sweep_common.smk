# Which scenarios have a sweep or robust lengths to publish, and what of their configuration belongs to that.

from functools import cache


@cache
def made_to_track(name):
    """Every file of a scenario's sweep and robust lengths; none where it asks for neither."""
    swept = made_of_sweep(name) if name in swept_scenarios() else []
    return [*swept, *made_robust(name)]


def tracked_of_sweep(name):
    """For input: what says that the sweep of a scenario is published."""
    return expand([str(path) for path in rules.track_sweep.output], scenario=name)


def tracked_options(wildcards):
    """What is published of a scenario's configuration, as a file: sections that nothing was made of need not go with the others."""
    scenario, sections = SCENARIOS[wildcards.scenario], set(SCENARIO_STAGES["track-sweep"].sections)
    if not scenario.sweep.parameters:
        sections -= {"sweep", "sensitivity"}
    if not scenario.optimise_robust.uncertain:
        sections -= {"optimise", "optimise_robust"}
    return kept_options(wildcards.scenario, scenario.model_dump_json(include=sections, by_alias=True))
