"""`python -m jointgap` is `jointgap`."""

from jointgap.cli import main

main()
