# Which scenarios ask for networks that know the design, and what is made of them.


def made_networks(name):
    """Every file of a scenario's networks; what is asked has to be possible, before anything runs."""
    if not SCENARIOS[name].design_networks.parameters:
        return []
    from jointgap.config import Scenario
    from jointgap.config.load import validate
    from jointgap.design_networks.design_space import design_space  # loads scipy

    try:
        # As its job reads them: sections that are left to their defaults have to go with the others too.
        read = set(SCENARIO_STAGES["design-networks"].sections)
        sections = SCENARIOS[name].model_dump(include=read, by_alias=True)
        design_space(validate(Scenario, sections, "its configuration"))
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return expand([str(path) for path in rules.design_networks.output], scenario=name)
