"""The stages on files: each takes what it needs of a case and writes its tables.

Each imports what it needs when it runs: a job that reads data alone does not wait for the compiled dynamics.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import pandas as pd

from jointgap.campaign.clockwise import clockwise, map_as_read, residuals_as_read
from jointgap.campaign.folder import MECHANISM, OF_OUTCOME
from jointgap.campaign.state import Case
from jointgap.config import load_mechanism
from jointgap.tables import OPTIMUM, write_text

if TYPE_CHECKING:
    from jointgap.campaign.tables_of_identification import Outcome

FALSE_ALARM_RATE = 0.01
"""Share of campaigns with nothing hidden in which something is found nevertheless."""

SEED = 0


def measure(case: Case, pictures: bool = True) -> None:
    """Read what was measured and, with `pictures`, look at it."""
    from jointgap.campaign.config_snapshot import stated
    from jointgap.recordings import read_measurements, to_frame

    case.measurements = read_measurements(case.campaign)
    case.folder.write("stated", stated(case.campaign))
    remarks = pd.DataFrame({"remark": pd.Series(case.measurements.remarks, dtype=object)})
    case.folder.write("remarks", remarks)
    case.folder.write("measured", to_frame(case.measurements))
    if pictures:
        from jointgap.figures import style
        from jointgap.recordings.inspection import inspect

        numbers, drawings = inspect(case.campaign, case.measurements)
        case.folder.write("look", numbers)
        for run, drawing in drawings.items():
            style.save(drawing, case.folder.path / "measure" / run)


def preflight(case: Case, advice: bool = True) -> None:
    """Say which effects the campaign can show and tell apart, from its plan alone; with `advice`, what would help most."""
    from jointgap.campaign.preflight import preflight_tables, preflight_tables_with_advice

    planned = preflight_tables_with_advice if advice else preflight_tables
    for name, frame in planned(case.campaign, FALSE_ALARM_RATE).items():
        case.folder.write(name, frame)


def noise(case: Case) -> None:
    """Find the noise of every series."""
    from jointgap.campaign.tables_of_identification import noise_to_frames
    from jointgap.identification.noise_model import noise_of_model

    case.noise = noise_of_model(case.model)
    case.folder.write_all(noise_to_frames(case.noise), "noise")


def recalibrate(case: Case) -> None:
    """Fit the nuisances within their ranges, and count in what other numerics would predict."""
    from jointgap.campaign.tables_of_identification import fits_to_frames, noise_to_frames
    from jointgap.identification.baseline import recalibrate as recalibrated
    from jointgap.identification.noise_model import numerics_noise

    found = case.recalibrated = recalibrated(case.model, case.noise)
    whole = numerics_noise(case.model, found.base.mapping, case.noise)  # of held-out runs too
    case.whole_noise = whole | {part.series.key: part.noise for part in found.problem.parts}
    case.folder.write_all(noise_to_frames(case.whole_noise), "recalibrate")
    for which, fit in (("nominal", found.nominal), ("base", found.base)):
        case.folder.write_all(fits_to_frames([fit], whole_jacobian=True), f"recalibrate/{which}")


def screen(case: Case) -> None:
    """Simulate every candidate at a small size, and choose what is worth a fit."""
    from jointgap.campaign.tables_of_identification import screened_frame, signatures_to_frames
    from jointgap.identification.model_selection import shortlist_singles
    from jointgap.identification.noise_model import degrees_of_freedom
    from jointgap.identification.thresholds import screen_candidates

    dof = degrees_of_freedom(case.noise)
    known, limits = case.screening = screen_candidates(case.recalibrated, FALSE_ALARM_RATE, dof, SEED)
    case.folder.write_all(signatures_to_frames(known), "screen")
    case.folder.write("thresholds", pd.DataFrame([vars(limits)]))
    case.folder.write("screened", screened_frame(known, shortlist_singles(known, limits)))


def fit(case: Case, part: int = 0, parts: int = 1) -> None:
    """Fit one part of the chosen single effects by forward simulation."""
    from jointgap.campaign.tables_of_identification import fits_to_frames
    from jointgap.identification import hypothesis_fits

    screened = case.screening
    found, seconds = hypothesis_fits.fit_singles(case.recalibrated, screened.known, screened.limits, part, parts)
    case.folder.write_all(fits_to_frames(found, seconds, whole_jacobian=True), f"fit/{part}")


def pair(case: Case, part: int = 0, parts: int = 1) -> None:
    """Fit one part of the pairs that are worth it beside the single effects, which as many parts have fitted.

    Where none of these is enough the first part takes a second look at them all.
    """
    from jointgap.campaign.tables_of_identification import fits_to_frames
    from jointgap.identification import hypothesis_fits

    screened, (alone, _) = case.screening, case.fits("fit", parts)
    found, seconds = hypothesis_fits.fit_pairs(case.recalibrated, screened.known, screened.limits, alone, part, parts)
    case.folder.write_all(fits_to_frames(found, seconds, whole_jacobian=True), f"pair/{part}")


def decide(case: Case, parts: int = 1) -> None:
    """Choose among the fits of all parts."""
    from jointgap.campaign.tables_of_identification import fits_to_frames, outcome_of
    from jointgap.identification.model_selection import select_hypothesis

    (singles, seconds), (doubles, more) = (case.fits(stage, parts) for stage in ("fit", "pair"))
    decision = select_hypothesis(case.recalibrated, case.screening.known, [*singles, *doubles], case.screening.limits)
    case.settled = replace(case.recalibrated, base=decision.base)
    case.folder.write_all(fits_to_frames([decision.base], whole_jacobian=True), "decide/base")
    durations = {label: seconds.get(label, 0.0) + more.get(label, 0.0) for label in seconds | more}
    _settled(case, outcome_of(decision, durations), "decide")


def locate(case: Case) -> None:
    """Map where the base that the verdict rests on disagrees with the measurement."""
    from jointgap.identification.disagreement import map_disagreement

    found = map_disagreement(case.settled.problem, case.settled.base.residual, FALSE_ALARM_RATE)
    for name in ("bins", "windows"):
        case.folder.write(f"map_{name}", map_as_read(getattr(found, name), clockwise(case.campaign)))
    for name in ("tests", "orders", "scaling"):
        case.folder.write(f"map_{name}", getattr(found, name))


def regress(case: Case) -> None:
    """Look for a force law where no effect of the list explains what is missing."""
    from jointgap.campaign.tables_of_identification import outcome_with_law
    from jointgap.identification import force_law
    from jointgap.identification.decision import UNEXPLAINED

    if case.folder.read("decision", "decide")["verdict"].iloc[0] != UNEXPLAINED:
        case.folder.write_all(case.folder.read_all(OF_OUTCOME, "decide"), "regress")
        return
    base = case.settled
    proposed = force_law.regress(base.problem, base.base, case.library, case.screening.limits, base.differences)
    _settled(case, outcome_with_law(case.outcome("decide"), proposed), "regress")


def _settled(case: Case, outcome: "Outcome", stage: str) -> None:
    from jointgap.campaign.tables_of_identification import fits_to_frames, parameter_frame

    named = outcome.verdict.startswith("named")
    parameters = parameter_frame([outcome.chosen, *outcome.equivalent], clockwise(case.campaign))
    kept = [outcome.chosen] if named else outcome.equivalent
    case.folder.write_all(fits_to_frames(kept), stage)
    case.folder.write("fit_parameters", parameters, stage)
    case.folder.write("ranking", outcome.ranking, stage)
    case.folder.write("decision", outcome.frame(), stage)


def confirm(case: Case) -> None:
    """Predict held-out runs with and without the effects of the verdict."""
    from jointgap.identification import confirmation

    outcome = case.outcome("regress")
    named = outcome.chosen if outcome.chosen.hypothesis else None
    plain = outcome.base if named else outcome.chosen  # nominal values where these are enough
    found = confirmation.confirm(case.model, case.whole_noise, plain, named, SEED)
    case.folder.write("residuals", residuals_as_read(found.residuals, clockwise(case.campaign)))
    case.folder.write("gaps", found.gaps)


def augment(case: Case) -> None:
    """Write the mechanism with the effects of the verdict, and the force that they add."""
    from jointgap.campaign.augment import augment as augmented

    text, force = augmented(case.campaign, case.outcome("regress"))
    write_text(case.folder.path / MECHANISM, text)
    case.folder.write("missing_force", force)


def rechain(case: Case) -> None:
    """Optimise the link lengths again, before and after, at the speed of the fastest run for fitting.

    Where nothing was added to the model, or no joint is loose, there is nothing to compare, and the table has no row.
    """
    written = load_mechanism(case.folder.path / MECHANISM)
    # the transmission angle of ideal joints follows from the lengths alone, whatever acts on the slider
    loose = case.campaign.mechanism.applied().loose or written.applied().loose
    outcome = case.outcome("regress") if loose else None
    if outcome is None or all(candidate.sensor for candidate in outcome.chosen.hypothesis):
        case.folder.write("campaign_optimum", pd.DataFrame(columns=[column.name for column in OPTIMUM.columns]))
        return
    from jointgap.campaign.augment import mechanisms
    from jointgap.campaign.reoptimise import rechain as chained
    from jointgap.slider_crank.modified_mechanism import mirrored

    models = dict(zip(("base", "augmented"), mechanisms(case.campaign, outcome), strict=True))
    fastest = max((run for run in case.campaign.runs if run.role != "confirm"), key=lambda run: run.speed)
    if fastest.direction == "clockwise":
        models = {name: mirrored(one.applied()) for name, one in models.items()}
    case.folder.write("campaign_optimum", chained(models, fastest.speed))


def conclude(case: Case) -> None:
    """Write the verdict, the summary and the figures."""
    from jointgap.campaign import conclude as concluding

    concluding.conclude(case)
    concluding.show(case)
