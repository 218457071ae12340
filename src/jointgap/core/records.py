"""Numbers by name for compiled code, which receives them as one pointer."""

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np


class Record(np.void):
    """Numbers by name for compiled code."""

    __slots__ = ("data",)

    def __getattr__(self, name: str):
        if name == "data":  # copies have numpy's attribute only
            return np.void.data.__get__(self)
        try:
            return self[name]
        except ValueError as error:
            raise AttributeError(
                f"there is no {name}; there are {', '.join(self.dtype.names)}"
            ) from error

    def __setattr__(self, name: str, value) -> None:
        if name == "data":
            super().__setattr__(name, value)
        else:
            self[name] = value


def record(group: NamedTuple) -> Record:
    """A group of parameters as a record of floats and integers."""
    return with_data(np.array([tuple(group)], kind_of(type(group))))


def numbers(name: str, defaults: Mapping[str, float | int]) -> type:
    """A group of parameters with their defaults."""
    group = NamedTuple(name, [(key, type(value)) for key, value in defaults.items()])
    group.__new__.__defaults__ = tuple(defaults.values())
    return group


def with_data(one: np.ndarray) -> Record:
    found = one[0]
    found.data = memoryview(one.view(np.uint8))
    return found


@cache
def kind_of(group: type) -> np.dtype:
    """Type of the records of a group of parameters."""
    kinds = {float: "f8", int: "i8", bool: "i8"}
    return np.dtype((Record, [(name, kinds[kind]) for name, kind in group.__annotations__.items()]))
