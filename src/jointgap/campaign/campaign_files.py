"""Files of a campaign's results."""

import hashlib
import json
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointgap.core.costs import costs_so_far
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.files import write_text

if TYPE_CHECKING:  # slow to load
    import pandas as pd

    from jointgap.config.campaign import Campaign
    from jointgap.core.results_folder import ResultsFolder

MECHANISM, VERDICT = "mechanism.yaml", "verdict.json"
SUMMARIES = ("summary.md", "summary.html")
COSTS = "costs.jsonl"
"""Result files of a campaign; the last one has a line for each stage up to the verdict."""


@dataclass(frozen=True)
class CampaignFiles:
    """Files of one campaign."""

    campaign: str  # The campaign file
    plan: tuple[str, ...]  # The campaign file and its mechanism file
    data: tuple[str, ...]  # One of each run


def campaigns(paths: Any, folders: Sequence[Path]) -> dict[str, CampaignFiles]:
    """The campaigns of a configuration, by name."""
    from jointgap.config.load import load_campaign

    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(
            f"campaigns = {paths!r} must be a list of campaign files, e.g."
            " [config/campaigns/mine.yaml]"
        )
    found: dict[str, CampaignFiles] = {}
    for path in paths:
        file = next((folder / path for folder in folders if os.path.isfile(folder / path)), None)
        if file is None:
            searched = ", ".join(dict.fromkeys(str(folder.resolve()) for folder in folders))
            raise InputError(
                f"campaigns: no file '{path}' (looked in {searched}); give the path of a campaign"
                " file (CAMPAIGN=... of `make campaign`)"
            )
        campaign = load_campaign(file)
        check_same_file(file, Path("results/campaigns") / campaign.name)
        if campaign.name in found:
            both = f"{found[campaign.name].campaign} and {file}"
            raise InputError(
                f"campaigns: {both} have the same name '{campaign.name}'; give each its own name"
            )
        for run in campaign.runs:
            for missing in (
                name for name in run.files if not os.path.isfile(campaign.folder / name)
            ):
                raise InputError(
                    f"{file}: run {run.id}: no file '{missing}' in {campaign.folder}; correct"
                    " `file` or `folder`"
                )
        planned = (*plan(file), *campaign.load_files)
        data = tuple(map(str, campaign.data_files))
        if braced := [read for read in (*planned, *data) if "}" in read.partition("{")[2]]:
            raise InputError(
                f"{file}: the path {braced[0]} contains braces, which Snakemake reads as a"
                " wildcard; rename the folder or file, or run `jointgap analyse`"
            )
        found[campaign.name] = CampaignFiles(str(file), planned, data)
    return found


def plan(file: Path) -> tuple[str, ...]:
    """A campaign file and its mechanism file, if any."""
    from jointgap.config import read_yaml
    from jointgap.config.yaml_files import mechanism_file

    mechanism = read_yaml(file).get("mechanism")
    named = (
        [mechanism_file(mechanism, (file.parent,), f"{file}: mechanism")]
        if isinstance(mechanism, str)
        else []
    )
    return (str(file), *map(str, named))


ORIGIN = "campaign_file.json"
"""The campaign file that a folder of results is of: its path from that folder, which moves with it,
and its digest."""


def write_origin(file: Path, results: Path) -> None:
    """Note in the folder `results` that it is of the campaign `file`."""
    path = os.path.relpath(os.path.realpath(file), os.path.realpath(results))
    write_text(results / ORIGIN, json.dumps({"file": path, "sha256": _digest(file)}) + "\n")


def check_same_file(file: Path, results: Path) -> None:
    """InputError if the folder `results` is of another campaign file: its verdict would be
    replaced.

    A file that was moved, but not changed, is no other.
    """
    if not (results / ORIGIN).is_file():
        return
    origin = json.loads((results / ORIGIN).read_text(encoding="utf-8"))
    earlier = Path(os.path.normpath(os.path.join(os.path.realpath(results), origin["file"])))
    same = (
        os.path.samefile(earlier, file) if earlier.is_file() else origin["sha256"] == _digest(file)
    )
    if not same:
        raise InputError(
            f"{file}: {results} contains the results of another file, {earlier}; give this one"
            f" another `name`, choose another folder of results, or delete {results}"
        )


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


@contextmanager
def recorded_failure(folder: "ResultsFolder", step: str) -> Iterator[None]:
    """Context of an optional step: an error is written to the results `folder`, and the analysis
    continues."""
    path = folder.path / "failed" / f"{step}.txt"
    path.unlink(missing_ok=True)
    try:
        yield
    except OSError:  # such as a full disk
        raise
    except Exception as error:
        is_expected = isinstance(error, InputError | SimulationError)
        kind = "" if is_expected else f"{type(error).__name__}: "
        write_text(path, f"{kind}{' '.join(str(error).split())}\n\n{traceback.format_exc()}")


def failures(folder: "ResultsFolder") -> dict[str, str]:
    """The error of each optional step that failed, in a line, by step."""
    paths = sorted((folder.path / "failed").glob("*.txt"))
    return {path.stem: path.read_text(encoding="utf-8").partition("\n")[0] for path in paths}


@contextmanager
def recorded_costs(folder: "ResultsFolder", stage: str) -> Iterator[None]:
    """Context of a stage: its costs are added to the results `folder`."""
    begin = costs_so_far()
    yield
    spent = {name: round(end - begin[name], 3) for name, end in costs_so_far().items()}
    folder.path.mkdir(parents=True, exist_ok=True)
    with (folder.path / COSTS).open("a", encoding="utf-8") as file:
        file.write(json.dumps({"stage": stage} | spent) + "\n")


def costs(folder: "ResultsFolder") -> dict[str, Any]:
    """The costs of each stage, by its name, and their sum; a repeated stage counts once."""
    path, names = folder.path / COSTS, costs_so_far()
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    entries = [json.loads(line) for line in lines]
    jobs = {entry["stage"]: {name: entry[name] for name in names} for entry in entries}
    total = {name: round(sum(job[name] for job in jobs.values()), 3) for name in names}
    return {"jobs": jobs, "total": total}


def end_after_failures(folder: "ResultsFolder") -> None:
    """Exit code 3 and a line per failed step, if an optional step failed."""
    failed = failures(folder)
    for step, error in failed.items():
        details = folder.path / "failed" / f"{step}.txt"
        print(f"jointgap: failed: {step}: {error} (more: {details})", file=sys.stderr)
    if failed:
        raise SystemExit(3)


def config_snapshot(campaign: "Campaign") -> "pd.DataFrame":
    """Table `CONFIG_SNAPSHOT`: keys and values of a campaign and its mechanism."""
    import pandas as pd

    from jointgap.config.yaml_files import leaves

    # name, date and folder do not change the data
    content = campaign.model_dump(mode="json", exclude={"name", "date", "folder"})
    content["runs"] = {run.pop("id"): run for run in content["runs"]}
    content["nuisance"] = dict(campaign.nuisance)  # with all digits
    rows = [(".".join(path), json.dumps(value)) for path, value in leaves(content)]
    return pd.DataFrame(rows, columns=["key", "value"])


def check_unchanged(campaign: "Campaign", snapshot: "pd.DataFrame") -> None:
    """InputError if a campaign file has changed since its data were read."""
    now, then = (
        dict(zip(table["key"], table["value"], strict=True))
        for table in (config_snapshot(campaign), snapshot)
    )
    if list(now.items()) == list(then.items()):
        return
    changed = next((key for key in {**then, **now} if now.get(key) != then.get(key)), None)
    what = f"{changed}: {then.get(changed, 'absent')} then, {now.get(changed, 'absent')} now"
    raise InputError(
        f"campaign {campaign.name}: the file has changed since its data were read"
        f" ({what if changed else 'other order'}; SI); repeat `jointgap measure` and the later"
        " stages"
    )
