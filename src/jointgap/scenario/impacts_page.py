"""Interactive page of the impacts: gaps, contact forces and modes of the loose joints over the
crank angle."""

from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import Template

from jointgap.config import Scenario
from jointgap.core.errors import needs
from jointgap.core.plot import COLOURS
from jointgap.core.words import format_name
from jointgap.scenario.figure_data import MODES, contacts_of, degrees, loose_joints

MOST_POINTS = 20_000  # per curve: 0.2 MB in the page
_FIRST_LOOK = 60.0  # [deg] first view: the part with flight and impacts


def impacts_page(
    trajectory: pd.DataFrame, events: pd.DataFrame, scenario: Scenario, name: str
) -> str:
    """The page as self-contained HTML."""
    with needs("an interactive figure", "workflow"):
        from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.04, row_heights=[0.4, 0.45, 0.15]
    )
    angle, mechanism = degrees(trajectory["crank_angle"]), scenario.mechanism.applied()
    turn = angle[0] - np.degrees(trajectory["crank_angle"].iloc[0])
    joints = {joint: format_name(joint) for joint in loose_joints(scenario)}
    for joint, number in loose_joints(scenario).items():
        words = joints[joint]
        gap = 1e6 * (trajectory[f"r{number}"].to_numpy() - mechanism.clearance(joint))
        force = trajectory[f"{joint}_normal_force"].where(lambda size: size > 0.0).to_numpy()
        for row, values, unit in ((1, gap, "µm"), (2, force, "N")):
            x, y = with_extremes(angle, values, MOST_POINTS)
            figure.add_scatter(
                x=x,
                y=y,
                name=words,
                mode="lines",
                line={"color": COLOURS[words], "width": 1.2},
                hovertemplate=f"{words}<br>%{{x:.2f}} deg<br>%{{y:.4~g}} {unit}<extra></extra>",
                legendgroup=words,
                showlegend=row == 1,
                row=row,
                col=1,
            )
        _add_impacts(figure, contacts_of(events, joint), turn, words)
        _add_modes(figure, angle, trajectory[f"{joint}_mode"].to_numpy(), words)
    _lay_out(figure, angle, list(joints.values()))
    drawn = figure.to_html(
        full_html=False,
        include_plotlyjs=True,
        div_id="impacts",  # reproducible pages
        default_height="max(85vh, 600px)",
        config={
            "responsive": True,
            "displaylogo": False,
            "toImageButtonOptions": {"format": "svg"},
        },
    )
    template = Path(__file__).parent / "templates/impacts.html.j2"
    page = Template(template.read_text(encoding="utf-8"), autoescape=True)
    return page.render(title=f"{format_name(name)}: impacts in the joints", figure=drawn)


def _add_impacts(figure, contacts: pd.DataFrame, turn: float, words: str) -> None:
    """A circle at the start of each contact that has ended, at its peak force."""
    contacts = contacts[contacts["peak_force"] > 0.0].astype(float)
    details = contacts[["approach_speed", "impulse", "duration"]] * [1.0, 1.0, 1e3]
    figure.add_scatter(
        x=turn + np.degrees(contacts["crank_angle"].to_numpy()),
        y=contacts["peak_force"].to_numpy(),
        customdata=details.to_numpy(),
        mode="markers",
        marker={
            "color": COLOURS[words],
            "symbol": "circle-open",
            "size": 9,
            "line": {"width": 1.5},
        },
        hovertemplate=(
            f"{words}: contact begins<br>%{{x:.2f}} deg<br>peak force %{{y:.4~g}} N<br>approach"
            " speed %{customdata[0]:.3~g} m/s<br>impulse %{customdata[1]:.3~g} N s<br>lasts"
            " %{customdata[2]:.3~g} ms<extra></extra>"
        ),
        legendgroup=words,
        name=f"{words}: impacts",
        showlegend=bool(len(contacts)),
        row=2,
        col=1,
    )


def _add_modes(figure, angle: np.ndarray, mode: np.ndarray, words: str) -> None:
    """A bar for each interval of a mode, one curve per mode."""
    starts = np.flatnonzero(np.append(True, mode[1:] != mode[:-1]))
    ends = np.append(starts[1:], len(mode) - 1)
    for kind in MODES:
        is_kind = mode[starts] == kind
        if not is_kind.any():
            continue
        low, high = angle[starts[is_kind]], angle[ends[is_kind]]
        figure.add_scatter(
            x=np.column_stack([low, high, np.full(len(low), np.nan)]).ravel(),
            y=[words] * (3 * len(low)),
            customdata=np.column_stack([low, high]).repeat(3, axis=0),
            mode="lines",
            line={"color": COLOURS[kind], "width": 12},
            hovertemplate=(
                f"{words}: {kind}<br>%{{customdata[0]:.2f}} to %{{customdata[1]:.2f}}"
                " deg<extra></extra>"
            ),
            name=kind,
            legendgroup=kind,
            legendrank=2000,  # after the joints
            showlegend=kind not in {trace.name for trace in figure.data},
            row=3,
            col=1,
        )


def _lay_out(figure, angle: np.ndarray, joints: list[str]) -> None:
    figure.update_layout(
        template="plotly_white",
        margin={"l": 80, "r": 20, "t": 30, "b": 60},
        legend={"orientation": "h", "yanchor": "top", "y": -0.12, "x": 0.0, "traceorder": "normal"},
        hovermode="closest",
        font={"size": 13},
    )
    figure.update_xaxes(
        range=[angle[0], min(angle[-1], angle[0] + _FIRST_LOOK)], showline=True, linecolor="#222222"
    )
    figure.update_xaxes(title_text="crank angle [deg]", row=3)
    figure.update_yaxes(title_text="penetration (+), gap (−) [µm]", row=1)
    figure.update_yaxes(
        title_text="normal force [N]", type="log", exponentformat="power", dtick=1, row=2
    )
    ends = [-0.7, len(joints) - 0.3]
    figure.update_yaxes(categoryarray=joints[::-1], categoryorder="array", range=ends, row=3)


def with_extremes(x: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Reduce the points `x`, `y` (n,) of a curve to about `most`, as float32, keeping the extremes
    of every interval.

    Gaps (nan in `y`) remain where a whole interval has no value.
    """
    if len(x) > most:
        indices = [0, len(x) - 1]
        for part in np.array_split(np.arange(len(x)), most // 2):
            defined = part[np.isfinite(y[part])]
            if len(defined):
                indices += [defined[np.argmin(y[defined])], defined[np.argmax(y[defined])]]
            else:
                indices.append(part[0])
        indices = np.unique(indices)
        x, y = x[indices], y[indices]
    return x.astype(np.float32), y.astype(np.float32)
