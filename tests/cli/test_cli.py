"""The command line answers fast, in words, and never with a traceback for a mistake of the user's."""

import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from jointgap.cli import cli

ROOT = Path(__file__).resolve().parents[2]


def jointgap(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", "from jointgap.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        **options,
    )


def test_help_lists_every_stage_and_imports_nothing_heavy():
    code = (
        "import sys; from jointgap.cli import cli; cli(['--help'], standalone_mode=False);"
        "print('heavy:', sorted({'numpy', 'torch', 'numba', 'mlflow', 'pandas', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "heavy: []" in done.stdout
    for stage in ("simulate", "surrogate", "kinematics", "optimise", "figures", "compare", "track"):
        assert f"  {stage} " in done.stdout


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_subcommand_explains_itself_and_each_of_its_options(name):
    command = cli.commands[name]
    assert command.help
    options = [option for option in command.params if isinstance(option, click.Option)]
    assert [option.name for option in options if not option.help] == []
    assert CliRunner().invoke(cli, [name, "--help"]).exit_code == 0


def test_a_mistake_in_the_options_ends_with_one_line_and_code_two(tmp_path):
    outputs = ["--trajectory", str(tmp_path / "t.parquet"), "--events", str(tmp_path / "e.parquet")]
    done = jointgap("simulate", "--options", '{"mechanism": {"crnk": 1}}', *outputs)
    assert done.returncode == 2
    assert "unknown key 'mechanism.crnk'; did you mean 'crank'?" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
