"""Effects that a mechanism may lack: every law at every site where it may act, laws of the user,
and the terms of formulas; with the magnitudes of the motion, which set the steps of a fit."""

import math
from dataclasses import replace
from itertools import product
from math import tau

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign import Campaign
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.formula import compile_formula
from jointgap.effects import effects_of
from jointgap.effects.base import (
    CRANK_SIGN_SPEED,
    DETECTABLE_SHARE,
    GROUPS,
    SLIDER_SIGN_SPEED,
    FitContext,
    MotionScale,
)
from jointgap.effects.own_law import OwnLaw, formula_effect
from jointgap.linkage.assembly import ideal_pose, signs_of
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.laws import evaluate
from jointgap.motion.effects import crank_radius
from jointgap.motion.ideal import ideal_channels
from jointgap.rig.simulate_run import augmented_mechanism

STEP_SHARE_OF_BOUNDS = 0.02  # [1] Step of a parameter over the width of its bounds (experience)
SCALE_ANGLES = 360  # Per revolution, for the magnitudes of the motion
GUIDE_SHARE = 0.3  # [1] Force across a slide over the inertia force along it
OWN_LAW_ANGLES = 72  # Per revolution, for the size of a law that a campaign states
SHAPES_TRIED = (1 / 6, 1 / 2, 5 / 6)  # [1, of the range] Start values of its shape parameters


def motion_scales(
    mechanism: Mechanism | LinkageFile, turning: float
) -> tuple[MotionScale, dict[str, MotionScale]]:
    """Magnitudes of the motion at the crank speed `turning` [rad/s]: of the mechanism, and by body
    where they differ.

    Of a slider-crank in closed form; else the force at a body is that which has the power of the
    inertia forces over an ideal revolution.
    """
    if isinstance(mechanism, Mechanism):
        return MotionScale.of(mechanism, turning), {}
    file = mechanism.applied()
    linkage, sites = linkage_of_file(file), file.sites
    angles = np.arange(SCALE_ANGLES) * (tau / SCALE_ANGLES)
    pose = ideal_pose(linkage, signs_of(linkage, 0.0), angles)  # speeds over that of the crank
    inertial = _rms(ideal_channels(file, angles, turning)["crank_torque"])
    radius = crank_radius(linkage)
    speed, force = radius * turning / math.sqrt(2.0), inertial / radius
    crank = MotionScale(radius, speed, turning, DETECTABLE_SHARE * force, force, 0.0)
    scales = {}
    slides = {**sites.slides, **{name: name for name in sites.tracks}}
    for body, name in {**slides, **sites.pivots}.items():
        place, rate = (np.broadcast_to(x, angles.shape) for x in pose.travel(linkage.joints[name]))
        pace, half = max(_rms(rate), 1e-9), 0.5 * float(np.ptp(place))
        middle = float(np.min(place)) + half
        if body in sites.pivots:
            scales[body] = replace(
                crank, turning=pace * turning, force=crank.force / pace, middle=middle, swing=half
            )
        else:
            along = inertial / pace
            scales[body] = MotionScale(
                half,
                pace * turning,
                turning,
                DETECTABLE_SHARE * along,
                GUIDE_SHARE * along,
                middle,
            )
    return crank, scales


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def physical_candidates(context: FitContext) -> list[Candidate]:
    """Possible missing effects by group, without those that the mechanism has or that cannot act in
    it."""
    candidates = []
    for effect in effects_of(context.mechanism.sites).values():
        for candidate in effect.candidates(context):
            site = candidate.site if candidate.has_site else None
            if context.mechanism.effect(candidate.name, site) is None and _is_possible(
                context, candidate
            ):
                place = GROUPS.index(effect.GROUP), effect.sites().index(site) if site else 0
                candidates.append((place, candidate))
    return [candidate for _, candidate in sorted(candidates, key=lambda entry: entry[0])]


def _is_possible(context: FitContext, candidate: Candidate) -> bool:
    """Whether the effect is valid in a mechanism file at a small size."""
    small = {
        f"{candidate.label}.{p.key}": (
            min(max(p.step, p.low), p.high) if p.key in candidate.amplitudes else p.nominal
        )
        for p in candidate.coordinates
    }
    try:
        augmented_mechanism(context.mechanism, (candidate,), small)
    except InputError:
        return False
    return True


def law_candidates(campaign: Campaign, context: FitContext) -> list[Candidate]:
    """The laws that a campaign states itself, except those that the mechanism has."""
    sites, candidates = campaign.mechanism.sites, []
    for name, law in campaign.candidates.items():
        if campaign.mechanism.effect(formula_effect(sites, law.site), name) is None:
            candidates.append(_law_candidate(campaign, name, law, context))
    return candidates


def _law_candidate(campaign: Campaign, name: str, law: OwnLaw, context: FitContext) -> Candidate:
    spans, amplitudes = law.spans, law.amplitudes
    shapes = {key: span for key, span in spans.items() if key not in amplitudes}
    middles = {key: span.middle for key, span in shapes.items()}
    starts = [
        [span.low + share * (span.high - span.low) for share in SHAPES_TRIED]
        for span in shapes.values()
    ]
    guesses = tuple(dict(zip(shapes, start, strict=True)) for start in product(*starts))
    scale = context.at(law.site)
    most = scale.force * (scale.stroke if law.key == "torque" else 1.0)
    states, coordinates = _states(campaign, law.site, context), []
    for key in amplitudes:
        sizes = []
        for values in (middles, *guesses):
            program = compile_formula(
                law.formula, {**dict.fromkeys(amplitudes, 0.0), **values, key: 1.0}
            )
            force = [evaluate(program.codes, program.numbers, *state, 0.0) for state in states]
            sizes.append(_rms(force))
            if not sizes[-1] < math.inf or sizes[0] == 0.0:
                settings = ", ".join(
                    f"{parameter} = {value:g}" for parameter, value in {key: 1.0, **values}.items()
                )
                raise InputError(
                    f"campaign {campaign.name}, candidates.{name}: with {settings} the formula"
                    f" '{law.formula}' is {sizes[-1]:g} over a turn; write |v|^n for v^n, or"
                    " correct it or the ranges"
                )
        span = spans[key]
        coordinates.append(Parameter(key, 0.0, span.low, span.high, most / sizes[0], span.unit))
    coordinates += [
        bounded(key, span.middle, span.low, span.high, span.unit) for key, span in shapes.items()
    ]
    return Candidate(
        name,
        law.site,
        tuple(coordinates),
        amplitudes,
        initial_guesses=guesses,
        formula=law.formula,
    )


def _states(campaign: Campaign, body: str, context: FitContext) -> np.ndarray:
    """Values (n, 4) of the variables v, x, w, theta of a formula at a body, over a revolution."""
    sites = campaign.mechanism.sites
    if body == sites.crank:  # its formulas have the variables of the first slide
        body = next(iter(sites.slides), body)
    angle, scale = tau * (np.arange(OWN_LAW_ANGLES) + 0.5) / OWN_LAW_ANGLES, context.at(body)
    turning = np.full(angle.size, context.scale.turning)
    if body == sites.crank:
        place, speed = angle, turning
    elif body in sites.pivots:
        place = scale.middle + scale.swing * np.cos(angle)
        speed = -math.sqrt(2.0) * scale.turning * np.sin(angle)
    else:
        place = scale.middle + scale.stroke * np.cos(angle)
        speed = -scale.stroke * scale.turning * np.sin(angle)
    return np.column_stack([speed, place, turning, angle])


def bounded(
    name: str, nominal: float, low: float, high: float, unit: str, run: str | None = None
) -> Parameter:
    """A parameter between bounds."""
    return Parameter(name, nominal, low, high, STEP_SHARE_OF_BOUNDS * (high - low), unit, run)


_ON_A_SLIDE = (
    "1 v |v| S v*|v| v^3 Y Y^3 |Y| cos(theta) sin(theta) Y*v Y*|v| Y*S v*cos(theta) v*sin(theta)"
)
_ON_THE_CRANK = "1 w w*|w| cos(theta) sin(theta) cos(2*theta) sin(2*theta)"
_AT_A_PIVOT = "1 v S v*|v| Y cos(theta) sin(theta) cos(2*theta) sin(2*theta)"
"""Terms of formulas by kind of site: Y is the distance from mid-stroke, S the sign of v."""


def library(mechanism: Mechanism | LinkageFile, context: FitContext) -> tuple[Candidate, ...]:
    """A candidate for each term of a force on a slide, or of a torque on the crank or at a
    pivot."""
    sites, candidates = mechanism.sites, []
    for body in (*sites.slides, sites.crank, *sites.pivots):
        scale, width, terms, arm = context.at(body), SLIDER_SIGN_SPEED, _ON_A_SLIDE, 1.0
        sizes = {"Y": scale.stroke, "v": scale.speed, "w": context.scale.turning}
        if body not in sites.slides:
            width, terms, arm = CRANK_SIGN_SPEED, _ON_THE_CRANK, scale.stroke
        if body in sites.pivots:
            terms, sizes = _AT_A_PIVOT, {"Y": scale.swing, "v": scale.turning}
        symbols = {"Y": f"(x - {scale.middle!r})", "S": f"tanh(v/{width!r})"}
        for term in terms.split():
            power = 3 if "^3" in term else 1
            size = math.prod(
                magnitude ** (power * term.count(symbol)) for symbol, magnitude in sizes.items()
            )
            coefficient = Parameter("coefficient", 0.0, step=scale.force * arm / size)
            text = term.replace("Y", symbols["Y"]).replace("S", symbols["S"])
            name = f"{formula_effect(sites, body)}[{text}]"
            candidates.append(Candidate(name, body, (coefficient,), ("coefficient",)))
    return tuple(candidates)
