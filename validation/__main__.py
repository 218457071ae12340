"""Blind trials: `python -m validation conceal|analyse|score|track`, as `make blind` calls them.

Only the score reads what was sealed.
"""

import json
import os
import sys
from pathlib import Path

import click

FILE, FOLDER = click.Path(dir_okay=False, path_type=Path), click.Path(file_okay=False, path_type=Path)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def cli() -> None:
    """Blind trials: campaigns with hidden effects, analysed without the ground truth at hand, then scored."""


def _write(path: Path, record: object) -> None:
    path.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


@cli.command()
@click.option("--sets", type=FILE, required=True, help="YAML file with the sets of trials.")
@click.option("--set", "name", required=True, help="Name of the set.")
@click.option("--trial", required=True, help="Identifier of the trial.")
@click.option("--campaign", type=FOLDER, required=True, help="Folder to write: the campaign.")
@click.option("--sealed", type=FILE, required=True, help="JSON file to write: the ground truth.")
def conceal(sets: Path, name: str, trial: str, campaign: Path, sealed: Path) -> None:
    """Draw one campaign, hide effects in its data, and seal the ground truth elsewhere."""
    from validation.hide import make_trial
    from validation.plan import plan_trials, read_sets, trial_set

    chosen = trial_set(read_sets(sets), name)
    plan = next((plan for plan in plan_trials(chosen) if plan.id == trial), None)
    if plan is None:
        raise click.BadParameter(f"the set {name} has no trial {trial}", param_hint="--trial")
    _write(sealed, make_trial(plan, chosen.seed, campaign))


@cli.command()
@click.option("--campaign", type=FOLDER, required=True, help="Folder of the campaign.")
@click.option("--found", type=FILE, required=True, help="JSON file to write: the verdict, and what baselines name.")
def analyse(campaign: Path, found: Path) -> None:
    """Identify what is missing in one campaign, in a folder that holds it alone."""
    from validation.analyse import analyse_trial

    record = analyse_trial(campaign)
    _write(found, record)
    click.echo(f"{record['id']} {record.get('verdict', {}).get('verdict', record.get('error'))} {record['seconds']} s")


@cli.command()
@click.option("--set", "name", required=True, help="Title of the set.")
@click.option("--sealed", type=FOLDER, required=True, help="Folder of the ground truths.")
@click.option("--verdicts", type=FOLDER, required=True, help="Folder of what was found.")
@click.option("--trial", "trials", multiple=True, help="Trial to score; repeatable; all that were analysed if absent.")
@click.option("--folder", type=FOLDER, required=True, help="Folder for trials.csv, rates.csv, the page, the figure.")
def score(name: str, sealed: Path, verdicts: Path, trials: tuple[str, ...], folder: Path) -> None:
    """Open the seals: how often the verdict was right, wrong or silent, with intervals, and what the baselines do."""
    from validation.report import write_score
    from validation.score import score_trials

    frame = score_trials(sealed, verdicts, trials or sorted(path.stem for path in verdicts.glob("*.json")))
    click.echo(write_score(name, frame, folder))


@cli.command()
@click.option("--set", "name", required=True, help="Title of the set.")
@click.option("--folder", type=FOLDER, required=True, help="Folder of the score.")
@click.option("--store", type=FOLDER, required=True, help="Folder of the MLflow store.")
@click.option("--published", type=FILE, required=True, help="JSON file to write: what was published where.")
def track(name: str, folder: Path, store: Path, published: Path) -> None:
    """Publish the score of a set to MLflow; nothing twice."""
    from jointgap.core.publish import publish_records
    from validation.report import DESCRIPTION, mlflow_records

    _write(published, publish_records(name, DESCRIPTION, mlflow_records(folder), None, store))


def main() -> None:
    """Run a command; a mistake in the input ends with its message, not a traceback."""
    from jointgap.core.errors import InputError

    for library in ("OPENBLAS", "OMP", "MKL"):  # sums in another order would change the last bits
        os.environ[f"{library}_NUM_THREADS"] = "1"
    try:
        cli()
    except InputError as error:
        sys.exit(f"validation: error: {error}")


if __name__ == "__main__":
    main()
