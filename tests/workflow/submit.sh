#!/usr/bin/env bash
# A cluster of one machine: starts the job script in the background and prints an id for it, as sbatch would.
setsid bash "$1" >/dev/null 2>&1 </dev/null &
echo "$!"
