"""The physical effects that could be missing in a slider-crank, by coordinates that a fit can vary."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from jointgap.config import EFFECTS, Mechanism
from jointgap.identification.protocol import Candidate, Parameter
from jointgap.joints import FROM_FRAME, PINS
from jointgap.slider_crank.nuisances import other_pins, replaced_by

_SHARE = 0.02  # of a channel's size: what noise could just hide
_INF = math.inf

_FIRST_CLEARANCES = (2e-5, 1e-4)  # [m] of a joint that was ideal: any of them lets the pin fly and hit
_CLEARANCES = tuple(8e-6 * 1.35**place for place in range(15))
_VISCOSITIES = (0.03, 0.2)  # [Pa s], of light and heavy oils: the least film carries the pin already
_BENDING_ORDERS = (60.0, 25.0, 10.0)  # frequencies of a bending rod over the crank's

Values = Mapping[str, float]


@dataclass(frozen=True)
class Scale:
    """Sizes of the motion from which sensible steps follow.

    Attributes
    ----------
    stroke, speed, turning : float
        Half the stroke [m], slider's speed [m/s] and crank's speed [rad/s], root mean squares.
    force : float
        A force on the slider [N] that noise could just hide.
    guide : float
        The guide's force [N].
    middle : float
        Slider's position at mid-stroke [m].
    """

    stroke: float
    speed: float
    turning: float
    force: float
    guide: float
    middle: float

    @classmethod
    def of(cls, mechanism: Mechanism, turning: float) -> "Scale":
        """Of a mechanism whose crank turns at `turning` [rad/s]."""
        crank, rod = mechanism.crank.length, mechanism.rod.length
        mass = mechanism.slider.mass + 0.5 * mechanism.rod.mass
        inertia = mass * crank * turning**2 / math.sqrt(2.0)
        return cls(crank, crank * turning / math.sqrt(2.0), turning, _SHARE * inertia, inertia * crank / rod, rod)


def size(name: str, step: float, unit: str, low: float = -_INF, high: float = _INF) -> Parameter:
    """A coordinate that is 0 where its effect is absent."""
    return Parameter(name, 0.0, low, high, step, unit)


def shape(name: str, start: float, step: float, unit: str, low: float, high: float) -> Parameter:
    """A coordinate that says nothing where its effect is absent."""
    return Parameter(name, start, low, high, step, unit)


def physical_candidates(
    mechanism: Mechanism,
    scale: Scale,
    nuisances: Mapping[str, Parameter],
    prescribed: bool,
    planned_orders: float,
    runs: Sequence[str],
) -> list[Candidate]:
    """Effects that could be missing in `mechanism`; those that it has, or that cannot act in it, are left out.

    Parameters
    ----------
    mechanism : Mechanism
    scale : Scale
    nuisances : mapping of str to Parameter
        Those that all runs share, by name.
    prescribed : bool
        Whether the crank turns at a constant speed.
    planned_orders : float
        Frequency [Hz] of a force that swings by itself before data tell one.
    runs : sequence of str
    """
    found = [
        *_forces(scale, planned_orders, runs),
        *_crank(mechanism, scale, prescribed),
        *_data(mechanism, scale, nuisances),
    ]
    found += [one for pin in PINS for one in _pin(mechanism, pin, scale, nuisances)]
    found += [one for joint in FROM_FRAME for one in _clearance(mechanism, joint, nuisances)]
    return [one for one in found if not _has(mechanism, one)]


def _has(mechanism: Mechanism, candidate: Candidate) -> bool:
    site = candidate.site if "site" in EFFECTS[candidate.name].model_fields else None
    return mechanism.effect(candidate.name, site) is not None


def _candidate(
    name: str, coordinates, amplitudes, parameters=dict, initial_guesses=({},), site=None, **further
) -> Candidate:
    site = site or EFFECTS[name].SITE
    return Candidate(name, site, tuple(coordinates), tuple(amplitudes), tuple(initial_guesses), parameters, **further)


def _one(name: str, coordinate: Parameter, **further) -> Candidate:
    return _candidate(name, (coordinate,), (coordinate.name,), **further)


def _polar(amplitude: str, angle: str, **fixed: str) -> Callable[[Values], dict[str, float]]:
    """Amplitude and angle of the parts with the cosine and the sine, and further parameters as they are."""

    def parameters(values: Values) -> dict[str, float]:
        cosine, sine = values["cosine"], values["sine"]
        found = {amplitude: math.hypot(cosine, sine), angle: math.atan2(sine, cosine)}
        return found | {name: values[key] for name, key in fixed.items()}

    return parameters


def _harmonic(values: Values) -> dict[str, float]:
    """Parameters of a swinging force: of one run, or the mean amplitude over runs and the phase in the first."""
    parts = {key.removeprefix("cosine"): values[key] for key in values if key.startswith("cosine")}
    sines = {
        run: -values[f"sine{run}"] for run in parts
    }  # f cos(w t + phase) = f cos phase cos w t - f sin phase sin w t
    first = next(iter(parts))
    return {
        "force_N": math.sqrt(sum(parts[run] ** 2 + sines[run] ** 2 for run in parts) / len(parts)),
        "frequency_Hz": values["frequency_Hz"],
        "phase_rad": math.atan2(sines[first], parts[first]),
    }


def _forces(scale: Scale, frequency: float, runs: Iterable[str]) -> Iterator[Candidate]:
    force = scale.force
    yield _one("slider_coulomb_friction", size("force_N", force, "N", 0.0))
    yield _one("slider_viscous_friction", size("damping_N_s_m", force / scale.speed, "N*s/m", 0.0))
    yield _one("slider_quadratic_drag", size("drag_N_s2_m2", force / scale.speed**2, "N*s^2/m^2", 0.0))
    yield _one("slider_load_friction", size("coefficient", min(force / scale.guide, 0.1), "1", 0.0, 1.0))
    yield _one("slider_constant_force", size("force_N", force, "N"))
    middle = scale.middle

    def spring(values: Values) -> dict[str, float]:
        stiffness = max(values["stiffness_N_m"], 1e-9 * force / scale.stroke)  # a constant force is a soft, far spring
        return {"stiffness_N_m": stiffness, "rest_position_m": middle + values["force_at_middle_N"] / stiffness}

    yield _candidate(
        "slider_spring",
        (size("stiffness_N_m", force / scale.stroke, "N/m", 0.0), size("force_at_middle_N", force, "N")),
        ("stiffness_N_m", "force_at_middle_N"),
        spring,
    )
    lengths = (0.2 * scale.stroke, scale.stroke)
    yield _candidate(
        "gas_pressure",
        (
            size("force_N", force, "N", 0.0),
            shape("dead_length_m", lengths[0], 0.1 * lengths[0], "m", 0.01 * scale.stroke, 20.0 * scale.stroke),
            shape("exponent", 1.2, 0.05, "1", 1.0, 1.4),
        ),
        ("force_N",),
        initial_guesses=[{"dead_length_m": length, "exponent": 1.2} for length in lengths],
    )
    yield _candidate(
        "harmonic_force",
        # runs are recorded one after the other: each has a phase of its own
        (
            *(Parameter(part, 0.0, step=force, unit="N", run=run) for run in runs for part in ("cosine", "sine")),
            shape("frequency_Hz", frequency, 1e-3 * frequency, "Hz", 0.0, _INF),
        ),
        tuple(f"{part}@{run}" for run in runs for part in ("cosine", "sine")),
        _harmonic,
        initial_guesses=({"frequency_Hz": frequency},),
        steady_counterpart="slider_constant_force",
    )


def _crank(mechanism: Mechanism, scale: Scale, prescribed: bool) -> Iterator[Candidate]:
    torque = scale.force * scale.stroke
    unbalance = scale.force / scale.turning**2
    yield _one("crank_coulomb_friction", size("torque_N_m", torque, "N*m", 0.0))
    yield _one("crank_viscous_friction", size("damping_N_m_s", torque / scale.turning, "N*m*s", 0.0))
    yield _candidate(
        "crank_unbalance",
        (size("cosine", unbalance, "kg*m"), size("sine", unbalance, "kg*m")),
        ("cosine", "sine"),
        _polar("unbalance_kg_m", "angle_rad"),
    )
    if prescribed:
        parameters = _polar("ratio", "phase_rad", order="order")
        yield _candidate(
            "speed_fluctuation",
            (
                size("cosine", 1e-3, "1", -0.3, 0.3),
                size("sine", 1e-3, "1", -0.3, 0.3),
                shape("order", 1.0, 1e-3, "1", 1.0, 12.0),
            ),
            ("cosine", "sine"),
            lambda values: (found := parameters(values)) | {"order": round(found["order"])},
            initial_guesses=[{"order": float(order)} for order in range(1, 9)],
        )


def _data(mechanism: Mechanism, scale: Scale, nuisances: Mapping[str, Parameter]) -> Iterator[Candidate]:
    """Weight, other masses and lengths, and a rod that bends."""
    yield _one("gravity", size("acceleration_m_s2", 0.5, "m/s^2", 0.0, 15.0))
    mass, crank, rod = mechanism.slider.mass, mechanism.crank.length, mechanism.rod.length
    replaces = replaced_by("added_slider_mass", "", nuisances)
    yield _one("added_slider_mass", size("mass_kg", _SHARE * mass, "kg", -0.95 * mass), replaces=replaces)
    yield _one("slider_offset", size("offset_m", 0.01 * crank, "m", -rod, rod))
    lengths = (size("crank_m", 2e-3 * crank, "m", -0.5 * crank), size("rod_m", 2e-3 * rod, "m", -0.5 * rod))
    replaces = replaced_by("link_length_error", "", nuisances)
    yield _candidate("link_length_error", lengths, ("crank_m", "rod_m"), replaces=replaces)
    slow = 1.0 / (30.0 * scale.turning) ** 2
    yield _candidate(
        "rod_flexibility",
        (
            size("compliance_s2", 0.1 * slow, "s^2", 0.0, 0.1 / scale.turning**2),
            shape("damping_ratio", 0.02, 0.01, "1", 0.0, 0.9),
        ),
        ("compliance_s2",),
        lambda values: {
            "frequency_Hz": 1.0 / (2.0 * math.pi * math.sqrt(max(values["compliance_s2"], 1e-300))),
            "damping_ratio": values["damping_ratio"],
        },
        initial_guesses=[
            {"damping_ratio": 0.02},
            *({"damping_ratio": 0.02, "compliance_s2": (order * scale.turning) ** -2.0} for order in _BENDING_ORDERS),
        ],
    )


def _pin(mechanism: Mechanism, pin: str, scale: Scale, nuisances: Mapping[str, Parameter]) -> Iterator[Candidate]:
    """Friction and film of a pin whose data are known."""
    joint = mechanism.joint(pin)
    if joint is None:
        return
    known = joint.contact.friction if joint.loose else 0.0
    replaces = replaced_by("pin_friction", pin, nuisances) if joint.loose else {}
    coordinates = [size("change", 0.02, "1", -known, 0.6 - known)]
    if "joint_friction" in replaces and other_pins(mechanism, pin):
        # The effect takes this pin out of what both share: what is left is the other pin's.
        both = nuisances["joint_friction"]
        coordinates.append(shape("joint_friction", both.nominal, both.step, "1", both.low, both.high))
    initial_guesses = ({p.name: p.nominal for p in coordinates[1:]},)
    yield _candidate(
        "pin_friction",
        coordinates,
        ("change",),
        lambda values: {"coefficient": max(known + values["change"], 0.0)},
        initial_guesses,
        pin,
        replaces=replaces,
        has_site=True,
        is_perturbation=joint.loose and known > 0.0,
    )
    if joint.loose:
        length = 2.0 * joint.journal_radius
        shear = joint.journal_radius * length**3 * scale.turning / joint.clearance**2  # force per viscosity
        yield _candidate(
            "lubricated_joint",
            (size("viscosity_Pa_s", scale.force / shear, "Pa*s", 0.0),),
            ("viscosity_Pa_s",),
            lambda values: {"viscosity_Pa_s": values["viscosity_Pa_s"], "length_m": length},
            [{"viscosity_Pa_s": value} for value in _VISCOSITIES],
            site=pin,
            has_site=True,
        )


def _clearance(mechanism: Mechanism, joint: str, nuisances: Mapping[str, Parameter]) -> Iterator[Candidate]:
    if mechanism.joint(joint) is None:
        return
    name, known = f"{joint}_clearance", mechanism.clearance(joint)
    yield _one(
        name,
        size("change_m", 0.05 * known if known else 2e-5, "m", -0.95 * known, 0.05 * mechanism.crank.length),
        parameters=lambda values: {"clearance_m": known + values["change_m"]},
        initial_guesses=({},) if known else [{"change_m": value} for value in _FIRST_CLEARANCES],
        grid=() if known else _CLEARANCES,
        is_perturbation=known > 0.0,
        site=joint,
        replaces=replaced_by(name, joint, nuisances),
    )
