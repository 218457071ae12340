"""`preflight`: what a campaign will be able to show, before anything is measured."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from jointgap import tables
from jointgap.api.campaign_verdict import campaign_file
from jointgap.api.result import Result, Row
from jointgap.campaign.phrasing import label_in_words, shown_size
from jointgap.campaign.preflight import (
    in_words,
    look_alikes_table,
    preflight_tables,
    preflight_tables_with_advice,
)
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.campaign.tables_of_identification import assumed, confusable_groups, undetectable
from jointgap.config.load import load_campaign
from jointgap.figures.campaign_catalogue import CATALOGUE
from jointgap.report.plain_words import joined


@dataclass(frozen=True, repr=False)
class Preflight(Result):
    """What a planned campaign can show, made by `jointgap.preflight`.

    Attributes
    ----------
    campaign : str
        Its name.
    detectable : pandas.DataFrame
        Smallest size of every effect that these runs and channels show.
    confusability : pandas.DataFrame
        Which effects look how much alike.
    advice : pandas.DataFrame or None
        Which further speed or channel would help most; None where it was not sought.
    look_alikes : pandas.DataFrame or None
        Which joints that could have become loose look alike; None where it was not sought.
    """

    campaign: str
    detectable: pd.DataFrame
    confusability: pd.DataFrame
    advice: pd.DataFrame | None = None
    look_alikes: pd.DataFrame | None = None

    @property
    def _HEADLINE(self) -> str:
        return f"What the campaign {self.campaign} can show"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Noise that was assumed where the campaign states none."""
        return tuple(f"assumed noise: {text}" for text in assumed(self.detectable))

    @property
    def merged(self) -> list[list[str]]:
        """Groups of effects that these runs and channels cannot tell apart."""
        return confusable_groups(self.confusability)

    @property
    def text(self) -> str:
        """What was found as lines of text, as `jointgap preflight` prints it; without what was not sought."""
        empty = [
            pd.DataFrame(columns=table.names) if frame is None else frame
            for table, frame in ((tables.ADVICE, self.advice), (tables.LOOK_ALIKES, self.look_alikes))
        ]
        return in_words(self.detectable, self.confusability, *empty)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""
        return {name: CATALOGUE[name].title for name in ("detectable", "confusability")}

    def _draw(self, name: str):
        from jointgap.figures.campaign_catalogue import draw

        told = {"undetectable": undetectable(self.detectable), "merged": self.merged}
        return draw(name, {each: getattr(self, each) for each in self.figures}, {"preflight": told})

    def _rows(self) -> list[Row]:
        rows: list[Row] = [
            (
                label_in_words(row.label),
                f"shows {'' if row.falls else 'from '}"
                + shown_size(row.label, row.parameter, row.smallest_detectable, row.unit, row.falls),
                "",
            )
            for row in self.detectable[self.detectable["detectable"]].itertuples()
        ]
        rows += [(label_in_words(label), "not detectable", "") for label in undetectable(self.detectable)]
        rows += [("cannot be told apart", joined(map(label_in_words, group)), "") for group in self.merged]
        return rows


def preflight(campaign: Path | str, advice: bool = True) -> Preflight:
    """Say before anything is measured what a campaign will be able to show.

    Which effects its speeds and channels can detect, from which size on, which of them they cannot tell apart, and
    which further speed or channel would help most. Files of runs need not exist; of those that do, samples are counted.
    Nothing is written.

    Parameters
    ----------
    campaign : Path or str
        A campaign file, or a folder that holds one.
    advice : bool
        Whether further speeds and channels are tried too, and joints that could be loose are compared, which takes
        several times as long.

    Returns
    -------
    Preflight

    Raises
    ------
    InputError
        The campaign cannot be used; the message says what to do.
    SimulationError
        The model as it stands cannot be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> plan = jg.preflight("config/campaigns/demonstration.yaml", advice=False)
    >>> plan.plot("detectable").save("detectable.png")
    """
    planned = load_campaign(campaign_file(campaign))
    if not advice:
        return Preflight(planned.name, **_with_units(preflight_tables(planned, FALSE_ALARM_RATE)))
    frames = preflight_tables_with_advice(planned, FALSE_ALARM_RATE)
    return Preflight(planned.name, **_with_units(frames | {"look_alikes": look_alikes_table(planned)}))


def _with_units(frames: Mapping[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    return {name: tables.with_units(tables.TABLES[name], frame) for name, frame in frames.items()}
