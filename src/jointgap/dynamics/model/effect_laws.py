"""Forces on the slider and torques on the crank beyond joints and weight: the effects by their laws.

Laws, parameters and references: `jointgap.effects`. v, x: slider's speed and position; w: crank's speed.
"""

import math

from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.formula_evaluator import evaluate


@compiled
def formula_value(program, v, x, crank_speed, crank_angle, time):
    """Value of a formula whose program is a record."""
    return evaluate(program.codes[: program.length], program.numbers, v, x, crank_speed, crank_angle, time)


@compiled
def table_value(e, table, crank_angle, time):
    """Force [N] of a periodic table."""
    place = (e.table_sign * crank_angle if e.table_over == 1 else time) - e.table_begin
    place -= math.floor(place / e.table_period) * e.table_period
    row = min(int(place / e.table_period * table.count), table.count - 1)
    while row > 0 and table.pieces[row, 0] > place:
        row -= 1
    while row + 1 < table.count and table.pieces[row + 1, 0] <= place:
        row += 1
    since, c = place - table.pieces[row, 0], table.pieces[row]
    return ((c[1] * since + c[2]) * since + c[3]) * since + c[4]


@compiled
def varying(share, phase):
    """What is 1 at the `phase` 0 [rad] and less by up to the `share` [1] elsewhere."""
    return 1.0 - share * (0.5 - 0.5 * math.cos(phase))


@compiled
def slider_force(p, guide_force, x, v, crank_speed, crank_angle, time):
    """Force [N] along +x on the slider."""
    e = p.effects
    sign = math.tanh(v / e.slider_sign_speed)
    force = e.constant - (e.coulomb + e.load_friction * abs(guide_force)) * sign - e.viscous * v - e.drag * v * abs(v)
    if e.stribeck != 0.0:
        falling = e.stribeck_share * math.exp(-abs(v) / e.stribeck_speed)
        force -= e.stribeck * (1.0 - e.stribeck_share + falling) * sign
    if e.position_friction != 0.0:
        phase = 2.0 * math.pi * (x - e.position_friction_tightest) / e.position_friction_length
        force -= e.position_friction * varying(e.position_friction_share, phase) * sign
    if e.power_drag != 0.0:
        force -= e.power_drag * (abs(v) / e.power_drag_speed) ** e.power_drag_exponent * sign
    force -= e.spring_stiffness * (x - e.spring_rest)
    if e.nonlinear_spring != 0.0:
        stretch, share = x - e.nonlinear_spring_rest, e.nonlinear_spring_share
        force -= e.nonlinear_spring * stretch * (1.0 - share + share * (stretch / e.nonlinear_spring_length) ** 2)
    if e.gas_force != 0.0:
        force -= e.gas_force * (e.gas_length / (e.gas_length + e.gas_outermost - x)) ** e.gas_exponent
    if e.harmonic != 0.0:
        force += e.harmonic * math.cos(e.harmonic_angular_frequency * time + e.harmonic_phase)
    if e.table_over != 0:
        force += table_value(e, p.slider_table, crank_angle, time)
    if p.slider_formula.length > 0:
        force += formula_value(p.slider_formula, v, x, crank_speed, crank_angle, time)
    return force


@compiled
def crank_losses(p, x, v, crank_speed, crank_angle, time):
    """Torque [N m] on the crank by friction, in step with its angle, by a formula; arguments as in `slider_force`."""
    e = p.effects
    sign = math.tanh(crank_speed / e.crank_sign_speed)
    torque = -e.crank_coulomb * sign - e.crank_viscous * crank_speed
    if e.angle_friction != 0.0:
        torque -= e.angle_friction * varying(e.angle_friction_share, crank_angle - e.angle_friction_tightest) * sign
    if e.crank_periodic != 0.0:
        torque += e.crank_periodic * math.cos(e.crank_periodic_order * crank_angle - e.crank_periodic_phase)
    if p.crank_formula.length > 0:
        torque += formula_value(p.crank_formula, v, x, crank_speed, crank_angle, time)
    return torque


@compiled
def motor_torque(drive, speed):
    """Torque [N m] of a motor with a straight line from its stall torque to its no-load speed."""
    return drive.stall_torque * (1.0 - speed / drive.no_load_speed)
