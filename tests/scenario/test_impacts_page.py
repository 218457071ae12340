"""The page to zoom into the impacts, on a small made-up motion."""

import numpy as np
import pytest

from jointgap.scenario.impacts_page import impacts_page, with_extremes


def test_the_page_is_complete_in_itself_and_names_axes_units_and_joints(tables, scenario):
    pytest.importorskip("plotly")
    page = impacts_page(tables["trajectory"], tables["events"], scenario, "my_press")
    head, _, drawn = page.rpartition("plotly.js v")
    assert "<title>my press: impacts in the joints</title>" in page and head
    assert (
        "src=" not in page.partition("</style>")[2].partition("<script")[0]
        and 'src="http' not in page
    )
    for words in (
        "penetration (+), gap (\\u2212) [\\u00b5m]",
        "normal force [N]",
        "crank angle [deg]",
        "piston pin",
    ):
        assert words in drawn, words
    assert page == impacts_page(tables["trajectory"], tables["events"], scenario, "my_press")


def test_of_a_long_curve_every_stretch_keeps_its_extremes():
    x = np.arange(100_000.0)
    y = np.sin(x / 300.0)
    y[[777, 54_321]] = 50.0, -50.0
    y[20_000:30_000] = np.nan
    few_x, few_y = with_extremes(x, y, 1000)
    assert len(few_x) <= 1002 and few_x[[0, -1]].tolist() == [0.0, 99_999.0]
    assert few_x[few_y == 50.0].tolist() == [777.0] and few_x[few_y == -50.0].tolist() == [54_321.0]
    assert np.isnan(few_y[(few_x > 20_000) & (few_x < 30_000)]).all()
    assert len(with_extremes(x, y, 200_000)[0]) == len(x)
