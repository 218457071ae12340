"""Which channels still contradict others once the faults of sensors that a fit holds are taken out of what was read."""

from collections.abc import Sequence

from jointgap.identification.fit import Fit
from jointgap.identification.problem import values_in_run
from jointgap.recordings import Measurements
from jointgap.recordings.contradictions import OF_SAMPLES, contradictions
from jointgap.slider_crank.model import SliderCrankModel
from jointgap.slider_crank.sensor_faults import Faults


def remaining_doubts(
    model: SliderCrankModel, measurements: Measurements, explanations: Sequence[Fit]
) -> tuple[str, ...]:
    """Channels whose readings contradict others' with at least one of several explanations."""
    return tuple(dict.fromkeys(channel for fit in explanations for channel in _left(model, measurements, fit)))


def _left(model: SliderCrankModel, measurements: Measurements, fit: Fit) -> list[str]:
    """Channels in doubt once the faults of a fit are taken out; a run with a fault of its own that is not fitted, such
    as the zero of an encoder in a held-out run, is left out.
    """
    corrected, erring = {}, False
    sensors = tuple(candidate for candidate in fit.hypothesis if candidate.sensor)
    for run in model.plans:
        recording = measurements.runs[run]
        own = [p.key for p in model.nuisances if p.run == run and p.name in Faults.NUISANCES]
        own += [f"{candidate.label}.{p.key}" for candidate in sensors for p in candidate.coordinates if p.run == run]
        if any(key not in fit.mapping for key in own):
            continue
        nuisances, effects = values_in_run(model, run, fit.mapping, sensors)
        faults = Faults(effects, model.plans[run].run.direction == "clockwise", nuisances)
        corrected[run] = faults.taken_out(recording)
        erring |= bool(faults)
    if not erring:
        return [found.channel for found in measurements.contradictions if found.doubtful]
    # what is clipped or stuck cannot be undone: there any fault of that sensor counts
    sites = {candidate.site for candidate in sensors}
    lost = [one for one in measurements.contradictions if one.kind in OF_SAMPLES and one.channel not in sites]
    left = contradictions(model.campaign, corrected, model.settings.recordings)
    return [one.channel for one in (*lost, *left) if one.doubtful]
