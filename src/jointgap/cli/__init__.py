"""The command line. Only here do stages meet files."""

import os
import sys

import click

from jointgap.cli import campaign_commands as campaign
from jointgap.cli import effect_commands as effects
from jointgap.cli import ensemble_commands as ensemble
from jointgap.cli import stage_commands as stages
from jointgap.cli import study_commands as study
from jointgap.cli import tool_commands as tools
from jointgap.cli import trial_commands as blind
from jointgap.cli.group import cli

__all__ = ["blind", "campaign", "cli", "effects", "ensemble", "main", "stages", "study", "tools"]


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
