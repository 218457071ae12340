"""Which code makes a stage's results: a digest that makes Snakemake run a stage again when its code changes."""

import ast
import hashlib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent

ENTRY_MODULES = {
    "simulate": ("dynamics.simulation", "dynamics.model.mechanism_warnings"),
    "surrogate": ("surrogate.train", "surrogate.train_clearance", "results"),
    "kinematics": ("kinematics", "results"),
    "optimise": ("optimise.optimise_stage", "results"),
    "figures": ("figures.*", "results"),
    "compare": ("paper.comparison", "paper.comparison_page", "paper.scenario_overview", "results"),
    "study": ("sweep.study_points", "sweep.study_page", "sweep.study_figures"),
    "campaign": ("campaign.stages", "campaign.mlflow_runs", "figures.*"),
    "track": ("track.publish", "track.scenario_runs"),
    "blind_conceal": ("trials.make_trial",),
    "blind_analyse": ("trials.analyse_trial",),
    "blind_score": ("trials.trials_report", "trials.trial_figures"),
}
"""Modules of the package in which the work of a stage begins; what they import belongs to the stage too."""


@cache
def imports_of(module: str) -> frozenset[str]:
    """Modules of the package that `module` (dotted, without ``jointgap.``) imports, inside functions and by name too."""
    found = set()
    for node in ast.walk(ast.parse(source_of(module).read_bytes())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "jointgap":
            base = node.module.removeprefix("jointgap").removeprefix(".")
            named = {".".join(filter(None, (base, alias.name))) for alias in node.names}
            found |= {name for name in (base, *named) if name and _exists(name)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("jointgap."):
            for name in expanded(node.value.removeprefix("jointgap.")) if node.value.isascii() else ():
                found |= {name} if _exists(name) else set()
    return frozenset(found | ({module.rpartition(".")[0]} - {""}))


@cache
def closure(module: str) -> frozenset[str]:
    """`module` and all modules of the package that it imports, directly or not."""
    seen, asked = set(), [module]
    while asked:
        name = asked.pop()
        if name not in seen:
            seen.add(name)
            asked += imports_of(name) - seen
    return frozenset(seen)


def code_digest(stage: str) -> str:
    """Twelve hexadecimal digits over the sources that `stage` runs (jointgap's own, not its dependencies)."""
    entries = [name for entry in ENTRY_MODULES[stage] for name in expanded(entry)]
    modules = sorted(set().union(*map(closure, entries)))
    digest = hashlib.sha256()
    for name in modules:
        digest.update(name.encode() + source_of(name).read_bytes())
    return digest.hexdigest()[:12]


def expanded(entry: str) -> list[str]:
    """The modules that an entry stands for: itself, or with ``.*`` at its end all of a package, imported by name at run time."""
    package, star, _ = entry.partition(".*")
    if not star:
        return [entry]
    return [
        f"{package}.{path.stem}" for path in sorted(source_of(package).parent.glob("*.py")) if path.stem != "__init__"
    ]


@cache
def source_of(module: str) -> Path:
    """File of a module, or of a package's face."""
    place = ROOT.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@cache
def _exists(name: str) -> bool:
    return all(part.isidentifier() for part in name.split(".")) and source_of(name).is_file()
