"""A campaign on one page, for someone who was not there."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from jointgap.campaign import page_writer as page
from jointgap.campaign.page_writer import Block, Heading, Listing, Picture, Rows, Text
from jointgap.campaign.phrasing import (
    ENOUGH,
    answer,
    effect_in_words,
    explanation_in_words,
    held_out_in_words,
    is_fault,
    joined,
    label_in_words,
    number,
    parameter_rows,
    percent,
    place_of,
    rounded,
    size_in_words,
    with_error,
)
from jointgap.campaign.preflight import assumed, failures

_MOST_WINDOWS = 5

_WHEN = {"base": "before", "augmented": "after"}

_LINKS = {"crank": "crank_length", "rod": "rod_length"}
"""Columns of table `jointgap.tables.OPTIMUM` by what they are of."""

_ONE_SIDED = 0.7  # share of the root mean square that is the mean: above, measurement and model differ to one side

_PLAIN = (*ENOUGH, "named")
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
        *_optimum(verdict["effects"], tables.get("optimum")),
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
        said.append(Listing(tuple(explanation_in_words(one) for one in verdict["equivalent"])))
        said += [Text(advice) for advice in [verdict.get("separated_by", "")] if advice]
    return said + table


def _gap(verdict: Mapping[str, Any], gaps: pd.DataFrame | None) -> list[Block]:
    added = bool(verdict["effects"])
    meaning = "The gap is the residual in standard deviations of the noise (root mean square): 1 is noise alone."
    told: list[Block] = [
        Heading("How far simulation and measurement are apart"),
        Text(f"{meaning} {held_out_in_words(verdict)}."),
    ]
    told += _parts_of_runs(verdict)
    if gaps is not None:
        own = gaps[(gaps["channel"] == "all") & (gaps["role"] == "confirm") & (gaps["run"] != "all")]
        when = ("before", "after") if added else ("before",)
        rows = tuple((row["run"], *(_interval(row, each) for each in when)) for row in own.to_dict("records"))
        heads = [f"gap {each} (90 % interval)" for each in when] if added else ["gap (90 % interval)"]
        told.append(Rows(("held-out run", *heads), rows))
    return [*told, Picture("gaps"), *([Picture("residuals")] if added else [])]


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
    return f"{rounded(row[when])} ({rounded(low)} to {rounded(high)})" if row[when] == row[when] else "–"


def _where(verdict: Mapping[str, Any], windows: pd.DataFrame | None) -> list[Block]:
    places = [
        place_of(one["run"], one["channel"], *one["crank_angle_deg"]) + f" (p = {one['p_adjusted']:.1g})"
        for one in verdict["where"]
    ]
    if windows is not None and len(windows):
        places = [_window(row) for row in windows.sort_values("rms", ascending=False).itertuples(index=False)]
    without = " without what was added" if verdict["effects"] else ""
    if not places:
        return [
            Heading("Where it shows"),
            Text(f"At no crank angle does the recalibrated model{without} stand out of the noise by itself."),
            Picture("disagreement"),
        ]
    more = len(places) - _MOST_WINDOWS
    further = [f"and {more} more windows (map of disagreement)"] if more > 0 else []
    return [
        Heading("Where it shows"),
        Text(f"The measurement differs from the model{without}, its parameters re-fitted, at:"),
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
    if verdict["verdict"] in ENOUGH:
        return []
    named = verdict["effects"]
    gains = joined(f"{_gain(effect)} for {effect_in_words(effect)}" for effect in named)
    evidence = [Text(f"Gain in BIC: {gains}; 10 would be very strong evidence.")] if named else []
    force = [] if all(map(is_fault, named)) else [Picture("missing_force")]
    return [Heading("What else was tried"), *evidence, Picture("ranking"), *force]


def _gain(effect: Mapping[str, Any]) -> str:
    return "not known" if effect["delta_bic"] is None else f"{effect['delta_bic']:.0f}"


def _optimum(effects: Sequence[Mapping[str, Any]], optimum: pd.DataFrame | None) -> list[Block]:
    if optimum is None:
        return []
    heading = Heading("Does it move the optimum?")
    if all(map(is_fault, effects)):
        return [heading, Text("Nothing was added to the mechanism, so there is nothing that could move it.")]
    if optimum.empty:
        words = (
            "No: all joints are ideal, so the transmission angle follows from the lengths alone, whatever forces act."
        )
        return [heading, Text(words)]
    meaning = (
        "At the optimal lengths the RMS error of the transmission angle is smallest, with the motion in the joints as it is at the "
        "original lengths; how far it falls is counted from the error at those."
    )
    said = []
    for model, reason in optimum.dropna(subset=["failed"]).set_index("model")["failed"].items():
        said.append(f"The model {_WHEN[model]} the effects were added could not be optimised again ({reason}).")
    for source, own in optimum[optimum["failed"].isna()].groupby("source", sort=False):
        own = own.set_index("model")
        if {"base", "augmented"} <= set(own.index):
            said.append(f"Motion from the {source.replace('_', ' ')}: {_optimal(own)}.")
        elif not said:  # a joint became loose
            own = own.head(1)
            lengths = joined(f"{words} {1e3 * own[key].iloc[0]:.2f} mm" for words, key in _LINKS.items())
            said.append(
                f"Before, all joints were ideal, and there was nothing to optimise; after, the optimal lengths are {lengths}{_edge(own)}."
            )
    return [heading, Text(meaning), Listing(tuple(said)), Picture("optimum")]


def _optimal(own: pd.DataFrame) -> str:
    """Optimal lengths and what they gain, from rows base and augmented."""
    before, after = own.loc["base"], own.loc["augmented"]
    pairs = [(words, 1e3 * before[key], 1e3 * after[key]) for words, key in _LINKS.items()]
    moves = joined(
        f"the {words} from {one:.2f} to {other:.2f} mm ({100.0 * (other / one - 1.0):+.2f} %)"
        for words, one, other in pairs
    )
    falls = [percent(row["reduction"]) for row in (before, after)]
    return f"optimal lengths move, {moves}; the error falls by {falls[0]} before and by {falls[1]} after{_edge(own)}"


def _edge(own: pd.DataFrame) -> str:
    """Tells of which model in `own` the optimum proper may lie beyond what was searched."""
    found = joined(_WHEN[model] for model in _WHEN if model in own.index and own.loc[model, "at_edge"])
    return f"; {found}, the optimum lies at the edge of the lengths that were searched" if found else ""


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
    failed = {} if effects is None else failures(effects)
    if absent := [label for label in verdict["preflight"]["undetectable"] if label not in failed]:
        lines.append(
            f"Not detectable with these runs and channels, so nothing is said about: {joined(map(label_in_words, absent))}."
        )
    if failed:
        lost = joined(f"{label_in_words(label)} ({reason})" for label, reason in failed.items())
        lines.append(f"Could not be simulated in the preflight, so what size of it would show is not known: {lost}.")
    if effects is not None:
        lines += _foreseen(verdict, effects)
    return [Heading("How sure, and what these data cannot show"), Listing(tuple(lines))]


def _foreseen(verdict: Mapping[str, Any], effects: pd.DataFrame) -> list[str]:
    """What would have been seen, and on what assumptions that rests; `effects` is table `jointgap.tables.DETECTABLE`."""
    lines = []
    found = effects[effects["detectable"]].sort_values("label")
    if verdict["verdict"] in ENOUGH and len(found):
        sizes = [
            f"{label_in_words(row.label)} "
            f"({size_in_words(row.parameter, number(row.smallest_detectable), row.unit, row.falls)})"
            for row in found.itertuples()
        ]
        lines.append(f"What would have been seen, from this size on: {', '.join(sizes)}.")
    if assumed(effects):
        lines.append(
            "What can be seen and told apart is reckoned from the plan alone, with assumed noise where the campaign states none "
            "(`jointgap preflight` lists it)."
        )
    return lines


def _capital(sentence: str) -> str:
    first = sentence if "_" in sentence.split(" ")[0] else sentence[:1].upper() + sentence[1:]  # names stay as they are
    return first.rstrip(".")
