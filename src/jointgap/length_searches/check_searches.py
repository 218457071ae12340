"""Whether searches can be compared at all: before anything is simulated, and without the packages that learn."""

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.design_networks.design_space import DesignSpace, design_space


def check_searches(scenario: Scenario) -> DesignSpace:
    """Whether the searches of a `scenario` can be compared at all."""
    if scenario.optimise.constraints.largest_pin_force is not None:
        raise InputError(
            "compare_searches: optimise.constraints.largest_pin_force cannot be kept, for networks, surrogate and "
            "frozen motion know no forces; leave it out"
        )
    return design_space(scenario)
