"""Every public name has its place in the reference and a docstring; types in signatures lead
there."""

import inspect
from importlib import import_module
from pkgutil import resolve_name

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

PUBLIC = ("jointgap", "jointgap.config", "jointgap.motion", "jointgap.motion.kinematics")
"""Packages whose `__all__` is a promise. Others are for the stages."""

log = logging.getLogger(__name__)


def _check(app: Sphinx, environment) -> None:
    """Warn of every public name that is not in the reference, or that no docstring explains."""
    documented = environment.domains["py"].objects
    places = _places(app)
    data = {place.rsplit(".", 1)[1] for place, item in documented.items() if item.objtype == "data"}
    for package in PUBLIC:
        module = import_module(package)
        for name in getattr(module, "__all__", ()):
            item = getattr(module, name)
            described = isinstance(item, type) or inspect.isroutine(
                item
            )  # else a constant, documented where it stands
            if not (_origin(item) in places if described else name in data):
                log.warning(
                    "public name without a place in the reference: %s.%s",
                    package,
                    name,
                    type="public_names",
                )
            if described and not item.__doc__:
                log.warning(
                    "public name without a docstring: %s.%s", package, name, type="public_names"
                )


def _lead(app: Sphinx, environment, node, shown):
    """Resolve a name by what it means: `jointgap.motion.simulation.Trajectory` is
    `jointgap.motion.Trajectory`."""
    if node.get("refdomain") != "py" or not node["reftarget"].startswith("jointgap."):
        return None
    try:
        wanted = resolve_name(node["reftarget"])
    except (ImportError, AttributeError, ValueError):
        return None
    place = _places(app).get(_origin(wanted))
    if place is None:
        return None
    uri = app.builder.get_relative_uri(node["refdoc"], place.docname)
    return nodes.reference("", "", shown, internal=True, refuri=f"{uri}#{place.node_id}")


def _places(app: Sphinx) -> dict:
    """Where classes and functions are documented, by module and name of their definition."""
    if not hasattr(app, "places_of_names"):
        app.places_of_names = {
            _origin(resolve_name(place)): item
            for place, item in app.env.domains["py"].objects.items()
            if item.objtype in ("class", "function", "exception")
        }
    return app.places_of_names


def _origin(item) -> tuple[str, str]:
    return getattr(item, "__module__", ""), getattr(item, "__qualname__", "")


def setup(app: Sphinx) -> dict:
    """Check names when all pages are read; resolve types when they are written."""
    app.connect("env-check-consistency", _check)
    app.connect("missing-reference", _lead)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
