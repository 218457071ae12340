"""`jointgap.analyse`, `jointgap.read_verdict` and their result."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from jointgap.app.result import Result
from jointgap.campaign import labels, verdict_json
from jointgap.campaign import sentences as say
from jointgap.campaign.campaign_files import MECHANISM, VERDICT
from jointgap.campaign.figures import FIGURES
from jointgap.config import Mechanism, load, read_yaml
from jointgap.core.errors import InputError
from jointgap.core.facts import Fact
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.words import format_name, joined, rounded_gap


@dataclass(frozen=True)
class Finding:
    """One parameter of an effect named by a verdict.

    Attributes
    ----------
    effect : str
        Label, such as ``Coulomb friction of the slider``.
    name, site : str
        In configuration files.
    parameter : str
        Of the effect.
    size : float or str
        Value in `unit`, or an identified formula.
    unit : str
        SI unit, ``"1"`` for pure numbers.
    sd : float or None
        Standard error; None if unknown.
    interval : tuple of float or None, or None
        90 % interval; an open end is None; None if unknown.
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
    """Result of a campaign, made by `jointgap.analyse` or `jointgap.read_verdict`.

    Attributes
    ----------
    folder : Path
        Contains ``verdict.json``, the identified mechanism, and all tables (`jointgap.read_table`).
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
        """``named``, ``named_with_remaining_misfit``, ``ambiguous``, ``unexplained``,
        ``no_disagreement`` or ``parameters_only``.
        """
        return self.document["verdict"]

    @property
    def sentence(self) -> str:
        return say.answer(self.document)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """The named effects, one entry per parameter."""
        findings = []
        for effect in self.document["effects"]:
            for estimate in labels.estimates([effect]):
                interval = (estimate.low, estimate.high)
                findings.append(
                    Finding(
                        effect=labels.format_effect(effect),
                        name=effect["name"],
                        site=effect["site"],
                        parameter=estimate.name,
                        size=estimate.value,
                        unit=estimate.unit,
                        sd=estimate.sd,
                        interval=interval if estimate.has_interval else None,
                    )
                )
        return tuple(findings)

    @property
    def effect(self) -> str | None:
        """Label of the first named effect (all: `findings`), or None."""
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
        """The mechanism with the named effects, to simulate or optimise."""
        return load.load_mechanism(self.folder / MECHANISM)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings about the data."""
        return tuple(ResultsFolder(self.folder).read("remarks")["remark"])

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: spec.title for name, spec in FIGURES.items()}

    def _draw(self, name: str):
        from jointgap.campaign.show import figure_tables

        frames = figure_tables(ResultsFolder(self.folder), FIGURES[name].tables)
        return FIGURES.draw(name, frames, self.document)

    @property
    def facts(self) -> list[Fact]:
        """Kind of verdict, named effects with sizes, equivalent explanations, gaps."""
        document = self.document
        facts = [Fact("verdict", format_name(self.kind))]
        for estimate in labels.estimates(document["effects"]):
            label = estimate.label
            facts.append(Fact(f"effects/{label}", estimate.text, "", label))
        for place, effects in enumerate(document["equivalent"], 1):
            words = joined(map(labels.format_effect, effects))
            facts.append(Fact(f"equivalent/{place}", words, "", f"explanation {place}"))
        proposed = document["effects"] or document["best_known"] or document["equivalent"]
        data = {"identify": "data used for fitting", "confirm": "held-out data"}
        for role, gaps in document["gap"].items():
            for when, gap in gaps.items():
                if gap is not None and (proposed or when == "before"):
                    label = f"gap on {data[role]} {when} (1: noise alone)"
                    facts.append(Fact(f"gap/{role}_{when}", rounded_gap(gap), "", label))
        return facts


def analyse(
    campaign: Path | str, folder: Path | str | None = None, anyway: bool = False
) -> Verdict:
    """Compare the measured runs of a campaign with its model, and identify the effect that the
    model lacks.

    Parameters
    ----------
    campaign : Path or str
        A campaign file (keys: config/README.md), or a folder with one.
    folder : Path or str, optional
        Output folder of all tables, the identified mechanism and ``verdict.json``; by default
        ``results/campaigns/{name of the campaign}``. Conclusions of an earlier analysis there are
        removed.
    anyway : bool
        Whether to continue if channels contradict each other, for example because two columns are
        swapped.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        The campaign or its data are invalid, channels contradict each other, or the folder is not
        writable.
    SimulationError
        The model could not be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> verdict = jg.analyse("config/campaigns/demonstration.yaml")
    >>> verdict.effect, verdict.unit
    ('Coulomb friction of the slider', 'N')
    >>> verdict.plot("gaps").save("gaps.png")
    """
    from jointgap.campaign.analyse import analyse as run

    campaign = campaign_file(campaign)
    folder = Path(folder or Path("results/campaigns") / load.load_campaign(campaign).name)
    return Verdict(folder, run(campaign, folder, anyway=anyway))


def read_verdict(folder: Path | str) -> Verdict:
    """Read the verdict of an earlier analysis, by `analyse` or by the workflow.

    Parameters
    ----------
    folder : Path or str
        Results folder of a campaign, such as ``results/campaigns/demonstration``.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        The folder has no verdict.

    Examples
    --------
    >>> import jointgap as jg
    >>> jg.read_verdict("results/campaigns/demonstration").kind
    'named'
    """
    return Verdict(Path(folder), verdict_json.read(Path(folder) / VERDICT))


def campaign_file(path: Path | str) -> Path:
    """The campaign file at `path`, or the only one in a folder.

    Raises
    ------
    InputError
        The folder contains none, or several.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(
        file
        for file in path.iterdir()
        if file.suffix in (".yaml", ".yml", ".json") and "channels" in read_yaml(file)
    )
    if len(files) != 1:
        names = ", ".join(file.name for file in files)
        what = f"several campaign files ({names})" if files else "no campaign file"
        raise InputError(f"{path}: contains {what}; give the path of one")
    return files[0]
