"""Clearances by date: the rate of growth and its interval, and which campaigns may stand in one trend."""

import json
from datetime import date, timedelta

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

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

DAYS = (0, 31, 59, 90)
LABEL = "crank_pin_clearance"


def clearance(value, sd=2e-6):
    """The effect as a verdict names it."""
    size = {"clearance_m": estimate_with_interval(value, sd, -np.inf, np.inf)}
    return {"name": LABEL, "site": "crank_pin", "delta_bic": 300.0, "parameters": size}


def named(value, sd=2e-6):
    return NAMED | {"effects": [clearance(value, sd)], "preflight": {"undetectable": [], "merged": []}}


class Rig:
    """Campaigns of one rig with verdicts as analysed ones have."""

    def __init__(self, place):
        self.place, self.files = place, []

    def add(self, day, verdict, **changed):
        """A campaign so many days after the first of January 2026; `changed` are keys of its file."""
        name = f"rig-{len(self.files)}"
        content = {
            "name": name,
            "date": date(2026, 1, 1) + timedelta(days=day),
            "mechanism": str(ROOT / "config/mechanisms/erkaya2009.yaml"),
            "runs": [
                {"id": "slow", "file": f"{name}-slow.csv", "speed": "200 rpm", "role": "identify"},
                {"id": "fast", "file": f"{name}-fast.csv", "speed": "400 rpm", "role": "confirm"},
            ],
            "channels": {"time": {"column": "t", "unit": "s"}, "crank_torque": {"column": "M", "unit": "N*m"}},
        } | changed
        content = {key: value for key, value in content.items() if value is not None}
        file = self.place / f"{name}.yaml"
        file.write_text(yaml.safe_dump(content))
        self.files.append(file)
        folder = ResultsFolder(self.place / "results" / content["name"])
        campaign = load_campaign(file)
        folder.write(CONFIG_SNAPSHOT, config_snapshot(campaign))
        (folder.path / "verdict.json").write_text(json.dumps(verdict | {"campaign": content["name"]}))
        return folder

    def trend(self):
        """What `jointgap trend` says; its tables are in `sizes` and `growth`."""
        out = ResultsFolder(self.place / "trend")
        command = ["trend", *map(str, self.files), "--results", str(self.place / "results"), "--folder", str(out.path)]
        said = CliRunner().invoke(cli, command, catch_exceptions=False).output
        self.sizes, self.growth = out.read(TREND), out.read(TREND_GROWTH)
        self.page = (out.path / "trend.md").read_text()
        return said


@pytest.fixture
def rig(tmp_path):
    return Rig(tmp_path)


def test_a_clearance_that_grows_is_told_with_its_rate_per_day(rig):
    for day in DAYS:
        rig.add(day, named(1e-4 + 2e-7 * day))
    said = rig.trend()
    (growth,) = rig.growth.to_dict("records")
    assert growth["growth"] == "grew"
    assert growth["rate"] == pytest.approx(2e-7)
    assert growth["first_value"] == pytest.approx(1e-4)
    # the textbook's error of a slope with equal errors: sd / sqrt(sum of squares of days about their mean)
    half_width = 1.645 * 2e-6 / np.sqrt(np.sum((np.array(DAYS) - 45.0) ** 2))
    assert growth["rate_high"] - growth["rate"] == pytest.approx(half_width)
    assert growth["rate"] - growth["rate_low"] == pytest.approx(half_width)
    assert growth["error_scale"] == 1.0
    assert "clearance in the crank pin: grew by 0.200 µm per day (90 % interval 0.151 to 0.249; p below 1e-10)" in said
    assert list(rig.sizes["date"]) == ["2026-01-01", "2026-02-01", "2026-03-01", "2026-04-01"]
    for file in ("figures/trend.png", "figures/trend.svg", "figures/trend.parquet"):
        assert (rig.place / "trend" / file).is_file()


def test_campaigns_are_ordered_by_date_however_they_are_given(rig):
    for day in reversed(DAYS):
        rig.add(day, named(1e-4 + 2e-7 * day))
    rig.trend()
    assert list(rig.sizes["days"]) == list(DAYS)
    assert rig.growth["rate"][0] == pytest.approx(2e-7)


def test_a_clearance_that_shrinks_is_told_as_that(rig):
    for day in DAYS:
        rig.add(day, named(1e-4 - 2e-7 * day))
    assert "shrank by 0.200 µm per day (90 % interval 0.151 to 0.249" in rig.trend()


def test_growth_within_the_errors_is_no_growth(rig):
    for day in DAYS:
        rig.add(day, named(1e-4 + 1e-8 * day, 1e-5))
    assert "no growth that these data show, 0.01 µm per day (90 % interval -0.24 to 0.26" in rig.trend()
    assert rig.growth["growth"][0] == "no growth"


def test_two_dates_are_too_few_however_many_campaigns_they_have(rig):
    for day in (0, 0, 90):
        rig.add(day, named(1e-4 + 2e-7 * day))
    assert "too few dates, 2 of the 3" in rig.trend()
    assert rig.growth["rate"].isna().all()


def test_a_campaign_that_names_nothing_is_listed_with_the_smallest_size_that_would_show_and_does_not_count(rig):
    nothing = UNNAMED | {"verdict": "no_disagreement", "preflight": {"undetectable": [], "merged": []}}
    folder = rig.add(0, nothing)
    row = {"label": LABEL, "parameter": "clearance_m", "smallest_detectable": 7e-5, "unit": "m", "typical": 1e-5}
    frame = pd.DataFrame([row | {"falls": False, "detectable": True, "failed": None, "assumed": ""}])
    folder.write(DETECTABLE, frame)
    for day in DAYS[1:]:
        rig.add(day, named(1e-4 + 2e-7 * day))
    rig.trend()
    first = rig.sizes.iloc[0]
    assert (first["counts"], first["reason"]) == (False, "not found; the verdict is no disagreement")
    assert first["smallest_detectable"] == 7e-5
    assert np.isnan(first["value"])
    assert rig.growth["dates"][0] == 3
    assert rig.growth["rate"][0] == pytest.approx(2e-7)
    assert "| 2026-01-01 | rig-0 | – | – | – | – | 70 | not found; the verdict is no disagreement |" in rig.page


@pytest.mark.parametrize(
    ("verdict", "reason"),
    [
        (UNNAMED | {"verdict": "ambiguous", "equivalent": [[clearance(1e-3)], [COULOMB]]}, "not certain"),
        (UNNAMED | {"verdict": "unexplained", "best_known": {"effects": [clearance(1e-3)]}}, "not proven"),
        (UNNAMED | {"preflight": {"undetectable": [LABEL], "merged": []}}, "not detectable with its runs"),
        (NAMED | {"effects": [clearance(1e-3, 0.0)]}, "not estimated"),
        (
            UNNAMED | {"verdict": "unexplained", "nuisances": {LABEL: clearance(1e-3)["parameters"]["clearance_m"]}},
            "without what else is missing",
        ),
    ],
    ids=["equivalent", "best-known", "undetectable", "without-an-error", "base-of-an-unexplained-verdict"],
)
def test_what_is_not_sure_does_not_count_and_says_why(rig, verdict, reason):
    rig.add(0, verdict)
    for day in DAYS[1:]:
        rig.add(day, named(1e-4 + 2e-7 * day))
    rig.trend()
    assert reason in rig.sizes["reason"][0]
    assert list(rig.sizes["counts"]) == [False, True, True, True]
    assert rig.growth["rate"][0] == pytest.approx(2e-7)


def test_what_an_ambiguous_verdict_calls_certain_counts(rig):
    for day in DAYS:
        rig.add(day, UNNAMED | {"verdict": "ambiguous", "certain": [clearance(1e-4 + 2e-7 * day)]})
    rig.trend()
    assert set(rig.sizes["source"]) == {"certain"}
    assert rig.growth["growth"][0] == "grew"


def test_a_clearance_that_was_fitted_as_a_nuisance_is_followed_into_the_effect_of_its_name(rig):
    for day in DAYS[:3]:
        fitted = {LABEL: estimate_with_interval(1e-3 + 2e-7 * day, 2e-6, 0.0, 1.0)}
        rig.add(day, UNNAMED | {"verdict": "parameters_only", "nuisances": fitted})
    rig.add(DAYS[3], named(1e-3 + 2e-7 * DAYS[3]))
    rig.trend()
    assert list(rig.sizes["source"]) == ["nuisance"] * 3 + ["named"]
    assert rig.growth["rate"][0] == pytest.approx(2e-7)


def test_another_effect_is_followed_where_two_campaigns_name_it(rig):
    rig.add(0, NAMED)
    rig.add(31, named(1e-4))
    assert "Coulomb" not in rig.trend()
    rig.add(59, NAMED)
    assert "Coulomb friction" in rig.trend()
    assert set(rig.sizes["label"]) == {"slider_coulomb_friction", LABEL}
    assert set(rig.sizes.loc[rig.sizes["label"] != LABEL, "unit"]) == {"N"}


def test_sizes_that_scatter_more_than_their_errors_widen_the_interval():
    days, errors = np.array([0.0, 1.0, 2.0, 3.0]), np.full(4, 1.0)
    found = fit_growth(days, np.array([3.0, -3.0, -3.0, 3.0]), errors)  # no slope, chi2 36 with 2 degrees of freedom
    assert found.error_scale == pytest.approx(np.sqrt(18.0))
    assert found.high == pytest.approx(1.645 * np.sqrt(18.0 / 5.0))
    assert found.rate == pytest.approx(0.0, abs=1e-12)


def test_sizes_weigh_as_their_errors_say():
    days, values = np.array([0.0, 10.0, 30.0, 31.0, 90.0]), np.array([1.0, 1.5, 2.0, 7.0, 5.0])
    errors = np.array([0.5, 0.2, 1.0, 4.0, 0.7])
    (rate, start), covariance = np.polyfit(days, values, 1, w=1 / errors, cov="unscaled")
    found = fit_growth(days, values, errors)
    assert (found.rate, found.first_value) == (pytest.approx(rate), pytest.approx(start))
    assert found.high - found.rate == pytest.approx(1.645 * found.error_scale * np.sqrt(covariance[0, 0]))


@pytest.mark.parametrize("dates", [3, 4, 8])
def test_nine_of_ten_intervals_hold_the_rate_where_errors_are_right_and_few_say_growth_where_there_is_none(dates):
    random, days, sets = np.random.default_rng(1), np.linspace(0.0, 90.0, dates), 4000
    errors = random.uniform(1e-6, 4e-6, (sets, dates))
    values = 1e-4 + 3e-8 * days + random.normal(0.0, errors)
    found = [fit_growth(days, *each) for each in zip(values, errors, strict=True)]
    held = np.mean([each.low <= 3e-8 <= each.high for each in found])
    assert 0.89 < held < 0.97  # the widened ones hold it more often than they say
    small = [fit_growth(days, each, error / 2.0) for each, error in zip(values, errors, strict=True)]
    assert np.mean([each.low <= 3e-8 <= each.high for each in small]) > 0.74  # 0.59 unless they are widened
    still = [fit_growth(days, *each) for each in zip(values - 3e-8 * days, errors, strict=True)]
    assert np.mean([each.p < 0.01 for each in still]) < 0.014  # 0.01, and three standard errors of the share


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"date": None}, "rig-1.yaml: has no date; add the day"),
        ({"date": "01.03.2026"}, "date = '01.03.2026'.*is no day; write year, month and day, such as 2026-03-01"),
        ({"date": 20260301}, "date = 20260301.*is no day"),
        ({"name": "rig-0"}, "campaign 'rig-0' is given twice"),
        (
            {"mechanism": str(ROOT / "config/mechanisms/ideal_joints.yaml")},
            r"rig-1.yaml: mechanism\.\S+ = .* in campaign 'rig-0' \(SI\); campaigns of a trend are of one mechanism",
        ),
        (
            {"runs": [{"id": "one", "file": "rig-0-slow.csv", "speed": "200 rpm", "role": "split"}]},
            "reads .*rig-0-slow.csv, as campaign 'rig-0' does",
        ),
    ],
    ids=["no-date", "no-day", "a-number", "twice", "another-mechanism", "the-same-data"],
)
def test_campaigns_that_make_no_trend_are_refused_and_nothing_is_written(rig, changed, words):
    rig.add(0, named(1e-4))
    with pytest.raises(InputError, match=words):
        rig.add(31, named(1e-4), **changed)
        rig.trend()
    assert not [path for path in rig.place.glob("trend/**/*") if path.is_file()]


def test_a_campaign_without_a_verdict_and_one_that_was_changed_since_are_refused(rig):
    folder = rig.add(0, named(1e-4))
    text = rig.files[0].read_text()
    rig.files[0].write_text(text.replace("200 rpm", "201 rpm"))
    with pytest.raises(InputError, match="the file has changed since its data were read"):
        rig.trend()
    rig.files[0].write_text(text)
    (folder.path / "verdict.json").unlink()
    with pytest.raises(InputError, match=r"is no verdict .*run the campaign's stages first"):
        rig.trend()


def test_a_date_that_was_added_later_needs_no_new_analysis(rig):
    for day in DAYS:
        rig.add(day, named(1e-4), date=None)
    for day, file in zip(DAYS, rig.files, strict=True):
        file.write_text(f"date: {date(2026, 1, 1) + timedelta(days=day)}\n{file.read_text()}")
    assert "no growth" in rig.trend()


def test_campaigns_that_found_no_size_are_refused(rig):
    for day in DAYS:
        rig.add(day, UNNAMED)
    with pytest.raises(InputError, match="rig-0, rig-1, rig-2 and rig-3: no clearance was found in any of them"):
        rig.trend()
