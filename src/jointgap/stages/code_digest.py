"""Which code makes a stage's results: a digest that makes Snakemake run a stage again when its code changes."""

import ast
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parent.parent


@cache
def code_digest(function: Callable[..., Any]) -> str:
    """Twelve hexadecimal digits over what a function of this package runs (jointgap's own code, not its
    dependencies).
    """
    own, modules = code_of(function)
    digest = hashlib.sha256(own.encode())
    for name in sorted(modules):
        source = source_of(name)
        digest.update(name.encode() + source.read_bytes())
        if source.name == "__init__.py":  # templates are code too
            for template in sorted(source.parent.glob("templates/*.j2")):
                digest.update(template.name.encode() + template.read_bytes())
    return digest.hexdigest()[:12]


def code_of(function: Callable[..., Any]) -> tuple[str, frozenset[str]]:
    """The code that a function runs."""
    own = _used(ast.parse(source_of(function.__module__.removeprefix("jointgap.")).read_bytes()), function.__name__)
    return "\n".join(map(ast.unparse, own)), frozenset().union(*map(closure, _imported(own)))


@cache
def closure(module: str) -> frozenset[str]:
    """`module` and all modules of the package that it imports, directly or not."""
    seen, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += _imports_of(name) - seen
    return frozenset(seen)


@cache
def source_of(module: str) -> Path:
    """File of a module, or of a package's face."""
    place = _ROOT.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@cache
def _imports_of(module: str) -> frozenset[str]:
    return _imported([ast.parse(source_of(module).read_bytes())]) | ({module.rpartition(".")[0]} - {""})


def _imported(nodes: Iterable[ast.AST]) -> frozenset[str]:
    """Modules of the package that the code in `nodes` imports, or names in a text from which it imports at run time."""
    names = (name for root in nodes for node in ast.walk(root) for name in _named(node))
    return frozenset(name for name in names if name and _exists(name))


def _named(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "jointgap":
        base = node.module.removeprefix("jointgap").removeprefix(".")
        yield base
        yield from (".".join(filter(None, (base, alias.name))) for alias in node.names)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("jointgap."):
        # "jointgap.figures.", as in an f-string that a module's name follows, may be any module of that package, "...*"
        # is all
        name = node.value.removeprefix("jointgap.")
        package = name.rstrip("*").rstrip(".")
        yield name
        if package != name and _exists(package):
            yield from (f"{package}.{path.stem}" for path in sorted(source_of(package).parent.glob("*.py")))


def _used(module: ast.Module, name: str) -> list[ast.stmt]:
    """The statements of a module that define `name`, and all that these use of the module."""
    defined: dict[str, ast.stmt] = {}
    typed_only = [inner for statement in module.body if isinstance(statement, ast.If) for inner in statement.body]
    for statement in (*typed_only, *module.body):
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            defined[statement.name] = statement
        elif isinstance(statement, ast.Import | ast.ImportFrom):
            defined |= {(alias.asname or alias.name).partition(".")[0]: statement for alias in statement.names}
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            defined |= {node.id: statement for node in ast.walk(statement) if _is_stored(node)}
    used, waiting = {}, [name]
    while waiting:
        statement = defined.get(waiting.pop())
        if statement is not None and statement not in used:
            used[statement] = None
            waiting += [node.id for node in ast.walk(statement) if isinstance(node, ast.Name)]
            waiting += _quoted_in_annotations(statement)
    return sorted(used, key=lambda statement: statement.lineno)


def _quoted_in_annotations(statement: ast.stmt) -> Iterator[str]:
    """Names in quoted annotations. Other texts, such as the name of a section of the configuration, mean no code."""
    for node in ast.walk(statement):
        for annotation in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            for inner in ast.walk(annotation) if annotation is not None else ():
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                    yield from re.findall(r"[A-Za-z_]\w*", inner.value)


def _is_stored(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)


@cache
def _exists(name: str) -> bool:
    return all(part.isidentifier() for part in name.split(".")) and source_of(name).is_file()
