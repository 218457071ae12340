"""Clearances by date: the rate of growth with its interval, and campaigns that form a trend."""

import json
from contextlib import nullcontext
from datetime import date, timedelta
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner
from scipy.stats import t

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign.campaign_files import config_snapshot
from jointgap.campaign.trend import fit_growth
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONFIG_SNAPSHOT, DETECTABLE, TREND, TREND_GROWTH
from jointgap.identification.fit import estimate_with_interval
from tests.campaign.verdicts import COULOMB, NAMED, UNNAMED
from tests.draws import check_rate

DAYS = (0, 31, 59, 90)
CURVE = np.array([1.0, -1.0, -1.0, 1.0]) / np.sqrt(2.0)
"""Scatter about a line over these days that changes neither slope nor level, as large as errors of
1 state."""
LABEL = "crank_pin_clearance"
UNDETECTABLE = {"undetectable": [], "merged": []}


def clearance(value, sd=2e-6):
    """The effect in a verdict."""
    size = {"clearance_m": estimate_with_interval(value, sd, -np.inf, np.inf)}
    return {"name": LABEL, "site": "crank_pin", "delta_bic": 300.0, "parameters": size}


def named(value, sd=2e-6):
    return NAMED | {"effects": [clearance(value, sd)], "preflight": UNDETECTABLE}


def unnamed(verdict, **more):
    return UNNAMED | {"verdict": verdict, **more}


class Rig:
    """Campaigns of one rig with verdicts as analysed ones have."""

    def __init__(self, place):
        self.place, self.files = place, []

    def add(self, day, verdict, **changed):
        """A campaign so many days after the first of January 2026; `changed` are keys of its
        file."""
        name, speeds = f"rig-{len(self.files)}", {"slow": "200 rpm", "fast": "400 rpm"}
        roles = {"slow": "identify", "fast": "confirm"}
        runs = [{"id": run, "file": f"{name}-{run}.csv", "speed": speeds[run]} for run in roles]
        torque = {"column": "M", "unit": "N*m"}
        content = {
            "name": name,
            "date": date(2026, 1, 1) + timedelta(days=day),
            "mechanism": str(ROOT / "config/mechanisms/erkaya2009.yaml"),
            "runs": [run | {"role": roles[run["id"]]} for run in runs],
            "channels": {"time": {"column": "t", "unit": "s"}, "crank_torque": torque},
        }
        given = {key: value for key, value in (content | changed).items() if value is not None}
        self.files.append(self.place / f"{name}.yaml")
        self.files[-1].write_text(yaml.safe_dump(given))
        name = given["name"]
        folder = ResultsFolder(self.place / "results" / name)
        folder.write(CONFIG_SNAPSHOT, config_snapshot(load_campaign(self.files[-1])))
        (folder.path / "verdict.json").write_text(json.dumps(verdict | {"campaign": name}))
        return folder

    def grows(self, rate=2e-7, days=DAYS, sd=2e-6, scatter=0.0):
        """Campaigns that name a clearance of 0.1 mm that grows by `rate` a day, with a `scatter`
        about it by day."""
        for day, off in zip(days, np.broadcast_to(scatter, len(DAYS)), strict=False):
            self.add(day, named(1e-4 + rate * day + off, sd))

    def trend(self, pictures=False):
        """What `jointgap trend` says; its tables are in `sizes` and `growth`."""
        out = ResultsFolder(self.place / "trend")
        folders = ["--results", str(self.place / "results"), "--folder", str(out.path)]
        command = ["trend", *map(str, self.files), *folders]
        with nullcontext() if pictures else patch("jointgap.core.plot.Drawing.save"):
            said = CliRunner().invoke(cli, command, catch_exceptions=False).output
        self.sizes, self.growth = out.read(TREND), out.read(TREND_GROWTH)
        self.page = (out.path / "trend.md").read_text()
        return said


@pytest.fixture
def rig(tmp_path):
    return Rig(tmp_path)


def test_a_clearance_that_grows_is_reported_with_its_rate_per_day_however_campaigns_are_given(rig):
    rig.grows(days=DAYS[::-1], sd=1e-6, scatter=1e-6 * CURVE)
    said = rig.trend(pictures=True)
    (growth,) = rig.growth.to_dict("records")
    assert (growth["growth"], growth["error_scale"]) == ("grew", pytest.approx(1.0))
    assert (growth["rate"], growth["first_value"]) == pytest.approx((2e-7, 1e-4))
    # the textbook's error of a slope with equal errors: sd / sqrt(sum of squares of days about
    # their mean)
    half_width = t.ppf(0.95, 2) * 1e-6 / np.sqrt(np.sum((np.array(DAYS) - 45.0) ** 2))
    assert growth["rate_high"] - growth["rate"] == pytest.approx(half_width)
    assert growth["rate"] - growth["rate_low"] == pytest.approx(half_width)
    growth = "grew by 0.200 µm per day (90 % interval 0.156 to 0.244; p = 0.0056)"
    assert f"clearance in the crank pin: {growth}" in said
    assert "Scatter about the line: 1 times the stated errors." in rig.page
    assert list(rig.sizes["days"]) == list(DAYS) and rig.sizes["date"][1] == "2026-02-01"
    assert (rig.place / "trend/figures/trend.png").is_file()


@pytest.mark.parametrize(
    "growth, summary",
    [
        (
            {"rate": -2e-7, "sd": 1e-6, "scatter": 1e-6 * CURVE},
            "shrank by 0.200 µm per day (90 % interval 0.156 to",
        ),
        ({"rate": 1e-8, "scatter": 1e-5 * CURVE}, "0.01 µm per day (90 % interval -0.43 to 0.45"),
        ({"rate": 0.0}, "no significant growth: 0."),  # sizes that are equal to the last digit
        ({"days": (0, 0, 90)}, "2 of at least 3"),
    ],
)
def test_shrinking_no_growth_and_too_few_dates_are_reported(rig, growth, summary):
    rig.grows(**growth)
    assert summary in rig.trend()
    assert rig.growth["rate"].isna().all() == ("days" in growth)


def test_what_is_not_sure_does_not_count_and_says_why(rig):
    size = clearance(1e-3)["parameters"]["clearance_m"]
    doubtful = [
        (unnamed("ambiguous", equivalent=[[clearance(1e-3)], [COULOMB]]), "not certain"),
        (unnamed("unexplained", best_known={"effects": [clearance(1e-3)]}), "not confirmed"),
        (UNNAMED | {"preflight": UNDETECTABLE | {"undetectable": [LABEL]}}, "not detectable with"),
        (NAMED | {"effects": [clearance(1e-3, 0.0)]}, "not estimated"),
        (unnamed("unexplained", nuisances={LABEL: size}), "without the missing effect"),
    ]
    for verdict, _ in doubtful:
        rig.add(0, verdict)
    nothing = rig.add(0, unnamed("no_disagreement", preflight=UNDETECTABLE))
    row = {"label": LABEL, "parameter": "clearance_m", "smallest_detectable": 7e-5, "unit": "m"}
    row |= {"typical": 1e-5, "falls": False, "detectable": True, "failed": None, "assumed": ""}
    nothing.write(DETECTABLE, pd.DataFrame([row]))
    rig.grows(days=DAYS[1:])
    rig.trend()
    assert list(rig.sizes["counts"]) == [False] * 6 + [True] * 3
    for (_, reason), shown in zip(doubtful, rig.sizes["reason"], strict=False):
        assert reason in shown
    assert rig.sizes["smallest_detectable"][5] == 7e-5 and np.isnan(rig.sizes["value"][5])
    not_found = "| – | – | – | – | 70 | not found; the verdict is no disagreement |"
    assert f"| 2026-01-01 | rig-5 {not_found}" in rig.page
    assert (rig.growth["dates"][0], rig.growth["rate"][0]) == (3, pytest.approx(2e-7))


def test_certain_sizes_and_fitted_nuisances_count(rig):
    fitted = {LABEL: estimate_with_interval(1e-4, 2e-6, 0.0, 1.0)}
    rig.add(0, unnamed("parameters_only", nuisances=fitted))
    rig.add(31, unnamed("ambiguous", certain=[clearance(1e-4 + 2e-7 * 31)]))
    rig.grows(days=DAYS[2:])
    rig.trend()
    assert list(rig.sizes["source"]) == ["nuisance", "certain", "named", "named"]
    assert (rig.growth["growth"][0], rig.growth["rate"][0]) == ("grew", pytest.approx(2e-7))


def test_sizes_weigh_as_their_errors_say_and_more_evenly_where_they_scatter_more():
    days, values = np.array([0.0, 10.0, 30.0, 31.0, 90.0]), np.array([1.0, 1.5, 2.0, 2.5, 3.9])
    errors = np.array([0.5, 0.2, 1.0, 4.0, 0.7])
    (rate, start), covariance = np.polyfit(
        days, values, 1, w=1 / errors, cov=True
    )  # scaled by the residuals
    found = fit_growth(days, values, errors)
    assert found.error_scale < 1.0
    assert (found.slope, found.first) == pytest.approx((rate, start))
    assert found.high - found.slope == pytest.approx(t.ppf(0.95, 3) * np.sqrt(covariance[0, 0]))
    (rate, _), covariance = np.polyfit(days, 1e3 * values**2, 1, cov=True)
    found = fit_growth(days, 1e3 * values**2, errors)
    assert found.slope == pytest.approx(rate, rel=1e-3)
    assert found.high - found.slope == pytest.approx(
        t.ppf(0.95, 3) * np.sqrt(covariance[0, 0]), rel=1e-3
    )


@pytest.mark.parametrize(
    "dates, scatter, of_a_day", [(3, 0.0, 1), (3, 100.0, 1), (3, 100.0, 2), (6, 100.0, 1)]
)
def test_false_alarms_and_coverage_of_the_growth_rate(dates, scatter, of_a_day):
    """However much sizes `scatter` from day to day beyond their errors, which are all stated twice
    too large."""
    random, draws = np.random.default_rng(dates), 2000
    days = np.repeat(np.linspace(0.0, 90.0, dates), of_a_day)
    errors = random.uniform(1e-6, 3e-6, (draws, days.size))
    of_days = np.repeat(random.normal(0.0, scatter * 1e-6, (draws, dates)), of_a_day, axis=1)
    values = 1e-4 + of_days + random.normal(0.0, errors)
    found = [fit_growth(days, *each) for each in zip(values, 2.0 * errors, strict=True)]
    check_rate([each.p < 0.01 for each in found], 0.01)
    check_rate([each.low < 0.0 < each.high for each in found], 0.9)


SAME_DATA = [{"id": "one", "file": "rig-0-slow.csv", "speed": "200 rpm", "role": "split"}]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"date": None}, "rig-1.yaml: has no `date`; add the day"),
        ({"date": "01.03.2026"}, "is not a date; write year, month and day"),
        ({"date": 20260301}, "date = 20260301.* is not a date"),
        ({"name": "rig-0"}, "campaign 'rig-0' is given twice"),
        ({"mechanism": "ideal_joints"}, r"rig-1.yaml: mechanism\..* in campaign 'rig-0' \(SI\)"),
        ({"runs": SAME_DATA}, "reads .*rig-0-slow.csv, like campaign 'rig-0'"),
    ],
)
def test_campaigns_that_make_no_trend_are_refused_and_nothing_is_written(rig, changes, message):
    rig.add(0, named(1e-4))
    with pytest.raises(InputError, match=message):
        rig.add(31, named(1e-4), **changes)
        rig.trend()
    assert not (rig.place / "trend").exists() or not any((rig.place / "trend").rglob("*.*"))


def test_campaigns_without_sizes_or_with_changed_files_are_refused(rig):
    folder = rig.add(0, UNNAMED, date=None)
    with pytest.raises(InputError, match=r"rig-0\.yaml: has no `date`"):
        rig.trend()
    text = f"date: 2026-01-01\n{rig.files[0].read_text()}"
    for changed, words in (
        (text, "rig-0: none identified a clearance"),
        (text.replace("200 rpm", "201 rpm"), "the file has changed since its data were read"),
        (text, r"not a verdict .*run the campaign's stages first"),
    ):
        if "not a verdict" in words:
            (folder.path / "verdict.json").unlink()
        rig.files[0].write_text(changed)
        with pytest.raises(InputError, match=words):
            rig.trend()
