"""`jointgap.preflight` and its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from jointgap.app.result import Result
from jointgap.app.verdict import campaign_file
from jointgap.campaign import labels, plan
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.config import load
from jointgap.core import schema
from jointgap.core.facts import Fact
from jointgap.core.parquet import with_units
from jointgap.core.words import joined


@dataclass(frozen=True, repr=False)
class Preflight(Result):
    """Identifiability of a planned campaign, made by `jointgap.preflight`.

    Attributes
    ----------
    campaign : str
        Its name.
    detectable : pandas.DataFrame
        Smallest detectable size of every effect, with these runs and channels.
    confusability : pandas.DataFrame
        Similarity of the effects.
    advice : pandas.DataFrame or None
        Most useful further speed or channel; None if not requested.
    """

    campaign: str
    detectable: pd.DataFrame
    confusability: pd.DataFrame
    advice: pd.DataFrame | None = None

    @property
    def _HEADLINE(self) -> str:
        return f"Identifiability of the campaign {self.campaign}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Assumed noise, where the campaign states none."""
        texts = map(labels.names_to_labels, plan.assumed(self.detectable))
        return tuple(f"assumed noise: {text}" for text in texts)

    @property
    def merged(self) -> list[list[str]]:
        """Groups of effects that these runs and channels cannot distinguish."""
        return plan.confusable_groups(self.confusability)

    @property
    def text(self) -> str:
        """The report of `jointgap preflight`."""
        return plan.preflight_summary(self.detectable, self.confusability, self.advice)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {"detectable": FIGURES["detectable"].title}

    def _draw(self, name: str):
        return FIGURES.draw(name, {name: self.detectable}, {})

    @property
    def facts(self) -> list[Fact]:
        """Smallest detectable sizes, undetectable effects, effects that cannot be distinguished."""
        facts = []
        for row in self.detectable[self.detectable["detectable"]].itertuples():
            size = ("shows " if row.falls else "shows from ") + labels.format_detectable(row)
            facts.append(Fact(f"detectable/{row.label}", size, "", labels.format_label(row.label)))
        for label in plan.undetectable(self.detectable):
            name = f"detectable/{label}"
            facts.append(Fact(name, "not detectable", "", labels.format_label(label)))
        for number, group in enumerate(self.merged, 1):
            words = joined(map(labels.format_label, group))
            facts.append(Fact(f"confusable/{number}", words, "", "cannot be distinguished"))
        return facts


def preflight(campaign: Path | str, advice: bool = True) -> Preflight:
    """Analyse the identifiability of a planned campaign.

    The result contains the smallest detectable size of every effect, the effects that cannot be
    distinguished, and the most useful further speed or channel. Files of runs may be missing;
    existing ones give the number of samples. Nothing is written.

    Parameters
    ----------
    campaign : Path or str
        A campaign file, or a folder with one.
    advice : bool
        Whether to try further speeds and channels, which takes several times as long.

    Returns
    -------
    Preflight

    Raises
    ------
    InputError
        The campaign is invalid.
    SimulationError
        The model could not be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> plan = jg.preflight("config/campaigns/demonstration.yaml", advice=False)
    >>> plan.plot("detectable").save("detectable.png")
    """
    loaded = load.load_campaign(campaign_file(campaign))
    tables = plan.preflight_tables(loaded, FALSE_ALARM_RATE, advice=advice)
    with_their_units = {
        name: with_units(schema.TABLES[name], table) for name, table in tables.items()
    }
    return Preflight(loaded.name, **with_their_units)
