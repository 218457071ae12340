"""Pieces of the workflow that are over in seconds, and what each leaves when nothing disturbs it."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.project import ROOT
from drills.project import digests, snakemake_command

TINY = {
    "run": ["tiny"],
    "campaigns": [],
    "scenarios": {
        "tiny": {
            "description": "Every stage with a budget that is over in seconds.",
            "simulate": {"revolutions": 2, "samples_per_revolution": 360},
            "surrogate": {
                "hidden": [4],
                "training_points": 37,
                "iterations": 20,
                "seeds": [0, 1],
                "seed_iterations": 10,
                "clearance_sampling": 20,
                "regularised_neurons": 30,
                "regularised_iterations": 20,
            },
            "optimise": {
                "genetic": {"population": 8, "generations": 2},
                "ensemble": {"members": 2, "settled_revolution": 2},
            },
            "figures": {"animation_frames": 2},
        }
    },
}
SWEPT = {
    "mechanism": "erkaya2009",
    "simulate": {"revolutions": 2, "samples_per_revolution": 360, "tolerance": "1e-8 m"},
    "sweep": {
        "number": 450,
        "designs_per_job": 100,
        "parameters": {"clearance": {"from": "0.1 mm", "to": "1 mm"}, "friction": {"from": 0, "to": 0.2}},
    },
}
"""Some seconds of simulation, so that most kills come while designs are simulated."""
_CAMPAIGN = {
    "name": "small",
    "mechanism": str(ROOT / "config/mechanisms/ideal_joints.yaml"),
    "runs": [
        {"id": "slow", "file": "slow.csv", "speed": "150 rpm", "role": "identify"},
        {"id": "fast", "file": "fast.csv", "speed": "400 rpm", "role": "confirm"},
    ],
    "channels": {
        "time": {"column": "t_ms", "unit": "ms"},
        "crank_angle": {"column": "angle_deg", "unit": "deg", "noise": 0.1},
        "crank_torque": {"column": "torque_Nm", "unit": "N*m"},
    },
}


def write_inputs(folder: Path) -> None:
    """The configurations ``tiny.json`` and ``sweeps.json``, the options ``sweep.json``, the campaign
    ``small/small.json`` and the samples of its runs.
    """
    (folder / "tiny.json").write_text(json.dumps(TINY))
    (folder / "sweep.json").write_text(json.dumps(SWEPT))
    (folder / "sweeps.json").write_text(json.dumps({"scenarios": {"swept": SWEPT}}))
    own = folder / "small"
    own.mkdir()
    (own / "small.json").write_text(json.dumps(_CAMPAIGN))
    for run in ("slow", "fast"):
        rows = list(csv.reader((ROOT / f"config/campaigns/demonstration/{run}.csv").read_text().splitlines()))
        with open(own / f"{run}.csv", "w", newline="") as file:
            csv.writer(file).writerows(rows)


@dataclass(frozen=True)
class Piece:
    """Something that is run, killed and run again.

    Attributes
    ----------
    name : str
    command : callable
        From a number of cores to a command, run in a copy of the project with `write_inputs`.
    left : callable
        From the folder to what has to be the same after any run that ends well.
    """

    name: str
    command: Callable[[int], list[str]]
    left: Callable[[Path], dict[str, str]]


def _results(folder: Path) -> dict[str, str]:
    """Digests of the results but for hidden files, which a write leaves that is killed."""
    found = digests(folder / "results") if (folder / "results").is_dir() else {}
    return {
        path: digest for path, digest in found.items() if not any(part.startswith(".") for part in Path(path).parts)
    }


def _dataset(folder: Path) -> dict[str, str]:
    """Digests of the results, and of every hidden file among the designs: other programs would read that too."""
    found = digests(folder / "results") if (folder / "results").is_dir() else {}
    return _results(folder) | {path: digest for path, digest in found.items() if Path(path).parent.name == "designs"}


def _workflow(*targets: str) -> Callable[[int], list[str]]:
    return lambda cores: snakemake_command("--configfile", "tiny.json", "--quiet", "all", "--", *targets, cores=cores)


def _campaign(*targets: str) -> Callable[[int], list[str]]:
    given = 'campaigns=["small/small.json"]'
    return lambda cores: snakemake_command("--config", given, "--quiet", "all", "--", *targets, cores=cores)


def hidden_files(folder: Path) -> list[str]:
    """Hidden files among the results: what a killed write leaves beside the file that it was to become."""
    return [
        path.name for path in (folder / "results").rglob(".*") if path.is_file() and not path.name.endswith(".lock")
    ]


def start_over(folder: Path) -> None:
    """Remove all that runs have left."""
    for name in ("results", ".snakemake"):
        shutil.rmtree(folder / name, ignore_errors=True)


NETWORK = Piece("a scenario up to a network", _workflow("results/tiny/surrogate/r2/errors.parquet"), _results)
SCENARIO = Piece(
    "a scenario up to its optimum",
    _workflow("results/tiny/optimise/optima.parquet", "results/tiny/kinematics/errors.parquet"),
    _results,
)
SCREENED = Piece("a campaign up to screening", _campaign("results/campaigns/small/screen/screened.parquet"), _results)
SWEEP = Piece(
    "a sweep",
    lambda cores: [
        *("jointgap", "sweep", "--options", "sweep.json", "--folder", "results/swept", "--workers", str(cores))
    ],
    _dataset,
)
SWEEP_OF_WORKFLOW = Piece(
    "a sweep of the workflow",
    lambda cores: snakemake_command("--configfile", "sweeps.json", "--quiet", "all", "--", "swept", cores=cores),
    _dataset,
)
CAMPAIGN = Piece("a campaign up to its verdict", _campaign("results/campaigns/small/verdict.json"), _results)
