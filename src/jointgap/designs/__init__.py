"""Parameter sweeps and the studies of their designs."""
