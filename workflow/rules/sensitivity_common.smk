# Which scenarios ask what decides the measures of their sweep, and what is made of that.


def made_decided(name):
    """Every file of what decides in a scenario's sweep."""
    if SCENARIOS[name].sensitivity is None or not SCENARIOS[name].sweep.parameters:
        return []
    return expand([str(path) for path in rules.sensitivity.output], scenario=name)
