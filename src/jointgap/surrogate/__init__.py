"""Networks in the place of the simulation: one function of the crank angle per output.

``network`` (layout, start, scaling) and ``evaluate`` (values and derivatives) need numpy alone, so that the stages
which use a fit need not load torch; ``model``, ``levenberg_marquardt`` and ``train`` make the fits. ``clearance`` is
the second surrogate, one consistent set of all outputs; ``speed`` turns derivatives by the crank angle into rates.
"""
