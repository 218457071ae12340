"""The tuned numbers of what decides a sweep's measures: what each means, and why it has this value."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SensitivitySettings:
    """How surrogates are trained and judged, and where there are no indices."""

    least_q2: float = 0.8  # [1] Share of the variance of held-out designs that a surrogate has to explain
    most_missing: float = 0.1
    least_designs: int = 50  # Designs with the measure
    held_out: float = 0.2  # [1] Share of designs that the surrogate is judged by and not trained on: the usual fifth
    validated: float = 0.25
    most_designs: int = 20_000  # Designs that are looked at, drawn at random of a larger sweep
    most_terms: int = 500  # Terms of a chaos expansion that are tried
    designs_per_term: int = 8  # Training designs for each term where all terms are kept
    norm: float = 0.75  # [1] Of the hyperbolic truncation
    highest_degree: int = 10  # Of the polynomials
    selection_designs: int = 600  # Designs on which sparse terms are chosen (least angle regression)
    selection_terms: int = 220  # Terms from which it chooses
    kriging_designs: int = 400  # Designs that a Gaussian process is trained on
    replicates: int = 400  # Of the bootstrap: the ends of a 90 % interval are then known to a tenth of its length
    confidence: float = 0.9  # [1] Of all intervals: 90 %, as everywhere in jointgap
    rounding: float = 1e-9  # [1] A measure whose standard deviation is a smaller share of its mean does not vary
    curve_points: int = 41  # Of a main effect, and of a map along each axis: a curve looks smooth
    shown_share: float = 0.01  # [1] Total index from which on a parameter's main effect is drawn


SETTINGS = SensitivitySettings()
