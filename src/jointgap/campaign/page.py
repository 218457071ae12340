"""The page of a campaign."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import pi
from typing import Any

import pandas as pd

from jointgap.campaign import labels
from jointgap.campaign import sentences as say
from jointgap.campaign.campaign_files import MECHANISM, VERDICT
from jointgap.campaign.facts import nuisances
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.plan import ADVICE
from jointgap.campaign.sentences import Verdict
from jointgap.campaign.tables import JOINED
from jointgap.config import Mechanism
from jointgap.config.campaign import NUISANCES, Campaign
from jointgap.config.linkage_file import LinkageFile
from jointgap.core import schema, words
from jointgap.core.page import (
    Block,
    Bullets,
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    written_today,
)
from jointgap.core.words import format_name, format_unit, joined, percent, reading_unit, rounded_gap
from jointgap.identification.fit import AT_BOUND
from jointgap.identification.settings import DEFAULT_SETTINGS

_MOST_WINDOWS = 7  # with the largest residuals; the map shows all
_UNLISTED = ("first_angle", "friction_speed", "lasting_damping")  # parameters of every fit
_BELOW_NOISE = 0.85  # if the whole interval of a gap is below, the noise is overestimated

Tables = Mapping[str, pd.DataFrame | None]


def page(
    verdict: Verdict,
    tables: Tables,
    figures: Collection[str] = tuple(FIGURES),
    warnings: Sequence[str] = (),
    campaign: Campaign | None = None,
    mechanism: str = MECHANISM,
) -> Page:
    """The one-page summary of a campaign.

    Parameters
    ----------
    verdict, tables
        Content of ``verdict.json`` and tables by name.
    figures : collection of str
        Those that were drawn.
    warnings : sequence of str
        Remarks on the data.
    campaign : Campaign, optional
        Or the file of a model of the user.
    mechanism : str
        The file of the mechanism with the effects; empty if there is none.
    """
    is_tested = verdict["effects"] or verdict["best_known"] or verdict["equivalent"]
    moments = ("before", "after") if is_tested else ("before",)
    ranges = NUISANCES if campaign is None else campaign.nuisance
    sections = {
        "": [*_answer(verdict), "measured_against_model", *_parameters(verdict["effects"])],
        "Measured against model": _measured(tables.get("channel_errors"), moments),
        "Gap between simulation and measurement": _gap(verdict, tables.get("gaps"), moments),
        "Location of the residual": _location(verdict, tables.get("map_windows")),
        "Tested explanations": _tested(verdict, tables.get("missing_force")),
        "Influence on the optimum": _optimum(
            verdict["effects"], tables.get("campaign_optimum"), campaign
        ),
        "Re-fitted parameters": _nuisances(verdict, ranges, mechanism),
        "Limits of these data": [
            Bullets(
                (
                    *_limits(verdict, tables.get("detectable"), tables.get("ranking")),
                    *untested_clearances(getattr(campaign, "mechanism", None)),
                )
            )
        ],
        "Next steps": [Bullets(_next_steps(verdict, mechanism))],
        "Data": _data(campaign, tables.get("look"), warnings),
    }
    blocks: list[Block] = []
    for heading, contents in sections.items():
        shown = [_figure(block) if isinstance(block, str) else block for block in contents]
        shown = [
            block for block in shown if not isinstance(block, FigureBlock) or block.stem in figures
        ]
        if heading and shown:
            blocks.append(Heading(heading))
        blocks += shown
    footer = (
        f"{written_today()} For programs: `{VERDICT}` and the Parquet tables (`jointgap"
        " describe FILE`)."
    )
    subject = say.subject(verdict)
    subject = subject[:1].upper() + subject[1:]
    return Page(say.title(verdict), tuple(blocks), subject, footer, width="60rem")


def _figure(name: str) -> FigureBlock:
    return FigureBlock(name, FIGURES[name].title, FIGURES[name].caption)


def frame_block(
    table: schema.Table,
    frame: pd.DataFrame,
    names: Iterable[str],
    caption: str,
    si: tuple[str, float] = ("", 1.0),
) -> Block:
    """Columns `names` of a `frame` of a `table` in reading units; `si`: unit and factor of columns
    in SI."""
    columns = {column.name: column for column in table.columns}
    heads, cells, align = [], [], ""
    for column in map(columns.get, names):
        unit, factor = si if column.unit == "SI" else reading_unit(column.unit)
        head = format_name(column.name.removesuffix("_deg"))
        if unit not in ("", "1") and " " not in unit:
            head += f" [{format_unit(unit)}]"
        heads.append(head)
        align += "l" if column.kind in ("text", "bool") else "r"
        cells.append([_cell(column, value, factor) for value in frame[column.name]])
    return TableBlock(tuple(heads), tuple(zip(*cells, strict=True)), align, caption)


def _cell(column: schema.Column, value: Any, factor: float) -> str:
    if value == "" or pd.isna(value):
        return "–"
    if column.kind == "float":
        return words.number(factor * value)
    if column.kind == "bool":
        return "yes" if value else "no"
    formats = dict.fromkeys(("channel", "source", "length"), format_name) | {"unit": format_unit}
    return formats.get(column.name, str)(value)


def _parameter_table(rows: Sequence[tuple[str, ...]]) -> TableBlock:
    return TableBlock(("parameter", "value", "90 % interval", ""), tuple(rows))


def _parameters(effects: Sequence[labels.Effect]) -> list[Block]:
    rows = [estimate.row for estimate in labels.estimates(effects)]
    return [_parameter_table(rows)] if rows else []


def _answer(verdict: Verdict) -> list[Block]:
    texts = (say.answer(verdict), *say.left_out_summary(verdict))
    blocks: list[Block] = [Paragraph(text, strong=True) for text in texts]
    if verdict["verdict"] not in (*say.ENOUGH, "named") and (reason := verdict.get("because")):
        reason = labels.names_to_labels(reason).rstrip(".")
        blocks.append(Paragraph(f"{reason[:1].upper()}{reason[1:]}."))
    if best := verdict["best_known"]:
        if not say.is_refuted(verdict):
            blocks += _parameters(best["effects"])
        blocks.append(Bullets(say.best_known_summary(verdict)))
    if verdict["verdict"] == "ambiguous":
        blocks.append(Bullets(tuple(map(labels.format_explanation, verdict["equivalent"]))))
        if advice := verdict.get("separated_by"):
            blocks.append(Paragraph(labels.names_to_labels(advice)))
    return blocks


def _measured(errors: pd.DataFrame | None, moments: Sequence[str]) -> list[Block]:
    if errors is None:
        return []
    caption = (
        "Root mean square of the residual in the unit of each channel. Before: uncertain parameters"
        " re-fitted, no effect added. After: with the effects above. Noise: expected from sensor"
        " noise and solver error."
    )
    speed = ["speed"] if errors["speed"].notna().any() else []
    names = ("run", *speed, "held_out", "channel", "unit", "noise", *moments)
    return [frame_block(schema.CHANNEL_ERRORS, errors, names, caption)]


def _gap(verdict: Verdict, gaps: pd.DataFrame | None, moments: Sequence[str]) -> list[Block | str]:
    meaning = (
        "The gap is the root mean square residual in standard deviations of the noise; 1 is noise"
        " alone."
    )
    blocks: list[Block | str] = [Paragraph(f"{meaning} {say.held_out_summary(verdict)}.")]
    split = [run["run"] for run in verdict.get("held_out", ()) if run["part"] == "last_third"]
    if split:
        text = f"The last third of {joined(split)} is held out; a separate run is better evidence."
        blocks.append(Paragraph(text))
    if gaps is not None:
        runs = gaps.query("run != 'all' and role == 'confirm' and channel == 'all'")
        if len(runs):
            names = [f"{moment}{end}" for moment in moments for end in ("", "_low", "_high")]
            caption = "Gap of each held-out run with its 90 % interval (low to high)."
            blocks.append(frame_block(schema.GAPS, runs, ["run", *names], caption))
        gap, high = (gaps[f"after{end}"].fillna(gaps[f"before{end}"]) for end in ("", "_high"))
        below = gaps.assign(gap=gap, high=high).query(
            "high < @_BELOW_NOISE and channel != 'all' and run != 'all'"
        )
        if len(below):
            channels = joined(
                f"{format_name(row.channel)} ({row.run} {rounded_gap(row.gap)})"
                for row in below.itertuples()
            )
            text = f"The gap of {channels} is far below 1: the noise is overestimated. State or"
            blocks.append(Paragraph(f"{text} correct `noise`."))
    return [*blocks, "gaps"]


def _location(verdict: Verdict, windows: pd.DataFrame | None) -> list[Block | str]:
    orders, cycle = verdict["orders"], verdict.get("cycle", "crank angle")
    if not cycle:
        return []
    word = cycle.replace(" ", "-")
    blocks: list[Block | str] = []
    if windows is not None and len(windows):
        caption = (
            f"{word.capitalize()} windows with the largest residuals before effects are added"
            " [standard deviations of noise]."
        )
        largest = windows.sort_values("rms", ascending=False).head(_MOST_WINDOWS).round({"mean": 4})
        names = ("run", "channel", "start_deg", "end_deg", "mean", "rms")
        blocks.append(frame_block(schema.MAP_WINDOWS, largest, names, caption))
    if orders:
        caption = (
            "Orders, in cycles of the crank or of the motion, that dominate the residual. Possible"
            " sources: drive, gear teeth, motor poles, joint impacts."
        )
        names = ("run", "channel", "order", "amplitude", "unit", "share")
        blocks.append(frame_block(schema.MAP_STANDOUT, pd.DataFrame(orders), names, caption))
    if not blocks:
        blocks.append(Paragraph(f"No {word} window has a significant residual."))
    return [*blocks, "disagreement"]


def _tested(verdict: Verdict, force: pd.DataFrame | None) -> list[Block | str]:
    if verdict["verdict"] in say.ENOUGH:
        return []
    effects = verdict["effects"]
    text = (
        "The Bayesian information criterion (BIC) weighs fit against parameters; 10 is very strong"
        " evidence."
    )
    if effects:
        gains = joined(
            f"{say.format_gain(effect['delta_bic'])} for {labels.format_effect(effect)}"
            for effect in effects
            if effect["delta_bic"] is not None
        )
        text = f"Gain in BIC: {gains}. {text}" if gains else text
        needed = [labels.format_effect(effect) for effect in effects if effect["delta_bic"] is None]
        if needed:
            text += f" No fit was made without {' or without '.join(needed)}."
    has_force = (force is None or len(force)) and not all(map(labels.is_fault, effects))
    return [Paragraph(text), "ranking", *(["missing_force"] if has_force else [])]


def _optimum(
    effects: Sequence[labels.Effect], optimum: pd.DataFrame | None, campaign: Campaign | None
) -> list[Block | str]:
    if optimum is None:
        return []
    if campaign and isinstance(campaign.mechanism, LinkageFile) and not campaign.optimise_linkage:
        return []
    if all(map(labels.is_fault, effects)):
        return [Paragraph("No effect was added to the mechanism, so the optimum does not change.")]
    if optimum.empty:
        return [
            Paragraph(
                "None: all joints are ideal, so the transmission angle depends on the lengths only."
            )
        ]
    objective = next(iter(optimum["objective"].dropna()), "objective")
    caption = f"Smallest {objective}: reduction in the search, and re-simulated."
    if not (optimum["model"] == "base").any():
        caption += " Before: all joints ideal, no optimum."
    models = optimum.assign(model=optimum["model"].map({"base": "before", "augmented": "after"}))
    names = ["model", "source", "length", "original", "optimum", "reduction", "resimulated"]
    names += ["at_edge", "failed"]
    return [frame_block(schema.CAMPAIGN_OPTIMUM, models, names, caption)]


def _nuisances(verdict: Verdict, ranges: Collection[str], mechanism: str) -> list[Block]:
    """Re-fitted parameters; `ranges`: those whose range the campaign file states."""
    rows, at_bounds, is_kept = [], [], False
    is_model = verdict.get("subject") == "model"
    for estimate in nuisances(verdict["nuisances"]):
        key = estimate.name.partition("/")[2]
        name, _, run = key.partition("@")
        if estimate.remark == AT_BOUND and (is_model or name in ranges):
            at_bounds.append(estimate.label)
        *row, remark = estimate.row
        if not key.startswith(_UNLISTED):
            if mechanism and verdict["nuisances"][key].get("kept") and not run:
                remark, is_kept = "; ".join(filter(None, (remark, "stated value kept"))), True
        rows.append((*row, remark))
    blocks: list[Block] = [_parameter_table(rows)] if rows else []
    if is_kept:
        text = f"The data do not determine some values: `{mechanism}` keeps the stated ones."
        blocks.append(Paragraph(text))
    if at_bounds:
        values = (
            "these values are at their bounds" if at_bounds[1:] else "this value is at its bound"
        )
        place = "in the class" if is_model else "under `nuisance`"
        text = f"Check the range of {joined(at_bounds)} {place}: {values}, or an effect is missing."
        blocks.append(Paragraph(text))
    return blocks


def untested_clearances(mechanism: Mechanism | LinkageFile | None) -> tuple[str, ...]:
    """A line on the joints whose clearance is not tested, if any; a model of the user has no
    mechanism."""
    joints = mechanism.without_bearing if mechanism else ()
    if not joints:
        return ()
    names = joined(map(format_name, joints))
    return (
        f"Not tested: clearance in {names}. To test it, give the joint's bearing in the mechanism"
        " file, with `loose: false`.",
    )


def _limits(
    verdict: Verdict, detectable: pd.DataFrame | None, ranking: pd.DataFrame | None
) -> tuple[str, ...]:
    """What the campaign cannot show; `ranking` is that of the fits."""
    lines = [
        f"False alarms: thresholds that {percent(verdict['false_alarm_rate'])} of simulated"
        " campaigns without a missing effect exceed."
    ]
    for group in not_distinguished(verdict["preflight"]["merged"], ranking):
        effects = joined(map(labels.format_label, group))
        lines.append(f"Distinguished neither by their sensitivities nor by the fits: {effects}.")
    best = (verdict["best_known"] or {}).get("effects", ())
    listed = set()
    for explanation in (verdict["effects"], *verdict["equivalent"], best):
        for effect in explanation:
            listed |= {effect["name"], f"{effect['name']}:{effect['site']}"}
    if detectable is not None:
        failed = detectable.dropna(subset=["failed"])
        listed |= set(failed["label"])
        if len(failed):
            effects = joined(
                f"{labels.format_label(row.label)} ({row.failed})" for row in failed.itertuples()
            )
            lines.append(f"Detectability unknown: {effects}.")
        rows = detectable[detectable["detectable"]].sort_values("label")
        if verdict["verdict"] in say.ENOUGH and len(rows):
            sizes = ", ".join(
                f"{labels.format_label(row.label)} ({labels.format_detectable(row)})"
                for row in rows.itertuples()
            )
            lines.append(f"Smallest detectable sizes: {sizes}.")
    absent = [label for label in verdict["preflight"]["undetectable"] if label not in listed]
    if absent:
        effects = joined(map(labels.format_label, absent))
        lines.append(f"Cannot be detected with these runs and channels: {effects}.")
    return tuple(lines)


def not_distinguished(
    merged: Sequence[Sequence[str]], ranking: pd.DataFrame | None
) -> list[list[str]]:
    """The groups `merged` by sensitivities, without effects that the fits distinguish.

    Two effects are distinguished if the best explanation that contains one of them and the same
    with the other differ by `min_delta_bic`.
    """
    bics = {}
    if ranking is not None:
        fitted = ranking.dropna(subset=["bic"])
        effects = fitted["explanation"].str.split(JOINED, regex=False).map(frozenset)
        bics = dict(zip(effects, fitted["bic"], strict=True))
    groups = []
    for group in merged:
        explanations = [effects for effects in bics if len(effects & {*group}) == 1]
        if explanations:
            best = min(explanations, key=bics.get)
            limit = bics[best] + DEFAULT_SETTINGS.decision.min_delta_bic
            partners = best - {*group}
            group = [
                label for label in group if bics.get(partners | {label}, -float("inf")) < limit
            ]
        groups += [list(group)] if len(group) > 1 else []
    return groups


_NEXT = {
    "no_disagreement": "Use the current model at these speeds and for these channels.",
    "parameters_only": "Use the re-fitted parameters in the model.",
    "unexplained": (
        "Locate the residual in the map of disagreement, and look for a cause on the rig there."
    ),
}
_LAW = "State a law of your own under `candidates` of the campaign file, and repeat."
_UNCERTAIN = "List uncertain masses, lengths and zeros under `nuisance` of the campaign file, and"
_LAW_OF_CLASS = "Add a law of your own to the class of the model as an `effect`, and repeat."
_CONSTANTS = "Make uncertain constants of the class a `parameter` with a wide range, and repeat."
_SMALLER = "To find smaller effects, measure a further speed or channel"
_BY_SUBJECT = {
    "campaign": {
        "no_disagreement": (f"{_SMALLER}: `jointgap preflight` ranks them.",),
        "parameters_only": (f"{_SMALLER}: `jointgap preflight` ranks them.",),
        "unexplained": (_LAW, f"{_UNCERTAIN} repeat."),
    },
    "model": {
        "no_disagreement": (f"{_SMALLER}.",),
        "parameters_only": (f"{_SMALLER}.",),
        "unexplained": (_LAW_OF_CLASS, _CONSTANTS),
    },
}


def _next_steps(verdict: Verdict, mechanism: str) -> tuple[str, ...]:
    faults = [effect for effect in verdict["effects"] if labels.is_fault(effect)]
    steps = [_NEXT[verdict["verdict"]]] if verdict["verdict"] in _NEXT else []
    steps += _BY_SUBJECT[verdict.get("subject", "campaign")].get(verdict["verdict"], ())
    if verdict.get("separated_by", "").startswith(ADVICE):
        steps.append(
            "Measure the run or channel that separates the explanations, add it to the campaign,"
            " and repeat."
        )
    if faults:
        steps.append(
            "Repair the sensor or its mounting, or correct its column:"
            f" {labels.format_explanation(faults)}."
        )
    if mechanism and verdict["verdict"] == "parameters_only":
        steps.insert(0, f"`{mechanism}` contains the re-fitted parameters.")
    if len(faults) < len(verdict["effects"]):
        use = (
            f"Use `{mechanism}`, your mechanism with the identified effects: simulate it, optimise"
            " its lengths, or make it the `mechanism` of the next campaign."
        )
        steps += [use] if mechanism else []
        steps += [
            (
                "Change the cause on the rig (oil, load, fit) and measure again: the parameter"
                " should change accordingly."
            ),
        ]
    return tuple(steps)


_ROLES = {
    "identify": "for fitting",
    "confirm": "held out",
    "split": "two thirds for fitting, last third held out",
}


_RUN_COLUMNS = {"run": "l", "file": "l", "crank speed [rpm]": "r", "use": "l"}
_RUN_COLUMNS |= {"samples": "r", "full revolutions": "r"}


def _data(
    campaign: Campaign | None, look: pd.DataFrame | None, warnings: Sequence[str]
) -> list[Block]:
    """The runs with their files, the channels, and remarks."""
    remarks = [Bullets(tuple(map(labels.names_to_labels, warnings)))] if warnings else []
    if campaign is None:
        return remarks
    sizes = {}
    if look is not None:
        sizes = look.groupby("run")[["samples", "cycles"]].max().astype(str).T.to_dict("list")
    runs = [
        {
            "run": run.id,
            "file": ", ".join(f"`{file}`" for file in run.files),
            **(
                {"crank speed [rpm]": words.number(30.0 / pi * run.speed)}
                if hasattr(run, "speed")
                else {}
            ),
            "use": _ROLES[run.role],
            **(
                dict(zip(("samples", "full revolutions"), sizes.get(run.id, "––"), strict=True))
                if look is not None
                else {}
            ),
        }
        for run in campaign.runs
    ]
    channels = [
        {
            "channel": format_name(name),
            "column": f"`{channel.column}`",
            "unit": format_unit(channel.unit),
        }
        for name, channel in campaign.channels.items()
    ]
    caption = f"Runs. Measured on {words.format_day(campaign.date)}." if campaign.date else "Runs."
    blocks: list[Block] = [
        TableBlock.of(runs, "".join(map(_RUN_COLUMNS.__getitem__, runs[0])), caption),
        TableBlock.of(channels, caption="Measured channels."),
    ]
    if campaign.own_loads:
        text = "Known loads of runs, which the augmented mechanism does not contain:"
        loads = tuple(map(labels.names_to_labels, campaign.own_loads))
        blocks += [Paragraph(text), Bullets(loads)]
    return blocks + remarks
