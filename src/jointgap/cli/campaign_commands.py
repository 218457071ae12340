"""Subcommands of a campaign: measured runs of a rig against its model."""

from pathlib import Path

import click

from jointgap.cli.group import IN, cli

campaign_argument = click.argument("campaign", type=IN)

folder_option = click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the campaign's results; results/campaigns/NAME when absent.",
)


def _case(campaign: Path, folder: Path | None):
    """The campaign with its results folder."""
    from jointgap.campaign.state import Case

    return Case(campaign, folder)


_parts = click.option(
    "--parts",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Into how many parts the fits are divided.",
)
_part = click.option(
    "--part", type=click.IntRange(min=0), default=0, show_default=True, help="Which of them to fit, counted from 0."
)

_STAGES = {
    "measure": "Read the runs of CAMPAIGN into SI units, check them, and look at them: cycles, gaps, scatter.",
    "noise": "Find the noise of every channel of every run, from what does not repeat.",
    "recalibrate": "Fit the parameters that are not known exactly within their ranges.",
    "screen": "Simulate every effect that could be missing at a small size, and choose what is worth a fit.",
    "fit": "Fit the chosen effects by forward simulation.",
    "pair": "Fit the pairs of effects that are worth it by forward simulation.",
    "decide": "Weigh the fits: what is missing, or why it cannot be told.",
    "locate": "Map where the recalibrated model disagrees with the measurement: run, channel, crank angle.",
    "regress": "Where no effect explains what is missing: look for a force law as a formula.",
    "confirm": "Predict the held-out runs with and without what was found.",
    "augment": "Write the mechanism file with what was found, for every other stage.",
    "rechain": "Optimise the link lengths for the model before and after: does the missing effect move the optimum?",
    "conclude": "Write verdict.json, the one-page summary and the figures.",
}
_OPTIONS = {"fit": (_part, _parts), "pair": (_part, _parts), "decide": (_parts,)}

_then = click.option(
    "--then",
    "further",
    type=click.Choice(tuple(_STAGES)),
    metavar="STAGE",
    multiple=True,
    help="Another stage to run afterwards in the same process; repeatable.",
)


def _check_part(part: int, parts: int) -> None:
    """InputError on a part that nobody would read."""
    from jointgap.errors import InputError

    if part >= parts:
        raise InputError(
            f"--part {part}: parts are counted from 0, and --parts {parts} has none of that number; give {parts - 1} at most, or more "
            "--parts"
        )


def _stage(name: str, words: str) -> None:
    """Make the subcommand that runs one stage on files, and others after it."""

    def command(campaign: Path, folder: Path | None, further: tuple[str, ...], **given) -> None:
        from jointgap.campaign import stages

        if "part" in given:
            _check_part(given["part"], given["parts"])
        case = _case(campaign, folder)
        case.folder.check_writable(f"{name}/{given['part']}" if "part" in given else name, *further)
        getattr(stages, name)(case, **given)
        for other in further:
            getattr(stages, other)(case)
        if name == "measure":
            lines = [f"Remark: {text}" for text in case.measurements.remarks]
            click.echo("\n".join([*lines, f"figures and tables: {case.folder.path / name}"]))

    command.__doc__ = words
    made = campaign_argument(folder_option(_then(command)))
    for option in _OPTIONS.get(name, ()):
        made = option(made)
    cli.command(name)(made)


for _name, _words in _STAGES.items():
    _stage(_name, _words)


@cli.command()
@campaign_argument
@folder_option
def preflight(campaign: Path, folder: Path | None) -> None:
    """Say before anything is measured what CAMPAIGN will be able to show.

    Which effects these speeds and channels can detect, from which size on, which of them they cannot tell apart, and which
    further speed or channel would help most. The runs' files need not exist; of those that do, the samples are counted.
    """
    from jointgap.campaign import stages
    from jointgap.campaign.preflight import in_words

    case = _case(campaign, folder)
    case.folder.check_writable("preflight")
    stages.preflight(case)
    click.echo(in_words(*(case.folder.read(name) for name in ("detectable", "confusability", "advice"))))


@cli.command()
@campaign_argument
@folder_option
def analyse(campaign: Path, folder: Path | None) -> None:
    """Find what is missing in the model of CAMPAIGN: every stage in one go, down to verdict.json, summary and figures.

    `make campaign` does the same with stages side by side, goes on where it was stopped, and optimises again.
    """
    from jointgap.campaign.conclude import show
    from jointgap.campaign.pipeline import analyse as whole
    from jointgap.campaign.verdict_sentences import answer

    case = _case(campaign, folder)
    verdict = whole(campaign, case.folder.path)
    show(case)
    click.echo(f"{verdict['verdict']}: {answer(verdict)}\n{case.folder.path / 'summary.md'}")


@cli.command("track-campaign")
@campaign_argument
@folder_option
@click.option("--store", type=click.Path(file_okay=False, path_type=Path), required=True, help="Folder of the store.")
@click.option("--published", type=IN, required=True, help="JSON file to write: what was published where.")
def track_campaign(campaign: Path, folder: Path | None, store: Path, published: Path) -> None:
    """Publish a campaign's verdict, fits and figures to MLflow; nothing twice."""
    import json

    from jointgap.campaign.mlflow_runs import DESCRIPTION, records
    from jointgap.tables import write_text
    from jointgap.track.publish import publish_records

    case = _case(campaign, folder)
    summary = publish_records(case.campaign.name, DESCRIPTION, records(case.folder.path), None, store)
    write_text(published, json.dumps(summary, indent=2) + "\n")
