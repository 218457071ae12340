"""A campaign: measured runs of a rig against its model, from the files to a verdict.

Its stages stand in `jointgap.campaign.stages`; `jointgap.campaign.analyse.analyse` runs them all.
"""
