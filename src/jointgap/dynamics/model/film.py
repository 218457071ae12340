"""Oil film between journal and bearing: the short bearing's (Ocvirk's) with squeeze, which cannot pull.

With e from the bearing's centre to the journal's, the film is c - e.u thick in the direction u; Reynolds' equation of
the short bearing (pressure varies along the axis far more than around it),

    d/dz (h^3 dp/dz) = 6 mu ((w_j + w_b) dh/dphi + 2 dh/dt) = -12 mu w.u,   w = e' - (w_j + w_b)/2 e_turned_by_90_deg,

is solved by p = 6 mu (L^2/4 - z^2) w.u / h^3. So the pressure is above ambient on the half circle around the direction
of w: the velocity of the journal's centre as seen by somebody who turns at the mean of the two bodies' rates. The film
tears on the other half (half-film cavitation, Gümbel) and pushes with nothing there. Integrating over length and half
circle, with a and b the components of the eccentricity e / c along w and 90 deg on,

    F = -mu R L^3 / c^3 |w| (I_w, I_n),   I_w = int cos^2 / (1 - a cos - b sin)^3,   I_n = int cos sin / (...)^3

over -90 ... 90 deg. Both are second derivatives of G(a, b) = int 1 / (1 - a cos - b sin), which is 2 angle / s with
s^2 = 1 - a^2 - b^2 and angle = atan2(s, -a). F.w is never positive: the film takes up energy, however it is moved.

F. W. Ocvirk, NACA TN 2808 (1952); the squeeze and the frame of w as in D. Childs, H. Moes and H. van Leeuwen,
J. Lubr. Technol. 99 (1977) 198-210.
"""

import math

from jointgap.dynamics.compilation import compiled

_SMALL = 0.3
_TERMS = range(2, 18)
_ALONG = tuple((-1) ** k * (4 * k - 4) / (4 * k * k - 1) for k in _TERMS)
_ACROSS = tuple((-1) ** k * (2 * k - 2) / (2 * k + 1) for k in _TERMS)


@compiled
def film_integrals(a, b, s):
    """I_w and I_n of the module's text for an eccentricity (a, b) of length < 1, s = sqrt(1 - a^2 - b^2)."""
    if a < -s / _SMALL:
        # Where the film is thickest nearly equal terms cancel: the power series of what is left of them.
        inverse = -1.0 / a
        square = (s * inverse) ** 2
        along = across = 0.0
        for i in range(len(_ALONG) - 1, -1, -1):
            along = along * square + _ALONG[i]
            across = across * square + _ACROSS[i]
        cube = inverse * inverse * inverse
        return along * cube, across * cube * inverse * b
    inverse = 1.0 / (s * s)
    angle = math.atan2(s, -a) / s
    along = inverse * (3.0 * a * inverse + angle * (1.0 + 3.0 * a * a * inverse))
    across = b * inverse * inverse * (2.0 + a * a / (1.0 - b * b) + 3.0 * a * angle)
    return along, across


@compiled
def film_force(joint, ex, ey, vx, vy, body_rate, partner_rate):
    """Force and moments of the oil film on the two bodies of a joint.

    The pair of forces acts halfway between the centres, so that no angular momentum is lost; to this comes the couple
    of the shear in the whole film, 2 pi mu R^3 L / (c sqrt(1 - eps^2)) times the difference of the rates. Beyond the
    eccentricity where dry contact begins the film stays as thin as it is there.
    """
    if joint.film_viscosity == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    radius = joint.partner_radius if joint.side < 0.0 else joint.body_radius
    c = joint.film_clearance
    scale = 1.0 / c
    square = (ex * ex + ey * ey) * scale * scale
    widest = 1.0 - joint.film_least * scale
    if square > widest * widest:
        scale *= widest / math.sqrt(square)
        square = widest * widest
    s = math.sqrt(1.0 - square)

    mean_rate = 0.5 * (body_rate + partner_rate)
    wx, wy = vx + mean_rate * ey, vy - mean_rate * ex
    speed = math.sqrt(wx * wx + wy * wy)
    fx, fy = 0.0, 0.0
    if speed > 0.0:
        nx, ny = wx / speed, wy / speed
        along, across = film_integrals((ex * nx + ey * ny) * scale, (ey * nx - ex * ny) * scale, s)
        strength = -joint.film_viscosity * radius * joint.film_length**3 / (c * c * c) * speed
        fx = strength * (along * nx - across * ny)
        fy = strength * (along * ny + across * nx)

    couple = 0.5 * (ey * fx - ex * fy)
    shear = 2.0 * math.pi * joint.film_viscosity * radius**3 * joint.film_length / (c * s) * (body_rate - partner_rate)
    return fx, fy, couple - shear, couple + shear
