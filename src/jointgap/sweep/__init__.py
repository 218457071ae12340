"""Many motions: ensembles, the study of clearance, speed and friction, and statistics over revolutions."""
