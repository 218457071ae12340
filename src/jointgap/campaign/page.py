"""verdict.json and the page of a campaign."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import pi
from typing import Any

import pandas as pd

from jointgap.campaign import sentences as say
from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import (
    MECHANISM,
    SUMMARIES,
    VERDICT,
    costs,
    costs_noted,
    failures,
    noted,
)
from jointgap.campaign.figures import FIGURES, ONE_RUN, one_run_against_model
from jointgap.campaign.fits_on_disk import JOINED
from jointgap.campaign.plan import (
    ADVICE,
    assumed,
    confusable_groups,
    preflight_tables,
    separated_by,
)
from jointgap.campaign.state import CampaignState
from jointgap.config.campaign import NUISANCES, Campaign
from jointgap.core import page as blocks_of
from jointgap.core import schema, words
from jointgap.core.files import write_text
from jointgap.core.page import Block, Bullets, FigureBlock, Heading, Page, Paragraph, TableBlock
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.words import format_name, format_unit, joined, percent, reading_unit, rounded_gap
from jointgap.identification.fit import AT_BOUND
from jointgap.identification.settings import DEFAULT_SETTINGS

_MOST_WINDOWS = 7  # with the largest residuals; the map shows all
_PARAMETER_HEADS = ("parameter", "value", "90 % interval", "")
_UNLISTED = ("first_angle", "friction_speed", "lasting_damping")  # parameters of every fit
_BELOW_NOISE = 0.85  # if the whole interval of a gap is below, the noise is overestimated

Verdict, Tables = Mapping[str, Any], Mapping[str, pd.DataFrame | None]


def page(
    verdict: Verdict, tables: Tables, warnings: Sequence[str] = (), campaign: Campaign | None = None
) -> Page:
    """The one-page summary of a campaign."""
    tried = verdict["effects"] or verdict["best_known"] or verdict["equivalent"]
    shown = ("before", "after") if tried else ("before",)
    sections = {
        "": _answer(verdict),
        "Measured against model": _measured(tables.get("channel_errors"), shown),
        "Gap between simulation and measurement": _gap(verdict, tables.get("gaps"), shown),
        "Location of the residual": _where(verdict["orders"], tables.get("map_windows")),
        "Tested explanations": _tried(verdict, tables.get("missing_force")),
        "Influence on the optimum": _optimum(verdict["effects"], tables.get("campaign_optimum")),
        "Re-fitted parameters": _nuisances(
            verdict["nuisances"], NUISANCES if campaign is None else campaign.nuisance
        ),
        "Limits of these data": _limits(verdict, tables.get("detectable"), tables.get("ranking")),
        "Next steps": [Bullets(_next_steps(verdict))],
        "Data": _data(campaign, tables.get("look"), warnings),
    }
    blocks: list[Block] = []
    for heading, own in sections.items():
        blocks += [Heading(heading), *own] if heading and own else own
    footer = (
        f"{blocks_of.written_today()} For programs: `{VERDICT}` and the Parquet tables (`jointgap"
        " describe FILE`)."
    )
    return Page(
        title(verdict), tuple(blocks), f"Campaign {verdict['campaign']}", footer, width="60rem"
    )


def title(verdict: Verdict) -> str:
    """The verdict in a line, with the parameter and its interval."""
    factor = verdict.get("interval_factor", 1.0)
    wider = (
        f"; intervals widened by the factor {factor:.1f}, as the residual exceeds noise"
        if factor >= 1.1
        else ""
    )
    if verdict["effects"]:
        text = say.headline(verdict["effects"]) + wider
        return text[:1].upper() + text[1:]
    if verdict["doubted_channels"] and verdict["verdict"] == "unexplained":
        return "Channels are inconsistent, so no effect can be identified"
    certain = f"certain is {say.headline(verdict['certain'])}{wider}" if verdict["certain"] else ""
    if (best := verdict["best_known"]) and not say.is_refuted(verdict):
        if certain:
            return f"An effect is missing; {certain}"
        share = f"partly explained ({own}) by " if (own := say.share_explained(verdict)) else ""
        return f"Not confirmed: {share}{say.headline(best['effects'])}{wider}"
    return {
        "no_disagreement": "No missing effect detected",
        "parameters_only": (
            "No missing effect detected: re-fitted parameters explain the measurement"
        ),
        "ambiguous": (
            f"An effect is missing: {len(verdict['equivalent'])} explanations fit equally well"
            f"{certain and '; '}{certain}"
        ),
    }.get(verdict["verdict"], "An effect is missing, but no tested effect explains the residual")


def frame_block(
    table: schema.Table,
    frame: pd.DataFrame,
    names: Iterable[str],
    caption: str,
    si: tuple = ("", 1.0),
) -> Block:
    """Columns `names` of a `frame` of a `table` in reading units; `si`: unit and factor of columns
    in SI."""
    heads, columns, align = [], [], ""
    own = {column.name: column for column in table.columns}
    for column in map(own.get, names):
        unit, factor = si if column.unit == "SI" else reading_unit(column.unit)
        shown = format_unit(unit) if unit not in ("", "1") and " " not in unit else ""
        heads.append(
            format_name(column.name.removesuffix("_deg")) + (f" [{shown}]" if shown else "")
        )
        align += "l" if column.kind in ("text", "bool") else "r"
        columns.append([_cell(column, value, factor) for value in frame[column.name]])
    return TableBlock(tuple(heads), tuple(zip(*columns, strict=True)), align, caption)


def _cell(column: schema.Column, value: Any, factor: float) -> str:
    if value == "" or pd.isna(value):
        return "–"
    if column.kind == "float":
        return words.number(factor * value)
    if column.kind == "bool":
        return "yes" if value else "no"
    return {"channel": format_name, "source": format_name, "unit": format_unit}.get(
        column.name, str
    )(value)


def _figure(name: str, narrow: str = "") -> FigureBlock:
    return FigureBlock(name, FIGURES[name].title, FIGURES[name].caption, narrow=narrow)


def _parameters(effects: Sequence[Mapping[str, Any]]) -> list[Block]:
    rows = say.parameter_rows(effects)
    return [TableBlock(_PARAMETER_HEADS, rows)] if rows else []


def _answer(verdict: Verdict) -> list[Block]:
    blocks: list[Block] = [
        Paragraph(text, strong=True)
        for text in (say.answer(verdict), *say.left_out_summary(verdict))
    ]
    if verdict["verdict"] not in (*say.ENOUGH, "named") and (reason := verdict.get("because")):
        reason = say.names_to_labels(reason).rstrip(".")
        blocks.append(Paragraph(f"{reason[:1].upper()}{reason[1:]}."))
    if best := verdict["best_known"]:
        own = [] if say.is_refuted(verdict) else _parameters(best["effects"])
        blocks += [*own, Bullets(say.best_known_summary(verdict))]
    if verdict["verdict"] == "ambiguous":
        blocks.append(Bullets(tuple(map(say.format_explanation, verdict["equivalent"]))))
        if advice := verdict.get("separated_by"):
            blocks.append(Paragraph(say.names_to_labels(advice)))
    blocks += [_figure("measured_against_model", narrow=ONE_RUN), *_parameters(verdict["effects"])]
    return blocks


def _measured(errors: pd.DataFrame | None, shown: Sequence[str]) -> list[Block]:
    caption = (
        "Root mean square of the residual in the unit of each channel. Before: uncertain parameters"
        " re-fitted, no effect added. After: with the effects above. Noise: expected from sensor"
        " noise and solver error."
    )
    names = ("run", "speed", "held_out", "channel", "unit", "noise", *shown)
    return [] if errors is None else [frame_block(schema.CHANNEL_ERRORS, errors, names, caption)]


def _gap(verdict: Verdict, gaps: pd.DataFrame | None, shown: Sequence[str]) -> list[Block]:
    meaning = (
        "The gap is the root mean square residual in standard deviations of the noise; 1 is noise"
        " alone."
    )
    blocks: list[Block] = [Paragraph(f"{meaning} {say.held_out_summary(verdict)}.")]
    if shared := [run["run"] for run in verdict.get("held_out", ()) if run["part"] == "last_third"]:
        blocks.append(
            Paragraph(
                f"The last third of {joined(shared)} is held out; a separate run is better"
                " evidence."
            )
        )
    if gaps is not None:
        runs = gaps[
            (gaps["run"] != "all") & (gaps["role"] == "confirm") & (gaps["channel"] == "all")
        ]
        names = ["run", *(f"{when}{end}" for when in shown for end in ("", "_low", "_high"))]
        caption = "Gap of each held-out run with its 90 % interval (low to high)."
        blocks += [frame_block(schema.GAPS, runs, names, caption)] if len(runs) else []
        gap, high = (gaps[f"after{end}"].fillna(gaps[f"before{end}"]) for end in ("", "_high"))
        low = gaps.assign(gap=gap)[
            (high < _BELOW_NOISE) & (gaps["channel"] != "all") & (gaps["run"] != "all")
        ]
        if channels := [
            f"{format_name(row.channel)} ({row.run} {rounded_gap(row.gap)})"
            for row in low.itertuples()
        ]:
            text = f"The gap of {joined(channels)} is far below 1: the noise is overestimated."
            blocks.append(Paragraph(f"{text} State or correct `noise`."))
    return [*blocks, _figure("gaps"), *([_figure("residuals")] if "after" in shown else [])]


def _where(orders: Sequence[Mapping[str, Any]], windows: pd.DataFrame | None) -> list[Block]:
    blocks: list[Block] = []
    if windows is not None and len(windows):
        text = (
            "Crank-angle windows with the largest residuals before effects are added [standard"
            " deviations of noise]."
        )
        largest = windows.sort_values("rms", ascending=False).head(_MOST_WINDOWS).round({"mean": 4})
        blocks.append(
            frame_block(
                schema.MAP_WINDOWS,
                largest,
                ("run", "channel", "start_deg", "end_deg", "mean", "rms"),
                text,
            )
        )
    if orders:
        text = (
            "Crank orders that dominate the residual. Possible sources: drive, gear teeth, motor"
            " poles, joint impacts."
        )
        names = ("run", "channel", "order", "amplitude", "unit", "share")
        blocks.append(frame_block(schema.MAP_STANDOUT, pd.DataFrame(orders), names, text))
    return [
        *(blocks or [Paragraph("No crank-angle window has a significant residual.")]),
        _figure("disagreement"),
    ]


def _tried(verdict: Verdict, force: pd.DataFrame | None) -> list[Block]:
    if verdict["verdict"] in say.ENOUGH:
        return []
    named = verdict["effects"]
    text = (
        "The Bayesian information criterion (BIC) weighs fit against parameters; 10 is very strong"
        " evidence."
    )
    if named:
        gains = joined(
            f"{say.format_gain(each['delta_bic'])} for {say.format_effect(each)}" for each in named
        )
        text = f"Gain in BIC: {gains}. {text}"
    pushes = (force is None or len(force)) and not all(map(say.is_fault, named))
    return [Paragraph(text), _figure("ranking"), *([_figure("missing_force")] if pushes else [])]


def _optimum(effects: Sequence[Mapping[str, Any]], optimum: pd.DataFrame | None) -> list[Block]:
    if optimum is None:
        return []
    if all(map(say.is_fault, effects)):
        return [Paragraph("No effect was added to the mechanism, so the optimum does not change.")]
    if optimum.empty:
        return [
            Paragraph(
                "None: all joints are ideal, so the transmission angle depends on the lengths only."
            )
        ]
    ideal = "" if (optimum["model"] == "base").any() else " Before: all joints ideal, no optimum."
    caption = (
        "Smallest RMS error of the transmission angle: reduction with frozen joint motion, and"
        f" re-simulated.{ideal}"
    )
    shown = optimum.assign(model=optimum["model"].map({"base": "before", "augmented": "after"}))
    names = (
        "model",
        "source",
        "crank_length",
        "rod_length",
        "reduction",
        "resimulated",
        "at_edge",
        "failed",
    )
    return [frame_block(schema.CAMPAIGN_OPTIMUM, shown, names, caption), _figure("optimum")]


def _nuisances(nuisances: Mapping[str, Mapping[str, Any]], listed: Collection[str]) -> list[Block]:
    """Re-fitted parameters; `listed`: those whose range the campaign file states."""
    if not nuisances:
        return []
    units = NUISANCES | {"first_angle": "rad", "friction_speed": "m/s", "clock_offset": "s"}
    rows, notes, narrow = [], {}, []
    for key, estimate in nuisances.items():
        *row, remark = say.estimate_row(
            words.format_nuisance(key), estimate, units.get(key.partition("@")[0], "")
        )
        if not key.startswith(_UNLISTED):
            if estimate.get("kept") and "@" not in key:
                remark = "; ".join(filter(None, (remark, "stated value kept")))
                notes[
                    f"The data do not determine some values: `{MECHANISM}` keeps the stated ones."
                ] = None
        if estimate.get("remark") == AT_BOUND and key.partition("@")[0] in listed:
            narrow.append(words.format_nuisance(key))
        rows.append((*row, remark))
    if narrow:
        one = (
            "this value is at its bound" if narrow[1:] == [] else "these values are at their bounds"
        )
        notes[
            f"Check the range of {joined(narrow)} under `nuisance`: {one}, or an effect is missing."
        ] = None
    return [TableBlock(_PARAMETER_HEADS, tuple(rows)), *map(Paragraph, notes)]


def _limits(
    verdict: Verdict, effects: pd.DataFrame | None, ranking: pd.DataFrame | None
) -> list[Block]:
    """Detectability; `effects` is table `DETECTABLE`, `ranking` that of the fits."""
    preflight = verdict["preflight"]
    rate = percent(verdict["false_alarm_rate"])
    lines = [
        f"False alarms: thresholds that {rate} of simulated campaigns without a missing effect"
        " exceed."
    ]
    for group in not_distinguished(preflight["merged"], ranking):
        lines.append(
            "Distinguished neither by the preflight nor by the fits:"
            f" {joined(map(say.format_label, group))}."
        )
    explanations = [
        verdict["effects"],
        *verdict["equivalent"],
        (verdict["best_known"] or {}).get("effects", ()),
    ]
    shown = {
        (effect["name"], effect["site"]) for explanation in explanations for effect in explanation
    }
    seen = {label for name, site in shown for label in (name, f"{name}:{site}")}
    if effects is not None:
        failed = effects[effects["failed"].notna()]
        seen |= set(failed["label"])
        if len(failed):
            lost = joined(
                f"{say.format_label(row.label)} ({row.failed})" for row in failed.itertuples()
            )
            lines.append(f"Detectability unknown, as the preflight simulation failed: {lost}.")
        rows = effects[effects["detectable"]].sort_values("label")
        if verdict["verdict"] in say.ENOUGH and len(rows):
            sizes = ", ".join(
                f"{say.format_label(row.label)} ({say.format_detectable(row)})"
                for row in rows.itertuples()
            )
            lines.append(f"Smallest detectable sizes: {sizes}.")
        if assumed(effects):
            lines.append(
                "Detectability uses assumed noise if the campaign file states none (`jointgap"
                " preflight`)."
            )
    if absent := [label for label in preflight["undetectable"] if label not in seen]:
        lines.append(
            "Cannot be detected with these runs and channels:"
            f" {joined(map(say.format_label, absent))}."
        )
    return [Bullets(tuple(lines))]


def not_distinguished(
    merged: Sequence[Sequence[str]], ranking: pd.DataFrame | None
) -> list[list[str]]:
    """The groups `merged` of the preflight, without effects that the fits distinguish.

    Two effects are distinguished if the best explanation that contains one of them and the same
    with the other differ by `min_delta_bic`.
    """
    bics = {}
    if ranking is not None:
        for row in ranking.dropna(subset=["bic"]).itertuples():
            bics[frozenset(row.explanation.split(JOINED))] = row.bic
    groups = []
    for group in merged:
        fitted = [each for each in bics if len(each & {*group}) == 1]
        best = min(fitted, key=bics.get, default=frozenset())
        rest, left = best - {*group}, []
        for label in group:
            own = bics.get(rest | {label})
            if (
                own is None
                or not best
                or own - bics[best] < DEFAULT_SETTINGS.decision.min_delta_bic
            ):
                left.append(label)
        groups += [left] if len(left) > 1 else []
    return groups


_SMALLER = (
    "To find smaller effects, measure a further speed or channel: `jointgap preflight` ranks them."
)
_NEXT = {
    "no_disagreement": ("Use the current model at these speeds and for these channels.", _SMALLER),
    "parameters_only": (f"Use `{MECHANISM}`: it contains the re-fitted parameters.", _SMALLER),
    "unexplained": (
        "Locate the residual in the map of disagreement, and look for a cause on the rig there.",
        "State a law of your own under `candidates` of the campaign file, and repeat.",
        (
            "List uncertain masses, lengths and zeros under `nuisance` of the campaign file, and"
            " repeat."
        ),
    ),
}


def _next_steps(verdict: Verdict) -> tuple[str, ...]:
    faults = [effect for effect in verdict["effects"] if say.is_fault(effect)]
    steps = list(_NEXT.get(verdict["verdict"], ()))
    if verdict.get("separated_by", "").startswith(ADVICE):
        steps.append(
            "Measure the run or channel that separates the explanations, add it to the campaign,"
            " and repeat."
        )
    if faults:
        steps.append(
            "Repair the sensor or its mounting, or correct its column:"
            f" {say.format_explanation(faults)}."
        )
    if len(faults) < len(verdict["effects"]):
        steps += [
            (
                f"Use `{MECHANISM}`, your mechanism with the identified effects, as `mechanism` of"
                " a scenario."
            ),
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


def _data(
    campaign: Campaign | None, look: pd.DataFrame | None, warnings: Sequence[str]
) -> list[Block]:
    """The runs with their files, the channels, and remarks."""
    blocks: list[Block] = []
    if campaign is not None:
        sizes = (
            {}
            if look is None
            else look.groupby("run")[["samples", "cycles"]].max().astype(str).T.to_dict("list")
        )
        runs = tuple(
            (
                run.id,
                ", ".join(f"`{file}`" for file in run.files),
                words.number(30.0 / pi * run.speed),
                _ROLES[run.role],
                *sizes.get(run.id, "––"),
            )
            for run in campaign.runs
        )
        heads = ("run", "file", "crank speed [rpm]", "use", "samples", "full revolutions")
        measured = f" Measured on {words.format_day(campaign.date)}." if campaign.date else ""
        columns = (
            (format_name(name), f"`{one.column}`", format_unit(one.unit))
            for name, one in campaign.channels.items()
        )
        blocks.append(TableBlock(heads, runs, "llrlrr", f"Runs.{measured}"))
        blocks.append(
            TableBlock(("channel", "column", "unit"), tuple(columns), caption="Measured channels.")
        )
        if campaign.own_loads:
            blocks.append(
                Paragraph("Known loads of runs, which the augmented mechanism does not contain:")
            )
            blocks.append(Bullets(tuple(map(say.names_to_labels, campaign.own_loads))))
    return [*blocks, *([Bullets(tuple(map(say.names_to_labels, warnings)))] if warnings else [])]


def conclude(state: CampaignState, advise: bool = True) -> dict[str, Any]:
    """Write ``verdict.json`` and return its content."""
    with costs_noted(state.folder, "conclude"):
        content = _concluded(state, advise)
    return _written(state.folder, content)


def _written(folder: ResultsFolder, content: dict[str, Any]) -> dict[str, Any]:
    """The `content` of ``verdict.json`` with the costs of all jobs, after it is written."""
    content |= {"costs": costs(folder)}
    write_text(folder.path / VERDICT, verdict_json.text(content))
    return content


def _concluded(state: CampaignState, advise: bool) -> dict[str, Any]:
    folder, outcome = state.folder, state.outcome("verdict")
    repeats = not any(series.statistic for series in state.model.series)
    tables = folder.read_all(verdict_json.TABLES)
    content = verdict_json.document(
        outcome, tables, state.campaign, state.inconsistent_channels, repeats
    )
    content |= {"false_alarm_rate": state.false_alarm_rate}
    explanations = [{*fit.label.split(JOINED)} for fit in outcome.equivalent]
    if (best := content["best_known"]) and say.is_near(best["rival"]):
        explanations = [
            {*outcome.best_known.label.split(JOINED)},
            {*best["rival"]["explanation"].split(JOINED)},
        ]
    if advise and explanations and "preflight" not in failures(folder):
        with noted(folder, "advice"):
            if not folder.place("advice").is_file():
                folder.write_all(
                    preflight_tables(
                        state.campaign, state.false_alarm_rate, state.settings, advice=True
                    )
                )
            groups = confusable_groups(folder.read("confusability"))
            content["separated_by"] = separated_by(folder.read("advice"), explanations, groups)
    content["left_out"] = [
        {"run": run, "because": why} for run, why in state.model.left_out.items()
    ]
    content["failed"] = failures(folder)
    return content


def show(state: CampaignState) -> None:
    """Draw the figures and write the one-page summary from ``verdict.json``."""
    with costs_noted(state.folder, "figures"):
        content = _shown(state)
    _written(state.folder, content)


def _shown(state: CampaignState) -> dict[str, Any]:
    from jointgap.core import plot

    folder = state.folder
    content = verdict_json.read(folder.path / VERDICT)
    frames = figure_tables(folder, FIGURES.needed_tables(FIGURES))
    for name, spec in FIGURES.items():
        with noted(folder, name):
            plot.save(FIGURES.draw(name, frames, content), folder.path / "figures" / name)
            if name == "measured_against_model":
                with plot.matplotlib_style():
                    plot.save(one_run_against_model(frames), folder.path / "figures" / ONE_RUN)
        if why := failures(folder).get(name):
            with plot.matplotlib_style():
                plot.save(
                    plot.message_sheet(spec.title, f"could not be drawn: {why}"),
                    folder.path / "figures" / name,
                )
    content["failed"] = failures(folder)
    summary = Page(
        f"Campaign {content['campaign']}: {say.answer(content)}",
        (Paragraph(f"Details: {VERDICT}"),),
    )
    with noted(folder, "page"):
        memory = folder.read("noise_memory", "noise").query("lag == 0")
        noise = [
            f"Run {row.run}: {text}."
            for row in memory.itertuples()
            for text in row.remarks.split("; ")
            if text
        ]
        remarks = (*folder.read("remarks")["remark"], *noise)
        summary = page(content, frames | {"look": folder.read("look")}, remarks, state.campaign)
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, blocks_of.to_markdown(summary))
    write_text(html, blocks_of.to_html(summary, folder.path / "figures"))
    content["failed"] = failures(folder)
    return content


def figure_tables(folder: ResultsFolder, names: Iterable[str]) -> dict[str, pd.DataFrame]:
    """The tables `names` by name, as far as the `folder` of a campaign contains them."""
    places = {
        name: (name, "verdict" if name == "ranking" else "") for name in names
    }  # several stages write a ranking
    return {
        name: folder.read(*place)
        for name, place in places.items()
        if folder.place(*place).is_file()
    }
