"""Random configurations and campaign files, read as users' files are: a clear error, or what is written."""

import base64
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drills import written as reading
from drills.documents import ROOT, Pairs, Tree, Writer, damaged, put, schema, shipped, written
from drills.harness import Answers, Case, Complaint, Sweep, crashed, unclear
from drills.plain_quantities import read

_ROUNDING = 1e-9  # relative, of products of factors

_CLEAR = "ends in a clear error or a result"
_MEANT = "what is accepted means what is written"
_AGAIN = "read, dumped and read again it is the same"

_EMPTY = ("", "~", "null", "Null", "NULL")
_TRUE, _FALSE = {"true", "yes", "on", "y"}, {"false", "no", "off", "n"}


def prepare() -> None:
    """Load what reads configurations, and pint's units."""
    from jointgap.config.load import load_campaign, parse_options, resolve  # noqa: F401
    from jointgap.quantities import to_si

    to_si("7 mm", "m")
    schema("campaign"), schema("config")


def make(random: np.random.Generator) -> Case:
    """A campaign file or a configuration, as bytes; three in four are damaged."""
    kind = "campaign" if random.random() < 0.4 else "config"
    writer = Writer(random, schema(kind))
    content = (_campaign if kind == "campaign" else _config)(writer)
    known = schema(kind)
    spare = ("run", "scenarios", "campaigns", "fit_parts")  # names of what is elsewhere
    options = [known | {"properties": {key: entry for key, entry in known["properties"].items() if key not in spare}}]
    content = writer.vary(content, options, more=writer.one_of([0.0, 0.02, 0.1]))
    text = damaged(writer, content) if writer.chance(0.75) else written(content).encode()
    return {"kind": kind, "content": base64.b64encode(text).decode()}


def _mechanism(writer: Writer) -> Tree:
    """A whole mechanism, with some effects, or one laid over a file."""
    if writer.chance(0.1):
        return Pairs([("base", "mechanism.yaml"), ("slider", Pairs([("mass", "0.5 kg")]))])
    content = shipped("config/mechanisms/erkaya2009.yaml")
    listed = schema("config")["$defs"]["Mechanism"]["properties"]["effects"]["items"]
    if writer.chance(0.5):
        count = int(writer.random.integers(1, 3))
        put(content, "effects", [writer.fresh(reading.branches(listed, writer.root)) for _ in range(count)])
    return content


def _campaign(writer: Writer) -> Pairs:
    content = shipped("config/campaigns/demonstration.yaml")
    put(content, "mechanism", _mechanism(writer) if writer.chance(0.9) else "mechanism.yaml")
    nuisances = schema("campaign")["properties"]["nuisance"]["propertyNames"]["enum"]
    if writer.chance(0.5):
        chosen = [str(name) for name in writer.random.permutation(nuisances)[:2]]
        put(
            content,
            "nuisance",
            Pairs((name, writer.one_of(["5 %", "1 percent", "0.5%", "[0.1, 0.9]"])) for name in chosen),
        )
    return content


def _config(writer: Writer) -> Pairs:
    content = Pairs([("mechanism", _mechanism(writer) if writer.chance(0.9) else "mechanism.yaml")])
    over = Pairs([("description", "one sentence")])
    for section in ("simulate", "surrogate", "optimise", "figures", "ensemble"):
        if writer.chance(0.4):
            own = writer.vary(Pairs(), reading.branches(schema("config")["properties"][section], writer.root), more=0.2)
            put(over if writer.chance(0.5) else content, section, own)
    content.append(("scenarios", Pairs([("one", over)])))
    return content


# ----------------------------------------------------------------------------------------------------------------------
# judging


def judge(case: Case, folder: Path) -> Answers:
    """Read the file as a user's is read, and hold what comes of it against an independent reading."""
    from jointgap.core.errors import InputError

    path = folder / f"{case['kind']}.yaml"
    path.write_bytes(base64.b64decode(case["content"]))
    (folder / "mechanism.yaml").write_bytes((ROOT / "config/mechanisms/erkaya2009.yaml").read_bytes())
    try:
        models = load(case["kind"], path)
    except InputError as error:
        return {_CLEAR: unclear(str(error), path.name)}
    except Exception as error:
        return {_CLEAR: crashed(error)}
    return {_CLEAR: None, _MEANT: other_meaning(case["kind"], path, models), _AGAIN: changed(models)}


def load(kind: str, path: Path) -> dict[str, Any]:
    """What the package makes of the file: scenarios by name, or the campaign under ``''``."""
    from jointgap.config import read_yaml, resolve
    from jointgap.config.load import load_campaign

    return {"": load_campaign(path)} if kind == "campaign" else resolve(read_yaml(path), (path.parent,), str(path))


def changed(models: dict[str, Any]) -> Complaint | None:
    """Whether a model is another one after its dump was read."""
    for model in models.values():
        try:
            again = type(model).model_validate_json(model.model_dump_json())
        except ValueError as error:
            return Complaint("its own dump is refused", str(error)[:500])
        if again != model:
            ours, theirs = model.model_dump(mode="json"), again.model_dump(mode="json")
            where = [key for key in ours if ours[key] != theirs[key]]
            return Complaint("its own dump is read as something else", f"{where}")
    return None


def other_meaning(kind: str, path: Path, models: dict[str, Any]) -> Complaint | None:
    """The first value of the file that the models hold otherwise than it is written."""
    text = path.read_bytes().decode("utf-8-sig")
    documents = list(yaml.compose_all(text))
    if len(documents) > 1:
        return Complaint("a second document is passed over", text[-200:])
    root = documents[0]
    if double := next(reading.duplicates(root), None):
        return Complaint("a key that is written twice is accepted", ".".join(map(str, double)))
    for name, model in models.items():
        held = model.model_dump(mode="json")
        for value in _written(kind, name, root):
            if complaint := _misread(value, held, model, root):
                return Complaint(
                    complaint.kind, f"{'.'.join(map(str, value.path))} = {value.text[:200]!r}: {complaint.details}"
                )
    return None


def _written(kind: str, name: str, root: yaml.Node) -> Iterator[reading.Written]:
    """Values that hold for the campaign, or for the scenario `name`: its own, and those beside that it leaves alone."""
    known = schema(kind)
    if kind == "campaign":
        yield from reading.values(root, [known], known)
        return
    own_node = reading.child(reading.child(root, "scenarios"), name)
    own = [] if own_node is None else list(reading.values(own_node, [known], known))
    laid = {_up_to_list(value.path) for value in own}
    whole = any(path[:1] == ("mechanism",) for path in laid)
    for value in reading.values(root, [known], known):
        place = _up_to_list(value.path)
        if value.path[:1] in (("scenarios",), ("run",), ("campaigns",), ("fit_parts",)):
            continue
        if whole and place[:1] == ("mechanism",):
            continue
        if not any(other[: len(place)] == place or place[: len(other)] == other for other in laid):
            yield value
    yield from own


def _up_to_list(path: reading.Path) -> reading.Path:
    """A list is replaced whole by what is laid over it."""
    return path[: next((n for n, step in enumerate(path) if isinstance(step, int)), len(path))]


_ABSENT = object()


def _held(held: Any, path: reading.Path) -> Any:
    for step in path:
        try:
            held = held[step]
        except (KeyError, IndexError, TypeError):
            return _ABSENT
    return held


def _misread(value: reading.Written, held: Any, model: Any, root: yaml.Node) -> Complaint | None:
    path, last = value.path, value.path[-1]
    if path[:1] == ("folder",) or last in ("base", "file", "contact", "<<") or "<<" in path or path == ("mechanism",):
        return None  # paths, names of what is elsewhere, and what is laid under
    if path[:1] == ("nuisance",):
        return _misread_nuisance(value, model)
    ours = _held(held, path)
    if value.text in _EMPTY and not value.quoted:
        return None  # left out
    if path[:1] == ("ensemble",) and not isinstance(path[-1], int) and last in ("from", "to", "number"):
        return None
    if ours is _ABSENT:
        return Complaint("a value is passed over", "nothing of it is held")
    if isinstance(ours, dict | list):
        return (
            None
            if isinstance(ours, dict) and last in ("start", "drive")
            else Complaint("text became a mapping", repr(ours)[:200])
        )
    unit = _unit(value, root)
    if unit is not None:
        return _misread_quantity(value.text, unit, ours)
    return _misread_plain(value, ours)


def _unit(value: reading.Written, root: yaml.Node) -> str | None:
    """Unit in which a quantity is held; None of what is none."""
    for option in value.schemas:
        if "unit" in option:
            return "" if option["unit"] == "1" else option["unit"]
    path = value.path
    if path[:1] == ("channels",) and len(path) > 2 and path[2] in ("noise", "resolution"):
        own = reading.child(reading.child(reading.child(root, "channels"), path[1]), "unit")
        return own.value if own is not None else None
    return None


def _misread_quantity(text: str, unit: str, ours: Any) -> Complaint | None:
    try:
        theirs = read(text, unit)
    except (KeyError, ValueError):  # the unit of a column is not in the table
        return None
    if not theirs.known:
        return None
    if theirs.value is None:
        return Complaint("what is no number with a unit of that kind is accepted", f"held as {ours!r} {unit}")
    if not isinstance(ours, int | float) or not math.isclose(ours, theirs.value, rel_tol=_ROUNDING, abs_tol=5e-324):
        return Complaint(
            "a quantity is held with another size", f"held as {ours!r} {unit}, written is {theirs.value!r}"
        )
    return None


def _misread_nuisance(value: reading.Written, model: Any) -> Complaint | None:
    from jointgap.config.nuisance_bounds import NUISANCES

    if len(value.path) < 2 or value.path[1] not in NUISANCES:
        return Complaint("a value is passed over", "no such nuisance") if len(value.path) > 1 else None
    unit, ours = NUISANCES[value.path[1]], model.nuisance.get(value.path[1])
    if len(value.path) == 3:
        return _misread_quantity(value.text, unit, ours[value.path[2]])
    share = read(value.text, "")
    if isinstance(ours, float):
        return _misread_quantity(value.text, "", ours)
    if share.value is not None and unit:
        return Complaint("a number became an amount", f"held as {ours!r}")
    return (
        _misread_quantity(value.text, unit, (ours[1] - ours[0]) / 2.0)
        if isinstance(ours, tuple) and not math.isclose(sum(ours), 0.0)
        else None
    )


def _misread_plain(value: reading.Written, ours: Any) -> Complaint | None:
    """Whether text, a whole number or a yes is held as it is written."""
    text = value.text
    if isinstance(ours, bool):
        word = text.lower()
        right = word in (_TRUE if ours else _FALSE) or text in ("1" if ours else "0")
    elif isinstance(ours, int | float):
        theirs = read(text.replace("_", ""), "").value
        right = theirs is not None and math.isclose(ours, theirs, rel_tol=_ROUNDING)
    elif isinstance(ours, str):
        right = ours == text
    else:
        right = ours is None
    return None if right else Complaint("a value is held otherwise than written", f"held as {ours!r}")


SWEEP = Sweep("configurations", 10_000, make, judge, prepare)
DRILL = SWEEP.drill()
