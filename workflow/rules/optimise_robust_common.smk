# Which scenarios ask for robust lengths, and what is made of them.


def made_robust(name):
    """Every file of a scenario's robust lengths; what is asked has to be possible, before anything runs."""
    if not SCENARIOS[name].optimise_robust.uncertain:
        return []
    from jointgap.config import Scenario
    from jointgap.config.load import validate
    from jointgap.robust_lengths.optimise_robust import check_robust  # loads scipy

    try:
        # As its job reads them: sections that are left to their defaults have to go with the others too.
        read = set(SCENARIO_STAGES["optimise-robust"].sections)
        sections = SCENARIOS[name].model_dump(include=read, by_alias=True)
        check_robust(validate(Scenario, sections, "its configuration"))
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return expand([str(path) for path in rules.optimise_robust.output], scenario=name)
