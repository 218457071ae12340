"""Campaigns of the benchmark as plain files, their truth in an archive, and answers of methods."""

import json
import multiprocessing
import shutil
import zipfile
from collections.abc import Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from jointgap.core.errors import InputError
from validation.kinds import Trial, plan_trials, read_set
from validation.score import NAMED, NOTHING_NAMED, effect_label, families_named, name_stated
from validation.trial import make_trial

_DATE = (2026, 1, 1, 0, 0, 0)  # of all entries of the archive


def draw(folder: Path, count: int = 100, cores: int = 2, sets: str = "config/blind.yaml") -> None:
    """Draw the first trials of the set `published` into ``campaigns/{id}/`` and ``truth.zip``;
    interrupted draws resume."""
    chosen = read_set(sets, "published")
    plans = plan_trials(chosen, count)
    campaigns = folder / "campaigns"
    campaigns.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(folder / "truth.zip", "a", zipfile.ZIP_DEFLATED) as archive:
        known = {Path(name).stem for name in archive.namelist()}
    due = [plan for plan in plans if plan.id not in known or not (campaigns / plan.id).is_dir()]
    drawn = partial(_drawn, chosen.seed, campaigns)
    with multiprocessing.get_context("spawn").Pool(cores) if cores > 1 else nullcontext() as pool:
        for number, truth in enumerate(pool.imap(drawn, due) if pool else map(drawn, due), 1):
            if truth["id"] not in known:
                with zipfile.ZipFile(folder / "truth.zip", "a", zipfile.ZIP_DEFLATED) as archive:
                    entry = zipfile.ZipInfo(f"{truth['id']}.json", _DATE)
                    archive.writestr(
                        entry, json.dumps(truth, indent=1, allow_nan=False), zipfile.ZIP_DEFLATED
                    )
            print(f"{number} of {len(due)}: {truth['id']}", flush=True)


def _drawn(seed: int, campaigns: Path, plan: Trial) -> dict[str, Any]:
    """Write the campaign of a trial with CSV files; its truth."""
    shutil.rmtree(campaigns / plan.id, ignore_errors=True)  # of an interrupted draw
    return make_trial(plan, seed, campaigns / plan.id, endings=("csv", "csv", "csv"))


def answers(records: Path, method: str = "verdict") -> dict[str, Any]:
    """Answers by trial from the files ``{trial}.json`` in a folder, of a `method`."""
    found = {path.stem: json.loads(path.read_bytes()) for path in sorted(records.glob("*.json"))}
    if not found:
        raise InputError(f"{records}: has no file {{trial}}.json")
    verdicts = {trial: _of_verdict(record.get("verdict")) for trial, record in found.items()}
    return (
        verdicts
        if method == "verdict"
        else {trial: record.get(method) for trial, record in found.items()}
    )


def _of_verdict(verdict: Mapping[str, Any] | None) -> Any:
    """Named effects with sizes; [] if nothing is missing; None without a decision."""
    if verdict is None or verdict["verdict"] not in NAMED:
        return [] if verdict and verdict["verdict"] in NOTHING_NAMED else None
    effects = verdict["effects"]
    size = {
        effect_label(one): {key: own["value"] for key, own in one["parameters"].items()}
        for one in effects
    }
    size |= {
        name_stated(one): {"shape": family["interval_99"]}
        for one in effects
        for family in families_named(one)
    }
    return {"named": sorted(map(name_stated, effects)), "size": size}
