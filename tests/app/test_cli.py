"""The command line: help, errors without traceback, exit codes."""

import json
import os
import subprocess
import sys
import textwrap

import click
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

import jointgap.app.cli as app
from jointgap.app.cli import cli
from jointgap.config import EFFECTS, Mechanism, load_mechanism, read_yaml, validate
from jointgap.rig.sensors import FAULTS
from tests.command import jointgap
from tests.config.mechanisms import PAPER, PIVOT


def refusal(*words) -> str:
    """The error message of a command."""
    done = jointgap(*words)
    assert (done.returncode, done.stdout) == (2, ""), done
    (line,) = done.stderr.splitlines()
    assert line.startswith("jointgap: error: ")
    return line.removeprefix("jointgap: error: ")


def test_the_help_lists_the_stages_and_imports_nothing_heavy():
    code = (
        "import sys; from jointgap.app.cli import cli; cli(['--help'], standalone_mode=False);"
        "print('heavy:', sorted({'numpy', 'torch', 'numba', 'mlflow', 'pandas', 'pydantic'}"
        " & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "heavy: []" in done.stdout
    for stage in ("simulate", "surrogate", "kinematics", "optimise", "figures", "compare", "track"):
        assert f"  {stage} " in done.stdout


def test_linear_algebra_uses_one_thread(monkeypatch):
    libraries, numbers = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), []
    for name in libraries:
        monkeypatch.setenv(name, "8")
    monkeypatch.setattr(app, "cli", lambda: numbers.extend(os.environ[name] for name in libraries))
    jointgap()
    assert numbers == ["1", "1", "1"]


def test_every_command_is_in_one_section_and_has_help_for_each_option():
    listed = [name for names in cli.sections.values() for name in names]
    assert sorted(listed) == sorted(cli.commands)
    for name, command in cli.commands.items():
        assert command.help
        options = [option for option in command.params if isinstance(option, click.Option)]
        assert all(option.help for option in options), name
        assert jointgap(name, "--help").returncode == 0


@pytest.mark.parametrize("name, hint", app.REMOVED["commands"].items())
def test_a_removed_command_states_its_replacement(name, hint):
    done = jointgap(name)
    assert done.returncode == 2
    assert f"{name} was removed; {hint}" in " ".join(done.stderr.split())


def test_an_error_is_one_line_with_exit_code_two(tmp_path):
    command = "-m jointgap simulate --options".split()
    options = ['{"mechanism": {"crnk": 1}}', "--results", tmp_path]
    done = subprocess.run(
        [sys.executable, *command, *options], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert done.stderr.startswith("jointgap: error: ") and "Traceback" not in done.stderr
    assert "unknown key 'mechanism.crnk'; did you mean 'crank'?" in done.stderr


def test_config_prints_the_warnings_of_a_run(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("mechanism: {base: compressor, slider: {mass: 2400}}\nscenarios: {a: }\n")
    done = jointgap("config", file)
    assert json.loads(done.stdout)["mechanism"]["slider"]["mass"] == 2400
    assert done.stderr.startswith("jointgap: slider.mass:")


CRANK = "scenarios: {a: {mechanism: compressor, optimise: {constraints: {crank_length: 25}}}}"


@pytest.mark.parametrize(
    "content, words",
    [
        ("", "is empty"),
        (f"run: {'[' * 5000}{']' * 5000}", "is not YAML"),
        (CRANK, "scenario a: optimise.constraints, box own: no lengths satisfy crank_length 25000"),
    ],
)
def test_a_wrong_file_is_an_error(tmp_path, content, words):
    file = tmp_path / "mine.yaml"
    file.write_text(content)
    error = refusal("config", file)
    assert error.startswith(str(file)) and words in error


def test_wrong_options_are_an_error_before_anything_is_written(tmp_path):
    nested = f'{{"mechanism": {"[" * 20_000}{"]" * 20_000}}}'
    error = refusal("simulate", "--options", nested, "--results", tmp_path / "results")
    assert error.startswith("--options: is not JSON")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "word, name",
    {"gas_presure": "gas_pressure", "amplifier_gain": "sensor_gain"}.items(),
)
def test_an_unknown_effect_gets_a_suggestion(word, name):
    assert f"no such effect; did you mean '{name}'" in refusal("effects", word)


MECHANISM = load_mechanism(PAPER).model_dump(mode="json")
OPTIONS = {
    "mechanism": MECHANISM,
    "simulate": {"revolutions": 1, "samples_per_revolution": 1800},
    "optimise": {"ensemble": {"settled_revolution": 1}},
}


def simulate(folder, options=OPTIONS):
    return jointgap("simulate", "--options", json.dumps(options), "--results", folder)


def test_a_trajectory_of_other_options_is_an_error_in_every_stage_that_reads_it(tmp_path):
    done = simulate(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "crank_pin: you asked for a restitution of 0.46; lankarani_nikravesh" in done.stderr
    other = json.dumps(OPTIONS | {"simulate": OPTIONS["simulate"] | {"speed": 30.0}})
    commands = ["kinematics", "optimise", "compare", "surrogate --output-name r2"]
    for command in [*commands, "figures --figure orbits"]:
        error = refusal(*command.split(), "--results", tmp_path, "--options", other)
        assert "give the options it was simulated with" in error
    assert [path.name for path in tmp_path.iterdir()] == ["simulate"]
    error = refusal("track", "--options", other, "--results", tmp_path / "nowhere")
    assert "no tables to publish" in error


def test_networks_require_a_loose_joint(tmp_path):
    joints = {name: joint | {"loose": False} for name, joint in MECHANISM["joints"].items()}
    options = {"mechanism": MECHANISM | {"joints": joints}, "simulate": OPTIONS["simulate"]}
    assert simulate(tmp_path, options).returncode == 0
    command = ("surrogate", "--results", tmp_path, "--output-name", "r2")
    error = refusal(*command, "--options", json.dumps(options))
    assert "all joints are ideal" in error and "make a joint loose" in error


def test_an_output_that_cannot_be_written_is_an_error_before_the_computation(tmp_path):
    (tmp_path / "simulate").touch()
    done = simulate(tmp_path)
    assert done.returncode == 2 and "trajectory.parquet: cannot be written" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["simulate"]


def test_all_effects_and_faults_are_listed_within_a_hundred_columns():
    shown = jointgap("effects").stdout
    assert max(map(len, shown.splitlines())) <= 100
    assert all(name in shown for name in (*EFFECTS, *FAULTS))


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_shown_with_an_example_for_the_mechanism_file(name):
    shown = jointgap("effects", name).stdout
    words = " ".join(shown.split())
    assert EFFECTS[name].LAW in words and EFFECTS[name].REFERENCE in words
    example = yaml.safe_load(textwrap.dedent(shown.split("in the mechanism file:")[1]))
    paper = read_yaml(PAPER)
    joints = paper["joints"] | {"crank_pivot": PIVOT | {"journal": "crank"}}
    made = validate(Mechanism, paper | example | {"joints": joints}, "pasted")
    assert made.effects[0].name == name


@pytest.mark.parametrize("name", FAULTS)
def test_a_sensor_fault_is_shown_with_law_and_parameter(name):
    shown = jointgap("effects", name).stdout
    assert FAULTS[name].law.split()[0] in shown and FAULTS[name].parameter in shown


def test_describe_shows_units_and_descriptions_of_any_file(tmp_path, monkeypatch):
    """Also with brackets, and metadata in any encoding."""
    monkeypatch.setenv("COLUMNS", "200")
    file, link = tmp_path / "a[b].parquet", "[link=file:///etc]x[/link]"
    speed = {"unit": "[m/s]", "description": "ends [/red] here"}
    loud = {"unit": b"\xb0C", "description": link}
    fields = [
        pa.field("speed [m/s]", pa.float64(), metadata=speed),
        pa.field("[bold]loud", pa.float64(), metadata=loud),
    ]
    pq.write_table(pa.table([[1.0], [2.0]], schema=pa.schema(fields)), file)
    done = jointgap("describe", file)
    assert done.returncode == 0, done.stderr
    words = ("a[b].parquet", "speed [m/s]", "ends [/red] here", "[bold]loud", "\ufffdC", link)
    assert all(text in done.stdout for text in words)
    pq.write_table(pa.table({"speed": [1.0]}), file, store_schema=False)
    file.write_bytes(file.read_bytes().replace(b"speed", b"sp\xff\xfed"))  # not text
    assert "parquet: cannot be read as Parquet" in refusal("describe", file)


def test_ctrl_c_ends_a_command_with_its_exit_code(monkeypatch):
    def stop(**options):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.commands["effects"], "callback", stop)
    done = jointgap("effects")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "jointgap: interrupted\n")
