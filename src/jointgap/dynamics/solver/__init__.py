"""Integration through events: steps, error control, modes, samples."""
