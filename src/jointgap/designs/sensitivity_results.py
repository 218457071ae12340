"""What decides, written to a folder: tables, figures and the page."""

from pathlib import Path

from jointgap import tables
from jointgap.core import plot
from jointgap.core.page import to_html, to_markdown
from jointgap.designs.sensitivity_figures import draw
from jointgap.designs.sensitivity_indices import SensitivityResult
from jointgap.designs.sensitivity_page import page


def write_results(found: SensitivityResult, folder: Path) -> str:
    """Write tables, figures and page into a `folder`; gives the page as Markdown.

    Figures of an earlier run that are not drawn again, of measures that have no indices any more, are removed.
    """
    places = {
        folder / Path(table.path).name: (table, frame)
        for table, frame in zip(
            tables.SENSITIVITY_TABLES, (found.surrogates, found.indices, found.effects), strict=True
        )
    }
    pages, figures = (folder / "summary.html", folder / "summary.md"), folder / "figures"
    tables.check_writable(*places, *pages)
    figures.mkdir(exist_ok=True)
    drawn = {path for name, drawing in draw(found) for path in plot.save(drawing, figures / name)}
    for path in set(figures.iterdir()) - drawn:
        path.unlink()
    for path, (table, frame) in places.items():
        tables.write(table, frame, path)
    shown = page(found)
    text = to_markdown(shown)
    tables.write_text(pages[0], to_html(shown, figures))
    tables.write_text(pages[1], text)
    return text
