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
    from jointgap.trials.batches import kept, of_files, pieces
    from jointgap.trials.make_trial import conceal
    from jointgap.trials.trial_plan import chosen, read_sets

    sizes = chosen(read_sets(sets), name)
    plans, found, code = pieces(sizes, batch), [], f"{code} {sizes.model_dump_json()}"
    for plan in plans:
        place, campaign = sealed / f"{plan.id}.json", campaigns / plan.id

        def made(plan=plan, campaign=campaign):
            truth = conceal(plan, sizes.seed, campaign)
            return truth | {"files": of_files(campaign)}

        found.append(kept(place, code, made, {"files": of_files(campaign)}))
        click.echo(plan.id)
    write_text(truth, json.dumps(found) + "\n")
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
    from jointgap.trials.analyse_trial import analysed
    from jointgap.trials.batches import kept, of_files, trials_in

    told = []
    for trial in trials_in(listed, campaigns):
        place, same = verdicts / trial / "trial.json", f"{code} {of_files(campaigns / trial)}"
        told.append(kept(place, same, lambda trial=trial: analysed(campaigns / trial, verdicts / trial)))
        verdict = told[-1].get("verdict", {}).get("verdict", told[-1].get("error"))
        click.echo(f"{trial} {verdict} {told[-1]['seconds']} s")
    write_text(found, json.dumps(told) + "\n")


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
    from jointgap.trials.trial_figures import draw
    from jointgap.trials.trials_report import markdown, metrics
    from jointgap.trials.trials_table import TRIALS, trials

    frame = trials(truths, founds)
    tables.write(TRIALS, frame, folder / "trials.parquet")
    for stem, drawing in draw(frame).items():
        style.save(drawing, folder / stem)
    tables.write_text(folder / "metrics.json", json.dumps(metrics(frame), indent=2) + "\n")
    words = markdown(name, frame)
    tables.write_text(folder / "summary.md", words)
    click.echo(words)


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
    from jointgap.trials.trial_runs import DESCRIPTION, records

    summary = publish_records(name, DESCRIPTION, records(folder), None, store)
    write_text(published, json.dumps(summary, indent=2) + "\n")
