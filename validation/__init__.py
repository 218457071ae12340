"""Blind trials: campaigns in which an effect is hidden, the naming of it without the truth at hand,
and the score."""
