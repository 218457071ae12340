"""The state within a step: the method's interpolant of seventh order, from three additional stages.

Section II.10 of Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd edition.
The three stages are computed once per step with samples. Where time is a function of the root of
the time from an event, so is the interpolant.

In nonsmooth motion the interpolant's error exceeds that of the step. The size of its highest term
detects this: each sample of such a step is the end of a shorter step. So samples are as accurate as
the steps."""

import math

from jointgap.dynamics.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.runge_kutta import (
    COUNT,
    INTERPOLANT,
    KEPT,
    MORE_NODES,
    MORE_STAGES,
    VELOCITY_TIME,
    auxiliary_after,
    auxiliary_rows,
    auxiliary_weight,
    ds_for,
    dt_ds,
    elapsed_time,
    instant,
    rates_over_s,
    step,
    weighted_rows,
)

_FIRST, _MORE, _TERMS = 5, KEPT - COUNT - 1, 4 + INTERPOLANT.shape[0]

_ROUGHEST = 10.0
"""Size of the highest term, in tolerances, above which the interpolant is not used.

Over two revolutions of the paper's mechanism, with and without friction, at tolerances of 1e-8 to
1e-14 m, the error is then at most 1.4 tolerances (about 1 in 99 % of the samples); without this
limit up to 178. With friction 2 to 16 % of the steps exceed it.
"""


@compiled
def prepare_inside(p, here, there, taken, tolerance, k):
    """Compute the additional stages of a step and the coefficients of its interpolant."""
    time_map, s, ds = taken
    y, x, auxiliary = here.clearance_state, here.auxiliary_state, p.switches.auxiliary
    rates_over_s(k, COUNT, there, dt_ds(time_map, s + ds), auxiliary)
    for i in range(_MORE):
        row = COUNT + 1 + i
        total = weighted_rows(k.rates, MORE_STAGES, i, _FIRST, row)
        z = (
            y[0] + ds * total[0],
            y[1] + ds * total[1],
            y[2] + ds * total[2],
            y[3] + ds * total[3],
            y[4] + ds * total[4],
            y[5] + ds * total[5],
            y[6] + ds * total[6],
            y[7] + ds * total[7],
        )
        z_auxiliary = x
        if auxiliary:
            newest, weight = k.auxiliary_rates[row - 1], MORE_STAGES[i, row - 1]
            z_auxiliary = auxiliary_after(
                p, x, ds, auxiliary_rows(p, MORE_STAGES, i, _FIRST, row - 1, k), weight, newest
            )
        on = MORE_NODES[i] * ds
        time = here.time + elapsed_time(time_map, s, on)
        there_inside = instant(p, time, z, z_auxiliary, here.modes, here.approaches, here.begins)
        rates_over_s(k, row, there_inside, dt_ds(time_map, s + on), auxiliary)
    for i in range(STATES):
        step = there.clearance_state[i] - y[i]
        k.terms[0, i], k.terms[1, i] = y[i], step
        k.terms[2, i] = ds * k.rates[0, i] - step
        k.terms[3, i] = step - ds * k.rates[COUNT, i] - k.terms[2, i]
    for n in range(4, _TERMS):
        total = weighted_rows(k.rates, INTERPOLANT, n - 4, _FIRST, KEPT)
        for i in range(STATES):
            k.terms[n, i] = ds * total[i]
    if auxiliary:
        for i in range(AUXILIARY_STATES):
            step = there.auxiliary_state[i] - x[i]
            k.auxiliary_terms[0, i], k.auxiliary_terms[1, i] = x[i], step
            k.auxiliary_terms[2, i] = ds * k.auxiliary_rates[0, i] - step
            k.auxiliary_terms[3, i] = (
                step - ds * k.auxiliary_rates[COUNT, i] - k.auxiliary_terms[2, i]
            )
            for n in range(4, _TERMS):
                total = INTERPOLANT[n - 4, 0] * k.auxiliary_rates[0, i]
                for j in range(_FIRST, KEPT):
                    total += INTERPOLANT[n - 4, j] * k.auxiliary_rates[j, i]
                k.auxiliary_terms[n, i] = ds * total
    return _highest_term(p, k) <= _ROUGHEST * tolerance


@inlined
def _highest_term(p, k) -> float:
    """Largest size [m] of the interpolant's term share^4 (1 - share)^3, weighted as in a step's
    error."""
    total = 0.0
    for i in range(STATES):
        weight = VELOCITY_TIME if i >= 4 else 1.0
        total += (weight * k.terms[_TERMS - 1, i]) ** 2
    if p.switches.auxiliary:
        for i in range(AUXILIARY_STATES):
            total += (auxiliary_weight(p, i) * k.auxiliary_terms[_TERMS - 1, i]) ** 2
    return (4.0 / 7.0) ** 4 * (3.0 / 7.0) ** 3 * math.sqrt(total)


@inlined
def _interpolate(terms, share, found) -> None:
    """Evaluate all columns at the `share` of the step into `found`, nested in share and 1 - share
    alternately."""
    rest = 1.0 - share
    for i in range(found.size):
        value = terms[_TERMS - 1, i] * share
        for n in range(_TERMS - 2, 0, -1):
            value = (terms[n, i] + value) * (share if n % 2 == 1 else rest)
        found[i] = terms[0, i] + value


@compiled
def state_inside(p, here, taken, time, smooth, k):
    """State and auxiliary states at the `time` [s] within a step, after `prepare_inside`."""
    time_map, s, ds = taken
    part = ds_for(time_map, s, time - here.time)
    if not smooth:
        y, x, _ = step(p, here, time_map, s, part, k)
        return y, x
    _interpolate(k.terms, part / ds, k.state)
    y = k.state
    y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
    if not p.switches.auxiliary:
        return y, here.auxiliary_state
    _interpolate(k.auxiliary_terms, part / ds, k.auxiliary_state)
    x = k.auxiliary_state
    return y, (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
