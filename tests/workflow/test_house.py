"""Rules of this project that a tool can check."""

import re
import tomllib

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.project import ROOT, run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize(
    "command",
    [
        "ruff check .",
        "ruff format --check .",
        "snakefmt --check Snakefile workflow",
        "snakemake --lint",
    ],
)
def test_the_style_checkers_have_no_complaint(command):
    done = run(ROOT, *command.split())
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_lock_file_pins_every_dependency_within_its_bounds():
    wanted = [
        *PROJECT["dependencies"],
        *(line for extra in PROJECT["optional-dependencies"].values() for line in extra),
    ]
    pins = dict(re.findall(r"^([A-Za-z0-9._-]+)==([^ ]+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    pins = {canonicalize_name(name): version for name, version in pins.items()}
    for requirement in map(Requirement, wanted):
        if requirement.name == PROJECT["name"]:  # an extra that takes in another
            assert requirement.extras <= PROJECT["optional-dependencies"].keys()
            continue
        assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)]), requirement


def test_the_conda_environment_asks_for_the_same_packages_as_the_project():
    other_names = {"matplotlib-base": "matplotlib", "pytorch": "torch"}
    lines = yaml.safe_load((ROOT / "workflow/envs/jointgap.yaml").read_text())["dependencies"]
    conda = {line.replace(" ", "") for line in lines if not line.startswith(("python ", "pip", "setuptools"))}
    conda = {re.sub(r"^[a-z-]+", lambda name: other_names.get(name[0], name[0]), line) for line in conda}
    extras = PROJECT["optional-dependencies"]
    in_jobs = {*PROJECT["dependencies"], *extras["learn"], *extras["workflow"]}
    assert conda == {line for line in in_jobs if not line.startswith("snakemake")}


def test_every_profile_and_the_catalogue_entry_can_be_read():
    profiles = sorted((ROOT / "workflow/profiles").glob("*/config.yaml"))
    assert [path.parent.name for path in profiles] == ["ci", "local", "slurm"]
    for path in [*profiles, ROOT / ".snakemake-workflow-catalog.yml", ROOT / "CITATION.cff"]:
        assert isinstance(yaml.safe_load(path.read_text()), dict), path


def test_make_help_names_every_target():
    makefile = (ROOT / "Makefile").read_text()
    targets = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[1].split()
    done = run(ROOT, "make", "--no-print-directory", "help")
    assert done.returncode == 0, done.stderr
    assert set(targets) == {line.split()[0] for line in done.stdout.splitlines() if not line.startswith("variables")}


def test_the_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    version = run(ROOT, "python", "-c", "import jointgap; print(jointgap.__version__)")
    assert version.stdout.strip() == PROJECT["version"] == citation["version"]
