"""The slider-crank as a model for the naming of effects: its nuisances, its candidates, its sensors.

`build_model` makes the model of a campaign, `augmented_mechanism` the mechanism with what was found written in.
"""

from jointgap.slider_crank.model import SliderCrankModel
from jointgap.slider_crank.model_from_campaign import build_model
from jointgap.slider_crank.modified_mechanism import augmented_mechanism
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SliderCrankSettings

__all__ = ["DEFAULT_SETTINGS", "SliderCrankModel", "SliderCrankSettings", "augmented_mechanism", "build_model"]
