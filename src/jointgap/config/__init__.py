"""Typed, frozen, validated configuration; SI inside."""

from jointgap.config.load import json_schema, load_mechanism, options_for, parse_options, read_yaml, resolve, validate
from jointgap.config.mechanism import Contact, Gravity, Joints, Link, LooseJoint, Mechanism, Slider
from jointgap.config.scenario import Box, Ensemble, Figures, Genetic, Optimise, Scenario, Simulate, Surrogate

__all__ = [
    "Box",
    "Contact",
    "Ensemble",
    "Figures",
    "Genetic",
    "Gravity",
    "Joints",
    "Link",
    "LooseJoint",
    "Mechanism",
    "Optimise",
    "Scenario",
    "Simulate",
    "Slider",
    "Surrogate",
    "json_schema",
    "load_mechanism",
    "options_for",
    "parse_options",
    "read_yaml",
    "resolve",
    "validate",
]
