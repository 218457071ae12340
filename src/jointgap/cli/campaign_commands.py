"""A subcommand for each stage of a campaign, made from its record; and one for all of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from jointgap.cli.group import FILE, FOLDER, OF_CAMPAIGN, add_command, cli, need
from jointgap.stages.campaign_stages import CAMPAIGN_STAGES
from jointgap.stages.record import Stage

if TYPE_CHECKING:  # loads pandas
    from jointgap.campaign.state import CampaignState

_campaign = click.argument("campaign", type=FILE)
_folder = click.option(
    "--folder", type=FOLDER, help="Folder of the campaign's results; results/campaigns/NAME when absent."
)
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
_anyway = click.option("--anyway", is_flag=True, help="Go on where channels contradict each other.")
_OPTIONS = {
    "noise": (_anyway,),
    "fit": (_part, _parts),
    "pair": (_part, _parts),
    "decide": (_parts,),
    "track-campaign": (
        need("--store", "Folder of the store.", FOLDER),
        need("--published", "JSON file to write: what was published where."),
    ),
}
_go_on = click.option(
    "--go-on", is_flag=True, help="A stage that only adds to the verdict does not fail: the verdict says what it lacks."
)
_then = click.option(
    "--then",
    "further",
    type=click.Choice([name for name in CAMPAIGN_STAGES if name not in {*_OPTIONS, "track-campaign"}]),
    metavar="STAGE",
    multiple=True,
    help="Another stage, of those without options of their own, to run afterwards in the same process; repeatable.",
)


def _state(campaign: Path, folder: Path | None) -> "CampaignState":
    from jointgap.campaign.state import CampaignState

    return CampaignState(campaign, folder)


def _end_if_something_failed(state: "CampaignState") -> None:
    """Exit code 3 and a line for each thing that could not be made beside the verdict."""
    from jointgap.campaign.failures import failures

    failed = failures(state.folder)
    for what, why in failed.items():
        click.echo(f"jointgap: failed: {what}: {why} (more: {state.folder.path / 'failed' / what}.txt)", err=True)
    if failed:
        raise SystemExit(3)


def _check_part(part: int, parts: int) -> None:
    """InputError on a part that nobody would read."""
    from jointgap.errors import InputError

    if part >= parts:
        raise InputError(
            f"--part {part}: parts are counted from 0, and --parts {parts} has none of that number; give {parts - 1} "
            "at most, or more --parts"
        )


def _stage_command(stage: Stage) -> None:
    def command(campaign: Path, folder: Path | None, further: tuple[str, ...], go_on: bool, **given: Any) -> str:
        if "part" in given:
            _check_part(given["part"], given["parts"])
        state = _state(campaign, folder)
        stages = [CAMPAIGN_STAGES[stage.name], *(CAMPAIGN_STAGES[name] for name in further)]
        state.folder.check_writable(*(path for each in stages for path in each.outputs(given.get("part", 0))))
        adding = set(CAMPAIGN_STAGES) - {*CAMPAIGN_STAGES.needed_for("confirm"), "conclude"} if go_on else ()
        shown = []
        for each, options in zip(stages, [given, *({} for _ in further)], strict=True):
            if each.name in adding:
                from jointgap.stages.campaign_pipeline import run_if_possible

                shown.append(run_if_possible(each, state, **options))
            else:
                shown.append(each.function(state, **options))
        if stage.name == "conclude" and not go_on:
            _end_if_something_failed(state)
        return "\n".join(filter(None, shown))

    add_command(
        stage.name, stage.help, command, [_campaign, _folder, _then, _go_on, *_OPTIONS.get(stage.name, ())], OF_CAMPAIGN
    )


for _each in CAMPAIGN_STAGES.values():
    _stage_command(_each)


@cli.command(hidden=True, context_settings={"ignore_unknown_options": True})
@click.argument("arguments", nargs=-1)
def rechain(arguments: tuple[str, ...]) -> NoReturn:
    """The former name of `jointgap reoptimise`."""
    from jointgap.errors import InputError

    raise InputError("rechain: is called `jointgap reoptimise` now, with the same arguments")


@cli.command()
@_campaign
@_folder
@_anyway
def analyse(campaign: Path, folder: Path | None, anyway: bool) -> None:
    """Find what is missing in the model of CAMPAIGN: every stage in one go, down to verdict.json, summary and figures.

    `make campaign` does the same with stages side by side, goes on where it was stopped, and optimises again.
    """
    from jointgap.campaign.conclude import show
    from jointgap.stages.campaign_pipeline import analyse as analyse_campaign
    from jointgap.stages.what_came_out import verdict_lines

    state = _state(campaign, folder)
    analyse_campaign(campaign, state.folder.path, pictures=True, anyway=anyway)
    show(state)
    click.echo("\n".join(verdict_lines(state.folder.path)))
    _end_if_something_failed(state)


@cli.command()
@click.argument("campaigns", metavar="CAMPAIGN...", type=FILE, nargs=-1, required=True)
@click.option(
    "--results",
    type=FOLDER,
    default=Path("results/campaigns"),
    show_default=True,
    help="Folder that holds the results of the campaigns, each in a folder of its name.",
)
@click.option(
    "--folder", type=FOLDER, default=Path("results/trend"), show_default=True, help="Folder to write the trend into."
)
def trend(campaigns: tuple[Path, ...], results: Path, folder: Path) -> None:
    """Show by date how clearances, and sizes of other effects, grow: one or more analysed campaigns of one rig.

    Each campaign file states its `date`; `make campaign` or `jointgap analyse` comes first.
    """
    from jointgap.campaign.trend import trend as write_trend

    click.echo(write_trend(campaigns, results, folder))
