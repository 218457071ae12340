# Which scenarios ask for networks that know the design, and what is made of them.


def made_networks(name):
    """Every file of a scenario's networks; what is asked has to be possible, before anything runs."""
    if not SCENARIOS[name].design_networks.parameters:
        return []
    from jointgap.design_networks.design_space import design_space  # loads scipy

    check_as_its_job("design-networks", name, design_space)
    return expand([str(path) for path in rules.design_networks.output], scenario=name)
