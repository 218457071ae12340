"""`jg.sweep`: a dataset of designs on disk, its summary and figures."""

import numpy as np
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
def sweep(mechanism, tmp_path_factory):
    """A function that runs a small sweep, with other arguments if given."""
    folder = tmp_path_factory.mktemp("sweep")
    arguments = {"folder": folder, "parameters": RANGES, "number": 8, "designs_per_job": 5}
    return lambda **over: jg.sweep(mechanism, OPTIONS, **arguments | {"workers": 1} | over)


@pytest.fixture(scope="module")
def swept(sweep):
    return sweep()


def test_a_sweep_is_a_dataset_with_units_of_designs_as_simulated_alone(mechanism, swept):
    assert [path.name for path in sorted(swept.dataset.iterdir())] == [
        "part_000000.parquet",
        "part_000001.parquet",
    ]
    pd.testing.assert_frame_equal(swept.designs, pd.read_parquet(swept.dataset))
    assert (
        swept.designs.attrs["units"]["clearance"] == "m"
        and swept.designs["clearance"].between(2e-4, 1e-3).all()
    )
    assert "8 designs" in (swept.folder / "summary.md").read_text()
    row = swept.designs.iloc[3]
    alone = jg.change(
        mechanism, {"joints.crank_pin.journal": row["mechanism.joints.crank_pin.journal"]}
    )
    for pin in ("crank_pin", "piston_pin"):
        radius = alone.joint(pin).journal_radius + row["clearance"]
        alone = jg.change(alone, {f"joints.{pin}.bearing_radius": radius})
    assert jg.simulate(alone, OPTIONS).steps == row["steps"]


def test_a_sweep_has_columns_a_summary_and_figures(swept):
    forces = swept.read("clearance", "crank_pin_peak_force")
    assert forces.shape == (8, 2) and forces.attrs["units"] == {
        "clearance": "m",
        "crank_pin_peak_force": "N",
    }
    rows = swept.summary().set_index("quantity")
    assert (rows.loc["designs", "value"], rows.loc["stroke", "unit"]) == (8, "mm")
    assert "<td style='text-align:left'>stroke</td>" in swept._repr_html_()
    drawn = swept.plot("crank_pin_peak_force").data
    assert set(drawn["x_quantity"]) == {"clearance", "crank pin journal"}
    assert sorted(drawn.query("series == 'design'")["y"].unique()) == sorted(
        swept.designs["crank_pin_peak_force"]
    )


def test_a_sweep_of_a_linkage_has_figures_of_its_output_body(tmp_path):
    parameters = {"joints.B.clearance": ["0.05 mm", "0.1 mm"]}
    keys = {"folder": tmp_path, "parameters": parameters, "number": 2, "workers": 1}
    swept = jg.sweep(jg.load_mechanism("four_bar"), OPTIONS, **keys, tolerance="1e-9 m")
    assert swept.figures["swing"] == "swing of the rocker"
    assert "largest torque of the drive" in swept._repr_html_()
    drawn = swept.plot("swing").data
    assert set(drawn["x_quantity"]) == {"joint B clearance"}
    assert sorted(drawn.query("series == 'design'")["y"]) == sorted(
        np.degrees(swept.read("swing")["swing"])
    )


def test_a_repeated_sweep_reads_its_designs(sweep, swept, monkeypatch):
    monkeypatch.setattr("jointgap.designs.dataset.simulate_designs", None)
    pd.testing.assert_frame_equal(sweep().designs, swept.designs)


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({"number": 0}, "sweep: number = 0: must be greater than or equal to 1"),
        ({"parameters": {"clearence": [1e-3]}}, "clearence: no such word; did you mean 'clearance"),
        ({"parameters": ["friction"]}, "sweep.*parameters"),
        ({"parameters": None}, "sweep.*parameters"),
    ],
)
def test_a_wrong_argument_is_an_error(sweep, tmp_path, arguments, words):
    with pytest.raises(jg.InputError, match=words):
        sweep(folder=tmp_path, **arguments)


def test_failed_designs_are_remarks_and_have_no_figures(sweep, swept, tmp_path):
    failed = sweep(folder=tmp_path, parameters={"simulate.tolerance": [1e-30, 2e-30]}, number=2)
    assert failed.remarks
    with pytest.raises(jg.InputError, match="no figures"):
        failed.plot()
    with pytest.raises(jg.InputError, match="no column 'clearence'; did you mean 'clearance'"):
        swept.read("clearence")
