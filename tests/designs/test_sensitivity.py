"""Sobol indices: functions with known indices, and measures without an accurate surrogate."""

import math

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.schema import MEASURES
from jointgap.designs.dataset import DIGEST, table_of
from jointgap.designs.sampling import Designs, designs_of
from jointgap.designs.sensitivity import SensitivityResult, compute_indices
from jointgap.designs.stages import sensitivity
from tests.motion.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
EVEN = {
    "clearance": {"distribution": "log_uniform", "from": "0.1 mm", "to": "1 mm"},
    "friction": {"from": 0, "to": 0.2},
    "speed": {"from": "300 rpm", "to": "900 rpm"},
}
"""Three parameters whose quantiles `quantiles` computes."""


def designs(parameters: dict, **keys) -> Designs:
    swept = {"parameters": parameters, **keys}
    return designs_of(Scenario(mechanism=MADE, simulate=COARSE, sweep=swept))


def frame_of(drawn: Designs, measure, has_failed=None) -> pd.DataFrame:
    """Designs whose measure `stroke` is a function of the parameters."""
    frame = pd.DataFrame(drawn.values(0, drawn.number))
    failed = np.zeros(len(frame), dtype=bool) if has_failed is None else has_failed(frame)
    stroke = np.where(failed, np.nan, measure(frame))
    return frame.assign(stroke=stroke, reason=np.where(failed, "it broke", None))


def indices_of(drawn: Designs, measure, has_failed=None, seed=0) -> SensitivityResult:
    return compute_indices(drawn, frame_of(drawn, measure, has_failed), ["stroke"], seed)


def quantiles(frame: pd.DataFrame) -> np.ndarray:
    """(n, 3) in [0, 1) of the parameters `EVEN`."""
    speed = frame["speed"] * 30 / math.pi / 600 - 0.5
    return np.column_stack([np.log10(frame["clearance"] / 1e-4), frame["friction"] / 0.2, speed])


def ishigami(frame: pd.DataFrame) -> np.ndarray:
    a, b, c = (math.pi * (2 * quantiles(frame) - 1)).T
    return np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


ISHIGAMI = {"clearance": (0.3139, 0.5576), "friction": (0.4424, 0.4424), "speed": (0.0, 0.2437)}
"""First-order and total indices (Ishigami and Homma 1990)."""


def additive(frame: pd.DataFrame) -> np.ndarray:
    return quantiles(frame) @ [3.0, 2.0, 1.0]


def check_indices(result: SensitivityResult, expected: dict, within: float) -> None:
    """Indices and intervals against known pairs of first-order and total index."""
    indices = result.indices.set_index("parameter")
    assert list(indices.index) == list(expected)
    for parameter, pair in expected.items():
        row = indices.loc[parameter]
        for index, value in zip(("first_order", "total"), pair, strict=True):
            assert row[index] == pytest.approx(value, abs=within)
            assert row[f"{index}_low"] - 1e-6 <= value <= row[f"{index}_high"] + 1e-6


def test_the_indices_of_the_ishigami_function_lie_in_their_intervals():
    result = indices_of(designs(EVEN, number=512), ishigami)
    check_indices(result, ISHIGAMI, within=0.02)
    assert result.surrogates.loc[0, "q2"] > 0.98


def test_a_sum_has_the_shares_of_its_variances_for_all_distributions():
    normal = {"distribution": "normal", "deviation": "0.1 mm"}
    triangular = {"from": "0.1 mm", "peak": "0.2 mm", "to": "0.7 mm"}
    parameters = {
        "clearance": {"distribution": "triangular", **triangular},
        "crank_length": normal | {"mean": "150 mm"},
        "rod_length": normal | {"mean": "564 mm", "from": "563.9 mm"},
        "speed": {"distribution": "log_uniform", "from": "300 rpm", "to": "900 rpm"},
        "mechanism.slider.mass": [1.0, 2.0, 6.0],
        "mechanism.joints.crank_pin.journal": ["crank", "rod"],
        "friction": [0.1],
    }
    drawn = designs(parameters, number=512)
    deviations = [axis.law.std() if axis.law else np.std(axis.values) for axis in drawn.axes[:5]]
    weights = np.arange(1.0, 6.0) / deviations

    def weighted_sum(frame):
        numbers = frame.iloc[:, :5].to_numpy(dtype=float)
        return numbers @ weights + 6 * (frame.iloc[:, 5] == "rod") / 0.5

    shares = np.arange(1.0, 7.0) ** 2 / 91
    expected = {key: (share, share) for key, share in zip(parameters, shares, strict=False)}
    check_indices(indices_of(drawn, weighted_sum), expected, within=0.01)


def intervals_hold(seed: int) -> list[bool]:
    """Which intervals contain the indices of a sum with a tenth of the variance as waves of the
    speed that are too short for a surrogate."""

    def measure(frame):
        amplitude = math.sqrt(2 * 14 / 12 / 9)
        return additive(frame) + amplitude * np.sin(2 * math.pi * 997 * quantiles(frame)[:, 2])

    result = indices_of(designs(EVEN, number=256, seed=seed), measure, seed=seed)
    expected = 0.9 * np.array([9, 4, 1]) / 14 + [0, 0, 0.1]
    return [
        bool(row[f"{index}_low"] <= value <= row[f"{index}_high"])
        for row, value in zip(result.indices.to_dict("records"), expected, strict=True)
        for index in ("first_order", "total")
    ]


def test_intervals_contain_indices_that_the_surrogate_explains_in_part():
    assert all(intervals_hold(0))


@pytest.mark.slow
def test_intervals_contain_indices_in_at_least_90_percent_of_the_draws():
    held = np.array([intervals_hold(seed) for seed in range(40)])
    # 90 % of 40 less two standard deviations of that number
    assert (held.sum(axis=0) >= 32).all()


def test_failed_designs_are_excluded_and_counted():
    def corner(frame):
        return (quantiles(frame) > [0.7, 0.7, 0.3]).all(axis=1)

    result = indices_of(designs(EVEN, number=512), additive, corner)
    assert 20 < result.failed < 51
    assert result.surrogates.loc[0, "failed"] == result.failed
    expected = {
        key: (weight / 14, weight / 14) for key, weight in zip(EVEN, (9, 4, 1), strict=True)
    }
    check_indices(result, expected, within=0.01)


def noisy(frame: pd.DataFrame) -> np.ndarray:
    return additive(frame) + 3 * np.random.default_rng(1).normal(size=len(frame))


@pytest.mark.parametrize(
    "number, measure, has_failed, reason",
    [
        (
            64,
            additive,
            lambda frame: quantiles(frame)[:, 0] > 0.5,
            "undefined for 50 % of the designs (32 failed), more than 10 %",
        ),
        (32, additive, None, "32 designs with a value, fewer than 50"),
        (64, lambda frame: np.full(len(frame), 0.3), None, "equal for all designs"),
        (128, noisy, None, "less than 80 %"),
    ],
)
def test_a_measure_without_an_accurate_surrogate_has_no_index(number, measure, has_failed, reason):
    result = indices_of(designs(EVEN, number=number), measure, has_failed)
    assert result.indices.empty and reason in result.surrogates.loc[0, "reason"]


def test_parameters_with_one_value_have_no_indices():
    with pytest.raises(InputError, match="every parameter has one value"):
        indices_of(designs({"friction": [0.1]}, number=64), lambda frame: frame["friction"])


def test_the_stage_writes_page_figures_and_reproducible_tables(tmp_path):
    made = Scenario(
        mechanism=MADE,
        simulate=COARSE,
        sweep={"parameters": EVEN, "number": 64},
        sensitivity={"measures": ["stroke", "noise_share"]},
    )
    drawn = designs_of(made)
    undefined = {name: np.nan for name in MEASURES.names if name != "stroke"}
    frame = frame_of(drawn, additive).assign(design=np.arange(64), start=0, steps=1, **undefined)
    path = tmp_path / "sweep/designs/part_000000.parquet"
    parquet.write(table_of(drawn), frame, path, {DIGEST: drawn.digest})
    text, folder = sensitivity(ScenarioResults(tmp_path, made)), tmp_path / "sensitivity"
    assert "Clearance has the largest total index for 1 of 1 measures" in text
    assert "noise" not in text  # no design has it
    tables = {path: path.read_bytes() for path in folder.glob("*.parquet")}
    sensitivity(ScenarioResults(tmp_path, made))
    assert len(tables) == 3
    assert all(path.read_bytes() == content for path, content in tables.items())
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert figures == {"indices", "main_effects_stroke"}
