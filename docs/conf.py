"""The documentation site. `make docs` builds it; every page is a file that reads well on GitHub
too.

The source folder is the root of the repository, so that links between docs/, config/ and the files
of the root lead to the same place in a clone, on GitHub and on the site.
"""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "docs" / "extensions")]

from jointgap import __version__  # noqa: E402

project = "jointgap"
author = "jointgap developers"
copyright = author
release = version = __version__

extensions = [
    "myst_nb",  # Markdown and notebooks
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_design",
    "sphinx_copybutton",
    # ours, in docs/extensions
    "mathml",
    "public_names",
    "sections",
    "workflow_drawing",
]

# -- pages
# ------------------------------------------------------------------------------------------

root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "config/README.md",
    "examples/README.md",
    "examples/*/README.md",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
]
exclude_patterns = [
    ".*",  # .git, .venv, .cache and others
    "docs/_build",
    "docs/extensions",
    "docs/static",
    "docs/templates",
    "results",
    "src",
    "tests",
]
templates_path = ["templates"]

myst_enable_extensions = ["attrs_block", "colon_fence", "dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
default_role = "code"  # single backticks in docstrings are names of the code
nb_execution_mode = "off"  # scripts/notebooks stores the outputs

# -- strictness
# ------------------------------------------------------------------------------------------

nitpicky = True
nitpick_ignore_regex = [
    # Types of other projects in signatures. Their inventories would have to be fetched at every
    # build.
    (
        r"py:.*",
        r"(click|collections|datetime|matplotlib|numpy|np|pandas|pd|pathlib|pydantic|rich|typing)(\..*)?",
    ),
    # Internal records of results and parts of a file, of which the docstrings tell enough.
    (
        r"py:class",
        r"jointgap\.(core\.facts\.Fact|scenario\.chosen_lengths\.ChosenLengths|lengths\.linkages\.LengthsFound|config\.linkage_file\.(BodyPart|Pin|Slide))",
    ),
    # Python's own types and what is short for those above.
    (
        r"py:.*",
        r"(Any|Callable|Iterable|Mapping|Path|Sequence|bool|bytes|dict|float|int|list|object|str|tuple|Figure)",
    ),
    # What a type variable stands for is said in the docstring.
    (r"py:.*", r"jointgap\.config\.variations\.AnyConfigModel"),
]

# -- Python reference
# ------------------------------------------------------------------------------------------

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
python_maximum_signature_line_length = 88
add_module_names = False

# -- appearance
# ------------------------------------------------------------------------------------------

html_theme = "furo"
html_title = "jointgap"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "to_front_page.html"}
html_copy_source = False
html_show_sourcelink = False
copybutton_exclude = ".linenos, .gp, .go"
copybutton_prompt_text = "$ "

repository = os.environ.get("GITHUB_REPOSITORY")  # set where GitHub builds the site
html_theme_options = {
    "top_of_page_buttons": ["edit"] if repository else [],
    "navigation_with_keys": True,
}
if repository:
    html_theme_options |= {
        "source_repository": (
            f"{os.environ.get('GITHUB_SERVER_URL', 'https://github.com')}/{repository}/"
        ),
        "source_branch": "main",
        "source_directory": "",
    }
