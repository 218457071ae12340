"""The tuned numbers of the comparison of searches: what each means, and why it has this value."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """How budgets are shared out, and how lengths are searched."""

    # [1] Share of what a budget leaves for learning that simulates designs; the training of networks takes the rest
    simulated_for_networks: float = 0.5
    # [1] The same of the surrogate of the error, which is trained in a few seconds
    simulated_for_surrogate: float = 0.8
    # [s] CPU time that is kept back for the search of each optimum with a network or a surrogate, as measured; half
    # of a budget at most
    search_time: float = 0.07
    first_width: float = 0.25  # [1] Standard deviation of the first candidates of CMA-ES as a share of the box
    restarts: int = 9  # Of CMA-ES where it has converged and its budget is not spent; each has twice the candidates
    # [1] Of the local search on a network or a surrogate: the change of the squared error at which it stops, as a
    # share of what it changes between the starting points, and the step of the central differences as a share of
    # the box. Double precision leaves the slope eight digits at this step
    tolerance: float = 1e-10
    # [1] Of the local search on a network or a surrogate: the change of the squared error at which it stops, as a
    # share of what it changes between the starting points, and the step of the central differences as a share of
    # the box. Double precision leaves the slope eight digits at this step
    difference: float = 1e-5
    # [1] Gains count as the same where one is this share of the other: a hundredth of a gain of a tenth is beyond
    # what lengths are made to
    as_good: float = 0.99
    kriging_designs: int = 100  # Of the surrogate: more of them take longer to fit than a small budget lasts
    selection_designs: int = 300  # Of the surrogate: more of them take longer to fit than a small budget lasts


SETTINGS = SearchSettings()
