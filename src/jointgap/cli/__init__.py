"""The command line: it parses, and calls the stages."""

import errno
import os
import sys
from typing import NoReturn

import click

from jointgap.cli import (  # each adds its subcommands
    campaign_commands,
    effect_commands,
    ensemble_commands,
    stage_commands,
    tool_commands,
    trial_commands,
)
from jointgap.cli.group import cli

__all__ = [
    "campaign_commands",
    "cli",
    "effect_commands",
    "ensemble_commands",
    "main",
    "stage_commands",
    "tool_commands",
    "trial_commands",
]


def main() -> None:
    """Run the command line; a mistake in the input ends with its message and exit code 2, not a traceback."""
    from jointgap.cli.progress_display import progress_shown
    from jointgap.errors import InputError, SimulationError

    # One thread, though Snakemake says as many as the job has: matrices are small, so that further threads cost more
    # processor time than they save, and sums in another order would change the last bits.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    try:
        with progress_shown():
            cli()
    except (InputError, SimulationError) as error:
        _end(str(error))
    except OSError as error:
        if error.errno not in _FULL:
            raise
        where = error.filename or "the log of this command, or a temporary file"
        _end(f"{where}: cannot be written ({error.strerror}); free some space, then run it again")


_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _end(message: str) -> NoReturn:
    """Show the message and end; where the log of a job has no room for it, on the terminal of the workflow."""
    text = "".join(f"jointgap: error: {line}\n" for line in message.splitlines())
    try:
        click.echo(text, err=True, nl=False)
    except OSError:
        # an open file, by its number; workflow/rules/terminal.smk
        if terminal := os.environ.get("JOINTGAP_TERMINAL"):
            os.write(int(terminal), text.encode())
    sys.exit(2)
