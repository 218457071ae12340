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
from jointgap.config.campaign import NUISANCES, Campaign
from jointgap.core.files import write_text
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
from jointgap.identification.fit import AT_BOUND, Fit
from jointgap.identification.settings import DEFAULT_SETTINGS

_MOST_WINDOWS = 5  # the largest disagreements; the map shows all
_PARAMETER_HEADS = ("parameter", "value", "90 % interval", "")
_IN_EVERY_FIT = ("first_angle", "friction_speed", "lasting_damping")  # parameters of a fit that nobody listed
_ONE_SIDED = 0.7  # share of the root mean square that is the mean: above, the residual has one sign
_BELOW_NOISE = 0.85  # a gap whose whole interval is below is less than noise

Tables = Mapping[str, pd.DataFrame | None]


def page(
    verdict: Mapping[str, Any], tables: Tables, warnings: Sequence[str] = (), campaign: Campaign | None = None
) -> Page:
    """The one-page summary of a campaign."""
    gaps = tables.get("gaps")
    return Page(
        title(verdict),
        (
            *_answer(verdict),
            *_measured(verdict, tables.get("channel_errors"), gaps),
            *_gap(verdict, gaps),
            *_where(verdict, tables.get("map_windows")),
            *_why(verdict, tables.get("missing_force")),
            *_optimum(verdict["effects"], tables.get("campaign_optimum")),
            *_nuisances(verdict),
            *_limits(verdict, tables.get("detectable")),
            *_next_steps(verdict),
            *_data(campaign, tables.get("look"), warnings),
        ),
        subject=f"Campaign {verdict['campaign']}",
        footer=f"{written_today()} For programs: `{VERDICT}` and the Parquet tables (`jointgap describe FILE` explains "
        "their columns).",
        width="60rem",
    )


def title(verdict: Mapping[str, Any]) -> str:
    """The answer in a line, with its number and interval."""
    if verdict["effects"]:
        return _capital(headline(verdict["effects"]) + _widened(verdict))
    best = verdict["best_known"]
    unexplained = "Something is missing that none of the effects tried explains"
    if best:
        share = share_explained(best)
        part = f"in part ({share})" if share else "in part"
        unexplained = f"Something is missing; explained {part}: {headline(best['effects'])}{_widened(verdict)}"
    return {
        "no_disagreement": "Nothing is missing that these data could show",
        "parameters_only": "Nothing is missing: other values of uncertain parameters fit the measurement",
        "ambiguous": f"Something is missing: {len(verdict['equivalent'])} explanations fit equally well",
    }.get(verdict["verdict"], unexplained)


def _widened(verdict: Mapping[str, Any]) -> str:
    factor = verdict.get("interval_factor", 1.0)
    return f"; the residual exceeds noise, so intervals are {factor:.1f} times as wide" if factor >= 1.1 else ""


def _capital(sentence: str) -> str:
    return (sentence[:1].upper() + sentence[1:]).rstrip(".")


def _figure(name: str) -> FigureBlock:
    return FigureBlock(name, FIGURES[name].title, FIGURES[name].caption)


def _parameters(effects: Sequence[Mapping[str, Any]]) -> list[Block]:
    rows = parameter_rows(effects)
    return [TableBlock(_PARAMETER_HEADS, rows)] if rows else []


def _answer(verdict: Mapping[str, Any]) -> list[Block]:
    blocks: list[Block] = [Paragraph(text, strong=True) for text in (answer(verdict), *left_out_in_words(verdict))]
    if verdict["verdict"] not in (*ENOUGH, "named") and (reason := verdict.get("because")):
        blocks.append(Paragraph(_capital(without_code_names(reason)) + "."))
    if says := best_known_in_words(verdict):
        blocks.append(Paragraph("The best explanation, which is not proven:"))
        blocks += [*_parameters(verdict["best_known"]["effects"]), Bullets(says)]
    if verdict["verdict"] == "ambiguous":
        blocks.append(Bullets(tuple(explanation_in_words(effects) for effects in verdict["equivalent"])))
        if advice := verdict.get("separated_by"):
            blocks.append(Paragraph(without_code_names(advice)))
    return [
        *blocks,
        _figure("measured_against_model"),
        *_parameters(verdict["effects"]),
        *map(Paragraph, _motions(verdict["effects"])),
    ]


def _motions(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """From which start the motion of each run came, where an effect allows several steady motions."""
    sentences = []
    for effect in effects:
        starts = {key.partition("@")[2]: start for key, start in effect.get("choices", {}).items()}
        if any(starts.values()):
            found = joined(f"of {run} from start {start}" for run, start in starts.items())
            sentences.append(
                f"With a {effect_in_words(effect)} several steady motions are possible at the same parameters. The "
                f"motion {found} fits the measurement; start 0 is the usual one."
            )
    return sentences


def _something_tried(verdict: Mapping[str, Any]) -> bool:
    """Whether a model with an effect is shown beside the one without."""
    return bool(verdict["effects"] or verdict["best_known"] or verdict["equivalent"])


_ERROR_HEADS = ("run", "crank speed [rpm]", "used", "channel", "unit", "noise", "RMS before", "RMS after", "explained")


def _measured(verdict: Mapping[str, Any], errors: pd.DataFrame | None, gaps: pd.DataFrame | None) -> list[Block]:
    """Residuals in the unit of each channel; `errors` is table `CHANNEL_ERRORS`, `gaps` table `GAPS`."""
    if errors is None:
        return []
    closed = {} if gaps is None else {(row.run, row.role, row.channel): row for row in gaps.itertuples()}
    heads = _ERROR_HEADS if _something_tried(verdict) else _ERROR_HEADS[:7]
    rows = []
    for row in errors.itertuples():
        gap = closed.get((row.run, "confirm" if row.held_out else "identify", row.channel))
        used, errors_shown = "held out" if row.held_out else "to fit", (row.noise, row.before, row.after)
        cells = (row.run, f"{30.0 / pi * row.speed:.4g}", used, in_words(row.channel), unit_in_words(row.unit))
        cells += (*("–" if pd.isna(each) else f"{each:.3g}" for each in errors_shown), _share_explained(gap))
        rows.append(cells[: len(heads)])
    caption = (
        "Root mean square (RMS) of the residual. Before: no effect added, uncertain parameters re-fitted. After: with "
        "the effects above. Noise: expected from sensor noise and numerics. Explained: share of the mean square beyond "
        "noise that is gone."
    )
    return [Heading("Measured against model"), TableBlock(heads, tuple(rows), "lrlllrrrr"[: len(heads)], caption)]


def _share_explained(gap: Any) -> str:
    """Share of the squared excess over the noise that is gone, of a row of `GAPS`."""
    if gap is None or pd.isna(gap.closed) or gap.before**2 <= DEFAULT_SETTINGS.decision.tolerated_reduced_chi2:
        return "–"
    return percent(min(gap.closed, 1.0), 0 if gap.closed > 0.995 else 1)


def _gap(verdict: Mapping[str, Any], gaps: pd.DataFrame | None) -> list[Block]:
    shown = _something_tried(verdict)
    meaning = "The gap is the root mean square residual in standard deviations of the noise; 1 is noise alone."
    blocks: list[Block] = [
        Heading("Gap between simulation and measurement"),
        Paragraph(f"{meaning} {held_out_in_words(verdict)}."),
    ]
    if shared := [run["run"] for run in verdict.get("held_out", ()) if run["part"] == "last_third"]:
        text = f"The last third of {joined(shared)} is held out; a separate run would be stronger evidence."
        blocks.append(Paragraph(text))
    if gaps is not None:
        own = gaps[(gaps["channel"] == "all") & (gaps["role"] == "confirm") & (gaps["run"] != "all")]
        when = ("before", "after") if shown else ("before",)
        rows = tuple((row["run"], *(_interval(row, each) for each in when)) for row in own.to_dict("records"))
        heads = [f"gap {each} (90 % interval)" for each in when]
        if shown and not verdict["effects"]:
            which = "best explanation" if verdict["best_known"] else "first explanation"
            heads[1] = f"gap with the {which} (90 % interval)"
        blocks += [TableBlock(("held-out run", *heads), rows), *_below_noise(gaps)]
    return [*blocks, _figure("gaps"), *([_figure("residuals")] if shown else [])]


def _interval(row: Mapping[str, Any], when: str) -> str:
    gap, low, high = (rounded_gap(row[f"{when}{end}"]) for end in ("", "_low", "_high"))
    return "–" if pd.isna(row[when]) else f"{gap} ({low} to {high})"


def _below_noise(gaps: pd.DataFrame) -> list[Block]:
    """Channels whose residual is far below their noise."""
    gap, high = (gaps[f"after{end}"].fillna(gaps[f"before{end}"]) for end in ("", "_high"))
    low = gaps.assign(gap=gap)[(high < _BELOW_NOISE) & (gaps["channel"] != "all") & (gaps["run"] != "all")]
    channels = [
        f"{in_words(channel)} ({joined(f'{row.run} {rounded_gap(row.gap)}' for row in rows.itertuples())})"
        for channel, rows in low.groupby("channel", sort=False)
    ]
    if not channels:
        return []
    text = f"The gap of {joined(channels)} is far below 1: the noise is overestimated. State or correct `noise`."
    return [Paragraph(text)]


def _where(verdict: Mapping[str, Any], windows: pd.DataFrame | None) -> list[Block]:
    places = [place_of(window["run"], window["channel"], *window["crank_angle_deg"]) for window in verdict["where"]]
    if windows is not None and len(windows):
        places = [_window(row) for row in windows.sort_values("rms", ascending=False).itertuples(index=False)]
    blocks: list[Block] = [Paragraph("No window of crank angle has a significant residual.")]
    if places:
        more = len(places) - _MOST_WINDOWS
        others = [f"and {more} more (map of disagreement)"] if more > 0 else []
        blocks = [
            Paragraph("Largest residuals of the model without added effects, its parameters re-fitted:"),
            Bullets((*places[:_MOST_WINDOWS], *others)),
        ]
    if verdict["orders"]:
        lines = tuple(
            f"run {line['run']}, {in_words(line['channel'])}: order {line['order']} ({line['order']} cycles per "
            f"revolution), amplitude {with_unit(number(line['amplitude']), unit_in_words(line['unit']))}, "
            f"{percent(line['share'])} of the residual beyond noise"
            for line in verdict["orders"]
        )
        text = "One order of the crank dominates (drive, gear teeth, motor poles, or a ringing joint):"
        blocks += [Paragraph(text), Bullets(lines)]
    return [Heading("Where it shows"), *blocks, _figure("disagreement")]


def _window(row) -> str:
    """One window of the map, and by how much measurement and model differ there."""
    side = ""
    if abs(row.mean) > _ONE_SIDED * row.rms:
        side = ", mostly above the model" if row.mean > 0 else ", mostly below the model"
    place = place_of(row.run, row.channel, row.start_deg, row.end_deg)
    return f"{place}: RMS residual {row.rms:.1f} standard deviations of the noise{side}"


def _why(verdict: Mapping[str, Any], force: pd.DataFrame | None) -> list[Block]:
    if verdict["verdict"] in ENOUGH:
        return []
    named = verdict["effects"]
    text = "Bayesian information criterion (BIC): fit against number of parameters; 10 is very strong evidence."
    if named:
        gains = (f"{_gain(effect)} for {effect_in_words(effect)}" for effect in named)
        text = f"Gain in BIC: {joined(gains)}. {text}"
    if is_told_by_features(verdict, [effect for effects in (named, *verdict["equivalent"]) for effect in effects]):
        text = "The ranking shows fits to samples, which do not decide here."
    pushes = (force is None or len(force)) and not all(map(is_fault, named))
    shown = [_figure("missing_force")] if pushes else []
    return [Heading("What else was tried"), Paragraph(text), _figure("ranking"), *shown]


def _gain(effect: Mapping[str, Any]) -> str:
    return "not known" if effect["delta_bic"] is None else f"{effect['delta_bic']:.0f}"


def _optimum(effects: Sequence[Mapping[str, Any]], optimum: pd.DataFrame | None) -> list[Block]:
    if optimum is None:
        return []
    heading = Heading("Does it move the optimum?")
    if all(map(is_fault, effects)):
        return [heading, Paragraph("Nothing was added to the mechanism, so the optimum stays.")]
    if optimum.empty:
        return [heading, Paragraph("No: all joints are ideal, so the transmission angle depends on the lengths alone.")]
    when, rows = {"base": "before", "augmented": "after"}, []
    for row in optimum.itertuples():
        if not pd.isna(row.failed):
            rows.append((when[row.model], "–", "–", "–", "–", "–", f"could not be optimised: {row.failed}"))
            continue
        lengths = (f"{1e3 * length:.2f} mm" for length in (row.crank_length, row.rod_length))
        falls = ("–" if pd.isna(share) else percent(share) for share in (row.reduction, row.resimulated))
        edge = "at a bound of the lengths" if row.at_edge else ""
        rows.append((when[row.model], in_words(row.source), *lengths, *falls, edge))
    heads = ("model", "motion from", "optimal crank", "optimal rod", "error reduction, frozen", "re-simulated", "")
    before = "" if (optimum["model"] == "base").any() else " Before, all joints were ideal."
    caption = f"Smallest RMS error of the transmission angle while the motion in the joints is frozen.{before}"
    return [heading, TableBlock(heads, tuple(rows), caption=caption), _figure("optimum")]


def _nuisances(verdict: Mapping[str, Any]) -> list[Block]:
    if not verdict["nuisances"]:
        return []
    units, rows, listed = NUISANCES | {"first_angle": "rad", "friction_speed": "m/s"}, [], []
    for key, estimate in verdict["nuisances"].items():
        *row, remark = estimate_row(nuisance_in_words(key), estimate, units.get(key.partition("@")[0], ""))
        is_listed = not key.startswith(_IN_EVERY_FIT)
        if is_listed:
            listed.append(estimate.get("remark"))
        kept = "stated value kept" if is_listed and "@" not in key and estimate.get("kept") else ""
        rows.append((*row, "; ".join(filter(None, (remark, kept)))))
    notes = []
    if any("stated value kept" in row[-1] for row in rows):
        notes.append(f"Where these data do not determine a value, `{MECHANISM}` keeps the one that you stated.")
    if AT_BOUND in listed:
        notes.append(
            "Check each value at its bound. If it is not plausible, the range is too narrow or something else is "
            "missing in the model."
        )
    return [
        Heading("Parameters re-fitted within their ranges"),
        TableBlock(_PARAMETER_HEADS, tuple(rows)),
        *map(Paragraph, notes),
    ]


def _limits(verdict: Mapping[str, Any], effects: pd.DataFrame | None) -> list[Block]:
    """What these data cannot show; `effects` is table `DETECTABLE`."""
    rate = percent(verdict["false_alarm_rate"])
    lines = [f"False alarms: in {rate} of campaigns in which nothing is missing, an effect would be named."]
    groups = verdict["preflight"]["merged"]
    lines += [f"Cannot be told apart and count as one: {joined(map(label_in_words, group))}." for group in groups]
    failed = {} if effects is None else failures_of_preflight(effects)
    explanations = [verdict["effects"], *verdict["equivalent"], (verdict["best_known"] or {}).get("effects", ())]
    told = {(effect["name"], effect["site"]) for explanation in explanations for effect in explanation}
    told_labels = {label for name, site in told for label in (name, f"{name}:{site}")}
    if absent := [one for one in verdict["preflight"]["undetectable"] if one not in failed and one not in told_labels]:
        lines.append(f"Cannot be detected with these runs and channels: {joined(map(label_in_words, absent))}.")
    if failed:
        lost = joined(f"{label_in_words(label)} ({reason})" for label, reason in failed.items())
        lines.append(f"Could not be simulated in the preflight, so detectability is not known: {lost}.")
    if effects is not None and verdict["verdict"] in ENOUGH and effects["detectable"].any():
        sizes = (
            f"{label_in_words(row.label)} "
            f"({shown_size(row.label, row.parameter, row.smallest_detectable, row.unit, row.falls)})"
            for row in effects[effects["detectable"]].sort_values("label").itertuples()
        )
        lines.append(f"Smallest detectable sizes: {', '.join(sizes)}.")
    if effects is not None and assumed(effects):
        lines.append("Detectability rests on assumed noise where the campaign states none (`jointgap preflight`).")
    return [Heading("How sure, and what these data cannot show"), Bullets(tuple(lines))]


_SMALLER = "To find smaller effects, measure a further speed or channel: `jointgap preflight` says which helps most."
_NEXT = {
    "no_disagreement": ("Use the model as it is, at these speeds and for what these channels show.", _SMALLER),
    "parameters_only": (f"Use `{MECHANISM}`: it has the parameters that the data determine.", _SMALLER),
    "ambiguous": (
        "Measure what separates the explanations, and run the campaign again with the new run added.",
        "Until then use none of them: all of them predict what was measured here.",
    ),
    "unexplained": (
        "See in the map of disagreement and in the residuals where it acts, and what on the rig acts there.",
        "Add an effect of your own as a formula: `jointgap effects discovered_slider_force` shows how.",
        "List uncertain masses, lengths and zeros under `nuisance` of the campaign file, and run it again.",
    ),
}


def _next_steps(verdict: Mapping[str, Any]) -> list[Block]:
    steps = list(_NEXT.get(verdict["verdict"], ()))
    if verdict["effects"]:
        faults = [effect for effect in verdict["effects"] if is_fault(effect)]
        steps = [f"Repair the sensor or correct its column: {explanation_in_words(faults)}."] if faults else []
        if len(faults) < len(verdict["effects"]):
            steps += [
                f"Use `{MECHANISM}`, your mechanism with what was found, as `mechanism` of a scenario.",
                "Change what is named on the rig (oil, load, fit) and measure again: the size should change with it.",
            ]
        if verdict["verdict"] == "named_with_remaining_misfit":
            steps.append("A residual is left: the map of disagreement shows where.")
    return [Heading("What to do next"), Bullets(tuple(steps))]


_ROLES = {"identify": "to fit and to choose", "confirm": "held out", "split": "two thirds to fit, last third held out"}


def _data(campaign: Campaign | None, look: pd.DataFrame | None, warnings: Sequence[str]) -> list[Block]:
    """The runs with their files, the channels, and what was noticed; `look` is table `LOOK`."""
    blocks: list[Block] = []
    if campaign is not None:
        sizes = {} if look is None else look.groupby("run")[["samples", "cycles"]].max().to_dict("index")
        rows = []
        for run in campaign.runs:
            counts = (str(sizes[run.id][key]) if run.id in sizes else "–" for key in ("samples", "cycles"))
            rows.append((run.id, f"`{run.file}`", f"{30.0 / pi * run.speed:.4g}", _ROLES[run.role], *counts))
        heads = ("run", "file", "crank speed [rpm]", "used", "samples", "whole revolutions")
        measured = f" Measured on {day_in_words(campaign.date)}." if campaign.date else ""
        blocks.append(TableBlock(heads, tuple(rows), "llrlrr", f"Runs of the campaign.{measured}"))
        channels = tuple(
            (in_words(name), f"`{channel.column}`", unit_in_words(channel.unit))
            for name, channel in campaign.channels.items()
        )
        blocks.append(TableBlock(("channel", "column of the files", "unit"), channels, caption="What was measured."))
    if warnings:
        blocks.append(Bullets(tuple(map(without_code_names, warnings))))
    return [Heading("About the data"), *blocks] if blocks else []


def conclude(state: CampaignState, advise: bool = True) -> dict[str, Any]:
    """Write ``verdict.json``; its content."""
    folder, outcome, separated = state.folder, state.outcome("verdict"), ""
    if advise and "preflight" not in failures(folder):
        with noted(folder, "advice"):
            separated = _separated_by(state, outcome.equivalent)
    detectable, confusability, gaps = (folder.read(name) for name in ("detectable", "confusability", "gaps"))
    added = outcome.named is not None
    concluded = verdict_json.Conclusion(
        campaign=state.campaign.name,
        outcome=outcome,
        windows=folder.read("map_windows"),
        gaps=gaps,
        gap={role: gap_of(gaps, role, added=added) for role in ("identify", "confirm")},
        held_out=held_out(gaps, {run.id: run.role for run in state.campaign.runs}, added),
        preflight={"undetectable": undetectable(detectable), "merged": confusable_groups(confusability)},
        false_alarm_rate=state.false_alarm_rate,
        separated_by=separated,
        clockwise=state.clockwise,
        standout=folder.read("map_standout"),
        doubted_channels=state.doubted_channels,
        families=folder.read("law_families"),
        repeats=not any(series.statistic for series in state.model.series),
    )
    content = verdict_json.document(concluded)
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
