"""From the folder of a model of your own to its verdict, figures and page."""

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.axis.data import read_runs
from jointgap.axis.model import AxisModel, build_axis_model, needed_channels
from jointgap.axis.model_file import NAME, ModelFile, load_model
from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import (
    COSTS,
    SUMMARIES,
    VERDICT,
    check_same_file,
    costs,
    failures,
    recorded_costs,
    recorded_failure,
    write_origin,
)
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.identify import explain, locate, write_detectability, write_tables
from jointgap.campaign.plan import detectability_of, preflight_summary
from jointgap.campaign.show import show
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.progress import with_progress
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.preflight import preflight
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

RESULTS = Path("results/models")
PUBLISHED = "track/published.json"


class ModelState:
    """A model of your own, its data, and its folder of results; what the stages of a campaign read
    of a `CampaignState`."""

    false_alarm_rate, seed, steps = FALSE_ALARM_RATE, 0, None
    inconsistent_channels: tuple[str, ...] = ()
    library: tuple = ()
    clockwise: frozenset[str] = frozenset()

    def __init__(
        self,
        folder: Path,
        results: Path | None = None,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.settings = settings
        self.path = folder / NAME if folder.is_dir() else folder
        self.campaign, self.kind = load_model(folder)
        self.folder = ResultsFolder(results or RESULTS / self.campaign.name)
        file: ModelFile = self.campaign
        inputs = [self.path, file.folder / file.model]
        inputs += [file.folder / run.file for run in file.runs]
        self.folder.check_apart(inputs, (VERDICT, *SUMMARIES))

    @cached_property
    def _read(self):
        return read_runs(self.campaign, needed_channels(self.campaign, self.kind))

    @property
    def remarks(self) -> list[str]:
        """Doubts about the data."""
        return self._read[1]

    @cached_property
    def model(self) -> AxisModel:
        return build_axis_model(self.campaign, self.kind, self._read[0])

    @staticmethod
    def remaining_inconsistencies(explanations: Any) -> tuple[str, ...]:
        """None: channels of a model of your own are not compared with each other."""
        return ()


def analyse_model(
    folder: Path | str,
    results: Path | str | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
    pictures: bool = True,
) -> dict[str, Any]:
    """Identify what the model in a folder lacks; return the content of ``verdict.json``.

    Parameters
    ----------
    folder : path
        With ``model.yaml``, the Python file of the class, and the data.
    results : path, optional
        Of all tables, ``verdict.json``, figures and page; default: ``results/models/NAME``.
    settings : IdentificationSettings
        Limits.
    pictures : bool
        Whether to draw figures and write the page.

    Raises
    ------
    InputError, SimulationError
        File, column or row, value and fix; or why the model cannot be simulated.
    """
    state = ModelState(Path(folder), results and Path(results), settings)
    check_same_file(state.path, state.folder.path)
    tables = CAMPAIGN_STAGES.written_by("measure", "identify")
    state.folder.check_writable(*(table.path for table in tables), VERDICT, *SUMMARIES)
    _ = state.model  # errors of the data leave the earlier results
    _remove_conclusions(state.folder)
    steps = [_measure, _identify, *([_show] if pictures else [])]
    for step in with_progress(steps, "stages of the analysis"):
        step(state)
    return verdict_json.read(state.folder.path / VERDICT)


def preflight_model(folder: Path | str) -> str:
    """What the data of a model can show, as text: smallest detectable sizes, and effects that
    cannot be distinguished. Nothing is written."""
    state = ModelState(Path(folder))
    result = preflight(state.model, None, state.false_alarm_rate, None, state.settings)
    tables = detectability_of(result)
    return preflight_summary(tables["detectable"], tables["confusability"])


def publish_model(results: Path) -> dict[str, Any]:
    """Publish verdict, fits and figures in a folder of results to MLflow; repeating it changes
    nothing."""
    from jointgap.campaign.mlflow_runs import DESCRIPTION, records
    from jointgap.core.publish import publish_records

    name = verdict_json.read(results / VERDICT)["campaign"]
    store = results.resolve().parent
    if store.name == RESULTS.name:
        store = store.parent
    summary = publish_records(name, DESCRIPTION, records(results), None, store)
    write_text(results / PUBLISHED, json.dumps(summary, indent=2) + "\n")
    return summary


def _remove_conclusions(folder: ResultsFolder) -> None:
    """Remove the results of an earlier analysis, so that an interrupted one does not show them as
    its own."""
    paths = [folder.path / name for name in (VERDICT, *SUMMARIES, COSTS)]
    paths += [folder.path / f"figures/{name}.png" for name in FIGURES]
    paths += (folder.path / "failed").glob("*.txt")
    for path in paths:
        path.unlink(missing_ok=True)


def _measure(state: ModelState) -> None:
    """Read and check the data."""
    folder = state.folder
    with recorded_costs(folder, "measure"):
        remarks = pd.DataFrame({"remark": pd.Series(state.remarks, dtype=object)})
        _ = state.model
        write_origin(state.path, folder.path)
        folder.write(schema.REMARKS, remarks)


def _identify(state: ModelState) -> None:
    """Identify what the model lacks, and write verdict and tables."""
    folder = state.folder
    with recorded_costs(folder, "identify"):
        identified, outcome = explain(state)
        write_tables(state, identified, outcome)
        write_detectability(state, identified)
        locate(state, identified, outcome)
        tables = folder.read_all(verdict_json.TABLES)
        verdict = verdict_json.document(outcome, tables, state.campaign)
        verdict["false_alarm_rate"] = state.false_alarm_rate
        verdict["cycle"] = "phase" if any(run.period for run in state.campaign.runs) else ""
        verdict["subject"] = "model"
        verdict["left_out"], verdict["failed"] = [], failures(folder)
    verdict["costs"] = costs(folder)
    write_text(folder.path / VERDICT, verdict_json.text(verdict))


def _show(state: ModelState) -> None:
    """Figures and page."""
    with recorded_failure(state.folder, "show"):
        show(state.folder, state.campaign)
