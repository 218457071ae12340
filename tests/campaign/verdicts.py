"""Verdicts of every kind, as ``verdict.json`` has them."""

COULOMB = {
    "name": "slider_coulomb_friction",
    "site": "slider",
    "delta_bic": 812.4,
    "parameters": {"force_N": {"value": 21.3, "sd": 0.4, "interval_90": [20.6, 22.0]}},
}
BIAS = {
    "name": "sensor_bias",
    "site": "crank_torque",
    "delta_bic": 40.0,
    "parameters": {"bias": {"value": 0.5, "sd": 0.002, "interval_90": [0.497, 0.503]}},
}
WEIGHT = {"name": "gravity", "site": "all bodies", "delta_bic": 30.0, "parameters": {}}
NAMED = {
    "schema_version": 3,
    "campaign": "rig-a",
    "verdict": "named",
    "basis": "samples",
    "effects": [COULOMB],
    "equivalent": [],
    "certain": [],
    "not_searched": [],
    "best_known": None,
    "held_out_test": "falls",
    "doubted_channels": [],
    "nuisances": {"slider_mass": {"value": 0.447, "sd": 0.002}},
    "where": [
        {"run": "slow", "channel": "crank_torque", "crank_angle_deg": [350, 10], "p_adjusted": 1e-9}
    ],
    "orders": [],
    "gap": {"identify": {"before": 9.1, "after": 1.02}, "confirm": {"before": 8.7, "after": 1.05}},
    "preflight": {
        "undetectable": ["crank_unbalance"],
        "merged": [["sensor_bias:crank_torque", "crank_coulomb_friction"]],
    },
    "false_alarm_rate": 0.01,
}
UNNAMED = NAMED | {"effects": [], "where": [], "held_out_test": None}
MET = UNNAMED | {
    "gap": {"identify": {"before": 1.01, "after": 1.01}, "confirm": {"before": 1.02, "after": 1.02}}
}
VERDICTS = {
    "named": NAMED,
    "named_with_remaining_misfit": NAMED | {"verdict": "named_with_remaining_misfit"},
    "no_disagreement": MET | {"verdict": "no_disagreement"},
    "parameters_only": MET | {"verdict": "parameters_only"},
    "ambiguous": (
        UNNAMED
        | {
            "verdict": "ambiguous",
            "equivalent": [[COULOMB], [BIAS]],
            "held_out_test": "falls",
        }
    ),
    "unexplained": UNNAMED | {"verdict": "unexplained"},
}
