"""The command line answers fast, in words, and never with a traceback for a mistake of the
user's."""

import json
import os
import subprocess
import sys
import textwrap

import click
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

import jointgap.app.cli as app
from jointgap.app.cli import cli
from jointgap.config import EFFECTS, Mechanism, load_mechanism, read_yaml, validate
from jointgap.rig.sensors import FAULTS
from tests.catalogue import each
from tests.command import jointgap
from tests.config.mechanisms import PAPER, PIVOT


def refusal(*words) -> str:
    """The only line that a command ends with where it is refused."""
    done = jointgap(*words)
    assert (done.returncode, done.stdout) == (2, ""), done
    (line,) = done.stderr.splitlines()
    assert line.startswith("jointgap: error: ")
    return line.removeprefix("jointgap: error: ")


def test_help_lists_every_stage_and_imports_nothing_heavy():
    code = (
        "import sys; from jointgap.app.cli import cli; cli(['--help'],"
        " standalone_mode=False);print('heavy:', sorted({'numpy', 'torch', 'numba', 'mlflow',"
        " 'pandas', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "heavy: []" in done.stdout
    for stage in ("simulate", "surrogate", "kinematics", "optimise", "figures", "compare", "track"):
        assert f"  {stage} " in done.stdout


def test_sums_of_matrices_take_one_thread_though_snakemake_allows_the_job_more(monkeypatch):
    libraries, found = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), []
    for name in libraries:
        monkeypatch.setenv(name, "8")
    monkeypatch.setattr(app, "cli", lambda: found.extend(os.environ[name] for name in libraries))
    jointgap()
    assert found == ["1", "1", "1"]


def test_every_subcommand_stands_in_one_section_of_the_help_and_explains_itself_and_each_of_its_options():
    listed = [name for names in cli.sections.values() for name in names]
    assert sorted(listed) == sorted(
        name for name, command in cli.commands.items() if not command.hidden
    )

    def explains_itself(name):
        command = cli.commands[name]
        assert command.help
        options = [option for option in command.params if isinstance(option, click.Option)]
        assert [option.name for option in options if not option.help] == []
        assert jointgap(name, "--help").returncode == 0

    each(explains_itself, cli.commands)


def test_a_removed_command_and_a_port_that_cannot_be_are_refused():
    for name, hint in cli.removed.items():
        done = jointgap(name)
        assert done.returncode == 2 and f"{name} was removed; {hint}" in " ".join(
            done.stderr.split()
        )
    for port in ("-5", "0", "70000"):
        done = jointgap("dashboard", "--port", port)
        assert done.returncode == 2 and f"{port} is not in the range" in done.stderr


def test_a_mistake_ends_the_command_with_one_line_and_code_two(tmp_path):
    outputs = ["--results", tmp_path]
    command = [
        sys.executable,
        "-m",
        "jointgap",
        "simulate",
        "--options",
        '{"mechanism": {"crnk": 1}}',
        *outputs,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert (
        done.stderr.splitlines()[0].startswith("jointgap: error: ")
        and "Traceback" not in done.stderr
    )
    assert "unknown key 'mechanism.crnk'; did you mean 'crank'?" in done.stderr


def test_config_prints_the_warnings_of_a_run(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "mechanism: {base: compressor, slider: {mass: 2400}}\nscenarios: {a: {simulate: {speed: 145"
        " rpm}}}\n"
    )
    done = jointgap("config", file)
    assert json.loads(done.stdout)["mechanism"]["slider"]["mass"] == 2400
    warnings = [line.split(":")[1].strip() for line in done.stderr.splitlines()]
    assert warnings[0] == "slider.mass"


def test_a_file_or_an_option_that_is_wrong_in_itself_is_reported(tmp_path):
    file, results = tmp_path / "mine.yaml", tmp_path / "results"

    def told(content, words):
        file.write_text(content)
        line = refusal("config", file)
        assert line.startswith(str(file)) and words in line

    length = "scenarios: {a: {mechanism: compressor, optimise: {constraints: {crank_length: 25}}}}"
    cases = [
        ("", "is empty"),
        ("a: 1\nb: 2\na: 3\n", "the key 'a' is a duplicate, in lines 1 and 3"),
        (f"run: {'[' * 5000}{']' * 5000}", "is not YAML"),
        (length, "scenario a: optimise.constraints, box own: crank_length 25000 mm is infeasible"),
    ]
    each(told, cases)
    nested = f'{{"mechanism": {"[" * 20_000}{"]" * 20_000}}}'
    error = refusal("simulate", "--options", nested, "--results", results)
    assert error.startswith("--options: is not JSON")
    assert not results.exists()
    assert "no such effect; did you mean 'gas_pressure'?" in refusal("effects", "gas_presure")
    assert "'sensor_gain'" in refusal("effects", "amplifier_gain") and "'gas_pressure'" in refusal(
        "effects", "gas_force"
    )


PAPERS = load_mechanism(PAPER).model_dump(mode="json")
OPTIONS = {
    "mechanism": PAPERS,
    "simulate": {"revolutions": 1, "samples_per_revolution": 1800},
    "optimise": {"ensemble": {"settled_revolution": 1}},
}


def simulate(folder, options=OPTIONS):
    return jointgap("simulate", "--options", json.dumps(options), "--results", folder)


def test_a_trajectory_of_other_options_is_refused_by_every_stage_that_reads_it(tmp_path):
    done = simulate(tmp_path)
    assert done.returncode == 0, done.stderr
    assert (
        "crank_pin: you asked for a restitution of 0.46; lankarani_nikravesh effectively gives"
        " 0.715" in done.stderr
    )
    other = json.dumps(OPTIONS | {"simulate": OPTIONS["simulate"] | {"speed": 30.0}})
    results = ("--results", tmp_path)
    stages = [("kinematics", *results), ("optimise", *results), ("compare", *results)]
    stages += [("surrogate", *results, "--output-name", "r2")]
    for command in (*stages, ("figures", *results, "--figure", "orbits")):
        assert "give the options it was simulated with" in refusal(*command, "--options", other)
    assert [path.name for path in tmp_path.iterdir()] == ["simulate"]
    assert "no tables to publish" in refusal(
        "track", "--options", other, "--results", tmp_path / "nowhere"
    )


def test_where_all_joints_are_ideal_there_is_a_motion_and_nothing_to_learn_from_it(tmp_path):
    joints = {name: joint | {"loose": False} for name, joint in PAPERS["joints"].items()}
    options = {"mechanism": PAPERS | {"joints": joints}, "simulate": OPTIONS["simulate"]}
    assert simulate(tmp_path, options).returncode == 0
    command = ("surrogate", "--results", tmp_path, "--output-name", "r2")
    line = refusal(*command, "--options", json.dumps(options))
    assert "all joints are ideal" in line and "make a joint loose" in line


def test_outputs_that_cannot_be_written_are_found_out_before_anything_is_computed(tmp_path):
    (tmp_path / "simulate").touch()
    done = simulate(tmp_path)
    assert done.returncode == 2 and "trajectory.parquet: cannot be written" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["simulate"]


def test_every_effect_and_fault_is_listed_within_a_hundred_columns_and_shown_with_what_to_paste():
    shown = jointgap("effects").stdout
    assert max(map(len, shown.splitlines())) <= 100
    assert [name for name in (*EFFECTS, *FAULTS) if name not in shown] == []
    paper = read_yaml(PAPER)
    joints = paper["joints"] | {"crank_pivot": PIVOT | {"journal": "crank"}}

    def in_full(name):
        shown = jointgap("effects", name).stdout
        words = " ".join(shown.split())
        if name in FAULTS:
            assert FAULTS[name].law.split()[0] in shown and FAULTS[name].parameter in shown
            return
        assert EFFECTS[name].LAW in words and EFFECTS[name].REFERENCE in words
        snippet = yaml.safe_load(textwrap.dedent(shown.split("in the mechanism file:")[1]))
        made = validate(Mechanism, paper | snippet | {"joints": joints}, "pasted")
        assert made.effects[0].name == name

    each(in_full, (*EFFECTS, *FAULTS))


def test_describe_shows_what_stands_in_a_file_as_it_is(tmp_path, monkeypatch):
    """Brackets are units, not marks of colours, and the metadata of another program may be in any
    encoding."""
    monkeypatch.setenv("COLUMNS", "200")
    place = tmp_path / "a[b].parquet"
    link = "[link=file:///etc]x[/link]"
    columns = [
        pa.field(
            "speed [m/s]",
            pa.float64(),
            metadata={"unit": "[m/s]", "description": "ends [/red] here"},
        ),
        pa.field("[bold]loud", pa.float64(), metadata={"unit": b"\xb0C", "description": link}),
    ]
    pq.write_table(pa.table([[1.0], [2.0]], schema=pa.schema(columns)), place)
    done = jointgap("describe", place)
    assert done.returncode == 0, done.stderr
    words = ("a[b].parquet", "speed [m/s]", "ends [/red] here", "[bold]loud", "\ufffdC", link)
    assert [text for text in words if text not in done.stdout] == []
    pq.write_table(pa.table({"speed": [1.0]}), place, store_schema=False)
    place.write_bytes(
        place.read_bytes().replace(b"speed", b"sp\xff\xfed")
    )  # names that are no text
    assert "parquet: cannot be read as Parquet" in refusal("describe", place)


def test_a_command_stopped_by_ctrl_c_says_so_and_ends_with_the_exit_code_of_an_interrupted_program(
    monkeypatch,
):
    def stopped(**given):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.commands["effects"], "callback", stopped)
    done = jointgap("effects")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "jointgap: interrupted\n")
