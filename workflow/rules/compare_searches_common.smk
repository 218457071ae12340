# Which scenarios compare searches, and what is made of them.


def made_compared(name):
    """Every file of the comparison of a scenario's searches; what is asked has to be possible, before anything runs."""
    if SCENARIOS[name].compare_searches is None:
        return []
    from jointgap.length_searches.check_searches import check_searches  # loads scipy

    check_as_its_job("compare-searches", name, check_searches)
    return expand([str(path) for path in rules.compare_searches.output], scenario=name)
