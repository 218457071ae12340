"""Every figure of a campaign: where model and measurement disagree, what is missing, and what adding it brings.

A further figure is a function of `jointgap.campaign.figures`, and its entry here. Imports nothing heavy."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from jointgap.core.errors import InputError, did_you_mean
from jointgap.scenario.figures_catalogue import FigureSpec

if TYPE_CHECKING:
    from jointgap.core.plot import Drawing

_FIRST, _WHERE, _WHAT = "Measured and predicted", "Where", "What is missing"
_BETTER, _PLAN = "What it brings", "What could be found"

CATALOGUE = {
    "measured_against_model": FigureSpec(
        "Measured against the model",
        _FIRST,
        "campaign.figures:measured_against_model",
        ("residuals", "channel_errors"),
        "One revolution of each channel, in the unit of its column: as measured, as the model predicts it before "
        "anything was added, and after. Below each: measured less predicted, with the root mean square of the whole "
        "run in the title, and as grey band the noise, two standard deviations to each side. Held-out runs, which "
        "took no part in fitting or choosing, come first, three runs at most, and the channel that the model missed by "
        "most; numbers of all: table channel_errors. A crank angle is shown as its departure from steady rotation. "
        "Without an effect of the verdict, after is the best explanation known; where there is none, there is no "
        "after.",
        nothing="no sample could be compared with the model",
    ),
    "disagreement": FigureSpec(
        "Map of disagreement",
        _WHERE,
        "campaign.figures:disagreement",
        ("map_bins", "map_windows"),
        "Where the measurement differs from the model as it stands, its parameters re-fitted within their ranges: "
        "mean residual by channel, run and crank angle, in standard deviations of the noise; red where the "
        "measurement is above. Outlined: windows that stand out of the noise once all windows tested are counted "
        "(false-discovery rate 1 %). Where means exceed 6 the scale of colours is linear up to 1 and logarithmic "
        "beyond.",
        nothing="no sample could be compared with the model",
    ),
    "residuals": FigureSpec(
        "Residuals before and after",
        _WHERE,
        "campaign.figures:residuals",
        ("residuals",),
        "Measured less predicted, over the standard deviation of noise and numerics, by crank angle: dots are "
        "samples, lines their means over 5 deg. Before: no effect added, parameters re-fitted unless nominal ones are "
        "enough; after: with the effects of the verdict. A true model stays in the grey band for 95 % of its samples. "
        "Where residuals are large the scale is linear inside that band and logarithmic outside. Without a named "
        "effect there is no after.",
        nothing="no sample could be compared with the model",
    ),
    "ranking": FigureSpec(
        "Candidates ranked",
        _WHAT,
        "campaign.figures:ranking",
        ("ranking",),
        "Each candidate was added to the model, simulated and fitted together with all uncertain parameters. Left: "
        "how much larger its Bayesian information criterion is than that of the best (linear up to 10, logarithmic "
        "beyond); beyond 10 the evidence against it is very strong. Right: the share of the misfit beyond noise that "
        "it explains. Diamonds: named, or not to be told apart. A list always has a best member, even if the truth is "
        "not on it: what counts is whether noise alone is left. All fits, those that failed too, with the reason: "
        "table ranking.",
        nothing="no candidate was fitted: nothing is there to be explained",
    ),
    "missing_force": FigureSpec(
        "The missing force",
        _WHAT,
        "campaign.figures:missing_force",
        ("missing_force",),
        "What the named effects push the slider with, or turn the crank with, along one settled revolution of each "
        "run for fitting: over velocity, over position (crank angle for a torque), and as colour over both; the runs "
        "drawn first are wider, so that they show where others lie on them. Effects that are no force (a mass, a "
        "length, a clearance, a fault of a sensor) have none.",
        nothing="no force or torque was named, so none is shown",
    ),
    "gaps": FigureSpec(
        "Gap before and after",
        _BETTER,
        "campaign.figures:gaps",
        ("gaps",),
        "Root mean square of measured less predicted over the noise's standard deviation, by run and below it by "
        "channel, with 90 % bootstrap intervals over stretches of time; 1 is noise alone. Held-out runs took no part "
        "in fitting or choosing; what only such a run knows of itself (its speed, its first angle) was fitted to it, "
        "before and after alike.",
        nothing="no gap was taken",
    ),
    "optimum": FigureSpec(
        "Optimum before and after",
        _BETTER,
        "campaign.figures:optimum",
        ("campaign_optimum",),
        "The link lengths with the smallest error of the transmission angle, found on the model as it stood (before) "
        "and on the model with the effects of the verdict (after), with the joints' motion from the source that is "
        "named; at a bound: of the lengths that were searched. Right: the RMS error at the original lengths and at "
        "the optimal ones, the motion in the joints frozen, and by how much it falls there, and falls when simulated "
        "again. A model whose joints are all ideal has no optimum and no row.",
        nothing="nothing to optimise: no effect was added to the mechanism, or no joint of it is loose",
    ),
    "confusability": FigureSpec(
        "Effects that look alike",
        _PLAN,
        "campaign.figures:confusability",
        ("confusability",),
        "Cosine between what two effects change in the measured channels, whitened, once uncertain parameters have "
        "taken up what they can; 1: no such experiment tells them apart, whatever their sizes. Outlined: classes that "
        "count as one here. Known before anything is measured.",
        nothing="there are no candidates to compare",
    ),
    "detectable": FigureSpec(
        "Smallest detectable sizes",
        _PLAN,
        "campaign.figures:detectable",
        ("detectable",),
        "The size from which on an effect is found in nine of ten such campaigns, over the size at which simulation "
        "and measurement are 1.5 standard deviations of the noise apart once uncertain parameters are re-fitted, "
        'turned over where an effect shrinks as its value grows ("up to"); its value stands at the right. Known '
        "before anything is measured.",
        nothing="there are no candidates to detect",
    ),
}
"""Every figure of a campaign by name, with the tables it needs."""

TABLES = tuple(dict.fromkeys(table for spec in CATALOGUE.values() for table in spec.tables))
"""Names of the tables that the figures of a campaign need."""


def draw(name: str, tables: Mapping[str, pd.DataFrame | None], verdict: Mapping[str, Any]) -> "Drawing":
    """Draw one figure of a campaign."""
    if name not in CATALOGUE:
        raise InputError(f"no figure '{name}' of a campaign; {did_you_mean(name, CATALOGUE)}")
    from jointgap.campaign.figures import message_sheet
    from jointgap.core import plot

    spec = CATALOGUE[name]
    with plot.matplotlib_style():
        if any(tables.get(table) is None for table in spec.tables) or tables[spec.tables[0]].empty:
            return message_sheet(spec.title, spec.nothing)
        return spec.load()(tables, verdict)
