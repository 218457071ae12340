"""What each step and setting of the identification is worth, on trials with known effects.

A variant leaves out one step, or halves or doubles one setting. Each analysis is a process with a
limit of processor time; its record is a file, so an interrupted ablation resumes.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.page import Heading, Page, Paragraph, TableBlock, to_markdown
from jointgap.identification.search import STEPS, Step
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from validation.analyse import analyse_trial
from validation.kinds import CLEARANCES, Trial
from validation.runner import analyse_within, draw_trial, summary, write_record
from validation.score import UNFINISHED, score_trial

COMPLETE = "complete"
"""Name of the variant with all steps and the default settings."""

OUTCOMES = ("right", "partly", "ambiguous", "unexplained", "missed", "wrong", "failed", UNFINISHED)

KINDS = ("steps", "sections", "settings")
"""Kinds of variants: one step left out; all settings of a section, or one, halved or doubled."""

_FACTORS = {"halved": 0.5, "doubled": 2.0}


@dataclass(frozen=True)
class Variant:
    """An identification with one change."""

    name: str
    kind: str = COMPLETE  # or one of KINDS
    settings: IdentificationSettings = DEFAULT_SETTINGS
    steps: Sequence[Step] = STEPS
    changed: str = ""  # the changed setting, or the section of the settings


def all_variants() -> list[Variant]:
    """The complete identification, then a variant for each change."""
    variants = [Variant(COMPLETE)]
    for step in STEPS:
        others = tuple(other for other in STEPS if other is not step)
        variants.append(Variant(f"without {step.name}", "steps", steps=others))
    sections = [(field.name,) for field in fields(DEFAULT_SETTINGS)]
    for kind, paths in (("sections", sections), ("settings", _numbers(DEFAULT_SETTINGS))):
        for path in paths:
            for word, factor in _FACTORS.items():
                settings = _with_scaled(DEFAULT_SETTINGS, path, factor)
                if settings != DEFAULT_SETTINGS:
                    changed = ".".join(path)
                    name = f"{changed} {word}"
                    variants.append(Variant(name, kind, settings, changed=changed))
    return variants


def chosen_variants(choice: str) -> list[Variant]:
    """The complete identification and the variants of a kind (`KINDS`), or with names that match a
    pattern such as ``stopping.*``."""
    complete, *others = all_variants()
    kept = [
        variant for variant in others if variant.kind == choice or fnmatch(variant.name, choice)
    ]
    if not kept and choice != COMPLETE:
        raise InputError(
            f"variants: '{choice}' matches none; give {COMPLETE}, {', '.join(KINDS)}, or a pattern"
            f" such as '{others[-1].changed.partition('.')[0]}.*'"
        )
    return [complete, *kept]


def scaled(value: Any, factor: float) -> Any:
    """A setting times `factor`. Of a share above one half the distance to 1 is scaled; whole
    numbers stay whole and at least 1."""
    if isinstance(value, tuple):
        return tuple(scaled(number, factor) for number in value)
    if isinstance(value, bool):
        return value
    if isinstance(value, int):
        return max(1, round(value * factor))
    if 0.5 < value < 1.0:
        return max(0.0, 1.0 - factor * (1.0 - value))
    return value * factor


def _numbers(settings: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Path of each number and tuple of numbers."""
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            yield from _numbers(value, (*path, field.name))
        elif not isinstance(value, bool):
            yield *path, field.name


def _with_scaled(settings: Any, path: Sequence[str], factor: float) -> Any:
    """The settings with a scaled number, or with all scaled numbers of a section."""
    if not is_dataclass(settings):
        return scaled(settings, factor)
    names = path[:1] or [field.name for field in fields(settings)]
    return replace(
        settings,
        **{name: _with_scaled(getattr(settings, name), path[1:], factor) for name in names},
    )


def watched(settings: Any, read: set[str], path: str = "") -> Any:
    """Equal settings that add the path of each number to `read` when it is read."""
    names = {field.name for field in fields(settings)}

    class Watched(type(settings)):
        def __getattribute__(self, name: str) -> Any:
            value = super().__getattribute__(name)
            if name in names and not is_dataclass(value):
                read.add(path + name)
            return value

    copy = object.__new__(Watched)
    for name in names:
        value = getattr(settings, name)
        inner = watched(value, read, f"{path}{name}.") if is_dataclass(value) else value
        object.__setattr__(copy, name, inner)
    return copy


def analyse_variant(campaign: Path, variant: Variant) -> dict[str, Any]:
    """The record of `analyse_trial` with ``settings_read``, the paths of the settings in use."""
    read: set[str] = set()
    record = analyse_trial(campaign, watched(variant.settings, read), variant.steps, others=False)
    return record | {"settings_read": sorted(read)}


def ablate(
    plans: Sequence[Trial],
    seed: int,
    folder: Path,
    variants: Sequence[Variant],
    seconds: float = 150.0,
    budget: float = 3600.0,
    analyse: Callable[[Path, Variant], dict[str, Any]] = analyse_variant,
) -> pd.DataFrame:
    """Analyse trials of a set with `seed` by all `variants`; one row for each analysis that
    `folder` holds of them.

    The first variant analyses all trials. Then the others follow, with the cheapest trial first,
    until `budget` CPU-seconds are spent. An analysis ends unfinished after `seconds` CPU-seconds. A
    setting that the first variant did not read changes nothing: then its record is repeated.
    """
    first, *others = variants
    spent, known = 0.0, {}
    for plan in plans:
        if spent < budget:
            truth = folder / "truth" / f"{plan.id}.json"
            draw_trial(plan, seed, folder / "campaigns" / plan.id, truth)
            spent += _analysed(folder, first, plan, seconds, analyse)
        known[plan] = _read(_place(folder, first, plan))
    for plan in sorted(plans, key=lambda plan: known[plan].get("seconds", math.inf)):
        for variant in others:
            if is_unused(variant, known[plan]):
                write_record(_place(folder, variant, plan), known[plan])
            elif spent < budget:
                spent += _analysed(folder, variant, plan, seconds, analyse)
    return table_of_analyses(folder, plans)


def is_unused(variant: Variant, record: Mapping[str, Any]) -> bool:
    """Whether the analysis of a `record` did not read the changed settings of a variant."""
    return (
        bool(variant.changed)
        and "settings_read" in record
        and not any(
            f"{path}.".startswith(f"{variant.changed}.") for path in record["settings_read"]
        )
    )


def _analysed(
    folder: Path, variant: Variant, plan: Trial, seconds: float, analyse: Callable
) -> float:
    """CPU-seconds of an analysis; 0 if its record exists."""
    path = _place(folder, variant, plan)
    if path.is_file():
        return 0.0
    campaign = folder / "campaigns" / plan.id
    record = analyse_within(path, plan.id, partial(analyse, campaign, variant), seconds)
    print(f"{variant.name}: {plan.number}: {summary(record)}", flush=True)
    return record["seconds"]


def _place(folder: Path, variant: Variant, plan: Trial) -> Path:
    return folder / "analyses" / variant.name / f"{plan.id}.json"


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_bytes()) if path.is_file() else {}


def table_of_analyses(folder: Path, plans: Sequence[Trial]) -> pd.DataFrame:
    """One row for each analysis of `plans` in `folder`: score, variant, group of the trial,
    simulated runs and revolutions."""
    rows = []
    for plan in plans:
        for path in sorted((folder / "analyses").glob(f"*/{plan.id}.json")):
            record = _read(path)
            row = score_trial(_read(folder / "truth" / f"{plan.id}.json"), record)
            spent = record.get("verdict", {}).get("costs", {}).get("total", {})
            costs = {key: spent.get(key, math.nan) for key in ("runs", "revolutions")}
            rows.append({"variant": path.parent.name, "group": group_of(plan), **row, **costs})
    return pd.DataFrame(rows)


def group_of(plan: Trial) -> str:
    """Group of trials with similar costs."""
    if plan.base == "chaotic":
        return "motion never repeats"
    if plan.kind == "triple":
        return f"three effects, {plan.base} joints"
    if plan.kind == "pair":
        return f"two effects, {plan.base} joints"
    if set(plan.effects) & set(CLEARANCES):
        return "hidden clearance"
    return f"one effect or none, {plan.base} joints"


def by_group(analyses: pd.DataFrame) -> pd.DataFrame:
    """Outcomes and costs of one variant by group of trials."""
    groups = analyses.groupby("group")
    counts = pd.crosstab(analyses["group"], analyses["outcome"])
    found = [outcome for outcome in OUTCOMES if outcome in counts]
    costs = {
        "CPU-s, median": groups["seconds"].median().round(1),
        "CPU-s, 90 %": groups["seconds"].quantile(0.9).round(1),
        "revolutions, median": groups["revolutions"].median().round(),
    }
    return pd.concat([groups.size().rename("trials"), counts[found], pd.DataFrame(costs)], axis=1)


def against_complete(analyses: pd.DataFrame) -> pd.DataFrame:
    """Each variant against the complete identification on the same trials: verdicts that change,
    right ones lost and gained, and the ratio of the costs [%]."""
    complete = analyses[analyses["variant"] == COMPLETE].set_index("id")
    rows = []
    for name, part in analyses[analyses["variant"] != COMPLETE].groupby("variant", sort=False):
        changed = part.set_index("id")
        changed = changed[changed.index.isin(complete.index)]
        usual = complete.loc[changed.index]
        same = (changed[["verdict", "named"]] == usual[["verdict", "named"]]).all(axis=1)
        was_right, is_right = usual["outcome"] == "right", changed["outcome"] == "right"
        known = changed["revolutions"].notna() & usual["revolutions"].notna()
        revolutions = changed["revolutions"][known].sum() / usual["revolutions"][known].sum()
        seconds = changed["seconds"].sum() / usual["seconds"].sum()
        rows.append(
            {
                "variant": name,
                "trials": len(changed),
                "other verdict": int((~same).sum()),
                "right lost": int((was_right & ~is_right).sum()),
                "right gained": int((is_right & ~was_right).sum()),
                "revolutions [%]": round(100 * revolutions, 1),
                "CPU-s [%]": round(100 * seconds, 1),
            }
        )
    return pd.DataFrame(rows)


def write_ablation(name: str, analyses: pd.DataFrame, folder: Path) -> str:
    """Write ``analyses.csv`` and the page ``ablation.md`` to `folder`; the page."""
    write_text(folder / "analyses.csv", analyses.to_csv(index=False, float_format="%.6g"))
    blocks = [
        Heading("Complete identification"),
        Paragraph("An unfinished analysis counts with its limit of processor time."),
        _block(by_group(analyses[analyses["variant"] == COMPLETE]).reset_index()),
    ]
    variants = against_complete(analyses)
    if len(variants):
        blocks += [
            Heading("Variants"),
            Paragraph(
                "Each variant leaves out one step, or halves or doubles one setting (of a share"
                " above one half: its distance to 1). It is compared with the complete"
                " identification on the same trials."
            ),
            _block(variants),
        ]
    text = to_markdown(Page(f"Steps and settings: {name}", tuple(blocks)))
    write_text(folder / "ablation.md", text)
    return text


def _block(table: pd.DataFrame) -> TableBlock:
    texts = table.astype(object).where(table.notna(), "").astype(str)
    rows, numbers = texts.itertuples(index=False), len(table.columns) - 1
    return TableBlock(tuple(table), tuple(rows), "l" + numbers * "r")
