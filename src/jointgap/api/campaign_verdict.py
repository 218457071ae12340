"""`analyse`: from measured runs and a model to what is missing in the model."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from jointgap.api.result import Result, Row
from jointgap.campaign import verdict as documents
from jointgap.campaign.campaign_files import MECHANISM, VERDICT
from jointgap.campaign.phrasing import effect_in_words, parameter_rows, sure_value, unit_of
from jointgap.campaign.verdict_sentences import answer
from jointgap.config import Mechanism, load_mechanism, read_yaml
from jointgap.config.load import load_campaign
from jointgap.errors import InputError
from jointgap.figures.campaign_catalogue import CATALOGUE
from jointgap.report.plain_words import in_words, joined, rounded_gap
from jointgap.tables.results_folder import ResultsFolder

_ENDINGS = (".yaml", ".yml", ".json")


@dataclass(frozen=True)
class Finding:
    """One parameter of one effect that a verdict names.

    Attributes
    ----------
    effect : str
        In words: ``Coulomb friction of the slider``.
    name, site : str
        Of the effect in configurations.
    parameter : str
        Of the effect.
    size : float or str
        Its value in `unit`; a formula where that is what was found.
    unit : str
        SI unit, ``"1"`` for pure numbers.
    sd : float or None
        Standard error; None where it is not known.
    interval : tuple of float or None, or None
        90 % interval; an end is None where it is open, and all of it where it is not known.
    """

    effect: str
    name: str
    site: str
    parameter: str
    size: float | str
    unit: str
    sd: float | None
    interval: tuple[float | None, float | None] | None


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """What a campaign comes to, made by `jointgap.analyse` or `jointgap.read_verdict`.

    Attributes
    ----------
    folder : Path
        Holds ``verdict.json``, the mechanism with what was found, and all tables (`jointgap.read_table`).
    document : dict
        Content of ``verdict.json``.
    """

    folder: Path
    document: dict[str, Any]

    @property
    def _HEADLINE(self) -> str:
        return f"Campaign {self.document['campaign']}: {self.sentence}"

    @property
    def kind(self) -> str:
        """``named``, ``named_with_remaining_misfit``, ``ambiguous``, ``unexplained``, ``no_disagreement`` or
        ``parameters_only``.
        """
        return self.document["verdict"]

    @property
    def sentence(self) -> str:
        """The verdict in a sentence or two."""
        return answer(self.document)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What is named, one entry a parameter; empty where nothing is."""
        return tuple(
            Finding(
                effect=effect_in_words(effect),
                name=effect["name"],
                site=effect["site"],
                parameter=parameter,
                size=estimate["value"],
                unit=unit_of(effect["name"], effect["site"], parameter),
                sd=estimate.get("sd"),
                interval=tuple(estimate["interval_90"]) if estimate.get("interval_90") else None,
            )
            for effect in self.document["effects"]
            for parameter, estimate in effect["parameters"].items()
        )

    @property
    def effect(self) -> str | None:
        """The effect that is named, in words; of several the first, see `findings`. None where none is."""
        return self.findings[0].effect if self.findings else None

    @property
    def size(self) -> float | str | None:
        """The first parameter of `effect`, in `unit`."""
        return self.findings[0].size if self.findings else None

    @property
    def unit(self) -> str | None:
        """SI unit of `size`."""
        return self.findings[0].unit if self.findings else None

    @property
    def interval(self) -> tuple[float | None, float | None] | None:
        """90 % interval of `size`."""
        return self.findings[0].interval if self.findings else None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism with what was found, to simulate or optimise with."""
        return load_mechanism(self.folder / MECHANISM)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the data made worth saying, before anything was concluded from them."""
        return tuple(self._tables.read("remarks")["remark"])

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""
        return {name: spec.title for name, spec in CATALOGUE.items()}

    def _draw(self, name: str):
        from jointgap.campaign.conclude import figure_tables
        from jointgap.figures.campaign_catalogue import draw

        return draw(name, figure_tables(self._tables, CATALOGUE[name].tables), self.document)

    @cached_property
    def _tables(self) -> ResultsFolder:
        return ResultsFolder(self.folder)

    def _rows(self) -> list[Row]:
        rows: list[Row] = [("verdict", in_words(self.kind), "")]
        rows += [(name, sure_value(*row), "") for name, *row in parameter_rows(self.document["effects"])]
        rows += [
            (f"explanation {place}", joined(map(effect_in_words, effects)), "")
            for place, effects in enumerate(self.document["equivalent"], 1)
        ]
        words = {"identify": "data used for fitting", "confirm": "held-out data"}
        for role, gap in self.document["gap"].items():
            for when, value in gap.items():
                if value is not None:
                    rows.append((f"gap on {words[role]} {when} (1: noise alone)", rounded_gap(value), ""))
        return rows


def analyse(campaign: Path | str, folder: Path | str | None = None, anyway: bool = False) -> Verdict:
    """Find where the measured runs of a campaign disagree with its model, and what is missing in the model.

    Parameters
    ----------
    campaign : Path or str
        A campaign file (docs/naming.md has its keys), or a folder that holds one.
    folder : Path or str, optional
        Where all tables, the mechanism with what was found and ``verdict.json`` are written;
        ``results/campaigns/{name of the campaign}`` by default. What an earlier analysis concluded there is removed.
    anyway : bool
        Whether to go on where channels contradict each other, such as two columns that are swapped.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        Campaign or data cannot be used, channels contradict each other, or the folder cannot be written; the message
        says what to do.
    SimulationError
        The model as it stands cannot be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> verdict = jg.analyse("config/campaigns/demonstration.yaml")
    >>> verdict.effect, verdict.unit
    ('Coulomb friction of the slider', 'N')
    >>> verdict.plot("gaps").save("gaps.png")
    """
    from jointgap.stages.campaign_pipeline import analyse as run

    campaign = campaign_file(campaign)
    folder = Path(folder or Path("results/campaigns") / load_campaign(campaign).name)
    return Verdict(folder, run(campaign, folder, anyway=anyway))


def read_verdict(folder: Path | str) -> Verdict:
    """The verdict of an analysis that has been made, by `analyse` or by the workflow.

    Parameters
    ----------
    folder : Path or str
        Results of a campaign, such as ``results/campaigns/demonstration``.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        No verdict is there.

    Examples
    --------
    >>> import jointgap as jg
    >>> jg.read_verdict("results/campaigns/demonstration").kind
    'named'
    """
    return Verdict(Path(folder), documents.read(Path(folder) / VERDICT))


def campaign_file(path: Path | str) -> Path:
    """The campaign file at a `path`, or the only one in a folder.

    Raises
    ------
    InputError
        The folder holds none, or several.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(file for file in path.iterdir() if file.suffix in _ENDINGS and "channels" in read_yaml(file))
    if len(files) != 1:
        names = ", ".join(file.name for file in files)
        what = f"holds several campaign files ({names}); name one" if files else "holds no campaign file; name one"
        raise InputError(f"{path}: {what}")
    return files[0]
