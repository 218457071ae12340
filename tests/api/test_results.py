"""Results of the calls in Python: as the stages have them, with units, tables and figures."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import jointgap as jg
from jointgap.core import parquet, schema
from jointgap.dynamics.simulation import simulate
from tests.campaign.verdicts import VERDICTS

OPTIONS = jg.Simulate(revolutions=1, samples_per_revolution=360, tolerance="1e-10 m")
BOX = {"crank_length": ("149 mm", "151 mm"), "rod_length": ("560 mm", "566 mm")}


@pytest.fixture(scope="module")
def mechanism():
    return jg.load_mechanism("config/mechanisms/erkaya2009.yaml")


@pytest.fixture(scope="module")
def run(mechanism):
    return jg.simulate(mechanism, OPTIONS)


@pytest.fixture(scope="module")
def best(mechanism):
    ensemble = {"members": 2, "settled_revolution": 1}
    return jg.optimise(
        mechanism,
        OPTIONS,
        boxes={"near": BOX},
        genetic={"population": 4, "generations": 2, "elites": 1},
        ensemble=ensemble,
    )


def test_a_motion_is_that_of_the_stage_simulate(mechanism, run):
    pd.testing.assert_frame_equal(run.samples, simulate(mechanism, OPTIONS).samples, check_exact=True)


def test_keys_are_those_of_a_file_and_go_over_options(mechanism, run):
    by_keys = jg.simulate(mechanism, speed="600 rpm", revolutions=1, samples_per_revolution=360, tolerance="1e-10 m")
    assert by_keys.options == OPTIONS
    assert jg.simulate(mechanism, OPTIONS, speed="300 rpm").options == jg.change(OPTIONS, {"speed": "300 rpm"})
    with pytest.raises(jg.InputError, match="Simulate: unknown key 'sped'; did you mean 'speed'"):
        jg.simulate(mechanism, sped="600 rpm")
    with pytest.raises(jg.InputError, match="mechanism: is text, no Mechanism; load one with load_mechanism"):
        jg.simulate("mine.yaml")


def test_columns_keep_their_units(run):
    assert (run.unit("crank_angle"), run.unit("peak_force")) == ("rad", "N")
    assert run.samples.query("crank_angle > 1").attrs["units"]["r2"] == "m"
    with pytest.raises(jg.InputError, match="no column 'crank_angel'; did you mean 'crank_angle'"):
        run.unit("crank_angel")


def test_a_summary_says_what_happened_with_units(run):
    rows = run.summary().set_index("quantity")
    assert rows.loc["speed of the crank"].tolist() == [pytest.approx(600.0), "rpm"]
    assert rows.loc["crank pin: radial clearance"].tolist() == [pytest.approx(1.0), "mm"]
    begun = run.events.query("joint == 'crank_pin' and event == 'impact'")
    assert rows.loc["crank pin: impacts (contacts that begin)", "value"] == len(begun)
    largest = rows.loc["crank pin: largest force, the start included", "value"]
    assert largest >= run.events.query("joint == 'crank_pin'")["peak_force"].max() > 1000.0
    assert "<td style='text-align:left'>crank pin: radial clearance</td>" in run._repr_html_()
    assert "Remark: Contact of the crank pin and piston pin: lankarani_nikravesh delivers" in repr(run)


def test_a_motion_draws_itself_and_a_notebook_shows_it(run, tmp_path):
    picture = run.plot("piston_acceleration")
    kinds, _ = picture._repr_mimebundle_()
    assert list(kinds) == ["image/png"]
    with Image.open(picture.save(tmp_path / "piston.png")) as written:
        assert written.width > 1000
    assert next(iter(run.figures)) == "orbits"
    with pytest.raises(jg.InputError, match="plot: no figure 'orbit' of this Motion; did you mean"):
        run.plot("orbit")
    with pytest.raises(jg.InputError, match=r"figures are not written as '\.doc'; end the name in \.png or \.svg"):
        picture.save(tmp_path / "piston.doc")


def test_ideal_joints_have_no_orbits_to_draw(mechanism):
    ideal = jg.simulate(jg.change(mechanism, {"joints.crank_pin": "ideal", "joints.piston_pin": "ideal"}), OPTIONS)
    assert next(iter(ideal.figures)) == "drive_and_guide"
    assert "orbits" not in ideal.figures


def test_an_ensemble_is_on_disk_and_read_with_units(mechanism, tmp_path):
    sweep = jg.ensemble(mechanism, OPTIONS, folder=tmp_path, vary={"clearance": ["0.5 mm", "1 mm"]}, members=1)
    assert sweep.runs["clearance"].tolist() == [0.0005, 0.001]
    assert sweep.runs.attrs["units"]["clearance"] == "m"
    assert sweep.samples.groupby("run").size().tolist() == [361, 361]
    with pytest.raises(jg.InputError, match=r"ensemble\.vary\.clearence: no such word; did you mean 'clearance'"):
        jg.ensemble(mechanism, OPTIONS, folder=tmp_path, vary={"clearence": [1e-3]})


def test_an_optimum_has_its_lengths_within_the_box_and_its_gain_as_simulated_again(mechanism, best):
    crank, rod = best.lengths
    assert 0.149 - 1e-9 <= crank <= 0.151 + 1e-9
    assert 0.560 - 1e-9 <= rod <= 0.566 + 1e-9
    assert (best.mechanism.crank.length, best.mechanism.rod.length) == pytest.approx(best.lengths)
    rows = best.tables["resimulated"].query("stretch == 'settled' and measure == 'rms'")
    assert best.gain in rows["reduction"].to_numpy()
    assert best.tables["worth"].attrs["units"]["stroke"] == "m"
    assert best.summary().set_index("quantity").loc["rod length", "value"] == pytest.approx(1e3 * rod)


def test_an_optimum_draws_its_valley_without_networks(best):
    assert set(best.plot("valley").data["series"]) >= {"local paths", "valley's floor"}


def test_nothing_is_searched_where_nothing_is_loose_or_a_key_is_unknown(mechanism):
    ideal = jg.change(mechanism, {"joints.crank_pin": "ideal", "joints.piston_pin": "ideal"})
    with pytest.raises(jg.InputError, match="optimise: all joints are ideal"):
        jg.optimise(ideal, OPTIONS, boxes={"near": BOX}, ensemble={"settled_revolution": 1})
    with pytest.raises(jg.InputError, match="Optimise: unknown key 'boxs'; did you mean 'boxes'"):
        jg.optimise(mechanism, OPTIONS, boxs={})


def results(folder, kind):
    """A folder with the verdict of a `kind` and what an analysis writes beside it."""
    document = VERDICTS[kind] | {"because": ""}
    (folder / "verdict.json").write_text(json.dumps(document))
    shutil.copy("config/mechanisms/erkaya2009.yaml", folder / "mechanism.yaml")
    remarks = pd.DataFrame({"remark": ["channel x: nothing"]})
    parquet.write(schema.REMARKS, remarks, folder / schema.REMARKS.path)
    return folder


def test_a_verdict_says_effect_size_and_interval(tmp_path):
    verdict = jg.read_verdict(results(tmp_path, "named"))
    assert (verdict.kind, verdict.effect) == ("named", "Coulomb friction of the slider")
    assert (verdict.size, verdict.unit, verdict.interval) == (21.3, "N", (20.6, 22.0))
    assert verdict.mechanism == jg.load_mechanism("config/mechanisms/erkaya2009.yaml")
    assert "Missing in the model is Coulomb friction of the slider." in verdict._repr_html_()
    assert "Remark: channel x: nothing" in repr(verdict)


def test_a_verdict_that_names_nothing_has_no_effect(tmp_path):
    verdict = jg.read_verdict(results(tmp_path, "ambiguous"))
    assert (verdict.effect, verdict.size, verdict.interval) == (None, None, None)
    assert [row for row in verdict.summary()["quantity"] if row.startswith("explanation")] == [
        "explanation 1",
        "explanation 2",
    ]


def test_a_verdict_draws_what_its_folder_has(tmp_path):
    verdict = jg.read_verdict(results(tmp_path, "named"))
    assert "gaps" in verdict.figures
    assert len(verdict.plot("gaps").figure.texts) + len(verdict.plot("gaps").figure.axes) > 0


def test_the_campaign_of_a_folder_is_the_only_one_in_it(tmp_path):
    with pytest.raises(jg.InputError, match="holds no campaign file"):
        jg.preflight(tmp_path)
    with pytest.raises(jg.InputError, match="holds several campaign files"):
        jg.preflight("config/campaigns")


def test_a_preflight_says_what_shows_and_what_looks_alike():
    plan = jg.preflight("config/campaigns/demonstration.yaml", advice=False)
    assert plan.advice is None
    assert "Coulomb friction of the slider: " in plan.text
    rows = plan.summary()
    assert rows.set_index("quantity").loc["Coulomb friction of the slider", "value"].startswith("shows from 0.1")
    assert np.isfinite(plan.plot().data["x"]).any()
