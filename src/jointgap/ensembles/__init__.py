"""Many motions of few designs: ensembles, growth of a small change, statistics over revolutions, the study."""
