"""The paper's numbers and claims beside ours; nothing here is tuned to match."""

from jointgap.compare.family import member
from jointgap.compare.pages import html, markdown
from jointgap.compare.stage import NEEDED, compare

__all__ = ["NEEDED", "compare", "html", "markdown", "member"]
