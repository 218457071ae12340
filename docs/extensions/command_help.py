"""Help of commands as the terminal shows it: what stands below a docstring's form feed is for the code's readers."""

from sphinx.application import Sphinx


def _cut(app: Sphinx, context, lines: list[str]) -> None:
    """Cut the sections of parameters, which the options below say again."""
    for number, line in enumerate(lines[1:], 1):
        if lines[number - 1].strip() == "Parameters" and line.strip("- ") == "" and line.strip():
            del lines[number - 1 :]
            return


def setup(app: Sphinx) -> dict:
    """Before the description of a command is read."""
    app.connect("sphinx-click-process-description", _cut)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
