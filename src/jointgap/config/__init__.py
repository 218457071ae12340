"""Typed, frozen, validated configuration; SI inside."""

from jointgap.config.load import (
    check_all_sections,
    is_complete,
    load_mechanism,
    parse_options,
    resolve,
    validate,
)
from jointgap.config.mechanism import (
    Contact,
    Joint,
    Joints,
    Link,
    Mechanism,
    Slider,
    hertz_stiffness,
)
from jointgap.config.scenario import (
    Box,
    ConstantDrive,
    Constraints,
    DrivenMechanism,
    Ensemble,
    Figures,
    FreeDrive,
    Genetic,
    MeasuredDrive,
    MotorDrive,
    Optimise,
    OptimiseLinkage,
    Scenario,
    Simulate,
    Surrogate,
    check_drive,
    check_tolerance,
)
from jointgap.config.variations import change
from jointgap.config.yaml_files import read_yaml, shipped_mechanisms
from jointgap.effects import EFFECTS
from jointgap.effects.base import (
    CRANK_SIGN_SPEED,
    SLIDER_SIGN_SPEED,
    Effect,
    example,
    parameters_of,
)
