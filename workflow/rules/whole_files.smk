# Files that are lost or damaged are made again, though all that was made of them is there: the rules that ask for everything
# ask for each file, and a run removes the tables whose bytes are not those that were written.

from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from jointgap.core.parquet import is_as_written


def whole(paths):
    """For input, in a function, of the rules that ask for everything: `paths`, of which a run removes the damaged tables."""
    paths = [str(path) for path in paths]
    for path in map(Path, paths):
        try:
            damaged = path.suffix == ".parquet" and path.is_file() and not is_as_written(path)
        except OSError as error:
            raise WorkflowError(f"{path}: cannot be read ({error.strerror}); check permission") from None
        if damaged:
            logger.warning(f"{path}: is damaged or from another version; it is made again")
            # no dry run, report or list of rules changes a file, and none that another run is working with
            if workflow.executor_plugin is not None and not workflow.dryrun and not workflow.touch:
                hold_run_lock()
                path.unlink()
    return paths
