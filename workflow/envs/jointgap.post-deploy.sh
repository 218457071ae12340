#!/usr/bin/env bash
# Runs inside the new conda environment, in the folder where snakemake was started.
set -euo pipefail
if ! grep -qs '^name = "jointgap"' pyproject.toml; then
    echo "start snakemake in a clone of jointgap the first time: its package is installed from there" >&2
    exit 1
fi
python -m pip install --no-deps --no-build-isolation .
