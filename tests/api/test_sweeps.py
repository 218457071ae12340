"""`jg.sweep`: designs on disk, read as one table, drawn over their parameters."""

import pandas as pd
import pytest

import jointgap as jg

OPTIONS = jg.Simulate(revolutions=1, samples_per_revolution=360, tolerance="1e-8 m")
RANGES = {
    "clearance": {"from": "0.2 mm", "to": "1 mm"},
    "mechanism.joints.crank_pin.journal": ["crank", "rod"],
}


@pytest.fixture(scope="module")
def mechanism():
    return jg.load_mechanism("erkaya2009")


@pytest.fixture(scope="module")
def swept(mechanism, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return jg.sweep(mechanism, OPTIONS, folder=folder, parameters=RANGES, number=8, designs_per_job=5, workers=1)


def test_a_sweep_is_a_dataset_on_disk_with_units(swept):
    assert [path.name for path in sorted(swept.dataset.iterdir())] == ["part_000000.parquet", "part_000001.parquet"]
    pd.testing.assert_frame_equal(swept.designs, pd.read_parquet(swept.dataset))
    assert swept.designs.attrs["units"]["clearance"] == "m"
    assert swept.designs["clearance"].between(2e-4, 1e-3).all()
    assert "8 designs" in (swept.folder / "summary.md").read_text()


def test_a_design_is_measured_as_simulated_alone(mechanism, swept):
    row = swept.designs.iloc[3]
    alone = jg.change(mechanism, {"joints.crank_pin.journal": row["mechanism.joints.crank_pin.journal"]})
    for pin in ("crank_pin", "piston_pin"):
        radius = alone.joint(pin).journal_radius + row["clearance"]
        alone = jg.change(alone, {f"joints.{pin}.bearing_radius": radius})
    assert jg.simulate(alone, OPTIONS).steps == row["steps"]


def test_columns_are_read_one_by_one_and_a_wrong_name_is_told(swept):
    forces = swept.read("clearance", "crank_pin_peak_force")
    assert forces.shape == (8, 2)
    assert forces.attrs["units"] == {"clearance": "m", "crank_pin_peak_force": "N"}
    with pytest.raises(jg.InputError, match="read: no column 'clearence'; did you mean 'clearance'"):
        swept.read("clearence")


def test_a_sweep_shows_itself_in_numbers_and_figures(swept):
    rows = swept.summary().set_index("quantity")
    assert rows.loc["designs", "value"] == 8
    assert rows.loc["stroke", "unit"] == "mm"
    assert "<td style='text-align:left'>stroke</td>" in swept._repr_html_()
    drawn = swept.plot("crank_pin_peak_force").data
    assert set(drawn["x_quantity"]) == {"clearance", "crank pin journal"}
    assert sorted(drawn.query("series == 'design'")["y"].unique()) == sorted(swept.designs["crank_pin_peak_force"])


def test_a_sweep_that_is_asked_for_again_is_read_and_a_wrong_key_is_told(mechanism, swept, monkeypatch):
    monkeypatch.setattr("jointgap.designs.run.simulate_designs", None)
    again = jg.sweep(mechanism, OPTIONS, folder=swept.folder, parameters=RANGES, number=8, designs_per_job=5)
    pd.testing.assert_frame_equal(again.designs, swept.designs)
    with pytest.raises(jg.InputError, match="sweep: number = 0: must be greater than or equal to 1"):
        jg.sweep(mechanism, OPTIONS, folder=swept.folder, parameters=RANGES, number=0)
    with pytest.raises(jg.InputError, match=r"parameters\.clearence: no such word; did you mean 'clearance'"):
        jg.sweep(mechanism, OPTIONS, folder=swept.folder, parameters={"clearence": [1e-3]})


def test_a_sweep_of_which_every_design_failed_says_so_in_place_of_a_figure(mechanism, tmp_path):
    failed = jg.sweep(
        mechanism, OPTIONS, folder=tmp_path, parameters={"simulate.tolerance": [1e-30, 2e-30]}, number=2, workers=1
    )
    assert failed.remarks
    with pytest.raises(jg.InputError, match="nothing to draw"):
        failed.plot()


@pytest.mark.parametrize("parameters", [["friction"], None])
def test_parameters_that_are_no_mapping_are_told(mechanism, tmp_path, parameters):
    with pytest.raises(jg.InputError, match=r"sweep.*parameters"):
        jg.sweep(mechanism, OPTIONS, folder=tmp_path, parameters=parameters)
