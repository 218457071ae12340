# Which scenarios compare searches, and what is made of them.


def made_compared(name):
    """Every file of the comparison of a scenario's searches; what is asked has to be possible, before anything runs."""
    if SCENARIOS[name].compare_searches is None:
        return []
    from jointgap.config import Scenario
    from jointgap.config.load import validate
    from jointgap.length_searches.check_searches import check_searches  # loads scipy

    try:
        # As its job reads them: sections that are left to their defaults have to go with the others too.
        read = set(SCENARIO_STAGES["compare-searches"].sections)
        sections = SCENARIOS[name].model_dump(include=read, by_alias=True)
        check_searches(validate(Scenario, sections, "its configuration"))
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return expand([str(path) for path in rules.compare_searches.output], scenario=name)
