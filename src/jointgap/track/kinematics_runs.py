"""Kinematics: how far each source of motion is from the simulation, how far the fits contradict each other."""

from jointgap.tables.kinematics_tables import KINEMATICS_CONTRADICTIONS, KINEMATICS_ERRORS
from jointgap.tables.surrogate_tables import CLEARANCE_FIT, FIT
from jointgap.track.finished_tables import Given
from jointgap.track.run_record import Record


def records(given: Given) -> list[Record]:
    """One run; metrics by source, so that the interface files them under it."""
    if not given.has(KINEMATICS_ERRORS):
        return []
    metrics = {}
    errors = given.read(KINEMATICS_ERRORS)
    for row in errors[errors["region"] == "first_revolution"].to_dict("records"):
        metrics[f"{row['source']}/{row['quantity']}_rms_over_range"] = row["rms_over_range"]
    if given.has(KINEMATICS_CONTRADICTIONS):
        found = given.read(KINEMATICS_CONTRADICTIONS)
        for row in found[found["region"] == "first_revolution"].to_dict("records"):
            key = f"{row['surrogate']} contradicts itself/{row['quantity']}_rms_over_range"
            metrics[key] = row["rms_over_range"]
    fits = given.names(FIT) + given.names(CLEARANCE_FIT)
    results = ["kinematics", "kinematics_errors", "kinematics_contradictions"]
    return [
        Record(
            "kinematics",
            metrics=metrics,
            datasets=given.datasets(["trajectory", *fits], results),
            costs=given.cost("kinematics"),
            **given.configuration("kinematics"),
        )
    ]
