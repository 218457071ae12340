"""An independent formulation: positions and angles of all bodies, multipliers for ideal joints."""

import math

import numpy as np

from jointgap.linkage.topology import FRAME, number


def vector(coordinates):
    return np.array([number(each) for each in coordinates])


def rotation(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


class Absolute:
    """The bodies of a linkage at given positions and velocities (x, y, angle) of mass centres."""

    def __init__(self, linkage, positions, velocities):
        self.linkage, self.positions, self.velocities = linkage, positions, velocities
        self.start = {name: 3 * i for i, name in enumerate(linkage.moving)}
        self.size = 3 * len(self.start)

    def point(self, place):
        """Position, velocity, Jacobian (2, size) and centripetal acceleration of a point."""
        body, name = place
        jacobian = np.zeros((2, self.size))
        local = vector(self.linkage.bodies[body].points[name])
        if body == FRAME:
            return local, np.zeros(2), jacobian, np.zeros(2)
        x, v = self.positions[body], self.velocities[body]
        arm = rotation(x[2]) @ (local - vector(self.linkage.bodies[body].centre))
        at = self.start[body]
        jacobian[:, at : at + 3] = [[1, 0, -arm[1]], [0, 1, arm[0]]]
        return x[:2] + arm, jacobian[:, at : at + 3] @ v, jacobian, -(v[2] ** 2) * arm

    def turn(self, body):
        row = np.zeros(self.size)
        if body != FRAME:
            row[self.start[body] + 2] = 1.0
        return row

    def angle_and_speed(self, body):
        if body == FRAME:
            return 0.0, 0.0
        return self.positions[body][2], self.velocities[body][2]

    def across(self, joint):
        """Row and rest of the condition that a slide's body stays on its line."""
        carrier = joint.partner.body
        (x1, v1, j1, c1), (x2, v2, j2, c2) = self.point(joint.partner), self.point(joint.body)
        angle, speed = self.angle_and_speed(carrier)
        along = np.array([1.0, 0.0])
        along = rotation(angle + number(joint.direction)) @ along
        normal = np.array([-along[1], along[0]])
        apart, rate = x2 - x1, v2 - v1
        row = normal @ (j2 - j1) - (along @ apart) * self.turn(carrier)
        rest = normal @ (c2 - c1) - 2 * speed * (along @ rate) - speed**2 * (normal @ apart)
        return row, rest, normal @ apart

    def rates(self, crank_acceleration, torque, forces, loads, moments):
        """Second rates of the loose joints' clearance vectors, and the crank's acceleration."""
        linkage = self.linkage
        mass, force = np.zeros(self.size), np.zeros(self.size)
        for name, at in self.start.items():
            body = linkage.bodies[name]
            mass[at : at + 3] = body.mass, body.mass, body.inertia or 1.0
            force[at : at + 2] = body.mass * vector(linkage.gravity)
            if name in loads:
                force[at : at + 3] += [*loads[name][0], loads[name][1]]
        rows, rests, closed = [], [], 0.0
        for joint in linkage.joints.values():
            (x1, _, j1, c1), (x2, _, j2, c2) = self.point(joint.partner), self.point(joint.body)
            jacobian = j2 - j1
            turn = self.turn(joint.body.body) - self.turn(joint.partner.body)
            if joint.loose:
                given = forces[joint.name]
                force += jacobian.T @ [given.fx, given.fy]
                force += given.on_body * self.turn(joint.body.body)
                force += given.on_partner * self.turn(joint.partner.body)
                continue
            if joint.kind == "revolute":
                force += moments.get(joint.name, 0.0) * turn
                rows += [*jacobian]
                rests += [*(c2 - c1)]
                closed = max(closed, np.abs(x2 - x1).max())
                continue
            row, rest, apart = self.across(joint)
            rows += [row, turn]
            rests += [rest, 0.0]
            closed = max(closed, abs(apart))
        crank = self.turn(linkage.crank)
        if crank_acceleration is None:
            force += torque * crank
        else:
            rows.append(crank)
            rests.append(-crank_acceleration)
        jacobian = np.array(rows).reshape(-1, self.size)
        zero = np.zeros((len(rows), len(rows)))
        matrix = np.block([[np.diag(mass), jacobian.T], [jacobian, zero]])
        right = np.concatenate([force, -np.array(rests)])
        accelerations = np.linalg.solve(matrix, right)[: self.size]
        rates = {}
        for joint in linkage.loose:
            (*_, j1, c1), (*_, j2, c2) = self.point(joint.partner), self.point(joint.body)
            rates[joint.name] = (j2 - j1) @ accelerations + c2 - c1
            if joint.kind == "slide":
                row, rest, _ = self.across(joint)
                turn = self.turn(joint.body.body) @ accelerations
                rates[joint.name] = np.array([row @ accelerations + rest, turn])
        return rates, float(crank @ accelerations), closed


def absolute_of(pose):
    """The bodies of a pose."""
    positions, velocities = {}, {}
    for name in pose.linkage.moving:
        place, speed = pose.point(name, None)
        cosine, sine = pose.directions[name]
        positions[name] = np.array([*place, math.atan2(sine, cosine)], float)
        velocities[name] = np.array([*speed, pose.speeds[name]], float)
    return Absolute(pose.linkage, positions, velocities)
