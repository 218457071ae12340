"""Where a simulation and measured data disagree, which effect is missing, and whether adding it closes the gap.

The modules know no mechanism: `protocol` says what they ask of a model.
"""
