# What the rules of campaigns share: where the tables of each stage lie, and the files of each campaign.

from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT
from jointgap.stages.campaign_stages import CAMPAIGN_STAGES
from jointgap.figures.campaign_catalogue import CATALOGUE as CAMPAIGN_FIGURES


def campaign_place(path):
    """Where something of a campaign lies."""
    return f"results/campaigns/{{campaign}}/{path}"


def handed_on(*stages):
    """For input and output: the tables of stages of a campaign."""
    return [campaign_place(table.path) for stage in stages for table in CAMPAIGN_STAGES[stage].writes]


def plan(wildcards):
    """For input: the campaign file and the mechanism that it names."""
    return CAMPAIGNS[wildcards.campaign].plan


def recordings(wildcards):
    """For input: the runs' files."""
    return CAMPAIGNS[wildcards.campaign].data


def fit_parts(wildcards):
    """For params: how many jobs share the fits."""
    return CAMPAIGNS[wildcards.campaign].parts


def all_parts(stage):
    """For input: what every part of the stage found."""

    def files(wildcards):
        parts = range(fit_parts(wildcards))
        return [
            path.format(campaign=wildcards.campaign, part=part) for part in parts for path in handed_on(stage)
        ]

    return files


def campaign_section(wildcards):
    """For the report: the campaign, after the scenarios."""
    return f"Campaign {wildcards.campaign}"
