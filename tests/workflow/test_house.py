"""Consistency of the project files."""

import re
import tomllib
from importlib import import_module
from pkgutil import resolve_name

import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import jointgap
from benchmarks.project import ROOT, run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


def test_lock_file_and_conda_environment_match_the_project():
    wanted = [*PROJECT["dependencies"], *(line for extra in EXTRAS.values() for line in extra)]
    lock = (ROOT / "requirements.lock").read_text()
    pins = re.findall(r"^([A-Za-z0-9._-]+)==([^ ]+)", lock, re.MULTILINE)
    pins = {canonicalize_name(name): version for name, version in pins}
    for requirement in map(Requirement, wanted):
        if requirement.name == PROJECT["name"]:  # an extra that takes in another
            assert requirement.extras <= EXTRAS.keys()
        else:
            assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)]), (
                requirement
            )
    other_names = {"matplotlib-base": "matplotlib", "pytorch": "torch"}
    lines = yaml.safe_load((ROOT / "workflow/envs/jointgap.yaml").read_text())["dependencies"]
    base = ("python ", "pip", "setuptools")
    conda = {line.replace(" ", "") for line in lines if not line.startswith(base)}
    conda = {
        re.sub(r"^[a-z-]+", lambda name: other_names.get(name[0], name[0]), line) for line in conda
    }
    in_jobs = {*PROJECT["dependencies"], *EXTRAS["learn"], *EXTRAS["workflow"]}
    assert conda == {line for line in in_jobs if not line.startswith("snakemake")}


def test_profiles_help_and_versions_are_complete():
    profiles = sorted((ROOT / "workflow/profiles").glob("*/config.yaml"))
    assert [path.parent.name for path in profiles] == ["ci", "local", "slurm"]
    for path in [*profiles, ROOT / ".snakemake-workflow-catalog.yml", ROOT / "CITATION.cff"]:
        assert isinstance(yaml.safe_load(path.read_text()), dict), path
    targets = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[
        1
    ].split()
    shown = run(ROOT, "make", "--no-print-directory", "help").stdout.splitlines()
    assert set(targets) == {line.split()[0] for line in shown if not line.startswith("variables")}
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert jointgap.__version__ == PROJECT["version"] == citation["version"]


def test_generated_pages_are_up_to_date():
    pages = sorted(
        page
        for page in (ROOT / "README.md", *ROOT.glob("docs/**/*.md"))
        if "<!-- generated:" in page.read_text(encoding="utf-8")
    )
    assert len(pages) > 5
    done = run(ROOT, "scripts/generated-pages", *map(str, pages))
    assert done.returncode == 0, done.stderr
    assert done.stdout == "".join(page.read_text(encoding="utf-8") for page in pages)


PAGES = [
    ROOT / f"{name}.md"
    for name in ("README", "config/README", "CONTRIBUTING", "SECURITY", "CODE_OF_CONDUCT")
]
PAGES += sorted(page for page in ROOT.glob("docs/**/*.md") if "_build" not in page.parts)


def test_names_and_paths_in_the_documentation_exist():

    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"`(jointgap(?:\.\w+)+)", text):
            resolve_name(name)
        for module, names in re.findall(
            r"^from (jointgap[\w.]*) import ([\w, ]+)$", text, re.MULTILINE
        ):
            for name in names.split(", "):
                assert hasattr(import_module(module), name), (module, name)
    for path in re.findall(
        r"`([\w.]+/[\w./-]*)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    ):
        if not path.startswith(("results/", "docs/_build/")):
            assert (ROOT / path).exists() or (ROOT / "src/jointgap" / path).exists(), path


def test_documented_functions_and_classes_exist():
    for page in sorted((ROOT / "docs").rglob("*.md")):
        module = "jointgap"
        for kind, name in re.findall(
            r"(?m)^\.\. (currentmodule|autofunction|autoclass):: ([\w.]+)$",
            page.read_text(encoding="utf-8"),
        ):
            if kind == "currentmodule":
                module = name
            else:
                resolve_name(name if name.startswith("jointgap.") else f"{module}.{name}")


def test_tests_named_in_scripts_and_pages_exist():
    files = [
        ROOT / "Makefile",
        *(ROOT / "scripts").iterdir(),
        *PAGES,
    ]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    named = {path.rstrip(".") for path in re.findall(r"\btests/[\w./{},-]+", text)}
    paths = run(ROOT, "bash", "-c", f"printf '%s\n' {' '.join(sorted(named))}").stdout.split()
    assert len(paths) > len(named) > 3
    assert [path for path in paths if not (ROOT / path).exists()] == []
