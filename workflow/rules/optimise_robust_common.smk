# Which scenarios ask for robust lengths, and what is made of them.


def made_robust(name):
    """Every file of a scenario's robust lengths; what is asked has to be possible, before anything runs."""
    if not SCENARIOS[name].optimise_robust.uncertain:
        return []
    from jointgap.designs.robust import check_robust  # loads scipy

    check_as_its_job("optimise-robust", name, check_robust)
    return expand([str(path) for path in rules.optimise_robust.output], scenario=name)
