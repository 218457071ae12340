"""What MLflow is told of a set of blind trials: one run with every score, so that sets can be compared."""

from pathlib import Path

from jointgap import tables
from jointgap.track.run_record import Dataset, Record
from jointgap.trials.trials_report import metrics
from jointgap.trials.trials_table import TRIALS

DESCRIPTION = "Blind trials: campaigns with hidden effects, analysed without the truth at hand"

_COST = "seconds"


def records(folder: Path) -> list[Record]:
    """The set's run.

    Parameters
    ----------
    folder : Path
        Where the score lies: ``trials.parquet``, ``summary.md`` and the figures.

    Raises
    ------
    InputError
        There is no table of trials, or it cannot be read.
    """
    place = folder / "trials.parquet"
    trials = tables.read(TRIALS, place)
    scores = {_allowed(name): value for name, value in metrics(trials).items()}
    counts = {f"trials/{kind}": float(count) for kind, count in trials["kind"].value_counts().items()}
    pictures = sorted(path for path in folder.iterdir() if path.suffix in (".svg", ".png"))
    return [
        Record(
            "blind",
            metrics=counts | {name: value for name, value in scores.items() if not name.startswith(_COST)},
            costs={name: value for name, value in scores.items() if name.startswith(_COST)},
            datasets=(Dataset(TRIALS.name, place, "result"),),
            files={"summary.md": folder / "summary.md"} | {f"figures/{path.name}": path for path in pictures},
        )
    ]


def _allowed(name: str) -> str:
    """A name that MLflow takes, which knows no comma and no %; it groups what stands before a stroke."""
    return name.replace(": ", "/").replace(", ", "/").replace("%", "percent")
