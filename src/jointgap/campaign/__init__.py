"""A campaign: measured runs of a rig against its model, from the files to a verdict.

Its stages stand in `jointgap.stages.campaign_stages`; `jointgap.stages.campaign_pipeline.analyse` runs them all.
"""
