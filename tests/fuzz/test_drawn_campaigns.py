"""Random campaigns reach a verdict or are refused before the search."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.campaign.analyse import analyse
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.progress import progress_listener
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.command import jointgap
from tests.fuzz.drawn_campaign import draw_campaign

pytestmark = pytest.mark.slow

COUNT = 40
SECONDS = 15.0  # CPU time of a command; the draw of a slower one is undecided
SCHEMA = json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
SELECTION = {"max_singles": 3, "partners": 1, "linearised_partners": 3}
SELECTION |= {"max_simulations": 200, "max_simulations_of_statistics": 60}
SHORT = replace(
    DEFAULT_SETTINGS,
    selection=replace(DEFAULT_SETTINGS.selection, **SELECTION),
    stopping=replace(DEFAULT_SETTINGS.stopping, max_steps=8),
)


class OutOfTime(BaseException):
    """No `Exception`, which the analysis would note."""


def limited(command: Callable[[], Any]) -> Any:
    """Result of a command; None if it exceeds the time limit."""
    end = time.process_time() + SECONDS

    def stop(*_):
        if time.process_time() > end:
            raise OutOfTime

    try:
        with progress_listener(stop):
            return command()
    except OutOfTime:
        return None


@pytest.mark.parametrize("seed", range(COUNT))
def test_a_random_campaign_has_a_verdict_or_is_refused_early(seed, tmp_path):
    folder = tmp_path / "results"
    try:
        path = limited(lambda: draw_campaign(np.random.default_rng(seed), tmp_path))
    except SimulationError:  # a motor that stalls, a journal that whirls
        path = None
    if path is None:
        return
    for command in (("measure", path, "--folder", tmp_path / "measure"), ("preflight", path)):
        done = limited(lambda command=command: jointgap(*command))
        assert done is None or done.returncode in (0, 2)
        assert done is None or (done.returncode == 2) == ("jointgap: error: " in done.stderr)
    try:
        verdict = limited(lambda: analyse(path, folder, SHORT, anyway=True))
    except (InputError, SimulationError):
        assert not (folder / "identify").exists()
        return
    if verdict is not None:
        assert verdict.get("failed", {}) == {}
        validate(json.loads((folder / "verdict.json").read_text(encoding="utf-8")), SCHEMA)
