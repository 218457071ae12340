# Jobs that go to SLURM (workflow/profiles/slurm) need one that answers, and arrays that it takes: looked at before the first
# job is submitted.

import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

SLURM_COMMANDS = ("sbatch", "squeue", "sacct", "scancel", "scontrol", "srun")
SLURM_PATIENCE = 20  # seconds; a controller that is busy answers late


def check_slurm():
    """End here where this run submits to SLURM and could not."""
    if workflow.executor_plugin.name != "slurm":
        return
    missing = [name for name in SLURM_COMMANDS if shutil.which(name) is None]
    if missing:
        refuse_slurm(
            f"the profile submits to SLURM, and this machine has no {', '.join(missing)}; run on a login node, or install "
            "SLURM's commands (Debian: apt-get install slurm-client)"
        )
    said, answered = asked_of_slurm("ping")
    if not answered:
        refuse_slurm(
            "the profile submits to SLURM, and its controller does not answer "
            f"(scontrol ping: {said}); look at SLURM_CONF, or ask who runs the cluster"
        )
    for path in map(str, (Path.cwd(), workflow.main_snakefile, *workflow.overwrite_configfiles)):
        if any(sign in path for sign in '"$`\\'):
            refuse_slurm(
                f'{path} has a sign in its path that the shell of a job would change (one of " $ ` and the backslash); rename it'
            )
    check_cores()
    check_arrays()


def asked_of_slurm(*question):
    """What `scontrol` says, in one line, and whether it had an answer."""
    try:
        done = subprocess.run(
            ["scontrol", *question], capture_output=True, text=True, timeout=SLURM_PATIENCE, check=False
        )
    except subprocess.TimeoutExpired as error:
        so_far = (error.stderr or b"").decode(errors="replace")
        return " ".join([*so_far.split(), f"nothing more within {SLURM_PATIENCE} s"]), False
    return " ".join((done.stdout + done.stderr).split()), done.returncode == 0


def check_cores():
    """Whether there is a node for each job: SLURM may let one wait for ever that asks for more cores than any node has."""
    cores = [
        int(one) for one in re.findall(r"CPUTot=(\d+)", asked_of_slurm("show", "nodes", "--oneliner")[0])
    ]
    asked = max(workflow.dag.needrun_jobs(), key=lambda job: job.threads, default=None)
    if cores and asked is not None and asked.threads > max(cores):
        refuse_slurm(
            f"{asked.rule.name} asks for {asked.threads} cores, and no node has more than {max(cores)}; add --max-threads "
            f"{max(cores)} (make: ARGS='--max-threads {max(cores)}')"
        )


def check_arrays():
    """Whether all jobs that are to go in arrays can. The plug-in waits for ever for those that Snakemake holds back, and numbers
    the tasks of all arrays with like jobs through.
    """
    in_arrays = {name.strip() for name in (workflow.executor_settings.array_jobs or "").split(",")}
    jobs = Counter(job.rule.name for job in workflow.dag.needrun_jobs())
    most = re.search(r"MaxArraySize\s*=\s*(\d+)", asked_of_slurm("show", "config")[0])
    limits = {
        "jobs": workflow.resource_settings.nodes,
        "max-jobs-per-timespan": workflow.scheduling_settings.max_jobs_per_timespan.max_jobs,
    }
    for name in sorted(in_arrays & jobs.keys()):
        for option, limit in limits.items():
            if jobs[name] > limit:
                refuse_slurm(
                    f"{jobs[name]} jobs of {name} are submitted in arrays, all at once, and {option} allows {limit}; leave it "
                    "as workflow/profiles/slurm/config.yaml has it, or take the rule out of slurm-array-jobs there"
                )
        if most and jobs[name] >= int(most[1]):
            refuse_slurm(
                f"{jobs[name]} jobs of {name} are more than the {int(most[1]) - 1} that arrays may have here (MaxArraySize of "
                "SLURM); give each job more (sweep.designs_per_job), or take the rule out of "
                "slurm-array-jobs in workflow/profiles/slurm/config.yaml"
            )


def refuse_slurm(error):
    sys.exit(f"jointgap: error: {error}")
