"""What ``import jointgap as jg`` offers beside the sections of a configuration: calls, results that show themselves.

The calls run what the stages run; results draw themselves with the figures of the stages.
"""
