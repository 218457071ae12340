"""Rules of this project that a tool can check."""

import ast
import re
import tomllib
from collections import Counter

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


# The package: what can be counted of its order

MODULES = {path: ast.parse(path.read_text()) for path in sorted((ROOT / "src/jointgap").rglob("*.py"))}


def public_functions():
    """Functions and methods without an underscore: where they stand, and the node."""
    for path, tree in MODULES.items():
        classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
        for body in (tree.body, *(node.body for node in classes)):
            for node in body:
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    yield f"{path.relative_to(ROOT)}:{node.lineno} {node.name}", node


def is_compiled(node):
    """Whether numba compiles it: annotations would be lost on it."""
    return any("compiled" in ast.unparse(decorator) for decorator in node.decorator_list)


def test_base_names_of_modules_are_unique_but_for_the_settings_of_each_room():
    names = Counter(path.name for path in MODULES if path.name != "__init__.py")
    assert {name for name, times in names.items() if times > 1} <= {"settings.py", "cycle_statistics.py"}


def test_public_functions_of_several_arguments_describe_each_of_them():
    lacking = {}
    for place, node in public_functions():
        names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        names = [name for name in names if name not in {"self", "cls"}]
        text = ast.get_docstring(node) or ""
        refers = "rguments as in" in text or "arameters as " in text
        missing = [name for name in names if not re.search(rf"\b{re.escape(name)}\b", text)]
        if len(names) > 1 and missing and not refers:
            lacking[place] = missing
    assert not lacking


def test_public_functions_say_what_they_return():
    lacking = [place for place, node in public_functions() if node.returns is None and not is_compiled(node)]
    assert not lacking


def test_joints_are_listed_in_one_place():
    joints = {"crank_pin", "piston_pin", "crank_pivot"}
    lists = []
    for path, tree in MODULES.items():
        types = {id(node.slice) for node in ast.walk(tree) if isinstance(node, ast.Subscript)}  # Literal of two names
        for node in ast.walk(tree):
            if isinstance(node, ast.Tuple | ast.List | ast.Set) and id(node) not in types and path.name != "joints.py":
                if len(joints & {item.value for item in node.elts if isinstance(item, ast.Constant)}) > 1:
                    lists.append(f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node)}")
    assert not lists


def test_tuned_numbers_of_naming_stand_in_the_settings():
    definitions = {"STANDARD_GRAVITY", "FILTER_ORDER"}  # nobody would tune these
    constants = []
    for path, tree in MODULES.items():
        if path.parent.name in {"identification", "slider_crank"} and path.name != "settings.py":
            for node in tree.body:
                number = isinstance(node, ast.Assign) and getattr(node.value, "value", None)
                if type(number) in (int, float) and ast.unparse(node.targets[0]) not in definitions:
                    constants.append(f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node)}")
    assert not constants
