"""Which code makes a stage's results: a digest that makes Snakemake run a stage again when its code changes."""

import hashlib
from pathlib import Path

# Modules (files or folders of the package) that decide what a stage writes. Snakemake watches rules, not packages.
_MECHANISM = (
    *(f"config/{name}" for name in ("mechanism.py", "applied.py", "contact.py", "joints.py", "effects")),
    "formula.py",
)
_CAMPAIGN = (
    *("campaign", "discrepancy", "rig", "measure", "dynamics", "mechanism", *_MECHANISM, "config/campaign"),
    *("surrogate", "optimise", "figures", "compare", "track", "results.py", "paper.py", "tables"),
)
CODE = {
    "simulate": ("dynamics", *_MECHANISM, "tables/simulate.py"),
    "surrogate": ("surrogate", "paper.py", "dynamics", *_MECHANISM, "tables/simulate.py", "tables/surrogate.py"),
    "kinematics": ("kinematics.py", "results.py", "surrogate", "mechanism", "paper.py", "tables/kinematics.py"),
    "optimise": (
        *("optimise", "results.py", "surrogate", "paper.py", "mechanism", "dynamics"),
        *(*_MECHANISM, "tables/optimise.py"),
    ),
    "figures": (
        *("figures", "results.py", "surrogate", "mechanism", "paper.py", "tables/figures.py"),
        "discrepancy/decide.py",
    ),
    "compare": ("compare", "paper.py", "tables/compare.py"),
    "study": (
        *("study", "dynamics", "ensemble", "statistics", "mechanism", *_MECHANISM, "tables/study.py"),
        *("figures", "results.py", "surrogate", "paper.py", "tables/figures.py", "discrepancy/decide.py"),
    ),
    "campaign": _CAMPAIGN,
    "track": ("track",),
    "blind_conceal": (
        *(
            f"blind/{name}.py"
            for name in ("conceal", "draw", "exudyn_rig", "files", "hidden", "motion", "numerics", "peer")
        ),
        *("blind/plan.py", "blind/size.py", "blind/statistics.py", "discrepancy/whiten.py", "dynamics", *_MECHANISM),
    ),
    "blind_analyse": ("blind/analyse.py", "blind/sparse.py", *_CAMPAIGN),
    "blind_score": ("blind", *_CAMPAIGN),
}


def code_digest(stage: str) -> str:
    """Twelve hexadecimal digits over the sources that `stage` runs (jointgap's own, not its dependencies)."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for name in CODE[stage]:
        place = root / name
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(str(file.relative_to(root)).encode() + file.read_bytes())
    return digest.hexdigest()[:12]
