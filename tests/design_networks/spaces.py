"""Scenarios for the tests of networks that know the design."""

from jointgap.config import Scenario
from tests.dynamics.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
PARAMETERS = {"clearance": {"from": "0.4 mm", "to": "0.8 mm"}, "friction": {"from": 0.05, "to": 0.2}}


def scenario(parameters: dict | None = None, made=MADE, optimise: dict | None = None, **sections) -> Scenario:
    """A small scenario; `sections` are compare_searches and other keys of design_networks."""
    compared = {"compare_searches": sections.pop("compare_searches")} if "compare_searches" in sections else {}
    networks = {"parameters": PARAMETERS if parameters is None else parameters, "designs": 16, "held_out": 8}
    return Scenario(
        mechanism=made,
        simulate=COARSE,
        optimise={
            "boxes": {"near": {"crank_length": ["148 mm", "152 mm"], "rod_length": ["560 mm", "568 mm"]}},
            "ensemble": {"settled_revolution": 2},
        }
        | (optimise or {}),
        design_networks=networks | {"steps": 10, "hidden": [6]} | sections,
        **compared,
    )
