# Checks before the first job: configuration files, lock of the folder, SLURM and the MLflow store. Dry runs and processes of single
# jobs check the configuration files only.

import fcntl
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

from snakemake.exceptions import WorkflowError

from jointgap.config import read_yaml
from jointgap.config.yaml_files import plain_speeds
from jointgap.core.errors import InputError


def check_config_files(*more):
    """Read the files strictly: Snakemake reads 0600 as 384 and ignores duplicate keys. A module of another workflow has no
    configuration files.
    """
    if workflow.modifier.skip_configfile:
        return
    try:
        for path in [*workflow.configfiles, *filter(os.path.exists, more)]:
            read_yaml(path)
    except InputError as error:
        raise WorkflowError(str(error)) from None


def refuse(error):
    """End with one line; Snakemake would show a traceback for an error in an input function."""
    sys.exit(f"jointgap: error: {error}")


def hold_run_lock():
    """Hold the lock of the folder until this process ends; scripts/run-workflow passes it on as open file 9."""
    global run_lock  # keeps the file open
    Path(".cache").mkdir(exist_ok=True)
    run_lock = open(".cache/run.lock", "a")
    try:
        if os.path.sameopenfile(9, run_lock.fileno()):
            return
    except OSError:  # no such open file
        pass
    try:
        fcntl.flock(run_lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        refuse(
            "another run works in this folder; try again when it has ended, or use `make`, which waits"
        )


def scontrol(*question):
    """Answer of SLURM's controller on one line, and whether it succeeded."""
    try:
        done = subprocess.run(["scontrol", *question], capture_output=True, text=True, timeout=20)
    except subprocess.TimeoutExpired:
        return "nothing within 20 s", False
    return " ".join((done.stdout + done.stderr).split()), done.returncode == 0


def check_slurm():
    """Check that SLURM is available and accepts all jobs. A job with more cores than any node, or an array that exceeds a limit
    of Snakemake, would wait for ever.
    """
    commands = ("sbatch", "squeue", "sacct", "scancel", "scontrol", "srun")
    if missing := [name for name in commands if shutil.which(name) is None]:
        refuse(
            f"the profile submits to SLURM, and this machine has no {', '.join(missing)}; run on a login node, or install "
            "SLURM's commands (Debian: apt-get install slurm-client)"
        )
    said, answered = scontrol("ping")
    if not answered:
        refuse(
            f"the profile submits to SLURM, and its controller does not answer (scontrol ping: {said}); look at SLURM_CONF, "
            "or ask who runs the cluster"
        )
    for path in map(str, (Path.cwd(), workflow.main_snakefile, *workflow.overwrite_configfiles)):
        if any(sign in path for sign in '"$`\\'):
            refuse(
                f'{path} has a sign in its path that the shell of a job would change: one of " $ ` and the backslash; rename it'
            )
    jobs = list(workflow.dag.needrun_jobs())
    cores = max(
        map(int, re.findall(r"CPUTot=(\d+)", scontrol("show", "nodes", "--oneliner")[0])),
        default=None,
    )
    for job in jobs:
        if cores is not None and job.threads > cores:
            refuse(
                f"{job.rule.name} asks for {job.threads} cores, and no node has more than {cores}; add --max-threads {cores} "
                f"(make: ARGS='--max-threads {cores}')"
            )
    most = re.search(r"MaxArraySize\s*=\s*(\d+)", scontrol("show", "config")[0])
    limits = {
        "jobs": workflow.resource_settings.nodes,
        "max-jobs-per-timespan": workflow.scheduling_settings.max_jobs_per_timespan.max_jobs,
        "MaxArraySize of SLURM": int(most[1]) - 1 if most else float("inf"),
    }
    in_arrays = re.split(r"\s*,\s*", workflow.executor_settings.array_jobs or "")
    for name, number in Counter(
        job.rule.name for job in jobs if job.rule.name in in_arrays
    ).items():
        for what, limit in limits.items():
            if number > limit:
                refuse(
                    f"{number} jobs of {name} are submitted in arrays, all at once, and {what} allows {limit}; leave that as "
                    "workflow/profiles/slurm/config.yaml has it, give each job more (sweep.designs_per_job), or take the rule "
                    "out of slurm-array-jobs there"
                )


def check_mlflow_store():
    """Check that the store in MLFLOW_TRACKING_URI is available, if a job publishes to it."""
    requests = [job.rule.resources.get("mlflow_store") for job in workflow.dag.needrun_jobs()]
    if not os.environ.get("MLFLOW_TRACKING_URI") or not any(
        resource and resource.value for resource in requests
    ):
        return
    from jointgap.core.publish import check_store, store_address

    try:
        check_store(store_address(Path("results")))
    except InputError as error:
        refuse(error)


# Snakemake runs only one onstart.
onstart:
    hold_run_lock()
    for path in map(str, workflow.overwrite_configfiles or ()):
        for remark in plain_speeds(path):
            print(f"jointgap: {remark}", file=sys.stderr)
    if workflow.executor_plugin.name == "slurm":
        check_slurm()
    check_mlflow_store()
