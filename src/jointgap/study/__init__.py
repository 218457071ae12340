"""The study: what clearance, speed and friction do to a mechanism.

`points` simulates the map, `jointgap.study.figures` draws it, `jointgap.study.summary` says it in words.
"""

from jointgap.study.points import joined, points

__all__ = ["joined", "points"]
