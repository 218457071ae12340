"""What failed of that which only adds to a verdict: noted in a file, told with the verdict, which it does not cost."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from jointgap.errors import InputError, SimulationError
from jointgap.tables import write_text
from jointgap.tables.results_folder import ResultsFolder

_FOLDER = "failed"


@contextmanager
def noted(folder: ResultsFolder, what: str) -> Iterator[None]:
    """Around what only adds to a verdict: an error is noted in the results `folder` as `what`, and the rest goes on."""
    place = folder.path / _FOLDER / f"{what}.txt"
    place.unlink(missing_ok=True)
    try:
        yield
    except OSError:  # a full disk is not this one's fault
        raise
    except Exception as error:
        kind = "" if isinstance(error, InputError | SimulationError) else f"{type(error).__name__}: "
        write_text(place, f"{kind}{' '.join(str(error).split())}\n\n{traceback.format_exc()}")


def failures(folder: ResultsFolder) -> dict[str, str]:
    """Why something failed that only adds to the verdict, in a line, by its name."""
    places = sorted((folder.path / _FOLDER).glob("*.txt"))
    return {place.stem: place.read_text(encoding="utf-8").partition("\n")[0] for place in places}
