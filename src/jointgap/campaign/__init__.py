"""Campaigns: measured runs of a rig compared with its model, from the files to a verdict.

`jointgap.campaign.stages` contains the stages; `jointgap.campaign.analyse.analyse` runs them all.
"""
