"""The stages of a scenario and of a campaign: one record each, from which command line, rules, pipeline and digests of
code follow.
"""
