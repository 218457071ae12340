"""Typed, frozen, validated configuration; SI inside."""

from jointgap.config.checks import check_drive, check_tolerance
from jointgap.config.contact import Contact
from jointgap.config.drive import ConstantDrive, MeasuredDrive, MotorDrive
from jointgap.config.effects import CRANK_SIGN_SPEED, EFFECTS, SLIDER_SIGN_SPEED, Effect
from jointgap.config.joints import Joint, Joints, hertz_stiffness
from jointgap.config.load import json_schema, load_mechanism, options_for, parse_options, read_yaml, resolve, validate
from jointgap.config.mechanism import Link, Mechanism, Slider
from jointgap.config.scenario import Box, Ensemble, Figures, Genetic, Optimise, Scenario, Simulate, Surrogate
from jointgap.config.study import Runs, Study

__all__ = [
    "CRANK_SIGN_SPEED",
    "EFFECTS",
    "SLIDER_SIGN_SPEED",
    "Box",
    "ConstantDrive",
    "Contact",
    "Effect",
    "Ensemble",
    "Figures",
    "Genetic",
    "Joint",
    "Joints",
    "Link",
    "MeasuredDrive",
    "Mechanism",
    "MotorDrive",
    "Optimise",
    "Runs",
    "Scenario",
    "Simulate",
    "Slider",
    "Study",
    "Surrogate",
    "check_drive",
    "check_tolerance",
    "hertz_stiffness",
    "json_schema",
    "load_mechanism",
    "options_for",
    "parse_options",
    "read_yaml",
    "resolve",
    "validate",
]
