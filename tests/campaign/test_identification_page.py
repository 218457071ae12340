"""docs/identification.md has every figure and verdict."""

from pathlib import Path

from jointgap.campaign.figures import FIGURES
from tests.campaign.verdicts import VERDICTS

PAGE = Path("docs/identification.md").read_text(encoding="utf-8")


def test_it_names_every_figure_and_every_verdict():
    assert all(f"*{name}*" in PAGE for name in FIGURES)
    assert all(f"| `{verdict}` |" in PAGE for verdict in VERDICTS)
