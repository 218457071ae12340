"""Digest of the code behind a function, such as a stage: if it changes, the stage runs again.

It covers the function with everything it uses from its module, the modules of its own package of
`jointgap` that it imports, and every other package that these import. Imports count directly and
indirectly; data files count as code. Modules are named without ``jointgap.``: ``networks.train``.
"""

import ast
import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from jointgap.core.schema import TABLES, Table

_ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(r"^ *from jointgap\.([\w.]+) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)
_COMPUTED_NAME = re.compile(r"jointgap\.(\w+)\.\{")


@cache
def code_digest(module: str, function: str, *tables: Table) -> str:
    """Twelve hexadecimal digits of the code that a `function` runs, and of the `tables` that it
    reads and writes or that occur in the code. Nothing is imported."""
    source = source_of(module, function)
    modules, packages = dependencies(module, function)
    paths = [_path(module) for module in modules]
    parts = [_content(path) for path in sorted(paths)]
    parts += [_package_content(package) for package in sorted(packages)]
    names = _tables_in(source).union(*(part[1] for part in parts))
    schemas = {repr(table) for table in (*tables, *(TABLES[name] for name in names))}
    digest = hashlib.sha256(source.encode())
    for text in (*(part[0] for part in parts), *sorted(schemas)):
        digest.update(text.encode())
    return digest.hexdigest()[:12]


@cache
def dependencies(module: str, function: str) -> tuple[frozenset[str], frozenset[str]]:
    """Modules of the function's package, and other packages, that it imports."""
    function_package = module.partition(".")[0]
    modules: set[str] = set()
    packages: set[str] = set()
    waiting = set(_imported_modules(source_of(module, function)))
    while waiting:
        name = waiting.pop()
        package = name.partition(".")[0]
        if package != function_package:
            packages |= packages_behind(package)
        elif name != package and name not in modules:
            modules.add(name)
            waiting |= _imported_modules(_path(name).read_text("utf-8"))
    return frozenset(modules), frozenset(packages)


@cache
def packages_behind(package: str) -> frozenset[str]:
    """A package of `jointgap` and all packages that it imports, directly or indirectly."""
    packages: set[str] = set()
    waiting = {package}
    while waiting:
        packages |= waiting
        waiting = {name for package in waiting for name in _imported_packages(package)} - packages
    return frozenset(packages)


@cache
def _imported_packages(package: str) -> frozenset[str]:
    sources = [path.read_text("utf-8") for path in _files(package) if path.suffix == ".py"]
    modules = [module for text in sources for module, _, _ in _IMPORT.findall(text)]
    return frozenset(module.partition(".")[0] for module in modules)


@cache
def _imported_modules(text: str) -> frozenset[str]:
    """Packages and modules that a text imports; all modules of a package if a name is computed."""
    modules = set()
    for module, block, line in _IMPORT.findall(text):
        names = re.findall(r"\w+", block or line)
        modules |= {module, *(f"{module}.{name}" for name in names)}
    for package in _COMPUTED_NAME.findall(text):
        modules |= {f"{package}.{path.stem}" for path in (_ROOT / package).glob("[!_]*.py")}
    return frozenset(name for name in modules if "." not in name or _path(name).is_file())


@cache
def _path(module: str) -> Path:
    return _ROOT.joinpath(*module.split(".")).with_suffix(".py")


def _files(package: str) -> list[Path]:
    paths = sorted((_ROOT / package).rglob("*"))
    return [path for path in paths if path.is_file() and "__pycache__" not in path.parts]


@cache
def _content(*paths: Path) -> tuple[str, frozenset[str]]:
    """Digest of files with their names, and names of the tables that occur in Python files."""
    digest = hashlib.sha256()
    tables: set[str] = set()
    for path in paths:
        content = path.read_bytes()
        digest.update(path.name.encode() + content)
        if path.suffix == ".py":
            tables |= _tables_in(content.decode())
    return digest.hexdigest(), frozenset(tables)


@cache
def _package_content(package: str) -> tuple[str, frozenset[str]]:
    return _content(*_files(package))


def _tables_in(code: str) -> frozenset[str]:
    names = (name.lower() for name in re.findall("[A-Z_]{3,}", code))
    return frozenset(name for name in names if name in TABLES)


@cache
def source_of(module: str, function: str) -> str:
    """Source of a function with everything that it uses from its module."""
    definitions = _definitions(module)
    used: dict[ast.stmt, None] = {}
    names = [function]
    while names:
        statement = definitions.get(names.pop())
        if statement is not None and statement not in used:
            used[statement] = None
            names += [node.id for node in ast.walk(statement) if isinstance(node, ast.Name)]
            if isinstance(statement, ast.FunctionDef):  # types in quotes: "CampaignState"
                names += re.findall(r"\b[A-Z]\w+", ast.unparse(statement.args))
    return "\n".join(map(ast.unparse, sorted(used, key=lambda statement: statement.lineno)))


@cache
def _definitions(module: str) -> dict[str, ast.stmt]:
    """Statements at the top level of a module by the names that they define."""
    definitions: dict[str, ast.stmt] = {}
    for statement in ast.parse(_path(module).read_text("utf-8")).body:
        for inner in statement.body if isinstance(statement, ast.If) else [statement]:
            definitions |= dict.fromkeys(_defined_names(inner), inner)
    return definitions


def _defined_names(statement: ast.stmt) -> Iterable[str]:
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return [(alias.asname or alias.name).partition(".")[0] for alias in statement.names]
    nodes = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
    return [node.id for node in nodes if isinstance(node.ctx, ast.Store)]
