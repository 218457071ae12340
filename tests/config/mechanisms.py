"""The paper's mechanism with changes, for the tests of the configuration."""

from pathlib import Path

from jointgap.config import Mechanism, load_mechanism, read_yaml, validate
from jointgap.config.yaml_files import merge

ROOT = Path(__file__).resolve().parents[2]
PAPER = ROOT / "config/mechanisms/erkaya2009.yaml"
PIVOT = {
    "journal": "frame",
    "journal_radius": "10 mm",
    "bearing_radius": "10.5 mm",
    "contact": "steel",
}


def paper() -> Mechanism:
    return load_mechanism(PAPER)


def mechanism(*effects: dict, **over) -> Mechanism:
    """The paper's mechanism with `effects`, and with sections laid over its own."""
    return validate(
        Mechanism, merge(read_yaml(PAPER), over | {"effects": list(effects)}), "mine.yaml"
    )


def with_contact(**keys) -> Mechanism:
    return mechanism(contacts={"steel": keys})


def effect(name: str, site: str | None = None, **parameters) -> dict:
    """An entry of the list of effects."""
    return {"name": name, "parameters": parameters} | ({"site": site} if site else {})
