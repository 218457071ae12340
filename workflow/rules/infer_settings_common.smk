# Which scenarios ask for the settings that the paper did not print, and what is made of them.


def made_inferred(name):
    """Every file of a scenario's inferred settings; what is asked has to be possible, before anything runs."""
    if SCENARIOS[name].infer_settings is None:
        return []
    from jointgap.designs.infer_settings import check_infer_settings  # loads scipy

    try:
        check_infer_settings(SCENARIOS[name])
    except InputError as error:
        refuse(f"scenario {name}: {error}")
    return expand([str(path) for path in rules.infer_settings.output], scenario=name)
