"""A Parquet file that tells whether it is still as it was written: the digest of its bytes stands in its own footer.

Parquet's checksums of pages leave the footer out, and a byte of that can move a column or cut rows off.
"""

import hashlib
import os
import re
from pathlib import Path
from typing import BinaryIO

_KEY, _LENGTH = "jointgap_sha256", 64
_CHUNK = 1 << 20  # [bytes]
_TAIL = 8  # [bytes], the length of the footer and Parquet's mark, which end a file
_ENTRY = re.compile(_KEY.encode() + rb"..(.{%d})" % _LENGTH, re.DOTALL)
"""The entry in the footer: between key and value stand the value's type and length, a byte each."""

BLANK = {_KEY: "0" * _LENGTH}
"""Metadata that a file needs before `write_digest` can fill it in; a value of the same length for any content."""


def write_digest(path: Path | str) -> None:
    """Fill the digest of all other bytes in, in a file that holds `BLANK`."""
    with open(path, "r+b") as file:
        place, _ = _entry(file)
        digest = _digest(file, place)
        file.seek(place)
        file.write(digest)


def is_as_written(path: Path | str) -> bool | None:
    """Whether all bytes of a file are those that were written; None where no digest is found in it."""
    with open(path, "rb") as file:
        entry = _entry(file)
        return _digest(file, entry[0]) == entry[1] if entry else None


def _entry(file: BinaryIO) -> tuple[int, bytes] | None:
    """Place of the digest in the file, and the digest."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _TAIL, 0))
    start = max(size - _TAIL - int.from_bytes(file.read(4), "little"), 0)
    file.seek(start)
    found = list(_ENTRY.finditer(file.read()))
    return (start + found[-1].start(1), found[-1][1]) if found else None


def _digest(file: BinaryIO, place: int) -> bytes:
    """Digest of the file but for the digest at `place`."""
    digest = hashlib.sha256()
    file.seek(0)
    while file.tell() < place:
        digest.update(file.read(min(_CHUNK, place - file.tell())))
    file.seek(place + _LENGTH)
    digest.update(file.read())
    return digest.hexdigest().encode()
