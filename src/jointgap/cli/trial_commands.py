"""Blind trials: conceal, analyse, score."""

from pathlib import Path

import click

from jointgap.cli.group import IN, OUT, cli, need

_FOLDER = click.Path(file_okay=False, path_type=Path)
_code = click.option("--code", default="", help="Digest of the code; trials made by the same are not made again.")


@cli.command("blind-conceal")
@need("--sets", "YAML file with the sets of trials.")
@click.option("--set", "name", required=True, help="Which set.")
@click.option("--batch", type=click.IntRange(min=0), required=True, help="Which batch of it, counted from 0.")
@click.option("--campaigns", type=_FOLDER, required=True, help="Folder for the campaigns, one each in a folder.")
@click.option("--sealed", type=_FOLDER, required=True, help="Folder for the truth, one file each.")
@need("--listed", "Text file to write: the batch's identifiers.", OUT)
@need("--truth", "JSON file to write: the batch's truth.", OUT)
@_code
def blind_conceal(
    sets: Path, name: str, batch: int, campaigns: Path, sealed: Path, listed: Path, truth: Path, code: str
) -> None:
    """Draw the campaigns of one batch, hide effects in their data, and seal the truth elsewhere."""
    import json

    from jointgap.tables import write_text
    from jointgap.trials.batches import cached_record, folder_digest
    from jointgap.trials.make_trial import make_trial
    from jointgap.trials.trial_plan import plan_batch, read_sets, trial_set

    chosen = trial_set(read_sets(sets), name)
    plans, records, code = plan_batch(chosen, batch), [], f"{code} {chosen.model_dump_json()}"
    for plan in plans:
        campaign = campaigns / plan.id

        def make(plan=plan, campaign=campaign) -> dict:
            return make_trial(plan, chosen.seed, campaign) | {"files": folder_digest(campaign)}

        required = {"files": folder_digest(campaign)}
        records.append(cached_record(sealed / f"{plan.id}.json", code, make, required))
        click.echo(plan.id)
    write_text(truth, json.dumps(records) + "\n")
    write_text(listed, "".join(f"{plan.id}\n" for plan in plans))


@cli.command("blind-analyse")
@need("--listed", "Text file with the batch's identifiers.")
@click.option("--campaigns", type=_FOLDER, required=True, help="Folder of the campaigns.")
@click.option("--verdicts", type=_FOLDER, required=True, help="Folder for what is found, one folder each.")
@need("--found", "JSON file to write: the batch's verdicts, and what the baselines name.", OUT)
@_code
def blind_analyse(listed: Path, campaigns: Path, verdicts: Path, found: Path, code: str) -> None:
    """Name what is missing in the campaigns of one batch, each in a folder that holds it alone."""
    import json

    from jointgap.tables import write_text
    from jointgap.trials.analyse_trial import analyse_trial
    from jointgap.trials.batches import cached_record, folder_digest, listed_trials

    records = []
    for trial in listed_trials(listed, campaigns):
        campaign, results = campaigns / trial, verdicts / trial
        digest = f"{code} {folder_digest(campaign)}"
        record = cached_record(
            results / "trial.json", digest, lambda campaign=campaign, results=results: analyse_trial(campaign, results)
        )
        records.append(record)
        click.echo(f"{trial} {record.get('verdict', {}).get('verdict', record.get('error'))} {record['seconds']} s")
    write_text(found, json.dumps(records) + "\n")


@cli.command("blind-score")
@click.option("--set", "name", required=True, help="What the set is called, for the title.")
@click.option("--truth", "truths", type=IN, multiple=True, required=True, help="A batch's truth; repeatable.")
@click.option("--found", "founds", type=IN, multiple=True, required=True, help="A batch's verdicts; repeatable.")
@click.option("--folder", type=_FOLDER, required=True, help="Folder for trials.parquet, summary.md and the figures.")
def blind_score(name: str, truths: tuple[Path, ...], founds: tuple[Path, ...], folder: Path) -> None:
    """Open the seals: how often the naming was right, wrong or silent, with intervals, and what the baselines do."""
    import json

    from jointgap import tables
    from jointgap.figures import style
    from jointgap.trials.score import TRIALS, score_batches
    from jointgap.trials.trial_figures import draw_score
    from jointgap.trials.trials_report import markdown, metrics

    frame = score_batches(truths, founds)
    tables.write(TRIALS, frame, folder / "trials.parquet")
    for stem, drawing in draw_score(frame).items():
        style.save(drawing, folder / stem)
    tables.write_text(folder / "metrics.json", json.dumps(metrics(frame), indent=2) + "\n")
    page = markdown(name, frame)
    tables.write_text(folder / "summary.md", page)
    click.echo(page)


@cli.command("blind-track")
@click.option("--set", "name", required=True, help="What the set is called.")
@click.option("--folder", type=_FOLDER, required=True, help="Folder of the score.")
@click.option("--store", type=_FOLDER, required=True, help="Folder of the store.")
@need("--published", "JSON file to write: what was published where.", OUT)
def blind_track(name: str, folder: Path, store: Path, published: Path) -> None:
    """Publish the score of a set of blind trials to MLflow; nothing twice."""
    import json

    from jointgap.tables import write_text
    from jointgap.track.publish import publish_records
    from jointgap.trials.trials_report import DESCRIPTION, mlflow_records

    summary = publish_records(name, DESCRIPTION, mlflow_records(folder), None, store)
    write_text(published, json.dumps(summary, indent=2) + "\n")
