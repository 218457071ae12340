"""The tuned numbers of what decides a sweep's measures: what each means, and why it has this value."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SensitivitySettings:
    """How surrogates are trained and judged, and where there are no indices.

    Attributes
    ----------
    least_q2 : float
        [1] Share of the variance of held-out designs that a surrogate has to explain. What it does not explain may
        belong to any parameter, so an index is open by at least 1 - Q2: beyond a fifth of the variance indices would
        seldom tell which of two parameters decides more.
    most_missing : float
        [1] Share of designs that failed or have no such measure, beyond which there are no indices. Nothing is known
        of the measure there, and the parameters of the designs left are no longer independent of each other: a tenth
        of the range is half of what `least_q2` leaves open.
    least_designs : int
        Designs with the measure. The held-out fifth of fewer than 50 is fewer than ten, which judge nothing.
    held_out : float
        [1] Share of designs that the surrogate is judged by and not trained on: the usual fifth.
    validated : float
        [1] Share of the training designs by which one of several surrogates is chosen, before the chosen one is
        trained on all of them: so that the held-out designs choose nothing.
    most_designs : int
        Designs that are looked at, drawn at random of a larger sweep. Beyond that the error of the surrogate is of its
        form, and memory and time are not worth it.
    most_terms : int
        Terms of a chaos expansion that are tried: with more of them the least squares take longer than a sweep.
    designs_per_term : int
        Training designs for each term where all terms are kept: with fewer the coefficients are mostly noise.
    norm : float
        [1] Of the hyperbolic truncation: below 1 terms of many parameters at once need a lower degree, for few
        measures have such (Blatman and Sudret 2011 recommend 0.75 or so).
    highest_degree : int
        Of the polynomials. A rough measure is not made smooth by higher ones, which swing at the ends of the ranges.
    selection_designs : int
        Designs on which sparse terms are chosen (least angle regression). Its time grows faster than their number:
        12 s instead of 1 s with 3300 designs, and the held-out error was the same to 0.01.
    selection_terms : int
        Terms from which it chooses.
    kriging_designs : int
        Designs that a Gaussian process is trained on; its time grows with the third power of their number.
    replicates : int
        Of the bootstrap: the ends of a 90 % interval are then known to a tenth of its length.
    confidence : float
        [1] Of all intervals: 90 %, as everywhere in jointgap.
    rounding : float
        [1] A measure whose standard deviation is a smaller share of its mean does not vary: what is left are roundings
        and the simulation's tolerance.
    curve_points : int
        Of a main effect, and of a map along each axis: a curve looks smooth.
    shown_share : float
        [1] Total index from which on a parameter's main effect is drawn: below it the curve is flat to the eye.
    """

    least_q2: float = 0.8
    most_missing: float = 0.1
    least_designs: int = 50
    held_out: float = 0.2
    validated: float = 0.25
    most_designs: int = 20_000
    most_terms: int = 500
    designs_per_term: int = 8
    norm: float = 0.75
    highest_degree: int = 10
    selection_designs: int = 600
    selection_terms: int = 220
    kriging_designs: int = 400
    replicates: int = 400
    confidence: float = 0.9
    rounding: float = 1e-9
    curve_points: int = 41
    shown_share: float = 0.01


SETTINGS = SensitivitySettings()
