"""The command line: it parses, and calls the stages."""

import os
import sys

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
    from jointgap.errors import InputError, SimulationError

    # One thread: the matrices are small, jobs run side by side, and sums in another order would change the last bits.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        cli()
    except (InputError, SimulationError) as error:
        for line in str(error).splitlines():
            click.echo(f"jointgap: error: {line}", err=True)
        sys.exit(2)
