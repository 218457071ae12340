"""Draw the figures of docs/simulation.md that show the simulation to be right, from what the tests compute.

python -m benchmarks.draw_proof
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from jointgap.core.plot import COLOURS, LOOK
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.contact import LAWS, delivered_restitution
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ALL, LUGRE, MOTOR, PINS, effect, mechanism, options
from tests.dynamics.ledger import bending, bodies, crank_losses, joint_powers, slider_effects
from tests.dynamics.quadrature import Motion, motion

PALETTE = [COLOURS[name] for name in ("simulation", "network", "optimised", "paper", "spline", "sky", "other")]
FOLDER = Path(__file__).resolve().parent.parent / "docs/figures"
SETS = {
    "crank pivot": ("crank_pivot",),
    "crank pin": ("crank_pin",),
    "piston pin": ("piston_pin",),
    "both pins": PINS,
    "all three": ALL,
}


def restitution(axes) -> None:
    """What each law delivers."""
    asked = np.linspace(0.05, 0.99, 95)
    for number, (name, law) in enumerate(LAWS.items()):
        delivered = [delivered_restitution(law(e)) for e in asked]
        line = {"color": "black", "linewidth": 2.0} if name == "exact_restitution" else {"linewidth": 1.2}
        axes.plot(asked, delivered, label=name.replace("_", " "), linestyle=("-", "--", "-.")[number % 3], **line)
    axes.set(xlabel="restitution asked for", ylabel="restitution delivered", xlim=(0, 1), ylim=(0, 1))
    axes.legend(fontsize=7, loc="lower right")


def energy_missing(moved: Motion) -> tuple[np.ndarray, float]:
    """Energy [J] gained at the end of each panel beyond the work done, and the largest kinetic energy."""
    made, bend = moved.made, bending(moved)
    kinetic, held = bend["kinetic"], bend["potential"] + bend["strain"]
    for mass, place, velocity, inertia, turn in bodies(moved):
        kinetic = kinetic + 0.5 * mass * (velocity**2).sum(0) + 0.5 * inertia * turn**2
        held = held - mass * (made.gravity[:, None, None] * place).sum(0)
    work = moved["crank_torque"] * moved["crank_speed"] + slider_effects(moved) * moved["slider_velocity"]
    work = work + crank_losses(moved) * moved["crank_speed"] - bend["loss"]
    for name in ALL:
        elastic, loss = joint_powers(moved, name)
        held, work = held + elastic, work - loss
    energy = kinetic + held
    return energy[:, -1] - energy[0, 0] - moved.integral(work), np.abs(kinetic).max()


def energy(axes) -> None:
    """Drift of the energy balance over half a revolution, over the largest kinetic energy."""
    bending = effect("rod_flexibility", frequency_Hz=150.0, damping_ratio=0.02)
    film = [effect("lubricated_joint", pin, viscosity_Pa_s=0.1, length_m=0.012) for pin in PINS]
    rub = {"friction": 0.1, "friction_speed": 0.1}
    cases = {
        "both pins, no friction": (mechanism(), {}),
        "both pins, friction": (mechanism(**rub), {}),
        "all three, motor": (mechanism(loose=ALL, gravity=True, **rub), {"drive": MOTOR}),
        "LuGre": (mechanism(**LUGRE), {}),
        "oil film": (mechanism(*film, **rub), {}),
        "flexible rod": (mechanism(bending, **rub), {}),
    }
    for name, (made, changed) in cases.items():
        moved = motion(made, revolutions=0.5, **changed)
        drift, scale = energy_missing(moved)
        angle = np.degrees(moved.angles[:, -1])
        axes.semilogy(angle, np.maximum(np.abs(drift) / scale, 1e-17), linewidth=1.0, label=name)
    axes.axhline(1e-8, color="black", linestyle=":", linewidth=1.2)
    axes.text(2, 1.3e-8, "bound of the tests", fontsize=7)
    axes.set(xlabel="crank angle [deg]", ylabel="energy missing / largest kinetic energy", ylim=(1e-17, 1e-6))
    axes.legend(fontsize=7, ncols=2, loc="upper right")


def order(axes) -> None:
    """Error a quarter turn on against the tolerance."""
    tolerances = 10.0 ** np.arange(-15, -7.9, 0.5)
    for name, loose in SETS.items():
        p = parameters(mechanism(loose=loose), options())
        ends = [integrate_to_angles(p, start_state(p), np.array([0, np.pi / 2]), t) for t in (1e-17, *tolerances)]
        places = np.array([np.append(end.states[-1, :4], end.auxiliary_states[-1, :2]) for end in ends])
        error = np.abs(places[1:] - places[0]).max(axis=1)
        axes.loglog(tolerances, np.maximum(error, 1e-19), marker="o", markersize=3, linewidth=1.0, label=name)
    axes.loglog(tolerances, tolerances, color="black", linestyle=":", linewidth=1.2, label="error = tolerance")
    axes.set(xlabel="tolerance [m]", ylabel="error of the clearance vectors at 90 deg [m]")
    axes.legend(fontsize=7, loc="upper left")


def limit(axes) -> None:
    """Deviation of the slider from the ideal mechanism as the clearance goes to zero, with friction, second
    revolution.
    """
    clearances, angles = 10.0 ** np.arange(-3, -6.1, -0.5), np.append(0.0, np.radians(np.arange(360, 721, 2.0)))
    ideal = parameters(mechanism(loose=()), options())
    exact = integrate_to_angles(ideal, start_state(ideal), angles, 1e-12).observed(ideal)["slider_position"]
    for name, loose in SETS.items():
        found = []
        for clearance in clearances:
            p = parameters(mechanism(loose=loose, clearance=clearance, friction=0.1, friction_speed=0.01), options())
            seen = integrate_to_angles(p, start_state(p), angles, 1e-11).observed(p)["slider_position"]
            found.append(np.abs(seen - exact)[1:].max())
        axes.loglog(clearances, found, marker="o", markersize=3, linewidth=1.0, label=name)
    axes.set(xlabel="radial clearance of each loose joint [m]", ylabel="largest deviation of the slider [m]")
    axes.legend(fontsize=7, loc="upper left")


FIGURES = {"restitution": restitution, "energy": energy, "order": order, "limit": limit}


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for name, draw in FIGURES.items():
        with plt.rc_context(LOOK):
            figure, axes = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
            axes.set_prop_cycle(color=PALETTE)
            draw(axes)
            figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)
        print(f"docs/figures/{name}.svg", flush=True)


if __name__ == "__main__":
    main()
