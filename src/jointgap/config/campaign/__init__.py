"""Campaign files: which runs were measured on a rig, how their columns map to channels, what is not known exactly."""

from jointgap.config.campaign.campaign import Campaign, CampaignRun, Csv
from jointgap.config.campaign.channels import CHANNELS, Channel
from jointgap.config.campaign.load import campaign_json_schema, load_campaign
from jointgap.config.campaign.nuisance import NUISANCES, PINS

__all__ = [
    "CHANNELS",
    "NUISANCES",
    "PINS",
    "Campaign",
    "CampaignRun",
    "Channel",
    "Csv",
    "campaign_json_schema",
    "load_campaign",
]
