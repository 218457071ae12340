"""`jointgap analyse-model` as a user types it."""

import json

from click.testing import CliRunner

from jointgap.app.cli import cli
from tests.axis.folders import gear


def test_the_command_writes_verdict_page_and_figures_and_publishes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gear(tmp_path / "gear")
    result = CliRunner().invoke(cli, ["analyse-model", "gear", "--track"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "model gear" in result.output and "backlash" in result.output
    folder = tmp_path / "results/models/gear"
    assert json.loads((folder / "verdict.json").read_text())["verdict"] == "named"
    assert (folder / "summary.html").is_file() and (folder / "figures/gaps.png").is_file()
    assert (folder / "track/published.json").is_file()


def test_preflight_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gear(tmp_path / "gear")
    arguments = ["analyse-model", "gear", "--preflight"]
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert "Smallest detectable size" in result.output and "backlash" in result.output
    assert not (tmp_path / "results").exists()


def test_a_folder_without_a_model_is_an_error_of_one_line(tmp_path):
    result = CliRunner().invoke(cli, ["analyse-model", str(tmp_path)])
    assert result.exit_code != 0
    assert "model.yaml" in str(result.exception or result.output)
