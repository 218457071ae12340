"""Four ways to the best lengths at equal CPU time: frozen motion, networks, surrogate of the error, simulation."""
