"""Networks in the place of the simulation: one function of the crank angle per output.

``network`` (layout, start, scaling, values and derivatives) needs numpy alone, so that the stages which use a fit need
not load torch; ``network_batch``, ``levenberg_marquardt`` and ``train`` make the fits. ``clearance_network`` is the
second surrogate, one consistent set of all outputs; ``crank_speed`` turns derivatives by the crank angle into rates.
"""
