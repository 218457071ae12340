"""The page of a campaign."""

from collections.abc import Iterable, Mapping, Sequence
from math import pi
from typing import Any

import pandas as pd

from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT, failures, noted
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.fits_on_disk import (
    assumed,
    confusable_groups,
    failures_of_preflight,
    gap_of,
    held_out,
    undetectable,
)
from jointgap.campaign.plan import preflight_tables_with_advice, separated_by
from jointgap.campaign.sentences import (
    ENOUGH,
    answer,
    best_known_in_words,
    effect_in_words,
    estimate_row,
    explanation_in_words,
    headline,
    held_out_in_words,
    is_fault,
    is_told_by_features,
    label_in_words,
    left_out_in_words,
    parameter_rows,
    place_of,
    share_explained,
    shown_size,
    without_code_names,
)
from jointgap.campaign.state import CampaignState
from jointgap.config.campaign_file import Campaign
from jointgap.config.nuisance_bounds import NUISANCES
from jointgap.core.page import (
    Block,
    Bullets,
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    to_html,
    to_markdown,
    written_today,
)
from jointgap.core.parquet import write_text
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.words import (
    day_in_words,
    in_words,
    joined,
    nuisance_in_words,
    number,
    percent,
    rounded_gap,
    unit_in_words,
    with_unit,
)
from jointgap.identification.fit import AT_BOUND, CHANGES_NOTHING, NOT_ESTIMATED, Fit
from jointgap.identification.settings import DEFAULT_SETTINGS

_MOST_WINDOWS = 5  # the largest disagreements; the map shows all

_WHEN = {"base": "before", "augmented": "after"}

_PARAMETER_HEADS = ("parameter", "value", "90 % interval", "")

_IN_EVERY_FIT = ("first_angle", "friction_speed", "lasting_damping")
"""How names of parameters begin that a fit has though nobody listed them."""

_LINKS = {"crank": "crank_length", "rod": "rod_length"}
"""Columns of table `CAMPAIGN_OPTIMUM` by what they are of."""

_ONE_SIDED = 0.7  # share of the root mean square that is the mean: above, measurement and model differ to one side

_BELOW_NOISE = 0.85  # a gap whose whole interval is below is less than noise

_PLAIN = (*ENOUGH, "named")
"""Verdicts whose sentence holds the reason."""

Tables = Mapping[str, pd.DataFrame | None]


def page(
    verdict: Mapping[str, Any], tables: Tables, warnings: Sequence[str] = (), campaign: Campaign | None = None
) -> Page:
    """The one-page summary of a campaign."""
    return Page(
        title(verdict),
        (
            *_answer(verdict),
            *_measured(verdict, tables.get("channel_errors"), tables.get("gaps")),
            *_gap(verdict, tables.get("gaps")),
            *_where(verdict, tables.get("map_windows")),
            *_why(verdict, tables.get("missing_force")),
            *_optimum(verdict["effects"], tables.get("campaign_optimum")),
            *_nuisances(verdict),
            *_limits(verdict, tables.get("detectable")),
            *_next_steps(verdict),
            *_data(campaign, tables.get("look"), warnings),
        ),
        subject=f"Campaign {verdict['campaign']}",
        footer=f"{written_today()} The same for programs: "
        f"`{VERDICT}`. Every compared sample, fit and interval: the Parquet tables beside it (`jointgap describe FILE` "
        "explains their columns).",
        width="60rem",
    )


def title(verdict: Mapping[str, Any]) -> str:
    """The answer in a line, with its number and interval."""
    if verdict["effects"]:
        return _capital(headline(verdict["effects"]) + _widened(verdict))
    best = verdict["best_known"]
    share = best and share_explained(best)
    part = f"in part ({share})" if share else "in part"
    return {
        "no_disagreement": "Nothing is missing that these data could show",
        "parameters_only": "Nothing is missing: other values of uncertain parameters meet the measurement",
        "ambiguous": f"Something is missing: {len(verdict['equivalent'])} explanations fit equally well",
    }.get(
        verdict["verdict"],
        f"Something is missing; explained {part}: {headline(best['effects'])}{_widened(verdict)}"
        if best
        else "Something is missing that none of the effects tried explains",
    )


def _widened(verdict: Mapping[str, Any]) -> str:
    """That intervals are wider than noise makes them, where that is worth a word."""
    factor = verdict.get("interval_factor", 1.0)
    return f"; more than noise is left, so intervals are {factor:.1f} times as wide" if factor >= 1.1 else ""


def _figure(name: str) -> FigureBlock:
    return FigureBlock(name, FIGURES[name].title, FIGURES[name].caption)


def _answer(verdict: Mapping[str, Any]) -> list[Block]:
    rows = parameter_rows(verdict["effects"])
    table = [TableBlock(_PARAMETER_HEADS, rows)] if rows else []
    blocks: list[Block] = [Paragraph(text, strong=True) for text in (answer(verdict), *left_out_in_words(verdict))]
    if verdict["verdict"] not in _PLAIN and (reason := verdict.get("because")):
        blocks.append(Paragraph(_capital(without_code_names(reason)) + "."))
    if says := best_known_in_words(verdict):
        shown = parameter_rows(verdict["best_known"]["effects"])
        blocks.append(Paragraph("The best explanation, which explains a part and is not proven:"))
        blocks += [TableBlock(_PARAMETER_HEADS, shown)] if shown else []
        blocks.append(Bullets(says))
    if verdict["verdict"] == "ambiguous":
        blocks.append(Bullets(tuple(explanation_in_words(effects) for effects in verdict["equivalent"])))
        advice = verdict.get("separated_by", "")
        blocks += [Paragraph(without_code_names(advice))] if advice else []
    return [*blocks, _figure("measured_against_model"), *table, *map(Paragraph, _motions(verdict["effects"]))]


def _motions(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """From which start the motion of each run came, of effects that let a mechanism have several steady ones."""
    sentences = []
    for effect in effects:
        starts = {key.partition("@")[2]: number for key, number in effect.get("choices", {}).items()}
        if any(starts.values()):
            found = joined(f"of {run} from start {number}" for run, number in starts.items())
            sentences.append(
                f"With a {effect_in_words(effect)} the mechanism may have several steady motions under the same "
                f"parameters. The motion {found} meets what was measured; start 0 is the usual one, the others begin "
                "earlier."
            )
    return sentences


_ERROR_HEADS = ("run", "crank speed [rpm]", "used", "channel", "unit", "noise", "RMS before", "RMS after", "explained")


def _measured(verdict: Mapping[str, Any], errors: pd.DataFrame | None, gaps: pd.DataFrame | None) -> list[Block]:
    """Measured against model, in the unit of each channel; `errors` is table `CHANNEL_ERRORS`, `gaps` table `GAPS`."""
    if errors is None:
        return []
    shares = {} if gaps is None else {(row.run, row.role, row.channel): row for row in gaps.itertuples()}
    shown = _something_tried(verdict)
    rows = []
    for row in errors.itertuples():
        gap = shares.get((row.run, "confirm" if row.held_out else "identify", row.channel))
        numbers = (row.noise, row.before, *([row.after] if shown else []))
        rows.append(
            (
                row.run,
                f"{30.0 / pi * row.speed:.4g}",
                "held out" if row.held_out else "to fit",
                in_words(row.channel),
                unit_in_words(row.unit),
                *("–" if each != each else f"{each:.3g}" for each in numbers),
                *([_share_explained(gap)] if shown else []),
            )
        )
    heads = _ERROR_HEADS if shown else _ERROR_HEADS[:7]
    after = (
        " After: with the effects above. Explained: the share of the mean square beyond noise that is gone; a dash "
        "where before there was no more than noise."
    )
    caption = (
        "Measured less predicted, root mean square (RMS) in the unit of each channel. Before: the model with nothing "
        "added, its uncertain parameters re-fitted. Noise: what the sensors' noise and equally good numerics alone "
        "would make it."
    )
    return [
        Heading("Measured against model"),
        TableBlock(heads, tuple(rows), "lrlllrrrr"[: len(heads)], caption + after * shown),
    ]


def _share_explained(gap: Any) -> str:
    """Share of the squared excess over the noise that is gone, of a row of `GAPS`."""
    if gap is None or gap.closed != gap.closed or gap.before**2 <= DEFAULT_SETTINGS.decision.tolerated_reduced_chi2:
        return "–"
    return percent(min(gap.closed, 1.0), 0 if gap.closed > 0.995 else 1)


def _something_tried(verdict: Mapping[str, Any]) -> bool:
    """Whether there is a model with something added, or with the best or the first explanation."""
    return bool(verdict["effects"] or verdict["best_known"] or verdict["equivalent"])


def _gap(verdict: Mapping[str, Any], gaps: pd.DataFrame | None) -> list[Block]:
    best = "the best explanation known" if verdict["best_known"] else "the first of the explanations"
    tried = "" if verdict["effects"] else f" with {best}"
    shown = _something_tried(verdict)
    meaning = (
        "The gap is how far measured and predicted are apart, as root mean square in standard deviations of the "
        "noise: 1 is noise alone, 2 is twice what noise makes."
    )
    blocks: list[Block] = [
        Heading("How far simulation and measurement are apart"),
        Paragraph(f"{meaning} {held_out_in_words(verdict)}."),
    ]
    blocks += _parts_of_runs(verdict)
    if gaps is not None:
        own = gaps[(gaps["channel"] == "all") & (gaps["role"] == "confirm") & (gaps["run"] != "all")]
        when = ("before", "after") if shown else ("before",)
        rows = tuple((row["run"], *(_interval(row, each) for each in when)) for row in own.to_dict("records"))
        heads = [f"gap {each}{with_what} (90 % interval)" for each, with_what in zip(when, ("", tried), strict=False)]
        blocks.append(TableBlock(("held-out run", *(heads if shown else ["gap (90 % interval)"])), rows))
        blocks += _below_noise(gaps)
    return [*blocks, _figure("gaps"), *([_figure("residuals")] if shown else [])]


def _below_noise(gaps: pd.DataFrame) -> list[Block]:
    """Says which channels are met far better than their noise lets them."""
    gap, high = (gaps[f"after{end}"].fillna(gaps[f"before{end}"]) for end in ("", "_high"))
    low = gaps.assign(gap=gap)[(high < _BELOW_NOISE) & (gaps["channel"] != "all") & (gaps["run"] != "all")]
    if low.empty:
        return []
    channels = [
        f"{in_words(channel)} ({joined(f'{row.run} {rounded_gap(row.gap)}' for row in rows.itertuples())})"
        for channel, rows in low.groupby("channel", sort=False)
    ]
    return [
        Paragraph(
            f"Far below 1 is the gap of {joined(channels)}: less is left there than the noise, and what numerics leave "
            "open, would make, so that small disagreements are not seen. Where the noise is stated, correct `noise`; "
            "where it was found, something that differs from cycle to cycle was taken for noise, such as impacts that "
            "ring: state it."
        )
    ]


def _parts_of_runs(verdict: Mapping[str, Any]) -> list[Block]:
    """Says where held-out data are from a run that was used for fitting too."""
    shared = [run["run"] for run in verdict.get("held_out", ()) if run["part"] == "last_third"]
    if not shared:
        return []
    return [
        Paragraph(
            f"Held out of {joined(shared)} is the last third of a run that was used for fitting: weaker evidence than "
            "a run of its own."
        )
    ]


def _interval(row: Mapping[str, Any], when: str) -> str:
    low, high = (row[f"{when}_{end}"] for end in ("low", "high"))
    return f"{rounded_gap(row[when])} ({rounded_gap(low)} to {rounded_gap(high)})" if row[when] == row[when] else "–"


def _where(verdict: Mapping[str, Any], windows: pd.DataFrame | None) -> list[Block]:
    places = [place_of(window["run"], window["channel"], *window["crank_angle_deg"]) for window in verdict["where"]]
    if windows is not None and len(windows):
        places = [_window(row) for row in windows.sort_values("rms", ascending=False).itertuples(index=False)]
    without = " without what was added" if verdict["effects"] else ""
    if not places:
        return [
            Heading("Where it shows"),
            Paragraph(f"At no crank angle does the recalibrated model{without} stand out of the noise by itself."),
            *_orders(verdict),
            _figure("disagreement"),
        ]
    more = len(places) - _MOST_WINDOWS
    others = [f"and {more} more window{'s' if more > 1 else ''} (map of disagreement)"] if more > 0 else []
    return [
        Heading("Where it shows"),
        Paragraph(f"The measurement differs from the model{without}, its parameters re-fitted, at:"),
        Bullets((*places[:_MOST_WINDOWS], *others)),
        *_orders(verdict),
        _figure("disagreement"),
    ]


def _orders(verdict: Mapping[str, Any]) -> list[Block]:
    """Says which single orders of the crank hold most of what a channel misses."""
    if not verdict["orders"]:
        return []
    lines = tuple(
        f"run {line['run']}, {in_words(line['channel'])}: order {line['order']} ({line['order']} cycles per "
        f"revolution), amplitude {with_unit(number(line['amplitude']), unit_in_words(line['unit']))}, "
        f"{percent(line['share'])} of what exceeds the noise"
        for line in verdict["orders"]
    )
    return [
        Paragraph(
            "Most of the difference is one order of the crank, as a drive, teeth or poles make it, or a loose joint "
            "that rings after its impacts:"
        ),
        Bullets(lines),
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


def _why(verdict: Mapping[str, Any], force: pd.DataFrame | None) -> list[Block]:
    if verdict["verdict"] in ENOUGH:
        return []
    named = verdict["effects"]
    gains = joined(f"{_gain(effect)} for {effect_in_words(effect)}" for effect in named)
    meaning = (
        "The Bayesian information criterion (BIC) weighs how well a model fits against how many parameters it has; "
        "10 is very strong evidence."
    )
    evidence = [Paragraph(f"Gain in BIC: {gains}. {meaning}")] if named else [Paragraph(meaning)]
    told = [effect for effects in (named, *verdict["equivalent"]) for effect in effects]
    if is_told_by_features(verdict, told):
        evidence = [Paragraph("Ranked are the fits to samples, which do not decide here.")]
    pushes = force is None or len(force)  # a mass, a length or a clearance is no force
    shown = [_figure("missing_force")] if pushes and not all(map(is_fault, named)) else []
    return [Heading("What else was tried"), *evidence, _figure("ranking"), *shown]


def _gain(effect: Mapping[str, Any]) -> str:
    return "not known" if effect["delta_bic"] is None else f"{effect['delta_bic']:.0f}"


def _optimum(effects: Sequence[Mapping[str, Any]], optimum: pd.DataFrame | None) -> list[Block]:
    if optimum is None:
        return []
    heading = Heading("Does it move the optimum?")
    if all(map(is_fault, effects)):
        return [heading, Paragraph("Nothing was added to the mechanism, so there is nothing that could move it.")]
    if optimum.empty:
        words = (
            "No: all joints are ideal, so the transmission angle follows from the lengths alone, whatever forces act."
        )
        return [heading, Paragraph(words)]
    meaning = (
        "At the optimal lengths the RMS error of the transmission angle is smallest, with the motion in the joints "
        "as it is at the original lengths; how far it falls is counted from the error at those."
    )
    sentences = []
    for model, reason in optimum.dropna(subset=["failed"]).set_index("model")["failed"].items():
        sentences.append(f"The model {_WHEN[model]} the effects were added could not be optimised again ({reason}).")
    for source, own in optimum[optimum["failed"].isna()].groupby("source", sort=False):
        own = own.set_index("model")
        if {"base", "augmented"} <= set(own.index):
            sentences.append(f"Motion from the {source.replace('_', ' ')}: {_optimal(own)}.")
        elif not sentences:  # a joint became loose
            own = own.head(1)
            lengths = joined(f"{words} {1e3 * own[key].iloc[0]:.2f} mm" for words, key in _LINKS.items())
            sentences.append(
                "Before, all joints were ideal, and there was nothing to optimise; after, the optimal lengths are "
                f"{lengths}{_edge(own)}."
            )
    return [heading, Paragraph(meaning), Bullets(tuple(sentences)), _figure("optimum")]


def _optimal(own: pd.DataFrame) -> str:
    """Optimal lengths and what they gain, from rows base and augmented."""
    before, after = own.loc["base"], own.loc["augmented"]
    pairs = [(words, 1e3 * before[key], 1e3 * after[key]) for words, key in _LINKS.items()]
    moves = joined(
        f"the {words} from {old:.2f} to {new:.2f} mm ({100.0 * (new / old - 1.0):+.2f} %)" for words, old, new in pairs
    )
    falls = [percent(row["reduction"]) for row in (before, after)]
    return f"optimal lengths move, {moves}; the error falls by {falls[0]} before and by {falls[1]} after{_edge(own)}"


def _edge(own: pd.DataFrame) -> str:
    """Tells of which model in `own` the optimum proper may lie beyond what was searched."""
    when = joined(_WHEN[model] for model in _WHEN if model in own.index and own.loc[model, "at_edge"])
    return f"; {when}, the optimum lies at the edge of the lengths that were searched" if when else ""


def _nuisances(verdict: Mapping[str, Any]) -> list[Block]:
    if not verdict["nuisances"]:
        return []
    rows = tuple(
        estimate_row(nuisance_in_words(key), estimate, _unit_of_nuisance(key))
        for key, estimate in verdict["nuisances"].items()
    )
    return [
        Heading("Parameters re-fitted within their ranges"),
        TableBlock(_PARAMETER_HEADS, rows),
        *([Paragraph(_borne_out(verdict))] if verdict["verdict"] == "parameters_only" else []),
        *([Paragraph(text)] if (text := _at_bounds_beside_a_name(verdict)) else []),
        *([Paragraph(text)] if (text := _not_taken_over(verdict)) else []),
    ]


def _not_taken_over(verdict: Mapping[str, Any]) -> str:
    """Which shared parameters that were listed keep their stated value in the mechanism file; empty where none does."""
    shared = {key: own for key, own in verdict["nuisances"].items() if "@" not in key and _is_listed(key)}
    kept = [key for key, own in shared.items() if own.get("kept")]
    if not kept:
        return ""
    one = len(kept) == 1
    return (
        f"These data do not determine {_parameters_in_words(kept)}: `{MECHANISM}` keeps the "
        f"{'value' if one else 'values'} that you stated."
    )


def _unit_of_nuisance(key: str) -> str:
    """SI unit of a nuisance, also of those that every fit has."""
    units = NUISANCES | {"first_angle": "rad", "friction_speed": "m/s"}
    return units.get(key.partition("@")[0], "")


def _at_bounds_beside_a_name(verdict: Mapping[str, Any]) -> str:
    """That stated ranges may be too narrow, where parameters end at bounds beside what is named; else empty."""
    keys = [
        key for key, estimate in verdict["nuisances"].items() if estimate.get("remark") == AT_BOUND and _is_listed(key)
    ]
    if not keys or not verdict["verdict"].startswith("named"):
        return ""
    one = len(keys) == 1
    return (
        f"{_capital(_parameters_in_words(keys))} {'ends' if one else 'end'} at a bound of "
        f"{'its range' if one else 'their ranges'}. If {'it' if one else 'they'} cannot really be there, what is named "
        "takes up too little, or something else acts besides."
    )


def _borne_out(verdict: Mapping[str, Any]) -> str:
    """Which of the parameters the data bear out, where these alone are said to meet the measurement."""
    remarks = {key: estimate.get("remark") for key, estimate in verdict["nuisances"].items() if _is_listed(key)}
    at_bound = [key for key, remark in remarks.items() if remark == AT_BOUND]
    untold = [key for key, remark in remarks.items() if remark in (CHANGES_NOTHING, NOT_ESTIMATED)]
    inside = [key for key in remarks if key not in (*at_bound, *untold)]
    says = []
    if inside:
        says.append(
            f"The data bear out {_parameters_in_words(inside)}: fitted inside "
            f"{'its range' if len(inside) == 1 else 'their ranges'}, with the interval above. "
            "Take over those whose interval is narrower than what you knew of them."
        )
    if at_bound:
        one = len(at_bound) == 1
        says.append(
            f"Do not take over {_parameters_in_words(at_bound)}: {'it ends' if one else 'they end'} at a bound. Either "
            "the data hardly tell (see the interval), or they ask for something beyond it, or "
            f"{'it takes' if one else 'they take'} up what is not in the model."
        )
    if untold:
        own = "its value is" if len(untold) == 1 else "their values are"
        says.append(f"The data say nothing of {_parameters_in_words(untold)}: {own} as you stated.")
    return " ".join(says)


def _is_listed(key: str) -> bool:
    """Whether a user listed a parameter, other than those that every fit has."""
    return not key.startswith(_IN_EVERY_FIT)


def _parameters_in_words(keys: Sequence[str]) -> str:
    """``slider mass and crank speed of run slow`` of keys of nuisances."""
    return joined(map(nuisance_in_words, keys))


def _limits(verdict: Mapping[str, Any], effects: pd.DataFrame | None) -> list[Block]:
    rate = verdict["false_alarm_rate"]
    lines = [
        f"Where nothing is missing, {100.0 * rate:.3g} % of such campaigns would name an effect all the same: the "
        "thresholds are set by simulated campaigns with nothing hidden, other numerics included."
    ]
    merged = verdict["preflight"]["merged"]
    lines += [
        f"These look alike in this experiment and count as one: {joined(map(label_in_words, group))}."
        for group in merged
    ]
    failed = {} if effects is None else failures_of_preflight(effects)
    explanations = [verdict["effects"], *verdict["equivalent"], (verdict["best_known"] or {}).get("effects", ())]
    told = {(effect["name"], effect["site"]) for explanation in explanations for effect in explanation}
    if absent := [
        label
        for label in verdict["preflight"]["undetectable"]
        if label not in failed and not any(label in (name, f"{name}:{site}") for name, site in told)
    ]:
        lines.append(
            "Not detectable with these runs and channels, so nothing is said about: "
            f"{joined(map(label_in_words, absent))}."
        )
    if failed:
        lost = joined(f"{label_in_words(label)} ({reason})" for label, reason in failed.items())
        lines.append(f"Could not be simulated in the preflight, so what size of it would show is not known: {lost}.")
    if effects is not None:
        lines += _foreseen(verdict, effects)
    return [Heading("How sure, and what these data cannot show"), Bullets(tuple(lines))]


def _foreseen(verdict: Mapping[str, Any], effects: pd.DataFrame) -> list[str]:
    """What would have been seen, and on what assumptions that rests; `effects` is table `DETECTABLE`."""
    lines = []
    seen = effects[effects["detectable"]].sort_values("label")
    if verdict["verdict"] in ENOUGH and len(seen):
        sizes = [
            f"{label_in_words(row.label)} "
            f"({shown_size(row.label, row.parameter, row.smallest_detectable, row.unit, row.falls)})"
            for row in seen.itertuples()
        ]
        lines.append(f"What would have been seen, from this size on: {', '.join(sizes)}.")
    if assumed(effects):
        lines.append(
            "What can be seen and told apart is reckoned from the plan alone, with assumed noise where the campaign "
            "states none (`jointgap preflight` lists it)."
        )
    return lines


_NEXT = {
    "no_disagreement": (
        "Use the model as it stands, at these speeds and with what these channels show.",
        "To look for smaller effects, measure at a further speed or with a further channel: `jointgap preflight` says "
        "which helps most.",
    ),
    "parameters_only": (
        f"Take over what the data bear out: `{MECHANISM}` has it.",
        "To look for smaller effects, measure at a further speed or with a further channel: `jointgap preflight` says "
        "which helps most.",
    ),
    "ambiguous": (
        "Measure what parts the explanations, and run the campaign again with the new run beside the old ones.",
        "Until then take none of them for true; all of them predict what was measured here.",
    ),
    "unexplained": (
        "See in the map of disagreement and in the residuals where and when it acts, and what on the rig acts there.",
        "An effect of your own can be added as a formula: `jointgap effects discovered_slider_force` shows the lines.",
        "Give uncertain masses, lengths and zeros under `nuisance` of the campaign file, and run it again.",
    ),
}


def _next_steps(verdict: Mapping[str, Any]) -> list[Block]:
    """What to do about the verdict."""
    if verdict["effects"]:
        faults = [effect for effect in verdict["effects"] if is_fault(effect)]
        physical = len(faults) < len(verdict["effects"])
        steps = [
            f"Mend the sensor or correct its column: {explanation_in_words(faults)}." if faults else "",
            f"Use `{MECHANISM}`: your mechanism with what was found. Name it under `mechanism` of a scenario to "
            "simulate and optimise with it."
            if physical
            else "",
            "On the rig, change what is named (oil, load, fit), measure again and run the same campaign: the size "
            "should move with it."
            if physical
            else "",
            "A rest is left: the map of disagreement shows where."
            if verdict["verdict"] == "named_with_remaining_misfit"
            else "",
        ]
    else:
        steps = list(_NEXT.get(verdict["verdict"], ()))
    return [Heading("What to do next"), Bullets(tuple(filter(None, steps)))]


_ROLES = {
    "identify": "to fit and to choose",
    "confirm": "held out",
    "split": "two thirds to fit and to choose, the last third held out",
}


def _data(campaign: Campaign | None, look: pd.DataFrame | None, warnings: Sequence[str]) -> list[Block]:
    """The runs with their files, the channels, and what was noticed; `look` is table `LOOK`."""
    blocks: list[Block] = []
    if campaign is not None:
        sizes = {} if look is None else look.groupby("run")[["samples", "cycles"]].max().to_dict("index")
        rows = tuple(
            (
                run.id,
                f"`{run.file}`",
                f"{30.0 / pi * run.speed:.4g}",
                _ROLES[run.role],
                *(str(sizes[run.id][key]) if run.id in sizes else "–" for key in ("samples", "cycles")),
            )
            for run in campaign.runs
        )
        heads = ("run", "file", "crank speed [rpm]", "used", "samples", "whole revolutions")
        measured = f" Measured on {day_in_words(campaign.date)}." if campaign.date else ""
        blocks.append(TableBlock(heads, rows, "llrlrr", f"Runs of the campaign.{measured}"))
        channels = tuple(
            (in_words(name), f"`{channel.column}`", unit_in_words(channel.unit))
            for name, channel in campaign.channels.items()
        )
        blocks.append(TableBlock(("channel", "column of the files", "unit"), channels, caption="What was measured."))
    if warnings:
        blocks.append(Bullets(tuple(map(without_code_names, warnings))))
    return [Heading("About the data"), *blocks] if blocks else []


def _capital(sentence: str) -> str:
    return (sentence[:1].upper() + sentence[1:]).rstrip(".")


def conclude(state: CampaignState, advise: bool = True) -> dict[str, Any]:
    """Write ``verdict.json``; its content."""
    folder, outcome, separated = state.folder, state.outcome("verdict"), ""
    if advise and "preflight" not in failures(folder):
        with noted(folder, "advice"):
            separated = _separated_by(state, outcome.equivalent)
    detectable, confusability, gaps = (folder.read(name) for name in ("detectable", "confusability", "gaps"))
    added = outcome.named is not None
    content = verdict_json.document(
        state.campaign.name,
        outcome,
        folder.read("map_windows"),
        gaps,
        {role: gap_of(gaps, role, added=added) for role in ("identify", "confirm")},
        held_out(gaps, {run.id: run.role for run in state.campaign.runs}, added),
        {"undetectable": undetectable(detectable), "merged": confusable_groups(confusability)},
        state.false_alarm_rate,
        separated,
        state.clockwise,
        folder.read("map_standout"),
        state.doubted_channels,
        folder.read("law_families"),
        not any(series.statistic for series in state.model.series),
    )
    content["left_out"] = [{"run": run, "because": why} for run, why in state.model.left_out.items()]
    content["failed"] = failures(folder)
    write_text(folder.path / VERDICT, verdict_json.text(content))
    return content


def show(state: CampaignState) -> None:
    """Draw the figures and write the one-page summary of a verdict that is there."""
    from jointgap.core import plot

    folder = state.folder
    content = verdict_json.read(folder.path / VERDICT)
    frames = figure_tables(folder, FIGURES.needed_tables(FIGURES))
    for name, spec in FIGURES.items():
        with noted(folder, name):
            plot.save(FIGURES.draw(name, frames, content), folder.path / "figures" / name)
        if why := failures(folder).get(name):
            with plot.matplotlib_style():
                plot.save(plot.message_sheet(spec.title, f"could not be drawn: {why}"), folder.path / "figures" / name)
    content["failed"] = failures(folder)
    summary = Page(f"Campaign {content['campaign']}: {answer(content)}", (Paragraph(f"All else: {VERDICT}"),))
    with noted(folder, "page"):
        remarks = (*folder.read("remarks")["remark"], *_noise_remarks(state))
        summary = page(content, frames | {"look": folder.read("look")}, remarks, state.campaign)
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, to_markdown(summary))
    write_text(html, to_html(summary, folder.path / "figures"))
    if (failed := failures(folder)) != verdict_json.read(folder.path / VERDICT).get("failed", {}):
        write_text(folder.path / VERDICT, verdict_json.text(content | {"failed": failed}))


def figure_tables(folder: ResultsFolder, names: Iterable[str]) -> dict[str, pd.DataFrame]:
    """Those of the tables `names`, which figures need, that are in the `folder` of a campaign; by name."""
    stages = {"ranking": "verdict"}  # written by several stages, of which the last one counts
    places = {name: (name, stages.get(name, "")) for name in names}
    return {name: folder.read(*place) for name, place in places.items() if folder.place(*place).is_file()}


def _noise_remarks(state: CampaignState) -> list[str]:
    memory = state.folder.read("noise_memory", "noise").query("lag == 0")
    return [f"Run {row.run}: {text}." for row in memory.itertuples() for text in row.remarks.split("; ") if text]


def _separated_by(state: CampaignState, equivalent: list[Fit]) -> str:
    """Which experiment would tell the explanations apart, in a sentence; empty where there is but one.

    Where advice has not been sought yet, all tables of the preflight are written again.
    """
    if not equivalent:
        return ""
    folder = state.folder
    if not folder.place("advice").is_file():
        of_preflight = state.campaign, state.false_alarm_rate, state.settings
        folder.write_all(preflight_tables_with_advice(*of_preflight))
    explanations = [{candidate.label for candidate in fit.hypothesis} for fit in equivalent]
    return separated_by(folder.read("advice"), explanations, confusable_groups(folder.read("confusability")))
