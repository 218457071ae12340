"""A campaign on one page, for someone who was not there."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from jointgap.campaign import page
from jointgap.campaign.page import Block, Heading, Listing, Picture, Rows, Text
from jointgap.campaign.words import (
    effect_in_words,
    joined,
    label_in_words,
    number,
    parameter_rows,
    place_of,
    with_error,
)

_MOST_WINDOWS = 5
_WEAK = 1.2  # a gap after of up to this is called noise: the seed of noise alone moves it by less

_ONE_SIDED = 0.7  # share of the root mean square that is the mean: above, measurement and model differ to one side

_PLAIN = ("no_disagreement", "parameters_only", "named")
"""Verdicts whose sentence holds the reason."""

Tables = Mapping[str, pd.DataFrame | None]


def markdown(verdict: Mapping[str, Any], tables: Tables, remarks: Sequence[str] = (), figures: str = "figures") -> str:
    """The summary as Markdown.

    Parameters
    ----------
    verdict : mapping
        Content of ``verdict.json``.
    tables : mapping of str to DataFrame
        ``gaps``, ``windows``, ``effects`` (of the preflight), ``optimum``: those that there are.
    remarks : sequence of str
        What was noticed about the data, a sentence each.
    figures : str
        Folder of the figures, relative to the page.
    """
    return page.markdown(title(verdict), blocks(verdict, tables, remarks), figures)


def html(verdict: Mapping[str, Any], tables: Tables, remarks: Sequence[str] = (), figures: str = "figures") -> str:
    """The summary as a page that holds its figures; `figures` is the folder of their PNG files, else as `markdown`."""
    return page.html(title(verdict), blocks(verdict, tables, remarks), figures)


def title(verdict: Mapping[str, Any]) -> str:
    """Heading of the page."""
    return f"Campaign {verdict['campaign']}: what is missing in the model"


def blocks(verdict: Mapping[str, Any], tables: Tables, remarks: Sequence[str] = ()) -> list[Block]:
    """What the page says, in order."""
    return [
        *_answer(verdict),
        *_gap(verdict, tables.get("gaps")),
        *_where(verdict, tables.get("windows")),
        *_why(verdict),
        *_optimum(tables.get("optimum")),
        *_nuisances(verdict),
        *_limits(verdict, tables.get("effects")),
        *([Heading("About the data"), Listing(tuple(remarks))] if remarks else []),
        Text(
            "Numbers: verdict.json. Every compared sample, fit and interval: the Parquet tables beside it (`jointgap describe` "
            "explains their columns)."
        ),
    ]


def _answer(verdict: Mapping[str, Any]) -> list[Block]:
    rows = parameter_rows(verdict["effects"])
    table = [Rows(("parameter", "value", "standard error", "90 % interval"), rows)] if rows else []
    said = [Text(answer(verdict), strong=True)]
    if verdict["verdict"] not in _PLAIN and (reason := verdict.get("because")):
        said.append(Text(_capital(reason) + "."))
    if verdict["verdict"] == "ambiguous":
        said.append(Listing(tuple(_explanation(one) for one in verdict["equivalent"])))
        said += [Text(advice) for advice in [verdict.get("separated_by", "")] if advice]
    return said + table


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict in a sentence or two."""
    effects = joined(effect_in_words(effect) for effect in verdict["effects"])
    are = "are" if len(verdict["effects"]) > 1 else "is"
    count = len(verdict["equivalent"])
    return {
        "no_disagreement": "Nothing is missing that these data could show: the model as it stands meets the measurement within the "
        "noise.",
        "parameters_only": "No effect is missing: with other parameters within their stated ranges the model meets the measurement "
        "within the noise.",
        "named": f"Missing in the model {are} {effects}. With this added the model meets the measurement within the noise.",
        "named_with_remaining_misfit": f"Missing in the model {are} {effects}. This closes most of the gap, but not all: a small "
        "rest is left that none of the effects tried explains.",
        "ambiguous": f"Something is missing, but these data cannot tell what: {count} explanations fit equally well. None of them "
        "was added to the model.",
        "unexplained": "Something is missing, and it is none of the effects tried: the model and the measurement disagree by more "
        "than the noise, and no explanation holds. No effect was added to the model.",
    }[verdict["verdict"]]


def _explanation(effects: Sequence[Mapping[str, Any]]) -> str:
    values = [
        f"{name} {number(one['value'])}" for effect in effects for name, one in effect.get("parameters", {}).items()
    ]
    return joined(effect_in_words(effect) for effect in effects) + (f" ({', '.join(values)})" if values else "")


def _gap(verdict: Mapping[str, Any], gaps: pd.DataFrame | None) -> list[Block]:
    confirm, added = verdict["gap"]["confirm"], bool(verdict["effects"])
    meaning = "The gap is the residual in standard deviations of the noise (root mean square): 1 is noise alone."
    if added and confirm["after"] is None:
        found = (
            f"On data that took no part in fitting or choosing it is {_two(confirm['before'])} before anything is added; "
            f"after is not known for all of them. {_not_simulated(verdict)}"
        )
    elif added:
        falls = confirm["after"] < confirm["before"]
        found = (
            f"On data that took no part in fitting or choosing it {'falls' if falls else 'does not fall: it goes'} from "
            f"{_two(confirm['before'])} to {_two(confirm['after'])}"
        )
        if falls and confirm["before"] > 1.0:
            closed = 1.0 - (confirm["after"] ** 2 - 1.0) / (confirm["before"] ** 2 - 1.0)
            found += f": {_percent(min(closed, 1.0))} of what exceeds the noise is gone"
        if not falls and confirm["after"] > _WEAK:
            found += ", so what was added does not hold there"
        if confirm["after"] > _WEAK:
            found += (
                ". More than noise is left there: the effect, or what else the held-out data hold, is not all known"
            )
    else:
        found = f"On data that took no part in fitting it is {_two(confirm['before'])}"
    told: list[Block] = [Heading("How far simulation and measurement are apart"), Text(f"{meaning} {found}.")]
    told += _parts_of_runs(verdict)
    if gaps is not None:
        own = gaps[(gaps["channel"] == "all") & (gaps["role"] == "confirm") & (gaps["run"] != "all")]
        when = ("before", "after") if added else ("before",)
        rows = tuple((row["run"], *(_interval(row, each) for each in when)) for row in own.to_dict("records"))
        heads = [f"gap {each} (90 % interval)" for each in when] if added else ["gap (90 % interval)"]
        told.append(Rows(("held-out run", *heads), rows))
    return [*told, Picture("gaps"), *([Picture("residuals")] if added else [])]


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated with what was added, and why."""
    lost = [f"run {one['run']} ({one['not_simulated']})" for one in verdict["held_out"] if "not_simulated" in one]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"


def _parts_of_runs(verdict: Mapping[str, Any]) -> list[Block]:
    """Says where held-out data are from a run that was used for fitting too."""
    shared = [one["run"] for one in verdict.get("held_out", ()) if one["part"] == "last_third"]
    if not shared:
        return []
    return [
        Text(
            f"Held out of {joined(shared)} is the last third of a run that was used for fitting: weaker evidence than a run of its own."
        )
    ]


def _interval(row: Mapping[str, Any], when: str) -> str:
    low, high = (row[f"{when}_{end}"] for end in ("low", "high"))
    return f"{_two(row[when])} ({_two(low)} to {_two(high)})" if row[when] == row[when] else "–"


def _where(verdict: Mapping[str, Any], windows: pd.DataFrame | None) -> list[Block]:
    places = [
        place_of(one["run"], one["channel"], *one["crank_angle_deg"]) + f" (p = {one['p_adjusted']:.1g})"
        for one in verdict["where"]
    ]
    if windows is not None and len(windows):
        places = [_window(row) for row in windows.sort_values("rms", ascending=False).itertuples(index=False)]
    if not places:
        return [
            Heading("Where it shows"),
            Text("At no crank angle does the recalibrated model without the effect stand out of the noise by itself."),
            Picture("disagreement"),
        ]
    more = len(places) - _MOST_WINDOWS
    further = [f"and {more} more windows (map of disagreement)"] if more > 0 else []
    return [
        Heading("Where it shows"),
        Text("The measurement differs from the model before anything was added, its parameters re-fitted, at:"),
        Listing((*places[:_MOST_WINDOWS], *further)),
        Picture("disagreement"),
    ]


def _window(row) -> str:
    """One window of the map, and by how much measurement and model differ there."""
    size = f"by {row.rms:.1f} standard deviations of the noise (root mean square)"
    side = ("", ", mostly above the model", ", mostly below the model")[int((row.mean > 0) - (row.mean < 0))]
    return (
        place_of(row.run, row.channel, row.start_deg, row.end_deg)
        + f", {size}"
        + side * (abs(row.mean) > _ONE_SIDED * row.rms)
    )


def _why(verdict: Mapping[str, Any]) -> list[Block]:
    if verdict["verdict"] in ("no_disagreement", "parameters_only"):
        return []
    named = verdict["effects"]
    gains = joined(f"{_gain(effect)} for {effect_in_words(effect)}" for effect in named)
    evidence = [Text(f"Gain in BIC: {gains}; 10 would be very strong evidence.")] if named else []
    force = [Picture("missing_force")] if named else []
    return [Heading("What else was tried"), *evidence, Picture("ranking"), *force]


def _gain(effect: Mapping[str, Any]) -> str:
    return "not known" if effect["delta_bic"] is None else f"{effect['delta_bic']:.0f}"


def _optimum(optimum: pd.DataFrame | None) -> list[Block]:
    if optimum is None:
        return []
    if optimum.empty:
        words = (
            "No: all joints are ideal, so the transmission angle follows from the lengths alone, whatever forces act."
        )
        return [Heading("Does it move the optimum?"), Text(words)]
    if not {"base", "augmented"} <= set(optimum["model"]):
        return []
    said = []
    for source in optimum["source"].unique():
        own = optimum[optimum["source"] == source].set_index("model")
        if {"base", "augmented"} <= set(own.index):
            moves = [
                f"the {words} from {1e3 * own.loc['base', key]:.2f} to {1e3 * own.loc['augmented', key]:.2f} mm "
                f"({100.0 * (own.loc['augmented', key] / own.loc['base', key] - 1.0):+.2f} %)"
                for key, words in (("crank_length", "crank"), ("rod_length", "rod"))
            ]
            gains = [_percent(own.loc[model, "reduction"]) for model in ("base", "augmented")]
            said.append(
                f"Motion from the {source}: optimal lengths move, {joined(moves)}; the gain there is {gains[0]} before and "
                f"{gains[1]} after."
            )
    return [Heading("Does it move the optimum?"), Listing(tuple(said)), Picture("optimum")]


def _nuisances(verdict: Mapping[str, Any]) -> list[Block]:
    if not verdict["nuisances"]:
        return []
    rows = []
    for name, one in verdict["nuisances"].items():
        value, error = with_error(one["value"], one["sd"])
        rows.append((name.replace("@", ", run "), value, one.get("remark", error)))
    return [
        Heading("Parameters re-fitted within their ranges"),
        Rows(("parameter", "value [SI]", "standard error"), tuple(rows)),
    ]


def _limits(verdict: Mapping[str, Any], effects: pd.DataFrame | None) -> list[Block]:
    rate = verdict["false_alarm_rate"]
    lines = [
        f"Where nothing is missing, {100.0 * rate:.3g} % of such campaigns would name an effect all the same: the thresholds are set by simulated "
        "campaigns with nothing hidden, other numerics included."
    ]
    merged = verdict["preflight"]["merged"]
    lines += [
        f"These look alike in this experiment and count as one: {joined(map(label_in_words, group))}."
        for group in merged
    ]
    absent = verdict["preflight"]["undetectable"]
    if absent:
        lines.append(
            f"Not detectable with these runs and channels, so nothing is said about: {joined(map(label_in_words, absent))}."
        )
    if effects is not None and verdict["verdict"] in ("no_disagreement", "parameters_only"):
        found = effects[effects["detectable"]].sort_values("label")
        sizes = [
            f"{label_in_words(row.label)} {number(row.smallest_detectable)} {row.unit}".removesuffix(" 1").rstrip()
            for row in found.itertuples()
        ]
        if sizes:
            lines.append(f"What would have been seen, from this size on: {', '.join(sizes)}.")
    return [Heading("How sure, and what these data cannot show"), Listing(tuple(lines))]


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _two(value: float) -> str:
    return f"{value:.2f}" if value < 100 else f"{value:.0f}"


def _capital(sentence: str) -> str:
    first = sentence if "_" in sentence.split(" ")[0] else sentence[:1].upper() + sentence[1:]  # names stay as they are
    return first.rstrip(".")
