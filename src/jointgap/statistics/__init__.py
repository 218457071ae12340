"""Statistics of motions over many revolutions: contacts, orbits, sections, periodicity.

They take the tables ``trajectory`` and ``events`` that a simulation leaves, and answer also where a motion is chaotic and its
samples cannot be compared.
"""

from jointgap.statistics.contacts import contacts, joint_revolutions, speed_distribution, time_shares
from jointgap.statistics.cycles import Cycles, cycles
from jointgap.statistics.orbit import clearance_vectors, eccentricity_band, journal_centre
from jointgap.statistics.periodicity import Periodicity, periodicity
from jointgap.statistics.section import poincare_section

__all__ = [
    "Cycles",
    "Periodicity",
    "clearance_vectors",
    "contacts",
    "cycles",
    "eccentricity_band",
    "joint_revolutions",
    "journal_centre",
    "periodicity",
    "poincare_section",
    "speed_distribution",
    "time_shares",
]
