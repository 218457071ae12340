"""Every figure of a scenario: its title and caption, where the report files it, and which tables it needs. Imports
nothing heavy.

A further figure is a function of a module beside this one, and its entry here."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pkgutil import resolve_name

from jointgap.core.errors import InputError, did_you_mean


@dataclass(frozen=True)
class FigureSpec:
    """One figure of a scenario or a campaign."""

    title: str  # For lists of figures
    category: str  # Section of the report
    function: str  # ``module:function`` within `jointgap`: tables, and scenario or verdict, in, `Drawing` out
    tables: tuple[str, ...]  # Names of the tables it needs
    caption: str  # What it shows and how to read it
    nothing: str = ""  # What a campaign's figure says where there is nothing to draw

    def load(self) -> Callable:
        """The function that draws it."""
        return resolve_name(f"jointgap.{self.function}")


_NETWORKS, _MOTION, _CONTACT, _OPTIMUM = "Networks", "Motion", "Contact", "Optimum"
_LEARNED = ("trajectory", "predictions")

CATALOGUE = {
    "figure_05": FigureSpec(
        "Clearances (the paper's figure 5)",
        _NETWORKS,
        "scenario.figures_networks:clearances",
        _LEARNED,
        "First revolution. Above: distance of the centres in each loose joint, simulation and network. Below: network "
        "minus simulation, at the points the network was trained at (black) and at every sample of the revolution; "
        "linear inside the grey band, logarithmic outside. A trained network meets its training points closely; "
        "between them, while the journals fly and hit, it may miss by a good part of the clearance. An error at "
        "training points alone does not show that.",
    ),
    "figure_06": FigureSpec(
        "Directions (the paper's figure 6)",
        _NETWORKS,
        "scenario.figures_networks:directions",
        _LEARNED,
        "First revolution. Above: simulation and network, the angles unwrapped; the dotted line is the crank angle "
        "itself. A direction that followed the crank would run along that line; load reversals turn it in strides "
        "instead, and the journals swing about it. Below: network minus simulation at training points (black) and at "
        "all samples; linear inside the grey band, logarithmic outside.",
    ),
    "figure_07": FigureSpec(
        "Derivatives (the paper's figure 7)",
        _NETWORKS,
        "scenario.figures_networks:derivatives",
        _LEARNED,
        "First revolution. Value above, network minus simulation below, at training points (black) and at all "
        "samples; scales are linear inside the grey band and logarithmic outside. Steel contacts ring at some kHz, "
        "about once per degree of crank angle at 600 rpm, which one training point per degree cannot show: there "
        "networks invent what lies between, even where their training errors are small.",
    ),
    "figure_08": FigureSpec(
        "Mean square error over the training (the paper's figure 8)",
        _NETWORKS,
        "scenario.figures_networks:mse_curves",
        ("fit_history", "fit_errors"),
        "Mean square error at the training points, over the squared range of the output, after every Levenberg- "
        "Marquardt iteration, both axes logarithmic. Thick: the default start, which was not chosen by its result; "
        "thin: the other starts. Diamonds: what the paper prints after 20 000 iterations. A curve that ends below its "
        "diamond has reached the paper's error; what that is worth between the points is another figure (errors "
        "between the training points).",
    ),
    "figure_09": FigureSpec(
        "Position of the rod (the paper's figure 9)",
        _MOTION,
        "scenario.figures_motion:rod_position",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), with clearance as simulated, and with "
        "clearance from the equations fed by the networks. Below: what is left after subtracting the desired "
        "position. The curves above can hardly be told apart; the deviation stays within about one clearance: along x "
        "the rod's centre moves with its crank end and a little by the rod's tilt, across it with half of each "
        "joint's clearance.",
    ),
    "figure_10": FigureSpec(
        "Velocity of the rod (the paper's figure 10)",
        _MOTION,
        "scenario.figures_motion:rod_velocity",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), simulated with clearance, and from the "
        "networks. Below: deviation from the desired velocity. Steps are impacts, most of them early in the "
        "revolution; later bumps come where the journals cross their bearings or swing along the wall. The networks "
        "are fed through the paper's equations, which take the clearance as constant, so they cannot follow the free "
        "flight at the start.",
    ),
    "figure_11": FigureSpec(
        "Acceleration of the rod (the paper's figure 11)",
        _MOTION,
        "scenario.figures_motion:rod_acceleration",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), simulated with clearance, and from the "
        "networks; below: deviation. The scale is linear inside the grey band and logarithmic outside, because "
        "impacts exceed the desired acceleration many times over. While a journal flies free the simulated rod is "
        "nearly without acceleration; the paper's equations, which leave out the derivatives of the clearances' "
        "lengths, show something else there. Compare the two columns before believing that y deviates more than x.",
    ),
    "figure_12": FigureSpec(
        "Position of the piston (the paper's figure 12)",
        _MOTION,
        "scenario.figures_motion:piston_position",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), simulated with clearance, and from the "
        "networks. Below: deviation from the desired position. It swings through about plus and minus the sum of the "
        "clearances, because their vectors lie along the rod when the load reverses: the piston carries the "
        "clearances of all joints.",
    ),
    "figure_13": FigureSpec(
        "Velocity of the piston (the paper's figure 13)",
        _MOTION,
        "scenario.figures_motion:piston_velocity",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), simulated with clearance, and from the "
        "networks. Below: deviation from the desired velocity. Deviations are large at the start, where the piston "
        "flies on while the crank already pulls, and around the load reversals.",
    ),
    "figure_14": FigureSpec(
        "Acceleration of the piston (the paper's figure 14)",
        _MOTION,
        "scenario.figures_motion:piston_acceleration",
        ("kinematics",),
        "First revolution. Above: without clearance (desired, dashed), simulated with clearance, and from the "
        "networks; below: deviation. The scale is linear inside the grey band and logarithmic outside. Free flight "
        "shows as zero acceleration, impacts as spikes; in contact the acceleration follows the desired one with a "
        "ripple, the journal swinging along its bearing's wall. Where the curve of the networks leaves that of the "
        "simulation, the paper's equations or the networks fail, not the mechanism.",
    ),
    "figure_15": FigureSpec(
        "Transmission angle (the paper's figure 15)",
        _MOTION,
        "scenario.figures_motion:transmission_angles",
        ("kinematics",),
        "First revolution. Above: the angle between rod and the normal to the slide. Below: actual minus desired. The "
        "whole error that the optimisation works on is this lower curve, small beside the swing of the angle itself "
        "over every revolution (compare the two scales).",
    ),
    "figure_16": FigureSpec(
        "Errors of the transmission angle (the paper's figure 16)",
        _OPTIMUM,
        "scenario.figures_motion:transmission_errors",
        (*_LEARNED, "optimise_optima"),
        "First revolution. Desired minus actual at the original lengths, and desired minus optimised at the genetic "
        "algorithm's lengths, with the clearance motion frozen: above from the networks (the paper's way), below from "
        "the simulation. Other lengths can hardly do more than add a multiple of the crank angle's sine, so they "
        "cannot remove the part that comes from the journals' swings. The RMS counts the samples of the configured "
        "window.",
    ),
    "held_out": FigureSpec(
        "Errors between the training points",
        _NETWORKS,
        "scenario.figures_networks:held_out",
        ("fit_errors",),
        "Mean square errors over the squared range of each output's training points, logarithmic, for the whole first "
        "revolution and for its part past 60 deg: the networks at their training points and at held-out samples, a "
        "cubic spline through the same points; the regularised networks, whose samples are as dense as the contact "
        "needs, at their training points and at the third held out, and a smoothing spline of the same points; the "
        "second surrogate and a spline through its points where there is one; and the paper's printed errors (level "
        "strokes), which are errors at training points. Circle and square of a network close together: it knows the "
        "motion between its points. Marks are the default start, bars the range over all starts, of which the others "
        "may have had fewer iterations. Where a triangle lies below a circle, a spline would have done better than "
        "the network.",
    ),
    "contradictions": FigureSpec(
        "Networks that contradict each other",
        _NETWORKS,
        "scenario.figures_networks:contradictions",
        (*_LEARNED, "kinematics"),
        "First revolution. Above: the derivative of the network of the direction minus the network of its rate; zero "
        "if the two agreed. Below: what follows for the piston, as error against the simulation, if each output comes "
        "from its own network, as in the paper, or if one is derived from another's: its position with the directions "
        "as integrals of the networks of their rates, its acceleration with the derivatives of the networks of the "
        "directions. Linear inside the grey band, logarithmic outside. Independent fits do not describe one motion.",
    ),
    "valley": FigureSpec(
        "The valley of the objective",
        _OPTIMUM,
        "scenario.figures_optimum:valley",
        ("optimise_valley", "optimise_floor", "optimise_paths", "optimise_population", "optimise_optima"),
        "Clearance motion frozen, from the networks. Left: error over both lengths in the main box, with the bounds, "
        "the inequality, the six starting points and paths of the local optimiser, the best of each generation of the "
        "genetic algorithm, both optima and, for the paper's own mechanism, its three points. The error depends on "
        "the ratio of the lengths almost alone: a flat valley, not many minima. Right: reduction along the valley's "
        "floor, each measure at its own best crank length; marks are RMS reductions under this scenario's objective, "
        "the paper's points among them. It rises steadily with the rod's length, so the bound on the rod's length "
        "decides the optimum.",
    ),
    "resimulation": FigureSpec(
        "Frozen and true reductions",
        _OPTIMUM,
        "scenario.figures_optimum:resimulation",
        ("optimise_resimulated",),
        "By how much the error of the transmission angle falls with the lengths named on the left (the paper's three "
        "where the mechanism is the paper's, and what the genetic algorithm finds on each source): with the clearance "
        "motion frozen at the original lengths (open diamonds, what the optimiser believes) and simulated again with "
        "the new lengths (dots: median of an ensemble of perturbed starts, bars: 5 to 95 % of its pairs). Left panel: "
        "the configured window of the first revolution; right: a whole settled revolution. Bars that cross zero mean "
        "that a single run can show either sign: there is no gain to speak of.",
    ),
    "orbits": FigureSpec(
        "Orbits of the journals",
        _CONTACT,
        "scenario.figures_motion:orbits",
        ("trajectory",),
        "Left: path of the journal's centre in the first revolution, true scale; the circle is the clearance. Middle: "
        "the settled revolution, with the part beyond the circle (penetration into the wall) magnified by the "
        "factor in the panel, so that it shows where the bearing carries the load. Right: distance of the centres less "
        "the clearance over the crank angle, linear inside the grey band and logarithmic outside; negative values are "
        "flight. A settled curve that never goes below zero means permanent contact.",
    ),
    "contact_forces": FigureSpec(
        "Contact forces and modes",
        _CONTACT,
        "scenario.figures_motion:contact_forces",
        ("trajectory",),
        "Normal force in the loose joints, first revolution and settled revolution, on one logarithmic scale; gaps "
        "are flight. The bands below say what each joint is in: flight, impact (the journal hits and rebounds) or "
        "contact (it stays, swinging about its equilibrium). The impacts after the start, before the journals settle, "
        "can exceed all later forces many times. The nearer a joint is to the frame, the more mass hangs on it.",
    ),
    "impacts": FigureSpec(
        "Impacts",
        _CONTACT,
        "scenario.figures_motion:impacts",
        ("trajectory", "events"),
        "Every contact of the simulation at the crank angle where it begins: impulse of its normal force, its largest "
        "normal force, and the speed of approach. Filled: the journal hits and rebounds at once; open: it stays, so "
        "that the impulse is that of the load carried until it leaves. A contact that has not ended shows its "
        "approach speed alone. The axis ends where no more contacts begin: from there on the journals stay on their "
        "bearings.",
    ),
    "drive_and_guide": FigureSpec(
        "Drive and guide",
        _CONTACT,
        "scenario.figures_motion:drive_and_guide",
        ("trajectory",),
        "Speed of the crank and torque of its drive; force of the guide on the slider and its moment about the "
        "slider's pin, which balances the moment of the friction in the piston pin. First and settled revolution; "
        "where impacts dwarf the rest a scale is linear inside the grey band and logarithmic outside. The speed is a "
        "straight line unless a motor, a measured angle or a fluctuation drives the crank.",
    ),
}
"""The still figures by name: saved as SVG and PNG."""

FIGURES = tuple(CATALOGUE)

ANIMATION = FigureSpec(
    "The mechanism in motion",
    _CONTACT,
    "scenario.animation:animation",
    ("trajectory",),
    "First revolution. Above: the clearances drawn magnified as the title says; rings are bearings, dots are journals, "
    "grey in flight and in their joint's colour in contact; arrows are the forces on the journals, 30 mm longer for "
    "each factor of ten above 1 N. Below: the centres of the loose joints' journals in their true clearance circles "
    "with the way they have come, and the normal forces in the joints' colours with a cursor. The first 60 deg, where "
    "the journals fly and hit, get half of the frames.",
)
"""The animation of the first revolution, named ``animation``: saved as GIF."""

SPECS = CATALOGUE | {"animation": ANIMATION}


def spec_of(name: str) -> FigureSpec:
    """A figure of a scenario by its name."""
    if name not in SPECS:
        raise InputError(f"no figure '{name}'; {did_you_mean(name, SPECS)}")
    return SPECS[name]


def needed_tables(names: Iterable[str]) -> tuple[str, ...]:
    """Names of the tables that the figures `names` need, sorted."""
    return tuple(sorted({table for name in names for table in spec_of(name).tables}))
