"""The interactive page of the impacts, on a small simulated motion."""

import numpy as np
import pytest

from jointgap.scenario.impacts_page import impacts_page, with_extremes


def test_the_page_is_self_contained_and_labels_axes_and_joints(tables, scenario):
    pytest.importorskip("plotly")
    page = impacts_page(tables["trajectory"], tables["events"], scenario, "my_press")
    text = page.rpartition("plotly.js v")[2]
    assert "<title>my press: impacts in the joints</title>" in page
    assert "src=" not in page.partition("</style>")[2].partition("<script")[0]
    assert 'src="http' not in page
    gap = "penetration (+), gap (\\u2212) [\\u00b5m]"
    for label in (gap, "normal force [N]", "crank angle [deg]", "piston pin"):
        assert label in text, label
    assert page == impacts_page(tables["trajectory"], tables["events"], scenario, "my_press")


def test_a_reduced_curve_keeps_extremes_and_gaps():
    x = np.arange(100_000.0)
    y = np.sin(x / 300.0)
    y[[777, 54_321]] = 50.0, -50.0
    y[20_000:30_000] = np.nan
    few_x, few_y = with_extremes(x, y, 1000)
    assert len(few_x) <= 1002 and few_x[[0, -1]].tolist() == [0.0, 99_999.0]
    assert few_x[few_y == 50.0].tolist() == [777.0] and few_x[few_y == -50.0].tolist() == [54_321.0]
    assert np.isnan(few_y[(few_x > 20_000) & (few_x < 30_000)]).all()
    assert len(with_extremes(x, y, 200_000)[0]) == len(x)
