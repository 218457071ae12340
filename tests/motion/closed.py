"""The slider-crank with ideal joints in closed form: kinematics and reactions."""

from dataclasses import dataclass

import numpy as np

from jointgap.config import Mechanism


@dataclass(frozen=True)
class Closed:
    """Motion at crank angles `angle` (n,) [rad] with the crank's `speed` and `acceleration` there;
    SI.

    A prime is a derivative with respect to the crank angle.
    """

    made: Mechanism
    angle: np.ndarray
    speed: np.ndarray | float
    acceleration: np.ndarray | float = 0.0

    def rated(self, first, second):
        """Rate and second rate over time of a quantity with the derivatives `first` and `second`
        over the angle."""
        return first * self.speed, second * self.speed**2 + first * self.acceleration

    @property
    def rod_angle(self):
        return np.arcsin(
            (self.made.slider.offset - self.made.crank.length * np.sin(self.angle))
            / self.made.rod.length
        )

    @property
    def rod_primes(self):
        ratio = self.made.crank.length / self.made.rod.length
        first = -ratio * np.cos(self.angle) / np.cos(self.rod_angle)
        return first, (ratio * np.sin(self.angle) + np.sin(self.rod_angle) * first**2) / np.cos(
            self.rod_angle
        )

    def on_rod(self, distance):
        """Place, first and second derivative over the crank angle of a point of the rod, (2, n)
        each."""
        r, turn, bend = self.made.crank.length, *self.rod_primes
        crank = np.array([np.cos(self.angle), np.sin(self.angle)])
        along = np.array([np.cos(self.rod_angle), np.sin(self.rod_angle)])
        ahead, across = np.array([-crank[1], crank[0]]), np.array([-along[1], along[0]])
        second = -r * crank + distance * (bend * across - turn**2 * along)
        return r * crank + distance * along, r * ahead + distance * turn * across, second

    @property
    def slider_position(self):
        return self.on_rod(self.made.rod.length)[0][0]

    @property
    def slider_rates(self):
        _, first, second = self.on_rod(self.made.rod.length)
        return self.rated(first[0], second[0])

    @property
    def rod_rates(self):
        return self.rated(*self.rod_primes)

    @property
    def centre_rates(self):
        return self.rated(*self.on_rod(self.made.rod.mass_centre)[1:])

    @property
    def crank_inertia(self):
        """About the pivot [kg m^2]."""
        crank = self.made.crank
        return crank.inertia + crank.mass * (crank.mass_centre**2 + crank.mass_centre_across**2)

    def turned(self, along, across_line, twice=False):
        """A vector of the crank (`along` and `across_line` its axis), turned by 90 or 180 degrees,
        (2, n)."""
        arm = (along + 1j * across_line) * np.exp(1j * self.angle) * (-1 if twice else 1j)
        return np.array([arm.real, arm.imag])

    def virtual_work_torque(self, slider_force=0.0):
        """Torque of the drive [N m]: what inertia, weight and the force on the slider [N] take up
        per radian."""
        made, gravity = self.made, self.made.gravity[:, None]
        _, turn, _ = self.on_rod(made.rod.mass_centre)
        moved = self.turned(made.crank.mass_centre, made.crank.mass_centre_across)
        torque = made.rod.mass * ((self.centre_rates[1] - gravity) * turn).sum(0)
        torque = torque + made.rod.inertia * self.rod_rates[1] * self.rod_primes[0]
        torque = torque - made.crank.mass * (gravity * moved).sum(0)
        torque = torque + self.crank_inertia * self.acceleration
        pull = made.slider.mass * (self.slider_rates[1] - made.gravity[0]) - slider_force
        return torque + pull * self.on_rod(made.rod.length)[1][0]

    def reactions(self, slider_force=0.0, pin_moment=0.0, piston_moment=0.0):
        """Forces on the rod in crank pin and piston pin, of the frame on the crank, (2, n) each
        [N]; guide force; torque.

        `pin_moment` and `piston_moment` act on the rod by friction in its pins [N m].
        """
        made, gravity = self.made, self.made.gravity[:, None]
        rod, crank = made.rod, made.crank
        c, s = np.cos(self.rod_angle), np.sin(self.rod_angle)
        inertia = rod.mass * (self.centre_rates[1] - gravity)
        piston_x = slider_force - made.slider.mass * (self.slider_rates[1] - made.gravity[0])
        moment = rod.inertia * self.rod_rates[1] + rod.mass_centre * (
            c * inertia[1] - s * inertia[0]
        )
        piston_y = ((moment - pin_moment - piston_moment) / rod.length + s * piston_x) / c
        piston = np.array([piston_x + 0 * piston_y, piston_y])
        pin = inertia - piston
        arm = crank.mass_centre, crank.mass_centre_across
        turned, back = self.turned(*arm), self.turned(*arm, twice=True)
        frame = crank.mass * (self.acceleration * turned + self.speed**2 * back - gravity) + pin
        torque = self.crank_inertia * self.acceleration - crank.mass * (gravity * turned).sum(0)
        torque = torque + crank.length * (self.turned(1.0, 0.0) * pin).sum(0) + pin_moment
        return pin, piston, frame, piston_y - made.slider.mass * made.gravity[1], torque
