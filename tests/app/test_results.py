"""Results of the calls in Python: units, tables and figures."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import jointgap as jg
from jointgap.core import parquet, schema
from jointgap.motion.slider_crank import simulate
from tests.campaign.verdicts import VERDICTS

OPTIONS = jg.Simulate(revolutions=1, samples_per_revolution=360, tolerance="1e-10 m")
BOX = {"crank_length": ("149 mm", "151 mm"), "rod_length": ("560 mm", "566 mm")}


@pytest.fixture(scope="module")
def mechanism():
    return jg.load_mechanism("config/mechanisms/erkaya2009.yaml")


@pytest.fixture(scope="module")
def ideal(mechanism):
    return jg.change(mechanism, {"joints.crank_pin": "ideal", "joints.piston_pin": "ideal"})


@pytest.fixture(scope="module")
def run(mechanism):
    return jg.simulate(mechanism, OPTIONS)


def test_a_motion_is_that_of_the_stage_simulate_and_keys_override_options(mechanism, run):
    samples = simulate(mechanism, OPTIONS).samples
    pd.testing.assert_frame_equal(run.samples, samples, check_exact=True)
    slower = jg.simulate(mechanism, OPTIONS, speed="300 rpm")
    assert slower.options == jg.change(OPTIONS, {"speed": "300 rpm"})


def test_a_wrong_argument_is_an_error(mechanism, run):
    with pytest.raises(jg.InputError, match="Simulate: unknown key 'sped'; did you mean 'speed'"):
        jg.simulate(mechanism, sped="600 rpm")
    with pytest.raises(jg.InputError, match="mechanism: is text, not a Mechanism; load one with"):
        jg.simulate("mine.yaml")
    with pytest.raises(jg.InputError, match="no column 'crank_angel'; did you mean 'crank_angle'"):
        run.unit("crank_angel")


def test_a_summary_has_values_with_units(run):
    assert (run.unit("crank_angle"), run.unit("peak_force")) == ("rad", "N")
    assert run.samples.query("crank_angle > 1").attrs["units"]["r2"] == "m"
    rows = run.summary().set_index("quantity")
    assert rows.loc["speed of the crank"].tolist() == [pytest.approx(600.0), "rpm"]
    assert rows.loc["crank pin: radial clearance"].tolist() == [pytest.approx(1.0), "mm"]
    begun = run.events.query("joint == 'crank_pin' and event == 'impact'")
    assert rows.loc["crank pin: impacts (beginnings of contact)", "value"] == len(begun)
    largest = rows.loc["crank pin: largest force, including the start", "value"]
    assert largest >= run.events.query("joint == 'crank_pin'")["peak_force"].max() > 1000.0
    assert "<td style='text-align:left'>crank pin: radial clearance</td>" in run._repr_html_()
    assert "Remark: Contact of the crank pin and piston pin: you asked for a restitution" in repr(
        run
    )


def test_a_motion_has_figures_that_a_notebook_shows(run, ideal, tmp_path):
    picture = run.plot("piston_acceleration")
    assert list(picture._repr_mimebundle_()[0]) == ["image/png"]
    with Image.open(picture.save(tmp_path / "piston.png")) as written:
        assert written.width > 1000
    firsts = [next(iter(one.figures)) for one in (run, jg.simulate(ideal, OPTIONS))]
    assert firsts == ["orbits", "drive_and_guide"]  # ideal joints have no orbits
    with pytest.raises(jg.InputError, match="no figure 'orbit' of this Motion; did you mean"):
        run.plot("orbit")
    with pytest.raises(jg.InputError, match=r"no figure format '\.doc'; use \.png"):
        picture.save(tmp_path / "piston.doc")


def test_an_optimum_is_within_its_box_and_has_the_re_simulated_gain(mechanism, ideal):
    ensemble = {"members": 2, "settled_revolution": 1}
    genetic = {"population": 4, "generations": 2}
    best = jg.optimise(mechanism, OPTIONS, boxes={"near": BOX}, genetic=genetic, ensemble=ensemble)
    crank, rod = best.lengths
    assert 0.149 - 1e-9 <= crank <= 0.151 + 1e-9 and 0.560 - 1e-9 <= rod <= 0.566 + 1e-9
    assert (best.mechanism.crank.length, best.mechanism.rod.length) == pytest.approx(best.lengths)
    rows = best.tables["resimulated"].query("stretch == 'settled' and measure == 'rms'")
    assert best.gain in rows["reduction"].to_numpy()
    assert best.tables["worth"].attrs["units"]["stroke"] == "m"
    assert best.summary().set_index("quantity").loc["rod length", "value"] == pytest.approx(
        1e3 * rod
    )
    assert set(best.plot("valley").data["series"]) >= {
        "local paths",
        "valley's floor",
    }  # without networks
    settings = {"boxes": {"near": BOX}, "ensemble": {"settled_revolution": 1}}
    with pytest.raises(jg.InputError, match="optimise: all joints are ideal"):
        jg.optimise(ideal, OPTIONS, **settings)
    with pytest.raises(jg.InputError, match="Optimise: unknown key 'boxs'; did you mean 'boxes'"):
        jg.optimise(mechanism, OPTIONS, boxs={})
    with pytest.raises(jg.InputError, match="Simulate: speed = 'fast'"):
        jg.optimise(mechanism, OPTIONS, speed="fast")


def test_a_verdict_has_effect_size_interval_and_figures(tmp_path, mechanism):
    def verdict(kind):
        (tmp_path / "verdict.json").write_text(json.dumps(VERDICTS[kind] | {"because": ""}))
        shutil.copy("config/mechanisms/erkaya2009.yaml", tmp_path / "mechanism.yaml")
        parquet.write(
            schema.REMARKS,
            pd.DataFrame({"remark": ["channel x: nothing"]}),
            tmp_path / schema.REMARKS.path,
        )
        return jg.read_verdict(tmp_path)

    named = verdict("named")
    assert (named.kind, named.effect) == ("named", "Coulomb friction of the slider")
    assert (named.size, named.unit, named.interval) == (
        21.3,
        "N",
        (20.6, 22.0),
    ) and named.mechanism == mechanism
    assert "The model lacks Coulomb friction of the slider." in named._repr_html_()
    assert "Remark: channel x: nothing" in repr(named)
    assert "gaps" in named.figures and named.plot("gaps").figure.axes
    ambiguous = verdict("ambiguous")
    assert (ambiguous.effect, ambiguous.size, ambiguous.interval) == (None, None, None)
    rows = [row for row in ambiguous.summary()["quantity"] if row.startswith("explanation")]
    assert rows == ["explanation 1", "explanation 2"]


def test_a_preflight_lists_detectable_sizes():
    plan = jg.preflight("config/campaigns/demonstration.yaml", advice=False)
    assert plan.advice is None and "Coulomb friction of the slider: " in plan.text
    value = plan.summary().set_index("quantity").loc["Coulomb friction of the slider", "value"]
    assert value.startswith("shows from 0.1") and np.isfinite(plan.plot().data["x"]).any()


def test_a_folder_must_contain_one_campaign_file(tmp_path):
    with pytest.raises(jg.InputError, match="no campaign file"):
        jg.preflight(tmp_path)
    with pytest.raises(jg.InputError, match="several campaign files"):
        jg.preflight("config/campaigns")
