"""Batches of trials that resume where they were stopped: a trial that the same code has finished is not done again."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jointgap.core.errors import InputError
from jointgap.tables import write_text


def folder_digest(folder: Path) -> str:
    """Digest of the names and bytes of the files in a folder; one that is not there counts as empty."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*")):
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)} ".encode() + content)
    return digest.hexdigest()[:16]


def listed_trials(path: Path, campaigns: Path) -> list[str]:
    """The identifiers in a batch's list."""
    trials = _read_text(path, "--listed", "blind-conceal").split()
    for trial in trials:
        if not (campaigns / trial).is_dir():
            raise InputError(
                f"{path}: lists the campaign {trial}, which is not in {campaigns}; correct --campaigns, or run "
                "`jointgap blind-conceal` again"
            )
    return trials


def read_trial_records(path: Path, option: str, command: str) -> list[dict[str, Any]]:
    """The trials in a JSON file, each with its ``id``."""
    text = _read_text(path, option, command)
    try:
        records = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); run `jointgap {command}` again, which writes it") from error
    if not isinstance(records, list) or not all(isinstance(record, dict) and "id" in record for record in records):
        raise InputError(f"{path}: is no list of trials; give {option} a file that `jointgap {command}` wrote")
    return records


def _read_text(path: Path, option: str, command: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); correct {option}, or run `jointgap {command}`, which writes it"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not text in UTF-8 (byte {error.start}); give {option} a file that `jointgap {command}` wrote"
        ) from error


def cached_record(
    path: Path, code: str, make: Callable[[], dict[str, Any]], required: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The record that `make` gives: read from `path` where the same code has written it, else made and written there.

    What ended in an ``error`` is made again: another machine, or the same with more memory, may do better.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        expected = {"code": code, **(required or {})}
        if "error" not in record and all(record.get(key) == value for key, value in expected.items()):
            return record
    except (OSError, ValueError):
        pass  # not done yet, or not whole
    record = {**make(), "code": code}
    write_text(path, json.dumps(record, indent=1, allow_nan=False) + "\n")
    return record
