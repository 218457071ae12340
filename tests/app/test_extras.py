"""What runs without the packages of the extras."""

import subprocess
import sys

from benchmarks.project import ROOT

_WITHOUT = """
import importlib, pkgutil, sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

BLOCKED = "torch pymoo openturns mlflow requests snakemake plotly".split()
BLOCKED += "exudyn pysindy sympy sklearn IPython".split()
sys.meta_path.insert(0, Missing())

import jointgap
from jointgap.core.errors import MissingPackage

for module in pkgutil.walk_packages(jointgap.__path__, "jointgap."):
    if module.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except MissingPackage as error:
        print(module.name, error, sep=": ")

assert not any(name.partition(".")[0] in BLOCKED for name in sys.modules)
"""


def test_without_the_extras_only_training_and_optimising_fail():
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    said = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    said = {module.rpartition(".")[2]: message for module, message in said.items()}
    install = "pip install 'jointgap[learn]' (in a clone: scripts/set-up)"
    torch, pymoo = (
        f"training networks requires torch: {install}",
        f"optimising link lengths requires pymoo: {install}",
    )
    openturns = f"the sensitivity analysis requires openturns: {install}"
    assert (said["train"], said["optimise_robust"], said["sensitivity"]) == (
        torch,
        pymoo,
        openturns,
    )
    assert set(said.values()) == {torch, pymoo, openturns}  # the others are imported when needed
