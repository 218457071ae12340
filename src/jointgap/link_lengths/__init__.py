"""The search for link lengths that bring the transmission angle near its ideal: equation (12) and what it is worth."""
