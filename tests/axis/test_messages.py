"""Errors in the folder of a model: which file, key, column or row, and what to do."""

import numpy as np
import pandas as pd
import pytest

from jointgap.axis import effect, parameter
from jointgap.axis.analyse import ModelState
from jointgap.core.errors import InputError
from tests.axis.folders import gear, pendulum, piston


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return pendulum(tmp_path_factory.mktemp("model"))


def changed(folder, tmp_path, file, *pairs):
    """A copy of a folder in which texts of a file are replaced."""
    copy = tmp_path / "model"
    copy.mkdir()
    for path in folder.iterdir():
        text = path.read_text(encoding="utf-8")
        for old, new in pairs if path.name == file else ():
            assert old in text
            text = text.replace(old, new, 1)
        (copy / path.name).write_text(text, encoding="utf-8")
    return copy


def refusal(folder, tmp_path):
    with pytest.raises(InputError) as error:
        _ = ModelState(folder, tmp_path / "results").model.simulate
        model = ModelState(folder, tmp_path / "results").model
        model.simulate("slow", {p.name: p.nominal for p in model.nuisances})
    return str(error.value)


@pytest.mark.parametrize(
    "pairs, words",
    [
        ([("def force(self, position,", "def force(self, angle,")], ["force", "'angle'", "rename"]),
        ([("def mass(self)", "def weight(self)")], ["requires the method mass"]),
        ([("np.sin(position)", "np.sine(position)")], ["method force cannot be compiled"]),
        ([("class Pendulum(Axis):", "class Pendulum:")], ["0 classes derived"]),
        ([("0.14,", "0.14 +,")], ["model.py, line 10", "SyntaxError"]),
        ([("low=0.02", "low=0.2")], ["model.py, line 10", "low < high", "0.14"]),
        ([("return self.inertia", "return np.log(-self.inertia)")], ["method mass is nan"]),
        ([("self, position, velocity", "self, position, velocity, acceleration")], ["force"]),
    ],
)
def test_errors_of_the_class_name_file_and_method(folder, tmp_path, pairs, words):
    text = refusal(changed(folder, tmp_path, "model.py", *pairs), tmp_path)
    for word in ("model.py", *words):
        assert word in text, text


@pytest.mark.parametrize(
    "pairs, words",
    [
        ([("unit: N*m}", "unit: N}")], ["slides", "turns"]),
        ([("given: drive", "given: torque")], ["given = 'torque'", "drive"]),
        ([("role: confirm", "role: identify")], ["role confirm"]),
        ([("column: torque", "column: moment")], ["slow.csv", "moment"]),
        ([("coulomb_friction,", "coulomb_frictoin,")], ["'coulomb_frictoin'", "coulomb_friction"]),
        ([("{id: fast", "{id: slow")], ["several have the id 'slow'"]),
        ([("unit: deg, noise", "unit: furlongish, noise")], ["position", "furlongish"]),
        ([("start: at_rest}", "start: at_rest, from: 3 s, to: 1 s}")], ["slow", "before"]),
        ([("unit: deg, noise: 0.1", "unit: deg, bandwidth: 3 Hz")], ["bandwidth", "given"]),
        ([("unit: s}", "unit: s, bore: 3 mm}")], ["time.bore", "remove"]),
        ([("mean_of: 10", "mean_of: 300")], ["slow.csv", "mean_of"]),
    ],
)
def test_errors_of_the_model_file_name_key_and_value(folder, tmp_path, pairs, words):
    text = refusal(changed(folder, tmp_path, "model.yaml", *pairs), tmp_path)
    for word in ("model", *words):
        assert word in text, text


def with_cell(folder, tmp_path, column, row, value):
    copy = changed(folder, tmp_path, "")
    samples = pd.read_csv(copy / "slow.csv", dtype=str)
    samples.loc[row, column] = value
    samples.to_csv(copy / "slow.csv", index=False)
    return copy


@pytest.mark.parametrize(
    "column, value, words",
    [
        ("time", "0.001", ["row 102", "not after"]),
        ("torque", "", ["row 102", "drive must be known"]),
        ("torque", "much", ["row 102", "much"]),
    ],
)
def test_errors_of_samples_name_column_and_row(folder, tmp_path, column, value, words):
    text = refusal(with_cell(folder, tmp_path, column, 100, value), tmp_path)
    for word in ("slow.csv", column, *words):
        assert word in text, text


def test_a_gap_of_a_compared_channel_is_no_error(folder, tmp_path):
    copy = with_cell(folder, tmp_path, "position", 100, "")
    model = ModelState(copy, tmp_path / "results").model
    (series,) = [series for series in model.series if series.run == "slow"]
    assert pd.isna(series.value).sum() == 1


def test_an_unlikely_sample_is_a_remark(folder, tmp_path):
    state = ModelState(with_cell(folder, tmp_path, "position", 100, "1e9"), tmp_path / "r")
    assert any("slow.csv" in remark and "row 102" in remark for remark in state.remarks)


def test_a_model_needs_something_to_compare(tmp_path):
    copy = changed(
        gear(tmp_path / "gear"), tmp_path, "model.py", ("def output(self", "def other(self")
    )
    with pytest.raises(InputError, match="no measured channel can be compared"):
        _ = ModelState(copy, tmp_path / "results").model


def test_samples_at_uneven_times_cannot_be_filtered(tmp_path):
    folder = piston(tmp_path / "piston")
    samples = pd.read_csv(folder / "low.csv")
    samples.loc[7, "t"] += 0.004
    samples.to_csv(folder / "low.csv", index=False)
    with pytest.raises(InputError, match=r"low\.csv.*evenly spaced"):
        _ = ModelState(folder, tmp_path / "results").model


def test_a_gap_of_a_filtered_channel_is_a_gap_of_that_sample(tmp_path):
    folder = piston(tmp_path / "piston")
    before = ModelState(folder, tmp_path / "results").model.series[0].value
    samples = pd.read_csv(folder / "low.csv")
    samples.loc[1000, "F"] = None
    samples.to_csv(folder / "low.csv", index=False)
    after = ModelState(folder, tmp_path / "results").model.series[0].value
    assert np.isfinite(before).sum() - np.isfinite(after).sum() == 1


def test_a_run_that_the_filter_uses_up_is_refused(tmp_path):
    pairs = ("10 Hz", "0.1 Hz"), ("given:", "mean_of: 5\ngiven:")
    folder = changed(piston(tmp_path / "piston"), tmp_path, "model.yaml", *pairs)
    with pytest.raises(InputError, match=r"low\.csv.*to compare.*bandwidth"):
        _ = ModelState(folder, tmp_path / "results").model


def test_a_stated_noise_is_reduced_by_the_filter(tmp_path):
    folder = changed(
        piston(tmp_path / "piston"), tmp_path, "model.yaml", ("unit: N}", "unit: N, noise: 0.1}")
    )
    (series, *_) = ModelState(folder, tmp_path / "results").model.series
    # white noise of 100 Hz, through 10 Hz and means of 5 samples
    assert 0.02 < series.stated_noise[0] < 0.1 * 5.0**-0.5


def test_a_constant_input_is_no_error(tmp_path):
    folder = piston(tmp_path / "piston")
    samples = pd.read_csv(folder / "low.csv").assign(p=1.0)
    samples.to_csv(folder / "low.csv", index=False)
    assert ModelState(folder, tmp_path / "results").model.inputs == ["pressure"]


def test_a_folder_without_a_model_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"model\.yaml"):
        ModelState(tmp_path)


def test_impossible_parameters_and_effects_are_refused():
    with pytest.raises(ValueError, match="finite bounds"):
        parameter(1.0, "kg", low=0.0, high=float("inf"))
    with pytest.raises(ValueError, match="include 0"):
        effect("N", step=1.0, low=1.0, high=2.0)
    with pytest.raises(ValueError, match="'deg' is no SI unit; give values in rad"):
        parameter(1.0, "deg", low=0.0, high=2.0)
    with pytest.raises(ValueError, match="guesses"):
        effect("N", step=1.0, parts=("cosine", "sine"), guesses=(1.0,))
