"""An unlisted force law of a slider-crank is found as a formula with its size."""

import pytest

from jointgap.core.candidates import runs_of
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.force_law import ForceLawResult, find_force_law
from jointgap.identification.noise import estimate_noise
from jointgap.identification.screening import simulate_sensitivities
from jointgap.identification.thresholds import thresholds
from jointgap.rig.missing_effects import library
from jointgap.rig.model import LinkageModel
from jointgap.rig.simulate_run import augmented_mechanism
from tests.rig.campaigns import law, model_of, with_hidden
from tests.rig.rigs import mechanism, read, rig, worst


def regressed(model: LinkageModel) -> ForceLawResult:
    nominal = {
        run: {p.name: p.nominal for p in model.nuisances if p.run in (None, run)}
        for run in runs_of(model)
    }
    missed = {
        s.key: s.value - model.simulate(s.run, nominal[s.run])[s.channel] for s in model.series
    }
    base = recalibrate(model, estimate_noise(model, missed))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences, candidates=())
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    return find_force_law(
        base.problem,
        base.base,
        library(model.campaign.mechanism, model.context),
        limits,
        base.differences,
    )


def test_a_cubic_resistance_is_found_and_written_to_a_mechanism_file(tmp_path):
    model = model_of(with_hidden(tmp_path, law("-0.1*v^3")))
    result = regressed(model)
    assert result.accepted and not result.rivals, result.because
    assert (result.law.effect, result.law.formula) == ("discovered_slider_force", "c1*v^3")
    assert result.law.coefficients["c1"] == pytest.approx(-0.1, rel=0.05)
    augmented = augmented_mechanism(
        model.campaign.mechanism, result.fit.hypothesis, result.fit.mapping
    )
    assert augmented.effect("discovered_slider_force").coefficients == result.law.coefficients


def test_a_known_formula_remains_when_a_law_is_searched():
    model = rig(mechanism(effects=[law("20*cos(theta)")]))
    cube = next(
        term for term in library(model.campaign.mechanism, model.context) if "v^3" in term.name
    )
    separate = model.simulate("slow", model.nominal("slow"), [(cube, {"coefficient": -0.1})])
    both = rig(mechanism(effects=[law("20*cos(theta) - 0.1*v^3")]))
    assert worst(separate, read(both)) < 1e-9
    augmented = augmented_mechanism(
        model.campaign.mechanism, (cube,), {f"{cube.label}.coefficient": -0.1}
    )
    assert [effect.label for effect in augmented.effects] == ["", "found"]
