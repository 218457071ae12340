# What the rules of campaigns share: where the tables of each stage lie, and the files of each campaign.

from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.figures_catalogue import CATALOGUE as CAMPAIGN_FIGURES


def campaign_place(path):
    """Where something of a campaign lies."""
    return f"results/campaigns/{{campaign}}/{path}"


def campaign_output(*stages):
    """For output: the tables that the stages of one job write."""
    return [campaign_place(table.path) for stage in stages for table in CAMPAIGN_STAGES[stage].writes]


def campaign_input(*stages):
    """For input: the tables that the stages of one job read, but for those that they write; of parts all."""
    own = campaign_output(*stages)
    read = dict.fromkeys(
        campaign_place(table.path) for stage in stages for table in CAMPAIGN_STAGES[stage].reads
    )

    def files(wildcards):
        parts = {"campaign": [wildcards.campaign], "part": range(fit_parts(wildcards))}
        wanted = [path for path in read if path not in own]
        return list(dict.fromkeys(file for path in wanted for file in expand(path, **parts)))

    return files


def of_campaign_stages(*stages):
    """For params: the stages of one job, the first by its subcommand, and digests of their code."""
    return {
        "stage": stages[0],
        "then": [text for stage in stages[1:] for text in ("--then", stage)],
        "code": lambda wildcards: [CAMPAIGN_STAGES[stage].digest for stage in stages],
    }


def plan(wildcards):
    """For input: the campaign file and the mechanism that it names."""
    return CAMPAIGNS[wildcards.campaign].plan


def recordings(wildcards):
    """For input: the runs' files."""
    return CAMPAIGNS[wildcards.campaign].data


def fit_parts(wildcards):
    """For params: how many jobs share the fits."""
    return CAMPAIGNS[wildcards.campaign].parts


def made_of_campaign(name):
    """Every file that rules make of a campaign."""
    made = [
        rules.campaign_measure,
        rules.campaign_preflight,
        rules.campaign_recalibrate,
        rules.campaign_screen,
        rules.campaign_fit,
        rules.campaign_pair,
        rules.campaign_decide,
        rules.campaign_reoptimise,
        rules.campaign_conclude,
        rules.campaign_track,
    ]
    paths = [str(path) for rule in made for path in rule.output]
    return [file for path in paths for file in expand(path, campaign=name, part=range(CAMPAIGNS[name].parts))]
