"""Networks that know the design in plain words: how well they know it, and what they cost."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.page import FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.core.words import reading_unit, unit_in_words
from jointgap.design_networks.design_networks import DesignNetworksResult
from jointgap.design_networks.held_out_errors import ERROR
from jointgap.design_networks.networks_figures import CAPTION, MDEG, NAME, TITLE
from jointgap.design_networks.settings import SETTINGS
from jointgap.designs.page import parameter_in_words
from jointgap.designs.robust import law_in_words

_LEVEL = 1.1  # errors whose ratio is smaller are called level: another draw of designs would change it as much
_FACTOR = {"m": ("µm", 1e6), "rad": ("mdeg", MDEG)}


def page(found: DesignNetworksResult, scenario: Scenario, name: str) -> Page:
    """The page of networks that know the design."""
    blocks = (
        Paragraph(verdict(found), strong=True),
        Heading("Errors on held-out designs"),
        Paragraph(
            f"On {found.errors['design'].nunique()} designs that took no part in the training, each simulated with its "
            "own lengths. Beside the network stands what the paper's frozen motion gives: the motion in the joints is "
            "simulated with the original lengths, everything else being that of the design."
        ),
        _errors(found.errors),
        FigureBlock(NAME, TITLE, CAPTION),
        Heading("What it cost"),
        _costs(found.costs),
        Heading("What it knows"),
        axes_table(found.space.axes),
        Paragraph(_how(found, scenario)),
    )
    return Page(headline(found), blocks, subject=f"{name}: networks that know the design", footer=written_today())


def headline(found: DesignNetworksResult) -> str:
    """What came out, in a line."""
    network, frozen = _of_the_error(found.errors)
    return (
        f"The network knows the error of the transmission angle to {network:.2g} mdeg, the frozen motion to "
        f"{frozen:.2g} mdeg"
    )


def verdict(found: DesignNetworksResult) -> str:
    """What came out, in plain sentences."""
    network, frozen = _of_the_error(found.errors)
    rows = found.errors[found.errors["output"] == ERROR]
    wins = float((rows["network"].abs() < rows["frozen"].abs()).mean())
    cost = found.costs.set_index("step")["cpu_time"]
    nearer = f"{'The network' if network < frozen else 'The frozen motion'} is the nearer one to the simulation"
    if max(network, frozen) <= _LEVEL * min(network, frozen):
        nearer = "Network and frozen motion are about as near to the simulation"
    return (
        f"{nearer}: of the RMS error of the transmission angle, which is what "
        f"lengths are judged by, the network misses {network:.2g} mdeg and the frozen motion {frozen:.2g} mdeg (RMS "
        f"over held-out designs; the error itself is {MDEG * rows['simulated'].median():.3g} mdeg in the median). In "
        f"{100 * wins:.0f} % of the designs the network is nearer. It cost {cost['simulate']:.3g} CPU-seconds of "
        f"simulations and {cost['train']:.3g} of training; the frozen motion costs one simulation for each design."
    )


def _of_the_error(errors: pd.DataFrame) -> tuple[float, float]:
    """RMS over the designs of what network and frozen motion miss of the RMS error [mdeg]."""
    rows = errors[errors["output"] == ERROR]
    network, frozen = (float(MDEG * np.sqrt(np.mean(rows[way] ** 2))) for way in ("network", "frozen"))
    return network, frozen


def _errors(errors: pd.DataFrame) -> TableBlock:
    rows = []
    for output in dict.fromkeys(errors["output"]):
        of = errors[errors["output"] == output]
        unit, factor = _FACTOR[of["unit"].iloc[0]]
        sizes = [factor * np.sqrt(np.mean(of[way] ** 2)) for way in ("simulated", "network", "frozen")]
        rows.append((output, unit, *(f"{float(f'{size:.3g}'):,g}" for size in sizes)))
    heads = ("output", "unit", "itself", "network misses", "frozen motion misses")
    return TableBlock(heads, tuple(rows), "llrrr", caption="RMS over held-out designs and crank angles")


def _costs(costs: pd.DataFrame) -> TableBlock:
    rows = tuple((row.step, str(row.designs), str(row.failed), f"{row.cpu_time:.3g}") for row in costs.itertuples())
    return TableBlock(("step", "designs", "failed", "CPU-seconds"), rows, "lrrr")


def axes_table(axes: tuple) -> TableBlock:
    """What varies, its unit and how it is distributed."""
    rows = []
    for axis in axes:
        unit, factor = reading_unit(axis.unit or "1")
        words = "" if unit == "1" else unit_in_words(unit)
        rows.append((parameter_in_words(axis.key), words, law_in_words(axis, factor)))
    return TableBlock(("what", "unit", "distribution"), tuple(rows), "lll")


def _how(found: DesignNetworksResult, scenario: Scenario) -> str:
    options = scenario.design_networks
    weights = sum(layer.size for layer in found.trained.network.layers)
    return (
        f"One network of {weights} weights: layers of {' and '.join(map(str, options.hidden))} tansig neurons take the "
        f"design, and the output layer weighs {SETTINGS.harmonics} harmonics of the crank angle for x and y of each "
        f"loose joint. Trained on revolution {scenario.optimise.ensemble.settled_revolution} of designs from a "
        f"scrambled Sobol sequence (seed {options.seed}) by {found.trained.steps} steps of L-BFGS on one thread. The "
        "weights are in `weights.parquet`, all numbers in `errors.parquet`, `costs.parquet` and `training.parquet` "
        "beside this page."
    )
