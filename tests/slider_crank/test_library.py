"""A force law that is on no list is found on a slider-crank, as a formula with its size."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config import Simulate, load_mechanism
from jointgap.config.load import load_campaign
from jointgap.core.candidates import runs_of
from jointgap.core.formula import compile_formula
from jointgap.dynamics.simulation import simulate
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.force_law import ForceLawResult, effect_of, find_force_law, term_of
from jointgap.identification.noise import estimate_noise
from jointgap.identification.screening import simulate_sensitivities
from jointgap.identification.thresholds import thresholds
from jointgap.rig.model import SliderCrankModel, build_model, library
from jointgap.rig.read_files import read_measurements
from jointgap.rig.simulate_run import augmented_mechanism

MECHANISM = {
    "crank": {"length": 0.15, "mass": 0.3704, "inertia": 1.458e-3, "mass_centre": 0.075},
    "rod": {"length": 0.564, "mass": 0.773, "inertia": 2.482e-2, "mass_centre": 0.282},
    "slider": {"mass": 0.4482},
    "joints": {"crank_pin": "ideal", "piston_pin": "ideal"},
}
SPEEDS = {"slow": 200.0, "mid": 350.0, "fast": 500.0}  # rpm
CHANNELS = ("slider_acceleration", "crank_torque")
NOISE = 0.02  # of a channel's own standard deviation


def measured(folder: Path, formula: str) -> SliderCrankModel:
    """The ideal slider-crank without effects, and data of one on whose slider the force `formula` acts."""
    hidden = {"name": "discovered_slider_force", "parameters": {"formula": formula}}
    loaded = load_campaign(written_campaign(folder, hidden))
    return build_model(loaded, read_measurements(loaded))


def written_campaign(folder: Path, hidden: dict) -> Path:
    """The campaign file of the ideal slider-crank without effects, beside data of one with the effect `hidden`."""
    (folder / "base.yaml").write_text(yaml.safe_dump(MECHANISM))
    (folder / "true.yaml").write_text(yaml.safe_dump({**MECHANISM, "effects": [hidden]}))
    truth, rng, runs = load_mechanism(folder / "true.yaml"), np.random.default_rng(5), []
    for run, rpm in SPEEDS.items():
        options = Simulate(speed=rpm * np.pi / 30, revolutions=5, samples_per_revolution=72)
        seen = simulate(truth, options).samples.iloc[2 * 72 :]
        table = pd.DataFrame({"t": seen["time"] - seen["time"].iloc[0], "angle": seen["crank_angle"]})
        for channel in CHANNELS:
            clean = seen[channel]
            table[channel] = clean + NOISE * clean.std() * rng.standard_normal(clean.size)
        table.to_csv(folder / f"{run}.csv", index=False)
        role = "confirm" if run == "fast" else "identify"
        runs.append({"id": run, "file": f"{run}.csv", "speed": f"{rpm} rpm", "role": role})
    units = {"slider_acceleration": "m/s^2", "crank_torque": "N*m"}
    channels = {channel: {"column": channel, "unit": units[channel]} for channel in CHANNELS}
    channels |= {"time": {"column": "t", "unit": "s"}, "crank_angle": {"column": "angle", "unit": "rad"}}
    campaign = {
        "name": "hidden-law",
        "mechanism": "base.yaml",
        "drive": "constant_speed",
        "runs": runs,
        "channels": channels,
        "nuisance": {"slider_mass": "5%"},
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    return folder / "campaign.yaml"


def regressed(model: SliderCrankModel) -> ForceLawResult:
    nominal = {run: {p.name: p.nominal for p in model.nuisances if p.run in (None, run)} for run in runs_of(model)}
    missed = {s.key: s.value - model.simulate(s.run, nominal[s.run])[s.channel] for s in model.series}
    base = recalibrate(model, estimate_noise(model, missed))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences, candidates=())
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    return find_force_law(base.problem, base.base, library(model), limits, base.differences)


def test_a_cubic_resistance_is_found_with_its_size_and_goes_into_a_mechanism_file(tmp_path):
    model = measured(tmp_path, "-0.1*v^3")
    found = regressed(model)
    assert found.accepted, found.because
    assert not found.rivals
    assert (found.law.effect, found.law.formula) == ("discovered_slider_force", "c1*v^3")
    assert found.law.coefficients["c1"] == pytest.approx(-0.1, rel=0.05)
    augmented = augmented_mechanism(model.campaign.mechanism, found.fit.hypothesis, found.fit.mapping)
    law = augmented.effect("discovered_slider_force")
    assert list(law.coefficients.values()) == [found.law.coefficients["c1"]]


def test_a_stiffening_spring_and_a_friction_that_grows_along_the_slide_are_found_together(tmp_path):
    found = regressed(measured(tmp_path, "-900*(x - 0.564)^3 - 20*v*(x - 0.564)"))
    assert found.accepted, found.because
    assert set(found.law.terms.values()) == {"(x - 0.564)^3", "(x - 0.564)*v"}
    x, v = 0.564 + 0.15 * np.cos(np.linspace(0, 6, 50)), 5.0 * np.sin(np.linspace(0, 6, 50))
    true = -900 * (x - 0.564) ** 3 - 20 * v * (x - 0.564)
    value = {"(x - 0.564)^3": (x - 0.564) ** 3, "(x - 0.564)*v": (x - 0.564) * v}
    law = sum(found.law.coefficients[name] * value[term] for name, term in found.law.terms.items())
    assert np.sqrt(np.mean((law - true) ** 2) / np.mean(true**2)) < 0.1


def test_every_term_of_the_library_is_a_formula_and_changes_a_channel_at_its_step(tmp_path):
    model = measured(tmp_path, "0")
    at = {p.name: p.nominal for p in model.nuisances if p.run in (None, "mid")}
    base = model.simulate("mid", at)
    terms = library(model)
    assert len({term.label for term in terms}) == len(terms)
    for term in terms:
        assert effect_of(term) in ("discovered_slider_force", "discovered_crank_torque")
        assert len(compile_formula(term_of(term), {}).codes)
        changed = model.simulate("mid", at, [(term, {"coefficient": term.coordinates[0].step})])
        assert max(np.abs(changed[channel] - base[channel]).max() for channel in CHANNELS) > 1e-6
