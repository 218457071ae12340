"""How MLflow's pages show the runs of a stage: a description of the experiment, and a view with columns and charts.

MLflow keeps a view that is shared as a tag of the experiment, ``mlflow.sharedViewState.KEY``, and shows it where the
address says ``viewStateShareKey=KEY``. Its value is the state of the page as JSON, or that deflated: a tag has room for
5000 characters.
"""

import base64
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from jointgap.core.joints import JOINT_NUMBERS
from jointgap.tables import outputs
from jointgap.tables.sweep_tables import MEASURES
from jointgap.track.metric_names import name_and_factor
from jointgap.track.optimise_runs import ENDS, STRETCHES

KEY = "comparison"
"""Of the view in addresses; the same in every experiment."""

TAG, NOTE = f"mlflow.sharedViewState.{KEY}", "mlflow.note.content"

MOST_RUNS = 500  # that a chart shows
_STAGES_OWN = "tags.`jointgap.output` = ''"  # not those nested in it
_PER_SIGN, _LEAST = 8, 160  # [px] of a column's width

_SCENARIO = ("loose", "clearance_mm", "restitution", "friction", "drive", "speed_rpm")


@dataclass(frozen=True)
class Section:
    """Charts under one heading; each is titled by its metric, whose name ends with the unit."""

    heading: str
    metrics: Sequence[str]  # Numbers become bars, curves lines over the iterations on a logarithmic axis
    curves: bool = False  # Whether the metrics are curves
    columns: int = 3  # Charts side by side


@dataclass(frozen=True)
class View:
    """How an experiment is shown."""

    note: str  # What its runs are, in Markdown
    columns: Sequence[str] = ()  # Of the table of runs: ``params.NAME``, ``metrics.NAME`` or ``tags.NAME``
    sections: Sequence[Section] = ()
    parallel: tuple[Sequence[str], Sequence[str]] = ((), ())
    opened: Sequence[str] = ()  # Further sections of metrics, by what stands before the slash
    closed: Sequence[str] = ()  # Further sections of metrics, by what stands before the slash

    def state(self) -> str:
        """The value of the tag."""
        charts, sections = [], []
        for place, section in enumerate(self.sections):
            sections.append(_section(f"section-{place}", section.heading, True, section.columns))
            charts += [
                _chart(f"chart-{place}-{number}", f"section-{place}", metric, section.curves)
                for number, metric in enumerate(section.metrics)
            ]
        if any(self.parallel):
            sections.append(_section("section-parallel", "All at once", True, 1))
            charts.append(_parallel("chart-parallel", "section-parallel", *self.parallel))
        sections += [_section(f"opened-{name}", name, True, 2) for name in self.opened]
        sections += [_section(f"closed-{name}", name, False, 3) for name in self.closed]
        columns = [_column(name) for name in self.columns]
        state: dict[str, Any] = {
            "searchFilter": _STAGES_OWN,
            "orderByKey": "attributes.start_time",
            "orderByAsc": True,
            "startTime": "ALL",
            "lifecycleFilter": "Active",
            "modelVersionFilter": "All Runs",
            "datasetsFilter": [],
            "selectedColumns": columns,
            "columnOrder": columns,
            "columnWidths": {_column(name): max(_PER_SIGN * len(name), _LEAST) for name in self.columns},
            "runsExpanded": {},
            "runsPinned": [],
            "runsHidden": [],
            "runsVisibilityMap": {},
            "runsHiddenMode": "SHOW_ALL",
            "compareRunCharts": charts,
            "compareRunSections": sections,
            "viewMaximized": False,
            "runListHidden": False,
            "isAccordionReordered": True,
            "groupBy": None,
            "groupsExpanded": {},
            "autoRefreshEnabled": True,
            "useGroupedValuesInCharts": False,
            "hideEmptyCharts": True,
            "globalLineChartConfig": {"xAxisKey": "step", "lineSmoothness": 0, "selectedXAxisMetricKey": ""},
            "chartsSearchFilter": "",
        }
        packed = zlib.compress(json.dumps(state, separators=(",", ":")).encode(), 9)
        return f"deflate;{base64.b64encode(packed).decode()}"


def _column(name: str) -> str:
    kind, _, key = name.partition(".")
    return f"{kind}.`{key}`"


def _section(uuid: str, name: str, is_open: bool, columns: int) -> dict[str, Any]:
    shown = {"uuid": uuid, "name": name, "display": is_open, "columns": columns}
    return shown | {"isReordered": True, "deleted": False, "isGenerated": False}


def _card(uuid: str, section: str, kind: str) -> dict[str, Any]:
    card = {"uuid": uuid, "type": kind, "runsCountToCompare": MOST_RUNS, "metricSectionId": section}
    return card | {"deleted": False, "isGenerated": False}


def _chart(uuid: str, section: str, metric: str, curve: bool) -> dict[str, Any]:
    if not curve:
        return _card(uuid, section, "BAR") | {"metricKey": metric}
    return _card(uuid, section, "LINE") | {
        "metricKey": metric,
        "selectedMetricKeys": [metric],
        "lineSmoothness": 0,
        "xAxisScaleType": "log",
        "scaleType": "linear",
        "range": {},
        "xAxisKey": "step",
        "selectedXAxisMetricKey": "",
        "displayPoints": False,
        "yAxisKey": "metric",
        "yAxisExpressions": [],
        "ignoreOutliers": False,
        "useGlobalXaxisKey": False,
        "useGlobalLineSmoothing": True,
    }


def _parallel(uuid: str, section: str, params: Sequence[str], metrics: Sequence[str]) -> dict[str, Any]:
    shown = {"selectedParams": list(params), "selectedMetrics": list(metrics), "showAllRuns": True}
    return _card(uuid, section, "PARALLEL") | shown


_GAINS = tuple(f"gain_{stretch}{end}_percent" for end in ENDS for stretch in STRETCHES.values())
_GAPS = tuple(f"gap/{role}_{when}" for role in ("identify", "confirm") for when in ("before", "after"))

_ROBUST = ("original", "frozen", "nominal", "robust")

VIEWS = {
    "simulate": View(
        "The simulated contact of each scenario: impacts, forces and shares of time in contact. "
        "The whole configuration is the artifact `options.json` of each run.",
        columns=(*(f"params.{name}" for name in _SCENARIO), "metrics.smallest_transmission_angle_deg"),
        sections=(
            Section(
                "Peaks",
                (
                    *(f"{joint}_peak_normal_force_N" for joint in JOINT_NUMBERS),
                    "peak_crank_torque_N_m",
                    "peak_slider_acceleration_m_s2",
                    "smallest_transmission_angle_deg",
                ),
            ),
        ),
    ),
    "surrogate": View(
        "The networks of each scenario, trained by Levenberg-Marquardt. A scenario's run has the curves of all its "
        "outputs; under it stands a run for each output. MSE: mean square error at the training points, on data scaled "
        "to [0, 1].",
        columns=(
            *(f"params.{name}" for name in _SCENARIO),
            "metrics.network_outputs_training_at_paper",
            "metrics.network_outputs_held_out_at_paper",
            "metrics.network_outputs_of_the_paper",
        ),
        sections=(
            Section(
                "Training error by iteration, log10 of the MSE",
                tuple(f"log10_mse/{name}" for name in outputs(JOINT_NUMBERS)),
                curves=True,
            ),
        ),
    ),
    "optimise": View(
        "The link lengths that each scenario's optimum comes to, as differences from the original ones, and the gain: "
        "the reduction of the RMS error of the transmission angle, simulated again as an ensemble (median, 5 % and 95 "
        "% quantile), over the window and over a whole settled revolution. A scenario's run shows the genetic "
        "algorithm on the networks; under it stand all other optima.",
        columns=(
            "metrics.crank_length_change_um",
            "metrics.rod_length_change_um",
            *(f"metrics.{name}" for name in _GAINS),
            "params.loose",
            "params.friction",
            "params.window_deg",
        ),
        sections=(
            Section("Optimum against original lengths", ("crank_length_change_um", "rod_length_change_um"), columns=2),
            Section("Gain: median, 5 % and 95 % quantile", _GAINS, columns=2),
        ),
        parallel=(
            ("loose", "friction", "clearance_mm", "speed_rpm"),
            ("crank_length_change_um", "gain_window_percent", "gain_revolution_percent"),
        ),
        closed=("frozen", "resimulated_window", "resimulated_settled", "ideal_cycle", "simulated_cycle"),
    ),
    "sweep": View(
        "What scenarios ask of many designs: all designs of a scenario are one run, with its datasets. Of each measure "
        "of a sweep mean, standard deviation and quantiles over the designs that did not fail. Where the scenario asks "
        "for them: Sobol indices (`first_order`, `total`) with the held-out quality `q2` of the surrogate that they "
        "come from; for which designs the paper's printed numbers come out; robust lengths beside the original and the "
        "nominal ones on fresh draws; networks beside the frozen motion; searches at equal CPU time. Pages and figures "
        "are artifacts.",
        columns=(
            *("metrics.designs", "metrics.failed_percent"),
            *("metrics.angle_error_rms_mdeg/mean", "metrics.angle_error_rms_mdeg/deviation"),
            "metrics.printed/together_percent",
            *("metrics.robust/crank_length_mm", "metrics.robust/rod_length_mm"),
            "metrics.robust beside original/probability_percent",
            *("metrics.network misses/RMS_error_mdeg", "metrics.frozen motion misses/RMS_error_mdeg"),
        ),
        sections=(
            Section(
                "Error of the transmission angle over the designs [mdeg]",
                tuple(f"angle_error_rms_mdeg/{size}" for size in ("mean", "deviation", "quantile_95")),
            ),
            Section(
                "Robust lengths beside the original ones",
                ("robust beside original/probability_percent", "robust beside original/mean_fall_percent"),
                columns=2,
            ),
        ),
        opened=("printed", "gain_percent", "network misses", "frozen motion misses"),
        closed=(
            *(name_and_factor(column)[0] for column in MEASURES),
            *("first_order", "total", "q2", "gain_percent_low", "gain_percent_high", *_ROBUST),
            *(f"{one} beside {other}" for one, other in combinations(reversed(_ROBUST), 2)),
        ),
    ),
    "campaign": View(
        "What measured campaigns find missing in the model. Gap: residual in standard deviations of the noise (root "
        "mean square), before and after what was named is added; 1 is noise alone. Under each run stands one for every "
        "explanation that was fitted.",
        columns=(
            "tags.jointgap.verdict",
            "tags.jointgap.effects",
            *(f"metrics.{name}" for name in _GAPS),
        ),
        sections=(Section("Gap between simulation and measurement", _GAPS, columns=2),),
    ),
    "kinematics": View("How far the motion that networks give is from the simulated one, as a share of its range."),
    "compare": View("The paper's numbers and claims beside ours: counts of verdicts; the page is an artifact."),
    "figures": View("The figures of each scenario, as artifacts of its run."),
    "blind": View("How often the verdict is right, on campaigns with hidden effects: a run for each set of trials."),
}
"""By stage."""
