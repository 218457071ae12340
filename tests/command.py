"""The command line in this process: a second, where a process of its own takes several."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from subprocess import CompletedProcess
from unittest.mock import patch

from jointgap.app.cli import main


def jointgap(*words: object) -> CompletedProcess:
    """Output and exit code of a command; a traceback is an error of the test."""
    output, errors, code = io.StringIO(), io.StringIO(), 0
    command = ["jointgap", *map(str, words)]
    with redirect_stdout(output), redirect_stderr(errors), patch.object(sys, "argv", command):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return CompletedProcess(command, code, output.getvalue(), errors.getvalue())
