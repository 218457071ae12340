"""Friction, restitution and lubrication of revolute joints."""

from typing import Any, ClassVar

from jointgap.core.candidates import Candidate, Parameter
from jointgap.effects import base
from jointgap.effects.base import (
    CRANK_SIGN,
    DataEffect,
    Effect,
    amplitude,
    joint_data,
    parameter,
    register_effect,
)

# Largest least_film_m over clearance
_LARGEST_FILM_SHARE = 0.5

# Start values [Pa s] of fits: light and heavy oil
_VISCOSITIES = (0.03, 0.2)


class ContactCoefficient(DataEffect):
    """A contact coefficient of one pin (`site`) or of all loose pins."""

    ON, GROUP, SITE = "mechanism", "pins", "loose pins"
    ACTS_AT_ZERO = True  # it replaces the nominal coefficient
    KEY: ClassVar[str]  # of the coefficient in a contact
    NUISANCE: ClassVar[str]  # shared by all pins

    def apply(self, data: dict[str, Any]) -> None:
        bearings, listed = self.SITES.bearings, data["joints"]
        pins = (
            [self.site]
            if self.sites()
            else [pin for pin in bearings if listed.get(pin, "ideal") != "ideal"]
        )
        for pin in pins or bearings:
            joint_data(data, self.NAME, pin)["contact"][self.KEY] = self.parameters.coefficient

    @classmethod
    def deviation_from(
        cls, nominal: float, step: float, *nuisances: Parameter, **attributes: Any
    ) -> Candidate:
        """The candidate whose amplitude is the deviation from a `nominal` coefficient."""
        low, high = cls.DESCRIBED["coefficient"].ge, cls.DESCRIBED["coefficient"].le
        return cls.candidate(
            amplitude("change", step, "1", low - nominal, high - nominal),
            *nuisances,
            amplitudes=("change",),
            parameters=lambda values: {"coefficient": max(nominal + values["change"], low)},
            is_perturbation=nominal > 0.0,
            **attributes,
        )

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        shared, loose = context.nuisances.get(cls.NUISANCE), {*context.mechanism.loose}
        if shared is not None and len(loose & {*cls.SITES.bearings}) > 1:
            yield cls.deviation_from(shared.nominal, shared.step, replaces={cls.NUISANCE: "change"})


class Friction(ContactCoefficient):
    """A coefficient of friction that replaces that of the contacts."""

    KEY, NUISANCE = "friction", "joint_friction"
    coefficient = parameter("", "k, coefficient of friction", 0.1, ge=0, le=0.6)


@register_effect(order=100)
class PinFriction(Friction):
    """Friction in a pin: replaces the contact's coefficient in a loose pin, adds a friction moment
    in an ideal one."""

    SITE, PLACES = "{bearings}", "bearings"
    LAW = (
        f"loose: contact.friction = k; ideal: M = -k r |F| sgn w, {CRANK_SIGN}, r: journal_radius,"
        " F: the pin's force, w: relative speed of its bodies"
    )
    REFERENCE = "Haug, Wu and Yang, Mech. Mach. Theory 21 (1986) 401-406"
    WORDS = "friction in the {site}"

    def changes_data(self, mechanism: Any) -> bool:
        """True for a loose pin; a listed clearance effect determines whether it is loose."""
        clearance = mechanism.effect(f"{self.site}_clearance")
        return self.site in mechanism.loose if clearance is None else clearance.clearance_m > 0

    def check(self, mechanism: Any) -> None:
        if self.site not in (*mechanism.loose, *self.SITES.pins):
            raise ValueError(
                f"effects: pin_friction at {self.site} requires a loose joint, or one of two moving"
                " bodies; friction of an ideal joint of the frame is a coulomb_friction of its body"
            )
        if mechanism.joint(self.site) is None:
            raise ValueError(
                f"effects: pin_friction at {self.site} requires the joint's journal_radius; write"
                " the joint as a mapping, with 'loose: false' for an ideal joint"
            )

    def compile_into(self, records: base.Records) -> None:
        records["joints"][self.site]["pin_friction"] = self.parameters.coefficient

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        for pin in cls.sites():
            joint = context.mechanism.joint(pin)
            if joint is None or not (joint.loose or pin in cls.SITES.pins):
                continue
            replaces, nuisances, nominal = {}, [], 0.0
            if joint.loose:
                keys = (f"joint_friction_{pin}", "joint_friction")
                replaces = context.replaced(dict.fromkeys(keys, "change"))
                nominal = joint.contact.friction
            if "joint_friction" in replaces and {*context.mechanism.loose} & {
                *cls.SITES.bearings
            } - {pin}:
                # the shared nuisance then belongs to the other pin
                nuisances = [context.nuisances["joint_friction"]]
            guess = {nuisance.name: nuisance.nominal for nuisance in nuisances}
            yield cls.deviation_from(
                nominal, 0.02, *nuisances, site=pin, initial_guesses=(guess,), replaces=replaces
            )


@register_effect(order=102)
class CommonPinFriction(Friction):
    """A common coefficient of friction of all loose pins."""

    LAW = "contact.friction = k of every loose pin"
    WORDS = "deviating friction of all pins"


class Restitution(ContactCoefficient):
    """A coefficient of restitution that replaces that of the contacts."""

    REFERENCE = "Lankarani and Nikravesh, J. Mech. Des. 112 (1990) 369-376"
    KEY, NUISANCE = "restitution", "restitution"
    coefficient = parameter("", "e, coefficient of restitution", 0.3, ge=1e-3, le=0.999)


@register_effect(order=104)
class PinRestitution(Restitution):
    """The coefficient of restitution of a loose pin."""

    SITE, PLACES = "{bearings}", "bearings"
    LAW = "contact.restitution = e of the loose pin"
    WORDS = "deviating restitution of the {site}"

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        loose = [pin for pin in cls.sites() if pin in context.mechanism.loose]
        for pin in cls.sites():
            shared = context.nuisances.get("restitution") if loose == [pin] else None
            if nuisance := context.nuisances.get(f"restitution_{pin}", shared):
                yield cls.deviation_from(
                    nuisance.nominal, nuisance.step, site=pin, replaces={nuisance.name: "change"}
                )


@register_effect(order=106)
class CommonPinRestitution(Restitution):
    """A common coefficient of restitution of all loose pins."""

    LAW = "contact.restitution = e of every loose pin"
    WORDS = "deviating restitution of all pins"


@register_effect(order=220)
class LubricatedJoint(Effect):
    """A lubricant film in a loose pin with squeeze effect; dry contact if the film is thinner than
    h_min."""

    ON, GROUP, SITE, PLACES = "mechanism", "pins", "{bearings}", "bearings"
    LAW = (
        "short bearing (Ocvirk) with squeeze, pressure p >= 0: d/dz(h^3 dp/dz) = 6 mu ((w_j + w_b)"
        " dh/dphi + 2 dh/dt); dry contact where h < h_min"
    )
    REFERENCE = "DuBois and Ocvirk, NACA report 1157 (1953)"
    WORDS = "a lubricant film in the {site}"
    viscosity_Pa_s = parameter("Pa*s", "mu, dynamic viscosity", 0.05, gt=0)
    length_m = parameter("m", "L, axial length of the bearing", 0.012, gt=0)
    least_film_m = parameter(
        "m", "h_min, film thickness at which asperities touch: dry contact", 1e-6, 1e-6, gt=0
    )

    def check(self, mechanism: Any) -> None:
        where = f"effects: lubricated_joint at {self.site}"
        if self.site not in mechanism.loose:
            raise ValueError(f"{where} requires a clearance; make the joint loose")
        thinnest, clearance = self.parameters.least_film_m, mechanism.clearance(self.site)
        if thinnest > _LARGEST_FILM_SHARE * clearance:
            raise ValueError(
                f"{where}: least_film_m {thinnest:g} m is more than {_LARGEST_FILM_SHARE:g} of the"
                f" clearance {clearance:g} m; lower it"
            )

    def compile_into(self, records: base.Records) -> None:
        joint, parameters = records["joints"][self.site], self.parameters
        joint["film_viscosity"] = parameters.viscosity_Pa_s
        joint["film_length"] = parameters.length_m
        joint["film_least"] = parameters.least_film_m
        joint["clearance"] -= parameters.least_film_m

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        for pin in cls.sites():
            if pin not in context.mechanism.loose:
                continue
            joint = context.mechanism.joint(pin)
            radius, clearance = joint.journal_radius, joint.clearance
            length = 2.0 * radius  # assumed
            force_per_viscosity = radius * length**3 * context.scale.turning / clearance**2
            step = context.scale.force / force_per_viscosity
            yield cls.candidate(
                amplitude("viscosity_Pa_s", step, "Pa*s", 0.0),
                site=pin,
                initial_guesses=tuple({"viscosity_Pa_s": viscosity} for viscosity in _VISCOSITIES),
                parameters=lambda values, length=length: {**values, "length_m": length},
            )
