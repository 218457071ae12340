"""`python -m jointgap` is `jointgap`."""

from jointgap.app.cli import main

main()
