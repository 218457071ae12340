"""What `import jointgap as jg` offers."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import jointgap as jg

HEAVY = {"numpy", "pandas", "numba", "torch", "matplotlib", "pydantic", "scipy"}


def test_the_import_loads_nothing_heavy_and_an_unknown_name_is_an_error():
    code = f"import sys, jointgap; sys.exit(', '.join({HEAVY} & set(sys.modules)) or 0)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    with pytest.raises(AttributeError, match="no attribute 'simulat'") as error:
        jg.simulat  # noqa: B018
    # from which Python says: did you mean 'simulate'?
    assert (error.value.name, error.value.obj) == ("simulat", jg)


def test_every_public_name_is_listed_for_tab_completion_and_type_checkers():
    assert set(jg.__all__) <= set(dir(jg))
    nodes = ast.parse(Path(jg.__file__).read_text()).body
    (checked,) = (node for node in nodes if isinstance(node, ast.If))
    imported = {(node.module, name.name) for node in checked.body for name in node.names}
    assert imported == {(module, name) for module, names in jg._PUBLIC.items() for name in names}
    assert sorted(name for _, name in imported) == jg.__all__


@pytest.mark.parametrize("name", jg.__all__)
def test_every_public_name_has_a_docstring(name):
    text = inspect.getdoc(getattr(jg, name))
    assert text
    if inspect.isfunction(getattr(jg, name)):
        for section in ("Parameters", "Returns", "Raises", "Examples"):
            assert f"\n{section}\n---" in text
