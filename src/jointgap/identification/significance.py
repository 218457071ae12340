"""Whether an effect that a fit found is there: its amplitudes against what they could be by chance."""

import numpy as np
from scipy.stats import chi2

from jointgap.identification.fit import Fit
from jointgap.identification.protocol import Candidate


def wald_statistic(fit: Fit, candidate: Candidate) -> float:
    """Squared distance [1] of an effect's amplitudes from its absence, in standard errors of all of them together.

    It is what chi2 would gain by the effect in the valley in which the fit lies, if residuals were linear (Wald 1943):
    a hypothesis that gains more owes the rest to another valley of the nuisances. An amplitude at a bound other than 0
    has the error that it would have if the bound were farther.
    """
    amplitudes, free, covariance = _amplitudes(fit, candidate)
    if not free.any():
        return 0.0
    scale = np.sqrt(np.diag(covariance))
    scaled = amplitudes[free] / scale
    return float(scaled @ np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True) @ scaled)


def chance(fit: Fit, candidate: Candidate) -> float:
    """Probability [1] that amplitudes as far from 0 are found where the effect is absent: small where it is there."""
    amplitudes, free, _ = _amplitudes(fit, candidate)
    statistic = wald_statistic(fit, candidate)
    return float(chi2.sf(statistic, max(int(free.sum()), 1))) if amplitudes.size else 1.0


def _amplitudes(fit: Fit, candidate: Candidate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitudes (m,) of an effect, which of them have an error, and the covariance of these."""
    own = {f"{candidate.label}.{key}" for key in candidate.amplitudes}
    places = [i for i, p in enumerate(fit.parameters) if p.key in own]
    if fit.draws is not None:
        covariance = fit.distribution.covariance
    else:
        covariance = fit.covariance(released=[i for i in places if fit.values[i] != 0.0])
    covariance = covariance[np.ix_(places, places)]
    free = np.diag(covariance) > 0.0
    return fit.values[places], free, covariance[np.ix_(free, free)]
