"""The paper's mechanism in 80-bit numbers, independent of the package: the reference for errors."""

import numpy as np

from jointgap.motion.runge_kutta import COUNT, ERROR_3, ERROR_5, NODES, STAGES

REAL = np.longdouble
WEIGHTS = np.array([1, 1, 0.564, 1, 1e-5, 1e-5, 0.564e-5, 1e-5])


class Extended:
    """Frictionless slider-crank with loose pins, crank at constant speed from dead centre, F = K
    d^1.5 (1 + h d')."""

    def __init__(self, mechanism, speed, stiffness, damping):
        rod = mechanism.rod
        self.crank, self.speed = REAL(mechanism.crank.length), REAL(speed)
        self.near, self.far = REAL(rod.mass_centre), REAL(rod.length) - REAL(rod.mass_centre)
        self.rod_mass, self.inertia, self.slider_mass = (
            REAL(rod.mass),
            REAL(rod.inertia),
            REAL(mechanism.slider.mass),
        )
        self.clearance = [REAL(mechanism.clearance(name)) for name in ("crank_pin", "piston_pin")]
        self.stiffness, self.damping = (
            [REAL(value) for value in stiffness],
            [REAL(value) for value in damping],
        )
        rate = -self.crank * self.speed / (self.near + self.far)
        self.start = np.zeros(8, REAL)
        self.start[[0, 3]] = self.crank + self.near, self.crank + self.near + self.far
        self.start[[5, 6]] = self.crank * self.speed + self.near * rate, rate

    def joints(self, time, y):
        """Clearance vector and its rate in both joints, and the lever of a force on the rod
        there."""
        turned = self.speed * time
        cosine, sine, rod_cosine, rod_sine = (
            np.cos(turned),
            np.sin(turned),
            np.cos(y[2]),
            np.sin(y[2]),
        )
        a, b, c, w = -self.near, self.far, self.crank, self.speed
        return (
            (
                (y[0] + a * rod_cosine - c * cosine, y[1] + a * rod_sine - c * sine),
                (
                    y[4] - a * y[6] * rod_sine + c * w * sine,
                    y[5] + a * y[6] * rod_cosine - c * w * cosine,
                ),
                (a * rod_cosine, a * rod_sine),
            ),
            (
                (y[0] + b * rod_cosine - y[3], y[1] + b * rod_sine),
                (y[4] - b * y[6] * rod_sine - y[7], y[5] + b * y[6] * rod_cosine),
                (b * rod_cosine, b * rod_sine),
            ),
        )

    def depth(self, joint, time, y):
        (x, y), (vx, vy), _ = self.joints(time, y)[joint]
        r = np.sqrt(x * x + y * y)
        return r - self.clearance[joint], (x * vx + y * vy) / r

    def slope(self, time, y, approaches):
        out = np.zeros(8, REAL)
        out[:4] = y[4:]
        for joint, ((x, y_), (vx, vy), (lx, ly)) in enumerate(self.joints(time, y)):
            if approaches[joint] is None:
                continue
            r = np.sqrt(x * x + y_ * y_)
            d = max(r - self.clearance[joint], REAL(0))
            hysteresis = self.damping[joint] / approaches[joint]
            push = max(
                self.stiffness[joint] * d * np.sqrt(d) * (1 + hysteresis * (x * vx + y_ * vy) / r),
                REAL(0),
            )
            fx, fy = -push * x / r, -push * y_ / r
            out[4] += fx / self.rod_mass
            out[5] += fy / self.rod_mass
            out[6] += (lx * fy - ly * fx) / self.inertia
            if joint == 1:
                out[7] -= fx / self.slider_mass
        return out

    def step(self, time, y, h, approaches):
        k = np.zeros((COUNT, 8), REAL)
        for stage in range(COUNT):
            k[stage] = self.slope(
                time + NODES[stage] * h, y + h * (STAGES[stage, :stage] @ k[:stage]), approaches
            )
        fifth, third = (np.sum((WEIGHTS * (weights @ k)) ** 2) for weights in (ERROR_5, ERROR_3))
        error = h * fifth / np.sqrt(fifth + 0.01 * third) if fifth > 0 else REAL(0)
        return y + h * (STAGES[COUNT] @ k), error

    def state_at(self, end, tolerance):
        """State at time `end` [s] with a local error of `tolerance` [m]; contact begins and ends to
        the last digit."""
        time, y, h, approaches = REAL(0), self.start, REAL(1e-5), [None, None]
        while time < end:
            h = min(h, end - time)
            new, error = self.step(time, y, h, approaches)
            factor = min(
                REAL(3), max(REAL(0.2), 0.9 * (tolerance / max(error, REAL(1e-40))) ** REAL(0.125))
            )
            if error > tolerance:
                h *= factor
                continue
            crossed = [joint for joint in (0, 1) if self._crossed(joint, time + h, new, approaches)]
            if not crossed:
                time, y, h = time + h, new, min(h * factor, REAL(5e-4))
                continue
            length, joint = min(
                (self._locate(joint, time, y, h, approaches), joint) for joint in crossed
            )
            y, _ = self.step(time, y, length, approaches)
            time += length
            approaches[joint] = self.depth(joint, time, y)[1] if approaches[joint] is None else None
            h = REAL(1e-7)
        return y

    def _crossed(self, joint, time, y, approaches):
        depth = self.depth(joint, time, y)[0]
        return depth > 0 if approaches[joint] is None else depth < 0

    def _locate(self, joint, time, y, h, approaches):
        """Step length after which the joint's penetration is zero, by bisection and Newton's
        method."""
        low, high = REAL(0), h
        for _ in range(12):
            middle = (low + high) / 2
            beyond = self._crossed(
                joint, time + middle, self.step(time, y, middle, approaches)[0], approaches
            )
            low, high = (low, middle) if beyond else (middle, high)
        length = high
        for _ in range(4):
            depth, rate = self.depth(
                joint, time + length, self.step(time, y, length, approaches)[0]
            )
            length -= depth / rate
        return length
