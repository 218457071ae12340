"""Benchmarks (`make bench`). Every module has `measure() -> list[dict]`."""
