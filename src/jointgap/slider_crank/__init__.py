"""The slider-crank as a model for the naming of effects: its nuisances, its candidates, its sensors.

`rig_model` makes the model of a campaign, `rig_file` the mechanism with what was found written in.
"""

from jointgap.slider_crank.build_model import rig_model
from jointgap.slider_crank.model import RigModel
from jointgap.slider_crank.modified_mechanism import rig_file

__all__ = ["RigModel", "rig_file", "rig_model"]
