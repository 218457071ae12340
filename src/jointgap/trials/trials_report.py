"""The score of a set of trials: rates with intervals, confusion, the page, and the run for MLflow."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binom, binomtest

from jointgap import tables
from jointgap.core.page import Block, FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.identification.fit import LEVELS
from jointgap.rig.sensors import FAULTS
from jointgap.track.run_record import Dataset, Record
from jointgap.trials.score import BASELINES, NAMED, TRIALS
from jointgap.trials.size_calibration import GAP_TOLERANCE
from jointgap.trials.trial_plan import CLEARANCES
from jointgap.trials.virtual_rig import BASES

CONFIDENCE = 0.95
"""Of the intervals of shares and medians."""

DESCRIPTION = "Blind trials: campaigns with hidden effects, analysed without the truth at hand"
"""Of the set's experiment in MLflow."""

CLOSE_SIZE = 0.1
"""Relative error up to which the size of a clearance that is named right is close."""

EFFECT_CLASSES = {
    "clearance": CLEARANCES,
    "friction": (
        "slider_coulomb_friction", "slider_stribeck_friction", "slider_position_friction", "slider_viscous_friction",
        "slider_quadratic_drag", "slider_power_drag", "slider_load_friction", "crank_coulomb_friction",
        "crank_angle_friction", "crank_viscous_friction", "pin_friction", "common_pin_friction", "pin_restitution",
        "common_pin_restitution",
    ),
    "force": (
        "gravity", "slider_constant_force", "slider_spring", "slider_nonlinear_spring", "gas_pressure",
        "slider_force_table", "harmonic_force", "crank_periodic_torque", "speed_fluctuation",
    ),
    "mass or length": ("added_slider_mass", "crank_unbalance", "slider_offset", "link_length_error"),
    "film or rod": ("lubricated_joint", "rod_flexibility"),
    "sensor": tuple(FAULTS),
    "formula": ("discovered_slider_force", "discovered_crank_torque"),
}  # fmt: skip
"""Effects of the list by class: losses in contacts count as friction, what prescribes the crank's motion as a force."""


def share_interval(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson's interval at `CONFIDENCE` of a share of `hits` in a `count` of one or more.

    C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404-413.
    """
    return tuple(map(float, binomtest(hits, count).proportion_ci(CONFIDENCE, "exact")))


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """The rates and medians of a set, one a row: what, group, count, value, low, high.

    Shares have Clopper and Pearson's interval; medians have the one that order statistics give.
    """
    is_one = trials["kind"].isin(["single", "exudyn", "clearance"]) & (trials["hidden"] != "nothing")
    one, is_drawn_evenly = trials[is_one & trials["detectable"]], trials["kind"] != "clearance"
    single = one[one["kind"] != "clearance"]
    clearances, all_clearances = (rows[rows["hidden"].isin(CLEARANCES)] for rows in (one, trials[is_one]))
    nothing = trials[(trials["hidden"] == "nothing") & (trials["kind"] != "wiring")]
    pairs = trials[trials["kind"] == "pair"]
    detectable_pairs, off_list = pairs[pairs["detectable"]], trials[trials["kind"] == "off_list"]
    hidden = trials[(is_one & is_drawn_evenly) | (trials["kind"] == "pair")]
    undetectable = hidden[~hidden["detectable"]]
    wiring = trials[trials["kind"] == "wiring"]
    of_nuisances = {"all": trials, **{f"base {base}": trials[trials["base"] == base] for base in BASES}}
    of_nuisances["from Exudyn"] = trials[trials["kind"] == "exudyn"]
    not_excluded = trials[is_one & is_drawn_evenly & ~trials["foreseen"]]
    rows = [
        *_by_group("right name", single, "right"),
        _share(
            "right, of which ambiguous as foreseen",
            single,
            (single["outcome"] == "right") & (single["verdict"] == "ambiguous"),
        ),
        _outcomes("right, small effects too that preflight does not exclude", not_excluded, "right"),
        *_by_group("wrong name", single, "wrong"),
        _outcomes("wrong name, effect undetectable", undetectable, "wrong"),
        *_by_group("right joint, a clearance hidden", clearances, "right"),
        *_by_group("wrong name, a clearance hidden", clearances, "wrong"),
        _share(
            "size within 10 %, a clearance named right",
            clearances[clearances["outcome"] == "right"],
            clearances.loc[clearances["outcome"] == "right", "error"] <= CLOSE_SIZE,
        ),
        *_by_group("ambiguous", single, "ambiguous"),
        *_by_group("unexplained", single, "unexplained"),
        *_by_group("missed", single, "missed"),
        _outcomes("wrong name, effect off the list", off_list, "wrong"),
        _outcomes("unexplained or the force found, effect off the list", off_list, "unexplained", "right"),
        _outcomes("ambiguous or missed, effect off the list", off_list, "ambiguous", "missed"),
        *_by_group("nothing found, nothing hidden", nothing, "right"),
        _outcomes("both named and no third", detectable_pairs, "right"),
        _outcomes("wrong name, two effects", detectable_pairs, "wrong"),
        _share("undetectable", hidden, ~hidden["detectable"]),
        _share("undetectable, as preflight says", hidden, hidden["foreseen"]),
        _share("undetectable, within a stated range or overwritten", hidden, hidden["idle"]),
        _share("undetectable, a clearance hidden", all_clearances, ~all_clearances["detectable"]),
        *_by_base("wrong name, data wired wrongly", wiring, wiring["outcome"] == "wrong"),
        *_by_base("told which channel, data wired wrongly", wiring, wiring["told"]),
        _outcomes("failed", trials, "failed"),
        _median("error of the size", single["error"]),
        *(_share_of_values(f"size within the {level} % interval", single[f"covered_{level}"]) for level in LEVELS),
        *(
            _share_of_sums(
                f"nuisance within its {level} % interval", own[f"nuisances_covered_{level}"], own["nuisances"], group
            )
            for level in LEVELS
            for group, own in of_nuisances.items()
        ),
        _median("share of the excess closed", single["closed"]),
        _median("gap after", single.loc[single["outcome"] == "right", "gap_after"]),
        _share_of_sums("false windows", trials["false_windows"], trials["windows"]),
        _share_of_sums("bins missed", trials["missed_bins"], trials["bins_off"]),
        *(_median("seconds", trials.loc[trials["base"] == base, "seconds"], f"base {base}") for base in BASES),
        *(
            _quantile("seconds, of 90 % at most", trials.loc[trials["base"] == base, "seconds"], f"base {base}", 0.9)
            for base in BASES
        ),
    ]
    for baseline, words in BASELINES.items():
        for what, group, outcome in (
            ("right name", single, "right"),
            ("wrong name", single, "wrong"),
            ("false alarm", nothing, "wrong"),
            ("wrong name, effect off the list", off_list, "wrong"),
        ):
            asked = group[group[baseline] != "not asked"]
            rows.append(_share(f"{words}: {what}", asked, asked[baseline] == outcome))
    return pd.DataFrame([row for row in rows if row["count"]])


def _by_group(what: str, trials: pd.DataFrame, outcome: str) -> list[dict]:
    """The share of an outcome in all trials, by base, by drive, by gap, and in those from Exudyn."""
    groups = {"all": trials}
    groups |= {f"base {base}": trials[trials["base"] == base] for base in BASES}
    measured = trials["drive"] == "measured_angle"
    groups |= (
        {"drive constant_speed": trials[~measured], "drive measured_angle": trials[measured]} if any(measured) else {}
    )
    larger = trials["gap_caused"] > (1 + 2 * GAP_TOLERANCE) * trials["size"]
    sizes = sorted(set(trials["size"]) - {0.0})
    groups |= {f"gap {size:g}": trials[(trials["size"] == size) & ~larger] for size in sizes}
    groups |= {"gap larger than asked for": trials[larger & (trials["size"] > 0)]}
    exudyn = trials[trials["kind"] == "exudyn"]
    loose = (exudyn["base"] == "loose") | exudyn["hidden"].isin(CLEARANCES)
    groups |= {"from Exudyn, joints ideal": exudyn[~loose], "from Exudyn, joints loose": exudyn[loose]}
    return [_share(what, group, group["outcome"] == outcome, name) for name, group in groups.items()]


def _by_base(what: str, trials: pd.DataFrame, hit: pd.Series) -> list[dict]:
    """The share of `hit` in all trials, by base, and by what was damaged."""
    damage = trials["hidden"].map(lambda text: text.partition(":")[0])
    groups = {"all": trials.index}
    groups |= {f"base {base}": trials.index[trials["base"] == base] for base in BASES}
    groups |= {name: trials.index[damage == name] for name in sorted(set(damage))}
    return [_share(what, trials.loc[rows], hit.loc[rows], name) for name, rows in groups.items()]


def _outcomes(what: str, trials: pd.DataFrame, *outcomes: str) -> dict:
    return _share(what, trials, trials["outcome"].isin(outcomes))


def _share(what: str, trials: pd.DataFrame, hit: pd.Series, group: str = "all") -> dict:
    return _share_of_counts(what, group, int(np.count_nonzero(hit)), len(trials))


def _share_of_counts(what: str, group: str, hits: int, count: int) -> dict:
    value, (low, high) = (hits / count, share_interval(hits, count)) if count else (math.nan, (math.nan, math.nan))
    return {"what": what, "group": group, "count": count, "value": value, "low": low, "high": high}


def _share_of_values(what: str, values: pd.Series) -> dict:
    """A share of values between 0 and 1, of which a trial may have a half."""
    defined = values.dropna()
    return _share_of_counts(what, "all", round(defined.sum()), len(defined))


def _share_of_sums(what: str, part: pd.Series, total: pd.Series, group: str = "all") -> dict:
    return _share_of_counts(what, group, int(part.sum()), int(total.sum()))


def _median(what: str, values: pd.Series, group: str = "all") -> dict:
    """The median with its interval."""
    return _quantile(f"{what}, median", values, group, 0.5)


def _quantile(what: str, values: pd.Series, group: str, share: float) -> dict:
    """The value below which a share of all lies, with the interval between two of the sorted values, by the binomial
    distribution of how many lie below.
    """
    ordered = np.sort(values.dropna().to_numpy(float))
    row = {"what": what, "group": group, "count": ordered.size}
    if not ordered.size:
        return row | dict.fromkeys(("value", "low", "high"), math.nan)
    tail = (1 - CONFIDENCE) / 2
    low = max(int(binom.ppf(tail, ordered.size, share)) - 1, 0)
    high = min(int(binom.isf(tail, ordered.size, share)), ordered.size - 1)
    value = float(np.quantile(ordered, share))
    return row | {"value": value, "low": float(ordered[low]), "high": float(ordered[high])}


def confusion(trials: pd.DataFrame) -> pd.DataFrame:
    """How often what was named, by what was hidden; sites left out, one row a true effect."""
    kinds = trials[trials["kind"].isin(["single", "exudyn", "clearance", "nothing", "off_list"])]
    bare = {column: kinds[column].map(_without_sites) for column in ("hidden", "named")}
    return pd.crosstab(bare["hidden"], bare["named"])


def class_confusion(trials: pd.DataFrame) -> pd.DataFrame:
    """How often what was named, by class of what was hidden, of all trials but those wired wrongly.

    A column says ``right``, or the class of a wrong name, or the verdict where nothing was named; classes of two names
    are given with a plus.
    """
    kinds = trials[trials["kind"] != "wiring"]
    hidden = kinds["hidden"].map(_classes).where(kinds["kind"] != "off_list", "off the list")
    hidden = hidden.where(kinds["kind"] != "pair", "two effects")
    named = kinds["named"].map(_classes).where(kinds["verdict"].isin(NAMED), kinds["verdict"])
    named = named.where(kinds["outcome"] != "right", "right")
    counts = pd.crosstab(hidden.rename("hidden"), named.rename("named"))
    return counts[["right", *(name for name in counts if name != "right")]] if "right" in counts else counts


def _classes(names: str) -> str:
    """The classes of some effects, for a label as it is shown; names of no effect stay."""
    by_name = {name: own for own, members in EFFECT_CLASSES.items() for name in members}
    return " + ".join(sorted(by_name.get(name, name) for name in _without_sites(names).split(" + ")))


def _without_sites(names: str) -> str:
    return " + ".join(sorted(name.partition(":")[0] for name in names.split(" + ")))


def page(name: str, trials: pd.DataFrame) -> Page:
    """The summary on one page, with the figures of the score."""
    rows = [
        (row.what, row.group, str(row.count), _number(row.value), f"{_number(row.low)} - {_number(row.high)}")
        for row in rates(trials).itertuples()
    ]
    intervals = "Shares with 95 % intervals of Clopper and Pearson, medians with those of order statistics."
    blocks = [
        Paragraph(f"{len(trials)} campaigns. {intervals}"),
        FigureBlock("rates", "Shares of right and wrong verdicts"),
        TableBlock(("what", "group", "of", "value", "95 %"), tuple(rows), "llrrl"),
    ]
    blocks += [
        Heading("What was named, by class"),
        FigureBlock("confusion", "What was hidden and what was named"),
        _table(class_confusion(trials)),
    ]
    for base in BASES:
        part = trials[trials["base"] == base]
        if len(part):
            blocks += [Heading(f"What was named: base {base}"), _table(confusion(part))]
    wrong = trials["outcome"].isin(["wrong", "failed"])
    blocks += _section("Wrong or failed", trials[wrong])
    abstained = (trials["kind"] == "off_list") & (trials["outcome"] == "unexplained")
    blocks += _section("Neither right nor wrong", trials[~wrong & ~abstained & (trials["outcome"] != "right")])
    return Page(f"Blind trials: {name}", tuple(blocks), footer=written_today())


def _section(heading: str, trials: pd.DataFrame) -> list[Block]:
    """Trials one a row, those whose effect counts as undetectable last."""
    if trials.empty:
        return []
    columns = "id kind base size gap_caused numerics_gap detectable hidden verdict named outcome cause reason".split()
    rows = trials.sort_values(["detectable", "kind", "base", "hidden"], ascending=[False, True, True, True])
    rows = rows.round({"gap_caused": 2, "numerics_gap": 2}).assign(
        detectable=rows["detectable"].map({True: "yes", False: "no"})
    )
    return [Heading(heading), _table(rows[columns].set_index("id"))]


def _table(frame: pd.DataFrame) -> TableBlock:
    rows = tuple((str(name), *map(_cell, row)) for name, row in frame.iterrows())
    return TableBlock((frame.index.name, *map(str, frame.columns)), rows)


def _cell(value: object) -> str:
    """The value as text; nothing for a count of zero, and for a number that is not known."""
    return value if isinstance(value, str) else str(value) if value and not math.isnan(value) else ""


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def metrics(trials: pd.DataFrame) -> dict[str, float]:
    """The rates and medians by name, for a dashboard."""
    return {f"{row.what}, {row.group}": float(row.value) for row in rates(trials).itertuples()}


def mlflow_records(folder: Path) -> list[Record]:
    """The set as one run of MLflow with every score, so that sets can be compared."""
    place = folder / "trials.parquet"
    trials = tables.read(TRIALS, place)
    scores = {_mlflow_name(name): value for name, value in metrics(trials).items()}
    counts = {f"trials/{kind}": float(count) for kind, count in trials["kind"].value_counts().items()}
    pictures = sorted(path for path in folder.iterdir() if path.suffix in (".svg", ".png"))
    return [
        Record(
            "blind",
            metrics=counts | {name: value for name, value in scores.items() if not name.startswith("seconds")},
            costs={name: value for name, value in scores.items() if name.startswith("seconds")},
            datasets=(Dataset(TRIALS.name, place, "result"),),
            files={"summary.md": folder / "summary.md"} | {f"figures/{path.name}": path for path in pictures},
        )
    ]


def _mlflow_name(name: str) -> str:
    """A name that MLflow allows, which takes no comma and no %; it groups by what stands before a slash."""
    return name.replace(": ", "/").replace(", ", "/").replace("%", "percent")
