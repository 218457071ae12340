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
    from jointgap.campaign.case import Case

    case = Case(campaign, folder or Path())
    if folder is None:
        case.folder.path = Path("results/campaigns") / case.campaign.name
    return case


def _stage(name: str, words: str, **settings):
    """A subcommand that runs one stage on files."""

    def command(campaign: Path, folder: Path | None, **given) -> None:
        from jointgap.campaign import stages

        getattr(stages, name)(_case(campaign, folder), **given)

    command.__doc__ = words
    made = campaign_argument(folder_option(command))
    for option in settings.get("options", ()):
        made = option(made)
    return cli.command(name)(made)


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

_stage("measure", "Read the runs of CAMPAIGN into SI units, check them, and look at them: cycles, gaps, scatter.")
_stage("noise", "Find the noise of every channel of every run, from what does not repeat.")
_stage("recalibrate", "Fit the parameters that are not known exactly within their ranges.")
_stage("locate", "Map where the recalibrated model disagrees with the measurement: run, channel, crank angle.")
_stage("screen", "Simulate every effect that could be missing at a small size, and choose what is worth a fit.")
_stage("fit", "Fit the chosen effects by forward simulation.", options=(_part, _parts))
_stage("pair", "Fit the pairs of effects that are worth it by forward simulation.", options=(_part, _parts))
_stage("decide", "Weigh the fits: what is missing, or why it cannot be told.", options=(_parts,))
_stage("regress", "Where no effect explains what is missing: look for a force law as a formula.")
_stage("confirm", "Predict the held-out runs with and without what was found.")
_stage("augment", "Write the mechanism file with what was found, for every other stage.")
_stage("rechain", "Optimise the link lengths for the model before and after: does the missing effect move the optimum?")
_stage("conclude", "Write verdict.json, the one-page summary and the figures.")


@cli.command()
@campaign_argument
@folder_option
def preflight(campaign: Path, folder: Path | None) -> None:
    """Say before anything is measured what CAMPAIGN will be able to show.

    Which effects these speeds and channels can detect, from which size on, which of them they cannot tell apart, and which
    further speed or channel would help most. The runs' files need not exist.
    """
    from jointgap.campaign import stages
    from jointgap.campaign.preflight import in_words

    case = _case(campaign, folder)
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
    from jointgap.campaign.summary import answer
    from jointgap.campaign.whole import analyse as whole

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

    from jointgap.campaign.records import DESCRIPTION, records
    from jointgap.tables import write_text
    from jointgap.track.publish import publish_records

    case = _case(campaign, folder)
    summary = publish_records(case.campaign.name, DESCRIPTION, records(case.folder.path), None, store)
    write_text(published, json.dumps(summary, indent=2) + "\n")
