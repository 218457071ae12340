"""Verdicts of every kind, as ``verdict.json`` has them."""


def effect(name: str, site: str, delta_bic: float, **parameters: tuple) -> dict:
    """An effect with value, standard error and 90 % interval of its parameters."""
    keys = ("value", "sd", "interval_90")
    stated = {key: dict(zip(keys, numbers, strict=True)) for key, numbers in parameters.items()}
    return {"name": name, "site": site, "delta_bic": delta_bic, "parameters": stated}


COULOMB = effect("slider_coulomb_friction", "slider", 812.4, force_N=(21.3, 0.4, [20.6, 22.0]))
BIAS = effect("sensor_bias", "crank_torque", 40.0, bias=(0.5, 0.002, [0.497, 0.503]))
WEIGHT = effect("gravity", "all bodies", 30.0)
EMPTY = "equivalent certain not_searched doubted_channels orders".split()
WINDOW = {"run": "slow", "channel": "crank_torque", "crank_angle_deg": [350, 10]}
MERGED = [["sensor_bias:crank_torque", "crank_coulomb_friction"]]
NAMED = {name: [] for name in EMPTY} | {
    "schema_version": 3,
    "campaign": "rig-a",
    "verdict": "named",
    "basis": "samples",
    "effects": [COULOMB],
    "best_known": None,
    "held_out_test": "falls",
    "nuisances": {"slider_mass": {"value": 0.447, "sd": 0.002}},
    "where": [WINDOW | {"p_adjusted": 1e-9}],
    "gap": {"identify": {"before": 9.1, "after": 1.02}, "confirm": {"before": 8.7, "after": 1.05}},
    "preflight": {"undetectable": ["crank_unbalance"], "merged": MERGED},
    "false_alarm_rate": 0.01,
}
UNNAMED = NAMED | {"effects": [], "where": [], "held_out_test": None}
SMALL = {"identify": {"before": 1.01, "after": 1.01}, "confirm": {"before": 1.02, "after": 1.02}}
AT_NOISE = UNNAMED | {"gap": SMALL}
EQUIVALENT = {"equivalent": [[COULOMB], [BIAS]], "held_out_test": "falls"}
VERDICTS = {
    "named": NAMED,
    "named_with_remaining_misfit": NAMED | {"verdict": "named_with_remaining_misfit"},
    "no_disagreement": AT_NOISE | {"verdict": "no_disagreement"},
    "parameters_only": AT_NOISE | {"verdict": "parameters_only"},
    "ambiguous": UNNAMED | {"verdict": "ambiguous"} | EQUIVALENT,
    "unexplained": UNNAMED | {"verdict": "unexplained"},
}
