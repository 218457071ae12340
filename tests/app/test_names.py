"""What `import jointgap as jg` offers."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import jointgap as jg
from tests.catalogue import each

HEAVY = {"numpy", "pandas", "numba", "torch", "matplotlib", "pydantic", "scipy"}


def test_importing_it_loads_nothing_heavy_and_a_name_that_is_not_there_is_reported():
    code = f"import sys, jointgap; sys.exit(', '.join({HEAVY} & set(sys.modules)) or 0)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    with pytest.raises(AttributeError, match="no attribute 'simulat'") as told:
        jg.simulat  # noqa: B018
    assert (told.value.name, told.value.obj) == (
        "simulat",
        jg,
    )  # from which Python says: did you mean 'simulate'?


def test_every_public_name_is_there_for_tab_completion_and_for_type_checkers_and_says_what_it_is():
    assert set(jg.__all__) <= set(dir(jg))
    (checked,) = (
        node for node in ast.parse(Path(jg.__file__).read_text()).body if isinstance(node, ast.If)
    )
    told = {(node.module, name.name) for node in checked.body for name in node.names}
    assert told == {(module, name) for module, names in jg._PUBLIC.items() for name in names}
    assert sorted(name for _, name in told) == jg.__all__

    def says(name):
        words = inspect.getdoc(getattr(jg, name))
        assert words
        if inspect.isfunction(getattr(jg, name)):
            sections = [
                f"\n{section}\n---" for section in ("Parameters", "Returns", "Raises", "Examples")
            ]
            assert all(section in words for section in sections)

    each(says, jg.__all__)
