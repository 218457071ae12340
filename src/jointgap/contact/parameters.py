"""Parameters of a contact for compiled code, in SI; inactive parts are zero."""

import math
from typing import NamedTuple


class JointParameters(NamedTuple):
    """A contact: a revolute joint of a body with its partner, or a corner of a slide."""

    loose: bool = False
    clearance: float = 1.0  # Distance of the centres [m] at which dry contact begins
    body_radius: float = 0.0  # Radii of the surfaces [m]
    partner_radius: float = 0.0
    side: float = -1.0
    stiffness: float = 0.0  # K [N/m^n], n and chi of the normal force; chi is 0 for law penalty
    exponent: float = 1.5
    damping: float = 0.0
    least_approach: float = 1e-3  # Lower limit of the approach speed in the damping [m/s]
    memory_time: float = math.inf
    fading_time: float = 1.0
    steady_contact_damping: float = 0.0  # chi / v_ref [s/m] of a lasting contact
    penalty_damping: float = 0.0  # Law penalty: c_max [N s/m] and d_max [m], else 0
    penalty_depth: float = 0.0
    friction_law: int = 0  # This and the following: see `jointgap.contact.friction`
    friction: float = 0.0
    friction_speed: float = 1.0
    dead_band_speed: float = 0.0
    static_friction: float = 0.0
    stribeck_speed: float = 1.0
    viscous_friction: float = 0.0
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    film_viscosity: float = 0.0  # Of the lubricant [Pa s]; 0: no film
    film_length: float = 0.0  # [m]
    film_clearance: float = 1.0  # [m]
    film_least: float = 0.0  # Smallest film thickness [m]
    pin_friction: float = 0.0  # Coefficient of friction and radius [m] of an ideal joint
    pin_radius: float = 0.0
    corner_x: float = 0.0  # [m] Of a corner of a loose slide, along it and across it; `clearance`
    corner_y: float = 0.0  # is then the distance of its line from the wall
