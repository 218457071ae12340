"""The slider-crank as a model for the naming of effects: its nuisances, its candidates, its sensors.

`rig_model` makes the model of a campaign, `rig_file` the mechanism with what was found written in.
"""

from jointgap.rig.assemble import rig_model
from jointgap.rig.changes import rig_file
from jointgap.rig.model import RigModel

__all__ = ["RigModel", "rig_file", "rig_model"]
