"""The command line answers fast, in words, and never with a traceback for a mistake of the user's."""

import itertools
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import click
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.config import EFFECTS, Mechanism, load_mechanism, read_yaml, validate
from jointgap.rig.sensors import FAULTS

ROOT = Path(__file__).resolve().parents[2]


def jointgap(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", "from jointgap.app.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        **options,
    )


def test_help_lists_every_stage_and_imports_nothing_heavy():
    code = (
        "import sys; from jointgap.app.cli import cli; cli(['--help'], standalone_mode=False);"
        "print('heavy:', sorted({'numpy', 'torch', 'numba', 'mlflow', 'pandas', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "heavy: []" in done.stdout
    for stage in ("simulate", "surrogate", "kinematics", "optimise", "figures", "compare", "track"):
        assert f"  {stage} " in done.stdout


def test_sums_of_matrices_take_one_thread_though_snakemake_allows_the_job_more():
    libraries = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    code = (
        "import os, jointgap.app.cli as it;"
        f"it.cli = lambda: print([os.environ[name] for name in {libraries}]);it.main()"
    )
    allowed = os.environ | dict.fromkeys(libraries, "8")
    done = subprocess.run([sys.executable, "-c", code], env=allowed, capture_output=True, text=True, timeout=60)
    assert done.stdout == "['1', '1', '1']\n"


def test_every_subcommand_stands_in_one_section_of_the_help():
    listed = [name for names in cli.sections.values() for name in names]
    shown = [name for name, command in cli.commands.items() if not command.hidden]
    assert sorted(listed) == sorted(shown)


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_subcommand_explains_itself_and_each_of_its_options(name):
    command = cli.commands[name]
    assert command.help
    options = [option for option in command.params if isinstance(option, click.Option)]
    assert [option.name for option in options if not option.help] == []
    assert CliRunner().invoke(cli, [name, "--help"]).exit_code == 0


@pytest.mark.parametrize("name", sorted(cli.removed))
def test_a_removed_command_says_what_to_use_instead(name):
    done = CliRunner().invoke(cli, [name])
    assert done.exit_code == 2 and f"{name} is gone; {cli.removed[name]}" in done.output


def test_a_mistake_in_the_options_ends_with_one_line_and_code_two(tmp_path):
    outputs = ["--trajectory", str(tmp_path / "t.parquet"), "--events", str(tmp_path / "e.parquet")]
    done = jointgap("simulate", "--options", '{"mechanism": {"crnk": 1}}', *outputs)
    assert done.returncode == 2
    assert "unknown key 'mechanism.crnk'; did you mean 'crank'?" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A results folder with a short simulation, and the options it was made with."""
    folder = tmp_path_factory.mktemp("results")
    options = {
        "mechanism": load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml").model_dump(mode="json"),
        "simulate": {"revolutions": 1, "samples_per_revolution": 1800},
        "optimise": {"ensemble": {"settled_revolution": 1}},
    }
    files = ("--trajectory", folder / "simulate/trajectory.parquet", "--events", folder / "simulate/events.parquet")
    done = jointgap("simulate", "--options", json.dumps(options), *map(str, files))
    assert done.returncode == 0, done.stderr
    return folder, options


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        (
            "mechanism: a.yaml\nsimulate: {}\nmechanism: b.yaml\n",
            "the key 'mechanism' is given twice, in line 1 and in line 3",
        ),
        (f"run: {'[' * 5000}{']' * 5000}", "is not YAML"),
        (f"scenarios: {{a: {{simulate: {{speed: {'9' * 5000}}}}}}}", "is not YAML"),
        ("mechanism: {slider: {offset: 0_5}}", "0_5 is one thing to some programs"),
        (
            "scenarios: {a: {mechanism: compressor, optimise: {constraints: {crank_length: 25}}}}",
            "scenario a: optimise.constraints, box own: crank_length 25000 mm cannot be reached",
        ),
    ],
    ids=lambda text: text[:20],
)
def test_a_file_that_is_wrong_in_itself_ends_with_one_line_and_code_two(tmp_path, content, words):
    file = tmp_path / "mine.yaml"
    file.write_text(content)
    done = jointgap("config", str(file))
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"jointgap: error: {file}") and words in line


def test_options_that_are_nested_beyond_measure_end_with_one_line_and_code_two(tmp_path):
    options = f'{{"mechanism": {"[" * 20_000}{"]" * 20_000}}}'
    written = tmp_path / "growth.parquet"
    done = jointgap("growth", "--options", options, "--growth", str(written))
    assert (done.returncode, done.stdout, written.exists()) == (2, "", False)
    assert done.stderr.startswith("jointgap: error: --options: is not JSON") and done.stderr.count("\n") == 1


def test_a_trajectory_of_other_options_is_refused_by_every_stage_that_reads_it(simulated, tmp_path):
    folder, options = simulated
    other = json.dumps(options | {"simulate": options["simulate"] | {"speed": 30.0}})
    fitted = [str(tmp_path / name) for name in ("fit", "history", "errors")]
    trajectory = str(folder / "simulate/trajectory.parquet")
    for command in (
        ("kinematics", "--results", str(folder)),
        ("optimise", "--results", str(folder)),
        ("compare", "--results", str(folder)),
        ("figures", "--results", str(folder), "--figure", "orbits"),
        ("surrogate", "--trajectory", trajectory, "--output-name", "r2")
        + tuple(itertools.chain(*zip(("--fit", "--history", "--errors"), fitted, strict=True))),
        ("clearance", "--trajectory", trajectory, "--fit", fitted[0], "--errors", fitted[2]),
    ):
        done = jointgap(*command, "--options", other)
        assert done.returncode == 2, command
        assert "give the options it was simulated with" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_outputs_that_cannot_be_written_are_found_out_before_anything_is_computed(simulated, tmp_path):
    _, options = simulated
    (tmp_path / "file").touch()
    places = (
        "--events",
        str(tmp_path / "events.parquet"),
        "--trajectory",
        str(tmp_path / "file" / "trajectory.parquet"),
    )
    done = jointgap("simulate", "--options", json.dumps(options), *places)
    assert done.returncode == 2
    assert "trajectory.parquet: cannot be written" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_where_all_joints_are_ideal_there_is_a_motion_and_nothing_to_learn_from_it(tmp_path):
    mechanism = load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml").model_dump(mode="json")
    for joint in mechanism["joints"].values():
        joint["loose"] = False
    options = json.dumps({"mechanism": mechanism, "simulate": {"revolutions": 1, "samples_per_revolution": 1800}})
    trajectory, files = str(tmp_path / "trajectory.parquet"), [str(tmp_path / name) for name in ("a", "b", "c")]
    done = jointgap("simulate", "--options", options, "--trajectory", trajectory, "--events", files[0])
    assert done.returncode == 0, done.stderr
    learn = ("--trajectory", trajectory, "--fit", files[1], "--errors", files[2])
    for command in (("clearance", *learn), ("surrogate", *learn, "--history", files[0], "--output-name", "r2")):
        done = jointgap(*command, "--options", options)
        assert done.returncode == 2
        assert "all joints are ideal" in done.stderr and "make a joint loose" in done.stderr
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("port", ["-5", "0", "70000"])
def test_a_port_that_cannot_be_is_refused(port):
    done = CliRunner().invoke(cli, ["dashboard", "--port", port])
    assert done.exit_code == 2
    assert f"{port} is not in the range" in done.output


def test_nothing_is_published_from_a_folder_without_results(simulated, tmp_path):
    done = jointgap("track", "--options", json.dumps(simulated[1]), "--results", str(tmp_path / "nowhere"))
    assert done.returncode == 2
    assert "nothing to publish" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_catalogue_of_effects_fits_a_hundred_columns_and_leaves_none_out():
    shown = CliRunner().invoke(cli, ["effects"])
    assert shown.exit_code == 0
    assert max(map(len, shown.output.splitlines())) <= 100
    for name in (*EFFECTS, *FAULTS):
        assert name in shown.output


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_a_sensor_is_shown_with_what_the_sensor_reads(name):
    shown = CliRunner().invoke(cli, ["effects", name])
    assert shown.exit_code == 0
    assert FAULTS[name].law.split()[0] in shown.output and FAULTS[name].parameter in shown.output


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_shown_in_full_with_what_to_paste(name):
    shown = CliRunner().invoke(cli, ["effects", name])
    assert shown.exit_code == 0
    words = " ".join(shown.output.split())
    assert EFFECTS[name].LAW in words and EFFECTS[name].REFERENCE in words
    snippet = yaml.safe_load(textwrap.dedent(shown.output.split("in the mechanism file:")[1]))
    joints = {"crank_pivot": {"journal": "crank", "journal_radius": 0.01, "bearing_radius": 0.011, "contact": "steel"}}
    mechanism = read_yaml(ROOT / "config/mechanisms/erkaya2009.yaml")
    made = validate(Mechanism, mechanism | snippet | {"joints": mechanism["joints"] | joints}, "pasted")
    assert made.effects[0].name == name


def test_an_unknown_effect_is_told_with_the_nearest_one():
    done = jointgap("effects", "gas_presure")
    assert done.returncode == 2
    assert "no such effect; did you mean 'gas_pressure'?" in done.stderr


def test_a_law_that_delivers_another_restitution_says_so_with_the_number(simulated, tmp_path):
    _, options = simulated
    places = ("--events", str(tmp_path / "events.parquet"), "--trajectory", str(tmp_path / "trajectory.parquet"))
    done = jointgap("simulate", "--options", json.dumps(options), *places)
    assert done.returncode == 0
    assert "crank_pin: lankarani_nikravesh delivers a restitution of 0.715 where 0.46 is asked for" in done.stderr
    assert "exact_restitution delivers what is asked" in done.stderr


def test_describe_shows_what_stands_in_a_file_as_it_is(tmp_path):
    """Brackets are units, not marks of colours, and the metadata of another program may be in any encoding."""
    place = tmp_path / "a[b].parquet"
    columns = [
        pa.field("speed [m/s]", pa.float64(), metadata={"unit": "[m/s]", "description": "ends [/red] here"}),
        pa.field("[bold]loud", pa.float64(), metadata={"unit": b"\xb0C", "description": "[link=file:///etc]x[/link]"}),
    ]
    pq.write_table(pa.table([[1.0], [2.0]], schema=pa.schema(columns)), place)
    done = jointgap("describe", str(place), env={**os.environ, "COLUMNS": "200"})
    assert done.returncode == 0, done.stderr
    for text in (
        "a[b].parquet",
        "speed [m/s]",
        "ends [/red] here",
        "[bold]loud",
        "\ufffdC",
        "[link=file:///etc]x[/link]",
    ):
        assert text in done.stdout, text


def test_describe_refuses_a_file_whose_names_are_no_text(tmp_path):
    place = tmp_path / "table.parquet"
    pq.write_table(pa.table({"speed": [1.0]}), place, store_schema=False)
    place.write_bytes(place.read_bytes().replace(b"speed", b"sp\xff\xfed"))
    done = jointgap("describe", str(place))
    assert (done.returncode, done.stdout) == (2, "")
    assert "table.parquet: cannot be read as Parquet" in done.stderr
    assert "Traceback" not in done.stderr
